"""What the flight controller tells ground stations of its state: each message sent, and read back.

Values are in the frames inside (Earth ENU, body FLU, SI); `t` is simulation time, s. NaN is
what is not known. Every field is saturated to its type, so no number raises. What is read back
may hold NaN: a flight may have diverged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.rotations import euler, matrix, normalised
from fcu.mavlink.definitions import (
    GCS,
    NO_AUTOPILOT,
    Frame,
    ModeFlag,
    Packed,
    SystemStatus,
)
from fcu.mavlink.definitions import message as _message
from fcu.mavlink.frames import attitude, body, earth, heading
from fcu.mavlink.framing import Source
from fcu.mavlink.geodesy import Geodetic, Origin
from fcu.mavlink.px4_modes import custom_mode, main_and_sub

Fields = dict[str, Any]
_UNKNOWN_16 = 2**16 - 1
_CELLS, _MORE_CELLS = 10, 4  # of BATTERY_STATUS: lengths of voltages and voltages_ext
_NAN_21 = (math.nan, *[0.0] * 20)  # a covariance that is not known


def _ms(t: float) -> float:
    return 1e3 * t


def _us(t: float) -> float:
    return 1e6 * t


def _known(x: float, unknown: float) -> float:
    return unknown if math.isnan(x) else x


# --- identity and status


def heartbeat(
    kind: int, autopilot: int, armed: bool, main_mode: int, sub_mode: int, status: int,
    flags: int = 0,
) -> Packed:  # fmt: skip
    """HEARTBEAT of a vehicle of a MAV_TYPE; `flags`: MAV_MODE_FLAGs beside custom mode and armed."""
    return _message(
        "HEARTBEAT", type=kind, autopilot=autopilot,
        base_mode=ModeFlag.CUSTOM | flags | (ModeFlag.ARMED if armed else 0),
        custom_mode=custom_mode(main_mode, sub_mode), system_status=status, mavlink_version=3,
    )  # fmt: skip


def sys_status(
    present: int, enabled: int, health: int, load: float, voltage: float, current: float,
    remaining: float, errors: int,
) -> Packed:  # fmt: skip
    """SYS_STATUS; load and remaining are fractions, V, A; errors: messages dropped."""
    return _message(
        "SYS_STATUS", onboard_control_sensors_present=present,
        onboard_control_sensors_enabled=enabled, onboard_control_sensors_health=health,
        load=min(1000.0 * load, 1000.0), voltage_battery=_known(1e3 * voltage, _UNKNOWN_16),
        current_battery=_known(1e2 * current, -1), battery_remaining=_known(1e2 * remaining, -1),
        errors_comm=errors,
    )  # fmt: skip


def battery_status(
    voltage: float, current: float, drawn_Ah: float, remaining: float, left_s: float, cells: int,
    charge_state: int, energy_J: float,
) -> Packed:  # fmt: skip
    """BATTERY_STATUS of a lithium polymer battery: V, A, A h, fraction, s, J.

    voltage : of the whole pack, shared equally by its `cells`.
    """
    first, more = _cell_voltages(voltage, cells)
    return _message(
        "BATTERY_STATUS", battery_function=1, type=1, temperature=2**15 - 1, voltages=first,
        voltages_ext=more,
        current_battery=_known(1e2 * current, -1), current_consumed=_known(1e3 * drawn_Ah, -1),
        energy_consumed=_known(1e-2 * energy_J, -1), battery_remaining=_known(1e2 * remaining, -1),
        time_remaining=_known(left_s, 0), charge_state=charge_state,
    )  # fmt: skip


def _cell_voltages(voltage: float, cells: int) -> tuple[list[float], list[float]]:
    """The fields `voltages` and `voltages_ext`, mV: cells 1 to 10, and 11 to 14.

    A pack of more cells than the fields have room for is told as the standard says: its whole
    voltage fills the first fields, none above 65.534 V.
    """
    total = 1e3 * voltage
    if math.isnan(total):
        each = []
    elif cells <= _CELLS + _MORE_CELLS:
        each = [total / max(cells, 1)] * cells
    else:
        most = _UNKNOWN_16 - 1
        each = [min(total - n * most, most) for n in range(_CELLS) if total > n * most]
    first, more = each[:_CELLS], each[_CELLS:]
    return (
        first + [_UNKNOWN_16] * (_CELLS - len(first)),
        more + [0.0] * (_MORE_CELLS - len(more)),  # 0: no such cell
    )


def extended_state(landed_state: int) -> Packed:
    """EXTENDED_SYS_STATE."""
    return _message("EXTENDED_SYS_STATE", landed_state=landed_state)


def system_time(unix_s: float, t: float) -> Packed:
    """SYSTEM_TIME: the time of day (s since 1970) and simulation time."""
    return _message("SYSTEM_TIME", time_unix_usec=_us(unix_s), time_boot_ms=_ms(t))


# --- attitude and position


def attitude_euler(t: float, q_EB: Quat, w_B: Vec3) -> Packed:
    """ATTITUDE: roll, pitch and yaw of the body in NED."""
    angles = euler(matrix(Quat(*map(float, q_EB))))
    w = body(w_B)
    return _message(
        "ATTITUDE", time_boot_ms=_ms(t), roll=angles.x, pitch=-angles.y, yaw=heading(angles.z),
        rollspeed=w.x, pitchspeed=w.y, yawspeed=w.z,
    )  # fmt: skip


def attitude_quaternion(t: float, q_EB: Quat, w_B: Vec3) -> Packed:
    """ATTITUDE_QUATERNION."""
    q, w = attitude(q_EB), body(w_B)
    return _message(
        "ATTITUDE_QUATERNION", time_boot_ms=_ms(t), q1=q.w, q2=q.x, q3=q.y, q4=q.z,
        rollspeed=w.x, pitchspeed=w.y, yawspeed=w.z,
    )  # fmt: skip


def orbit_status(t: float, radius: float, frame: int, place: Geodetic) -> Packed:
    """ORBIT_EXECUTION_STATUS. `radius`: m, above 0 clockwise."""
    return _message(
        "ORBIT_EXECUTION_STATUS", time_usec=1e6 * t, radius=radius, frame=frame,
        x=1e7 * place.lat_deg, y=1e7 * place.lon_deg, z=place.alt_m,
    )  # fmt: skip


def local_position(t: float, r_E: Vec3, v_E: Vec3) -> Packed:
    """LOCAL_POSITION_NED."""
    r, v = earth(r_E), earth(v_E)
    return _message(
        "LOCAL_POSITION_NED", time_boot_ms=_ms(t), x=r.x, y=r.y, z=r.z, vx=v.x, vy=v.y, vz=v.z
    )


def global_position(t: float, place: Geodetic, above_home: float, v_E: Vec3, psi: float) -> Packed:
    """GLOBAL_POSITION_INT; heading of the nose."""
    v = earth(v_E)
    return _message(
        "GLOBAL_POSITION_INT", time_boot_ms=_ms(t), lat=1e7 * place.lat_deg,
        lon=1e7 * place.lon_deg, alt=1e3 * place.alt_m, relative_alt=1e3 * above_home,
        vx=1e2 * v.x, vy=1e2 * v.y, vz=1e2 * v.z, hdg=_centidegrees(heading(psi)),
    )  # fmt: skip


def _centidegrees(angle: float) -> float:
    return round(math.degrees(angle) * 100.0) % 36000 if math.isfinite(angle) else _UNKNOWN_16


def gps_raw(t: float, place: Geodetic, v_E: Vec3) -> Packed:
    """GPS_RAW_INT: the state is known, so a fix of the best kind with many satellites."""
    speed = math.hypot(v_E.x, v_E.y)
    course = _centidegrees(0.5 * math.pi - math.atan2(v_E.y, v_E.x)) if speed > 0.1 else _UNKNOWN_16
    return _message(
        "GPS_RAW_INT", time_usec=_us(t), fix_type=6, lat=1e7 * place.lat_deg,
        lon=1e7 * place.lon_deg, alt=1e3 * place.alt_m, eph=50, epv=50, vel=1e2 * speed,
        cog=course, satellites_visible=20, alt_ellipsoid=1e3 * place.alt_m, h_acc=10, v_acc=10,
        vel_acc=10,
    )  # fmt: skip


def gps_global_origin(origin: Geodetic) -> Packed:
    """GPS_GLOBAL_ORIGIN: the place of local (0, 0, 0)."""
    return _message(
        "GPS_GLOBAL_ORIGIN", latitude=1e7 * origin.lat_deg, longitude=1e7 * origin.lon_deg,
        altitude=1e3 * origin.alt_m,
    )  # fmt: skip


def home_position(place: Geodetic, r_E: Vec3) -> Packed:
    """HOME_POSITION."""
    r = earth(r_E)
    return _message(
        "HOME_POSITION", latitude=1e7 * place.lat_deg, longitude=1e7 * place.lon_deg,
        altitude=1e3 * place.alt_m, x=r.x, y=r.y, z=r.z, q=(math.nan,) * 4,
    )  # fmt: skip


def altitude(t: float, amsl: float, local: float, above_home: float) -> Packed:
    """ALTITUDE, m."""
    return _message(
        "ALTITUDE", time_usec=_us(t), altitude_monotonic=amsl, altitude_amsl=amsl,
        altitude_local=local, altitude_relative=above_home, altitude_terrain=math.nan,
        bottom_clearance=math.nan,
    )  # fmt: skip


def vfr_hud(
    airspeed: float, groundspeed: float, psi: float, throttle: float, alt: float, climb: float
) -> Packed:
    """VFR_HUD; throttle is a fraction."""
    degrees = round(math.degrees(heading(psi))) % 360 if math.isfinite(psi) else 0
    return _message(
        "VFR_HUD", airspeed=airspeed, groundspeed=groundspeed, heading=degrees,
        throttle=1e2 * throttle, alt=alt, climb=climb,
    )  # fmt: skip


def odometry(t: float, r_E: Vec3, q_EB: Quat, v_B: Vec3, w_B: Vec3) -> Packed:
    """ODOMETRY in LOCAL_NED and BODY_FRD; `v_B`: velocity in body axes."""
    r, q, v, w = earth(r_E), attitude(q_EB), body(v_B), body(w_B)
    return _message(
        "ODOMETRY", time_usec=_us(t), frame_id=Frame.LOCAL_NED, child_frame_id=Frame.BODY_FRD,
        x=r.x, y=r.y, z=r.z, q=(q.w, q.x, q.y, q.z), vx=v.x, vy=v.y, vz=v.z,
        rollspeed=w.x, pitchspeed=w.y, yawspeed=w.z, pose_covariance=_NAN_21,
        velocity_covariance=_NAN_21,
    )  # fmt: skip


def nav_controller_output(angles_c: Vec3, way: Vec3, psi: float) -> Packed:
    """NAV_CONTROLLER_OUTPUT: angles commanded (rad), the way to the setpoint (m, E), yaw (rad)."""
    far = math.hypot(way.x, way.y)
    towards = math.atan2(way.y, way.x) if far > 0.1 else psi
    nose, target = (
        round(math.degrees(heading(a))) % 360 if math.isfinite(a) else 0 for a in (psi, towards)
    )
    return _message(
        "NAV_CONTROLLER_OUTPUT", nav_roll=math.degrees(angles_c.x),
        nav_pitch=-math.degrees(angles_c.y), nav_bearing=_half(nose), target_bearing=_half(target),
        wp_dist=far, alt_error=way.z,
    )  # fmt: skip


def _half(degrees: int) -> int:
    """From -180 to 180."""
    return degrees - 360 if degrees > 180 else degrees


def rc_channels(t: float) -> Packed:
    """RC_CHANNELS of a vehicle without a receiver: no channels."""
    unused = {f"chan{n}_raw": _UNKNOWN_16 for n in range(1, 19)}
    return _message("RC_CHANNELS", time_boot_ms=_ms(t), chancount=0, rssi=255, **unused)


def flight_information(
    t: float, number: int, armed_us: int, took_off_us: int, landed_us: int
) -> Packed:
    """FLIGHT_INFORMATION: simulation times of the flight of this number, as PX4 has times since boot. 0: not yet."""
    return _message(
        "FLIGHT_INFORMATION", time_boot_ms=_ms(t), arming_time_utc=armed_us,
        takeoff_time_utc=took_off_us, flight_uuid=number, landing_time=landed_us // 1000,
    )  # fmt: skip


# --- rotors and air


def rotors(t: float, Omega: Rotors, spin: Rotors) -> Packed:
    """ACTUATOR_OUTPUT_STATUS: rotor speeds (rad/s), signed by the rotors' spin."""
    speeds = [o * s for o, s in zip(Omega, spin, strict=True)]
    active = sum(1 << i for i, s in enumerate(spin) if s != 0.0)
    return _message("ACTUATOR_OUTPUT_STATUS", time_usec=_us(t), active=active, actuator=speeds)


def servo_output_raw(t: float, u: Sequence[float]) -> Packed:
    """SERVO_OUTPUT_RAW: commands of 0 to 1, eight at most, as 1000 to 2000 us; 0 of what is absent."""
    raw = {f"servo{i}_raw": 1000.0 + 1000.0 * each for i, each in enumerate(u, start=1)}
    return _message("SERVO_OUTPUT_RAW", time_usec=_us(t), **raw)


def esc_status(
    t: float, first: int, rpm: Sequence[float], volts: Sequence[float], amperes: Sequence[float]
) -> Packed:
    """ESC_STATUS of four, from `first` on; rpm signed by direction."""
    return _message(
        "ESC_STATUS", index=first, time_usec=_us(t), rpm=rpm, voltage=volts, current=amperes
    )


def esc_info(t: float, first: int, counter: int, count: int, online: int) -> Packed:
    """ESC_INFO of four, from `first` on: no failures, temperature unknown."""
    return _message(
        "ESC_INFO", index=first, time_usec=_us(t), counter=counter, count=count, info=online,
        temperature=[2**15 - 1] * 4,
    )  # fmt: skip


def _sigma(variance: float) -> float:
    return math.sqrt(variance) if variance >= 0.0 else math.nan


def wind_cov(t: float, v_air_E: Vec3, var_horiz: float, var_vert: float, alt: float) -> Packed:
    """WIND_COV: velocity of the air; variability as one sigma; how accurate is not known.

    Takes variances, m^2/s^2; one that is negative is not known.
    """
    v = earth(v_air_E)
    return _message(
        "WIND_COV", time_usec=_us(t), wind_x=v.x, wind_y=v.y, wind_z=v.z,
        var_horiz=_sigma(var_horiz), var_vert=_sigma(var_vert), wind_alt=alt,
        horiz_accuracy=0.0, vert_accuracy=0.0,
    )  # fmt: skip


def wind(v_air_E: Vec3) -> Packed:
    """WIND: where it comes from (deg from North), how fast, and downwards (m/s)."""
    come_from = math.degrees(math.atan2(-v_air_E.x, -v_air_E.y))
    # not `% 360`, which makes 360 of what is less than 0 by a rounding
    direction = come_from + 360.0 if come_from < -1e-4 else abs(come_from)
    return _message(
        "WIND", direction=direction, speed=math.hypot(v_air_E.x, v_air_E.y), speed_z=-v_air_E.z
    )


def estimator_status(t: float, flags: int) -> Packed:
    """ESTIMATOR_STATUS: the state is reported, not estimated; its accuracy is not known."""
    return _message(
        "ESTIMATOR_STATUS", time_usec=_us(t), flags=flags, pos_horiz_accuracy=math.nan,
        pos_vert_accuracy=math.nan,
    )  # fmt: skip


def named_value_float(t: float, name: str, value: float) -> Packed:
    """NAMED_VALUE_FLOAT; a name has at most ten characters."""
    return _message("NAMED_VALUE_FLOAT", time_boot_ms=_ms(t), name=name.encode(), value=value)


def debug_float_array(t: float, name: str, number: int, data: Sequence[float]) -> Packed:
    """DEBUG_FLOAT_ARRAY of at most 58 values."""
    return _message(
        "DEBUG_FLOAT_ARRAY", time_usec=_us(t), name=name.encode(), array_id=number, data=data
    )


# --- read back


class Heartbeat(NamedTuple):
    """A system is alive. The modes mean something when it is an autopilot of PX4's kind."""

    source: Source
    type: int
    autopilot: int
    armed: bool
    main_mode: int
    sub_mode: int
    status: int


def _heartbeat(f: Fields, source: Source) -> Heartbeat:
    armed = f["base_mode"] & ModeFlag.ARMED != 0
    main, sub = main_and_sub(f["custom_mode"])
    return Heartbeat(source, f["type"], f["autopilot"], armed, main, sub, f["system_status"])


def ground_heartbeat() -> Packed:
    """HEARTBEAT of a ground station."""
    return _message(
        "HEARTBEAT",
        type=GCS,
        autopilot=NO_AUTOPILOT,
        system_status=SystemStatus.ACTIVE,
        mavlink_version=3,
    )


class LocalPosition(NamedTuple):
    """LOCAL_POSITION_NED."""

    source: Source
    time_boot_ms: int
    r_E: Vec3  # m
    v_E: Vec3  # m/s


def _local_position(f: Fields, source: Source) -> LocalPosition:
    r, v = Vec3(f["x"], f["y"], f["z"]), Vec3(f["vx"], f["vy"], f["vz"])
    return LocalPosition(source, f["time_boot_ms"], earth(r), earth(v))


class OriginTold(NamedTuple):
    """GPS_GLOBAL_ORIGIN."""

    source: Source
    origin: Origin

    def is_close(self, origin: Origin) -> bool:
        """Tell whether it is a place that was sent, as whole numbers carry it."""
        across = (self.origin.lat_deg - origin.lat_deg, self.origin.lon_deg - origin.lon_deg)
        near = max(map(abs, across)) < 2e-7
        return near and abs(self.origin.alt_m - origin.alt_m) < 2e-3


def _origin_told(f: Fields, source: Source) -> OriginTold:
    place = f["latitude"] * 1e-7, f["longitude"] * 1e-7, f["altitude"] * 1e-3
    return OriginTold(source, Origin(*place))


class GlobalPosition(NamedTuple):
    """GLOBAL_POSITION_INT."""

    source: Source
    time_boot_ms: int
    place: Geodetic
    above_home: float  # m
    v_E: Vec3  # m/s
    psi: float  # of the nose, rad; NaN: not known


def _global_position(f: Fields, source: Source) -> GlobalPosition:
    place = Geodetic(f["lat"] * 1e-7, f["lon"] * 1e-7, f["alt"] * 1e-3)
    v = Vec3(f["vx"] * 1e-2, f["vy"] * 1e-2, f["vz"] * 1e-2)
    psi = math.nan if f["hdg"] == _UNKNOWN_16 else heading(math.radians(f["hdg"] * 1e-2))
    above_home = f["relative_alt"] * 1e-3
    return GlobalPosition(source, f["time_boot_ms"], place, above_home, earth(v), psi)


class HomePosition(NamedTuple):
    """HOME_POSITION."""

    source: Source
    place: Geodetic
    r_E: Vec3  # m


def _home_position(f: Fields, source: Source) -> HomePosition:
    place = Geodetic(f["latitude"] * 1e-7, f["longitude"] * 1e-7, f["altitude"] * 1e-3)
    return HomePosition(source, place, earth(Vec3(f["x"], f["y"], f["z"])))


class Attitude(NamedTuple):
    """ATTITUDE_QUATERNION."""

    source: Source
    time_boot_ms: int
    q_EB: Quat
    w_B: Vec3  # rad/s


def _attitude(f: Fields, source: Source) -> Attitude:
    q_EB = normalised(attitude(Quat(f["q1"], f["q2"], f["q3"], f["q4"])))
    w_B = body(Vec3(f["rollspeed"], f["pitchspeed"], f["yawspeed"]))
    return Attitude(source, f["time_boot_ms"], q_EB, w_B)


class ExtendedState(NamedTuple):
    """EXTENDED_SYS_STATE."""

    source: Source
    landed_state: int


def _extended_state(f: Fields, source: Source) -> ExtendedState:
    return ExtendedState(source, f["landed_state"])


Message = (
    Heartbeat
    | LocalPosition
    | OriginTold
    | GlobalPosition
    | HomePosition
    | Attitude
    | ExtendedState
)
READERS: dict[str, Callable[[Fields, Source], Message]] = {
    "HEARTBEAT": _heartbeat,
    "LOCAL_POSITION_NED": _local_position,
    "GLOBAL_POSITION_INT": _global_position,
    "HOME_POSITION": _home_position,
    "GPS_GLOBAL_ORIGIN": _origin_told,
    "ATTITUDE_QUATERNION": _attitude,
    "EXTENDED_SYS_STATE": _extended_state,
}
