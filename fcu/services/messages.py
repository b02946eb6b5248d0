"""What the vehicle tells of itself: one row a message.

A row has the message's name, its default rates, what its fields are of the vehicle, and what is said of it in
docs/mavlink.md. Default rates are PX4's, of its `normal` link for ground stations and its `onboard` link for
scripts, so that what a client displays or waits for arrives as it is used to. Pacing, requests, groups and
the table in the docs follow from the rows. How values become bytes (units, frames) is in `fcu/mavlink`.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import NamedTuple

from fcu.kernel.rotations import from_euler, matrix, rotate_back
from fcu.mavlink import replies, setpoints
from fcu.mavlink import telemetry as tm
from fcu.mavlink.definitions import (
    AUTO_MODE,
    IGNORE_ATTITUDE,
    Autopilot,
    Capability,
    Estimated,
    Frame,
    ModeFlag,
    Packed,
    Sensor,
    definition,
)
from fcu.mavlink.geodesy import Geodetic, to_geodetic
from fcu.mavlink.plan_messages import fence_status
from fcu.mavlink.px4_modes import MainMode
from fcu.mavlink.setpoints import SetpointMessage
from fcu.services.status import MODES, custom_mode, landed_state, system_status
from fcu.services.view import View
from fcu.vehicle.fence import Breach
from fcu.vehicle.modes import BY_STICKS, Mode
from fcu.vehicle.returning import battery_left_s
from fcu.vehicle.state_machine import StateMachine

_ESTIMATED = Estimated.ATTITUDE | Estimated.VELOCITY_ACROSS | Estimated.VELOCITY_UP
_PLACED = (
    Estimated.POSITION_RELATIVE | Estimated.POSITION | Estimated.HEIGHT
    | Estimated.PREDICTS_RELATIVE | Estimated.PREDICTS_POSITION  # scripts wait for these
)  # fmt: skip
_SENSORS = (
    Sensor.GYRO | Sensor.ACCEL | Sensor.MAG | Sensor.PRESSURE | Sensor.GPS | Sensor.MOTORS
    | Sensor.AHRS | Sensor.BATTERY | Sensor.PREARM
)  # fmt: skip
CAPABILITIES = (
    Capability.MISSION_INT | Capability.COMMAND_INT | Capability.PARAM_ENCODE_BYTEWISE
    | Capability.SET_ATTITUDE_TARGET | Capability.SET_POSITION_TARGET_LOCAL_NED
    | Capability.SET_POSITION_TARGET_GLOBAL_INT | Capability.FLIGHT_TERMINATION
    | Capability.MAVLINK2 | Capability.MISSION_FENCE | Capability.MISSION_RALLY
)  # fmt: skip
# once: it searches files, and leaves cycles that nobody collects in flight
VERSION = version("m-mrac")
# The PX4 whose modes, commands and parameters these are: stations and scripts choose by it how they
# talk, and warn of an old one.
PX4_VERSION = "1.16.0"

Build = Callable[[View], Sequence[Packed]]


def heartbeat(vehicle: StateMachine, kind: int, autopilot: int) -> Packed:
    """HEARTBEAT: needs no state, so it is sent before there is one."""
    row = MODES[vehicle.mode]
    flags = ModeFlag.STABILIZE
    if row.guided:
        flags |= ModeFlag.GUIDED
    if row.main in (MainMode.AUTO, MainMode.OFFBOARD):
        flags |= ModeFlag.AUTO
    if vehicle.mode in BY_STICKS:
        flags |= ModeFlag.MANUAL_INPUT
    return tm.heartbeat(
        kind, autopilot, vehicle.armed, int(row.main), int(row.sub), system_status(vehicle), flags
    )


def _sys_status(v: View) -> Sequence[Packed]:
    present = _SENSORS if v.battery is not None else _SENSORS & ~Sensor.BATTERY
    health = present
    if not v.vehicle.armed and v.vehicle.unfit:
        health &= ~Sensor.PREARM
    if v.counters.position_off:
        health &= ~Sensor.GPS
    volts, amperes, left = math.nan, math.nan, math.nan
    if v.battery is not None:
        volts, amperes, left = v.battery.voltage, v.battery.current, v.battery.remaining
        if left < v.params["BAT_CRIT_THR"]:
            health &= ~Sensor.BATTERY
    fence = v.vehicle.fence
    if not fence.is_breached:  # also where none is set: a console takes unhealthy for a breach
        health |= Sensor.GEOFENCE
    enabled = present
    present |= Sensor.GEOFENCE
    if fence.is_set and v.params["GF_ACTION"] > 0.0:
        enabled |= Sensor.GEOFENCE
    load = v.counters.load
    return [tm.sys_status(present, enabled, health, load, volts, amperes, left, v.counters.errors)]


def _battery(v: View) -> Sequence[Packed]:
    b = v.battery
    if b is None:
        return []
    left_s = battery_left_s(b, v.params["BAT1_CAPACITY"])
    low, critical, emergency = (v.params[f"BAT_{n}_THR"] for n in ("LOW", "CRIT", "EMERGEN"))
    state = 1 + (b.remaining < low) + (b.remaining < critical) + (b.remaining < emergency)
    cells = int(v.params["BAT1_N_CELLS"])
    return [
        tm.battery_status(
            b.voltage,
            b.current,
            b.drawn_Ah,
            b.remaining,
            math.nan if left_s is None else left_s,
            cells,
            state,
            b.energy_J,
        )
    ]


def _vfr_hud(v: View) -> Sequence[Packed]:
    blows = v.wind.v_air_E
    air = v.measured.v_E - blows if blows.x == blows.x else v.measured.v_E
    climb = v.measured.v_E.z  # against air that neither rises nor sinks, as far as is known
    airspeed = math.sqrt(air.x * air.x + air.y * air.y + climb * climb)
    return [
        tm.vfr_hud(
            airspeed, v.ground_speed, v.angles.z, v.throttle, v.place.alt_m, v.measured.v_E.z
        )
    ]


def _home(v: View) -> Sequence[Packed]:
    if v.vehicle.home is None:
        return []
    place = to_geodetic(v.identity.origin, v.home)
    return [tm.home_position(place, v.home)]


def _estimator(v: View) -> Sequence[Packed]:
    placed = Estimated.POSITION_JUMPS if v.counters.position_off else _PLACED
    return [tm.estimator_status(v.t, _ESTIMATED | placed)]


def _odometry(v: View) -> Sequence[Packed]:
    m = v.measured
    v_B = rotate_back(matrix(m.q_EB), m.v_E)
    return [tm.odometry(v.t, m.r_E, m.q_EB, v_B, m.w_B)]


def _esc_status(v: View) -> Sequence[Packed]:
    Omega, spin, n = v.measured.Omega, v.law.rotors.spin, v.law.rotors.n
    rpm = [o * s * 30.0 / math.pi for o, s in zip(Omega, spin, strict=True)]
    volts, total = (v.battery.voltage, v.battery.current) if v.battery else (math.nan, math.nan)
    # a rotor's share of the current
    power = [c * o * o * o for c, o in zip(v.law.rotors.c_T, Omega, strict=True)]
    whole = sum(power) or 1.0
    amperes = [total * p / whole for p in power]
    each = [volts] * n + [0.0] * (len(rpm) - n)
    return [
        tm.esc_status(v.t, i, rpm[i : i + 4], each[i : i + 4], amperes[i : i + 4])
        for i in range(0, n, 4)
    ]


def _esc_info(v: View) -> Sequence[Packed]:
    counter = int(v.t) & 0xFFFF
    n = v.law.rotors.n
    return [tm.esc_info(v.t, i, counter, n, 2**n - 1) for i in range(0, n, 4)]


def _attitude_target(v: View) -> Sequence[Packed]:
    if not v.flying:
        return []
    o = v.outputs
    q = from_euler(o.angles_c.x, o.angles_c.y, o.angles_c.z)
    setpoint = v.vehicle.setpoint
    unused = IGNORE_ATTITUDE if setpoint is not None and setpoint.level > 1.0 else 0
    return [setpoints.attitude_target(v.t, unused, q, o.w_c, v.vehicle.throttle.of(o.T_c))]


def _nav_controller(v: View) -> Sequence[Packed]:
    setpoint = v.vehicle.setpoint
    if not v.flying or setpoint is None or setpoint.level > 0.0:
        return []
    way = v.vehicle.led_to(round(v.t * 1e6)) - v.measured.r_E
    return [tm.nav_controller_output(v.outputs.angles_c, way, v.angles.z)]


def _fence_status(v: View) -> Sequence[Packed]:
    """The fence. None without one."""
    fence = v.vehicle.fence
    if not fence.is_set:
        return []
    border = fence.border if fence.is_breached else Breach.NONE
    since_ms = fence.since_us // 1000
    return [fence_status(fence.is_breached, fence.breaches, border, since_ms)]


def _flown(v: View, as_global: bool) -> Sequence[Packed]:
    """The setpoint in force: a script's in its own frame and mask, else what is laid down."""
    setpoint = v.vehicle.setpoint
    if not v.flying or setpoint is None or setpoint.level > 0.0:
        return []
    message = v.asked
    if v.vehicle.mode is Mode.OFFBOARD and isinstance(message, SetpointMessage):
        is_global = message.geodetic is not None
        return [setpoints.echo(v.t, message)] if is_global == as_global else []
    now = v.vehicle.flown(round(v.t * 1e6))
    target = setpoints.target_of(now)
    if not as_global:
        return [setpoints.position_target(v.t, Frame.LOCAL_NED, 0, target)]
    place = to_geodetic(v.identity.origin, now.r_c)
    return [setpoints.position_target_global(v.t, Frame.GLOBAL_INT, 0, place, target)]


def _estimates(v: View) -> Sequence[Packed]:
    """What the law believes, by the names of the paper."""
    if not (v.adapts and v.flying):
        return []
    estimates, off = v.state.estimates, v.internals.prediction.v_til
    s, margin = estimates.s_v_hat, v.guard.margin
    values = {
        "m_hat": estimates.m_hat, "s_v_x": s.x, "s_v_y": s.y, "s_v_z": s.z,
        "v_til": math.sqrt(off.x * off.x + off.y * off.y + off.z * off.z),
        "saturated": max(v.outputs.saturation), "projected": v.internals.flags.projected,
        "governed": v.guard.governed, "margin_n": margin.force,
        "margin_deg": math.degrees(margin.tilt), "margin_c": margin.condition,
    }  # fmt: skip
    return [tm.named_value_float(v.t, name, value) for name, value in values.items()]


def _estimates_array(v: View) -> Sequence[Packed]:
    """What the law believes, what saturates, and the margins (N, rad, N)."""
    if not (v.adapts and v.flying):
        return []
    s, off, cut = v.state.estimates, v.internals.prediction, v.outputs.saturation
    data = [
        s.m_hat, *s.s_v_hat, *s.J_hat, *s.s_w_hat, *off.v_til, *off.w_til,
        v.internals.flags.projected, cut.thrust, cut.tilt, max(cut.torque, cut.yaw),
        v.guard.governed, *v.guard.margin,
    ]  # fmt: skip
    return [tm.debug_float_array(v.t, "mmrac", 0, data)]


def _orbit(v: View) -> Sequence[Packed]:
    """The circle that is flown. None in another mode."""
    circle = v.vehicle.circle
    if v.vehicle.mode is not Mode.ORBIT or circle is None:
        return []
    radius = circle.radius if circle.clockwise else -circle.radius
    place = to_geodetic(v.identity.origin, circle.center)
    return [tm.orbit_status(v.t, radius, Frame.GLOBAL, place)]


def _altitude(v: View) -> Sequence[Packed]:
    z = v.measured.r_E.z
    return [tm.altitude(v.t, v.place.alt_m, z, z - v.home.z)]


def _wind_cov(v: View) -> Sequence[Packed]:
    if not v.adapts:
        return []
    return [tm.wind_cov(v.t, v.wind.v_air_E, v.wind.variance, math.nan, v.place.alt_m)]


def _current_mode(v: View) -> Sequence[Packed]:
    number = custom_mode(v.vehicle.mode)
    return [replies.current_mode(MODES[v.vehicle.mode].standard, number, number)]


class Stream(NamedTuple):
    """A message that is sent at a rate, or when it is asked for."""

    name: str
    station_hz: float  # by default on a link of ground stations; 0: on request
    script_hz: float  # by default on a link of scripts
    build: Build  # nothing: not known, or not so in this mode
    meaning: str  # what docs/mavlink.md says of it
    group: int = 0  # of REQUEST_DATA_STREAM, which old stations pace it by; 0: none


# name, ground station (Hz), script (Hz), of the vehicle, what it is
STREAMS = {
    definition(stream.name).id: stream
    for stream in (
        Stream("SYS_STATUS", 1.0, 5.0, _sys_status, "health, load, battery", group=2),
        Stream("SYSTEM_TIME", 1.0, 1.0, lambda v: [tm.system_time(time.time(), v.t)], "time of day, simulation time since boot"),
        Stream("GPS_RAW_INT", 5.0, 5.0, lambda v: [tm.gps_raw(v.t, v.place, v.measured.v_E)], "position on Earth, as a perfect GPS", group=2),
        Stream("ATTITUDE", 15.0, 100.0, lambda v: [tm.attitude_euler(v.t, v.measured.q_EB, v.measured.w_B)], "roll, pitch, yaw, body rates", group=10),
        Stream("ATTITUDE_QUATERNION", 10.0, 50.0, lambda v: [tm.attitude_quaternion(v.t, v.measured.q_EB, v.measured.w_B)], "the same as a quaternion", group=10),
        Stream("LOCAL_POSITION_NED", 10.0, 30.0, lambda v: [tm.local_position(v.t, v.measured.r_E, v.measured.v_E)], "position and velocity from the origin", group=6),
        Stream("GLOBAL_POSITION_INT", 5.0, 50.0, lambda v: [tm.global_position(v.t, v.place, v.measured.r_E.z - v.home.z, v.measured.v_E, v.angles.z)], "position on Earth, height above home, heading", group=6),
        Stream("SERVO_OUTPUT_RAW", 1.0, 10.0, lambda v: [tm.servo_output_raw(v.t, v.commanded[: v.law.rotors.n])], "rotor commands, 1000 to 2000 us"),
        Stream("GPS_GLOBAL_ORIGIN", 0.5, 0.5, lambda v: [tm.gps_global_origin(Geodetic(*v.identity.origin))], "position of local (0, 0, 0) on Earth"),
        Stream("VFR_HUD", 4.0, 10.0, _vfr_hud, "speeds, heading, throttle, climb", group=11),
        Stream("ATTITUDE_TARGET", 2.0, 10.0, _attitude_target, "attitude, body rates and thrust that the law commands"),
        Stream("POSITION_TARGET_LOCAL_NED", 1.5, 10.0, lambda v: _flown(v, False), "the setpoint in force; a script's in its own frame and mask"),
        Stream("POSITION_TARGET_GLOBAL_INT", 1.5, 10.0, lambda v: _flown(v, True), "the setpoint in force, on Earth"),
        Stream("ALTITUDE", 1.0, 10.0, _altitude, "heights above the sea, the origin and home"),
        Stream("NAV_CONTROLLER_OUTPUT", 1.0, 0.0, _nav_controller, "commanded angles, distance and bearing to the setpoint"),
        Stream("MISSION_CURRENT", 1.0, 1.0, lambda v: [v.plans.current()], "the current item of the plan"),
        Stream("FENCE_STATUS", 1.0, 1.0, _fence_status, "breaches of the fence; only with a fence"),
        Stream("RC_CHANNELS", 0.0, 0.0, lambda v: [tm.rc_channels(v.t)], "no channels: the vehicle has no receiver"),
        Stream("FLIGHT_INFORMATION", 0.0, 0.0, lambda v: [tm.flight_information(v.t, *v.vehicle.flight_times)], "times of arming, takeoff and landing"),
        Stream("BATTERY_STATUS", 0.5, 0.5, _battery, "voltages of the cells, current, charge, time left"),
        Stream("WIND", 0.5, 1.0, lambda v: [tm.wind(v.wind.v_air_E)] if v.adapts else [], "estimated wind, as ArduPilot tells it; M-MRAC only"),
        Stream("ESTIMATOR_STATUS", 0.5, 1.0, _estimator, "what of the state is known"),
        Stream("WIND_COV", 0.5, 10.0, _wind_cov, "estimated wind and its variability; M-MRAC only"),
        Stream("HOME_POSITION", 0.5, 0.5, _home, "home, once there is one"),
        Stream("EXTENDED_SYS_STATE", 1.0, 5.0, lambda v: [tm.extended_state(landed_state(v.vehicle))], "landed, in the air, taking off, landing", group=2),
        Stream("NAMED_VALUE_FLOAT", 1.0, 10.0, _estimates, "estimates and margins by name; M-MRAC only"),
        Stream("ESC_INFO", 1.0, 1.0, _esc_info, "which rotors there are"),
        Stream("ESC_STATUS", 1.0, 10.0, _esc_status, "speed, voltage and current of each rotor"),
        Stream("ODOMETRY", 0.0, 30.0, _odometry, "position, attitude, velocities along the body"),
        Stream("DEBUG_FLOAT_ARRAY", 0.0, 0.0, _estimates_array, "all estimates and margins in one message; M-MRAC only"),
        Stream("ACTUATOR_OUTPUT_STATUS", 0.0, 10.0, lambda v: [tm.rotors(v.t, v.measured.Omega, v.law.rotors.spin)], "rotor speeds, rad/s, signed by their spin"),
        Stream("ORBIT_EXECUTION_STATUS", 2.0, 2.0, _orbit, "the circle that is flown; in Orbit only"),
        Stream("CURRENT_MODE", 0.5, 0.5, _current_mode, "the mode, as AVAILABLE_MODES numbers it"),
        Stream("AVAILABLE_MODES_MONITOR", 0.3, 0.3, lambda v: [replies.available_modes_monitor(0)], "changes when the list of modes does, which is never"),
    )
}  # fmt: skip
GROUPS = {
    group: [number for number, stream in STREAMS.items() if stream.group == group]
    for group in sorted({stream.group for stream in STREAMS.values()} - {0})
}


# --- on request only


class Answer(NamedTuple):
    """A message that is sent when it is asked for, and never at a rate."""

    name: str
    # of the vehicle (None: the plant was not heard yet), and of the number that is asked for beside
    # the message's. Nothing: not known yet. None: there is no such.
    build: Callable[[View | None, int], Sequence[Packed] | None]
    meaning: str  # what docs/mavlink.md says of it


def software_version(version: str) -> int:
    """A version as AUTOPILOT_VERSION has it: major, minor, patch, and 255 for a release."""
    major, minor, patch = (int(part) for part in version.split(".")[:3])
    return major << 24 | minor << 16 | patch << 8 | 255


def _autopilot_version(v: View | None, _which: int) -> Sequence[Packed]:
    if v is None:
        return []
    git = hashlib.sha256(VERSION.encode()).digest()[:8]
    presented = PX4_VERSION if v.identity.autopilot == Autopilot.PX4 else VERSION
    return [
        replies.autopilot_version(
            CAPABILITIES, software_version(presented), software_version(VERSION), git,
            v.identity.system_id,
        )
    ]  # fmt: skip


def _heartbeat(v: View | None, _which: int) -> Sequence[Packed]:
    return (
        [] if v is None else [heartbeat(v.vehicle, int(v.params["MAV_TYPE"]), v.identity.autopilot)]
    )


def _available_modes(which: int) -> Sequence[Packed]:
    """AVAILABLE_MODES of one mode, counted from 1, or of all (0)."""
    return [
        replies.available_modes(
            len(MODES), index, row.standard, custom_mode(mode), AUTO_MODE, mode.value
        )
        for index, (mode, row) in enumerate(MODES.items(), start=1)
        if which in (0, index)
    ]


ANSWERS = {
    definition(answer.name).id: answer
    for answer in (
        Answer("HEARTBEAT", _heartbeat, "type, mode, status; also once a second, and when one of them changes"),
        Answer("AUTOPILOT_VERSION", _autopilot_version, "capabilities and versions"),
        Answer("PROTOCOL_VERSION", lambda _v, _which: [replies.protocol_version()], "MAVLink 2, and 1 is understood"),
        Answer("AVAILABLE_MODES", lambda _v, which: _available_modes(which) or None, "one mode, or all of them (0)"),
    )
}  # fmt: skip
