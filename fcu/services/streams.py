"""Every message that the vehicle sends of itself: how often by default, and how it is built.

Default rates are PX4's, of its `normal` link for ground stations and its `onboard` link for
scripts, so that what a client displays or waits for arrives as it is used to.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from fcu.kernel.rotations import from_euler, matrix, rotate_back
from fcu.mavlink import answers, flown
from fcu.mavlink import telemetry as tm
from fcu.mavlink.enums import IGNORE_ATTITUDE, MainMode, Sensor
from fcu.mavlink.framing import Packed
from fcu.mavlink.geodesy import Geodetic, to_geodetic
from fcu.mavlink.ground_messages import SetpointMessage
from fcu.services.view import View
from fcu.vehicle import modes
from fcu.vehicle.modes import MODES, Mode

CELLS = 6
AVAILABLE_MODES, HOME_POSITION, GPS_GLOBAL_ORIGIN = 435, 242, 49

# MAV_MODE_FLAG
_AUTO, _GUIDED, _STABILIZE, _HIL = 4, 8, 16, 32
# ESTIMATOR_STATUS: attitude, velocity across and up; position relative and absolute, height;
# a jump of the position
_ESTIMATED, _PLACED, _GLITCH = 1 | 2 | 4, 8 | 16 | 32, 1024
_SENSORS = (
    Sensor.GYRO | Sensor.ACCEL | Sensor.MAG | Sensor.PRESSURE | Sensor.GPS | Sensor.MOTORS
    | Sensor.AHRS | Sensor.BATTERY | Sensor.PREARM
)  # fmt: skip
_AUTO_MODE = 4  # MAV_MODE_PROPERTY

Build = Callable[[View], Sequence[Packed]]


class Stream(NamedTuple):
    """One message."""

    id: int
    station_hz: float  # 0: on request
    script_hz: float
    build: Build


def heartbeat(view_of: Mode, armed: bool, autopilot: int, status: int) -> Packed:
    """HEARTBEAT: needs no state, so it is sent before there is one."""
    row = MODES[view_of]
    flags = _STABILIZE | _HIL | (_GUIDED if row.guided else 0)
    flags |= _AUTO if row.main in (MainMode.AUTO, MainMode.OFFBOARD) else 0
    return tm.heartbeat(autopilot, armed, int(row.main), int(row.sub), status, flags)


def _sys_status(v: View) -> Sequence[Packed]:
    present = _SENSORS if v.battery is not None else _SENSORS & ~Sensor.BATTERY
    health = present | Sensor.GEOFENCE  # there is none, so nothing is wrong with it
    if not v.vehicle.armed and v.vehicle.unfit:
        health &= ~Sensor.PREARM
    if v.counters.position_off:
        health &= ~Sensor.GPS
    volts, amperes, left = math.nan, math.nan, math.nan
    if v.battery is not None:
        volts, amperes, left = v.battery.voltage, v.battery.current, v.battery.remaining
        if left < v.params["BAT_CRIT_THR"]:
            health &= ~Sensor.BATTERY
    load = v.counters.load
    return [tm.sys_status(present, present, health, load, volts, amperes, left, v.counters.errors)]


def _battery(v: View) -> Sequence[Packed]:
    b = v.battery
    if b is None:
        return []
    left_s = math.nan
    if b.current > 1.0:
        left_s = 3.6 * b.remaining * v.params["BAT1_CAPACITY"] / b.current
    low, critical, emergency = (v.params[f"BAT_{n}_THR"] for n in ("LOW", "CRIT", "EMERGEN"))
    state = 1 + (b.remaining < low) + (b.remaining < critical) + (b.remaining < emergency)
    return [
        tm.battery_status(
            b.voltage, b.current, b.drawn_Ah, b.remaining, left_s, CELLS, state, b.energy_J
        )
    ]


def _attitude(v: View) -> Sequence[Packed]:
    return [tm.attitude_euler(v.t, v.measured.q_EB, v.measured.w_B)]


def _attitude_quaternion(v: View) -> Sequence[Packed]:
    return [tm.attitude_quaternion(v.t, v.measured.q_EB, v.measured.w_B)]


def _local_position(v: View) -> Sequence[Packed]:
    return [tm.local_position(v.t, v.measured.r_E, v.measured.v_E)]


def _global_position(v: View) -> Sequence[Packed]:
    above = v.measured.r_E.z - v.home.z
    return [tm.global_position(v.t, v.place, above, v.measured.v_E, v.angles.z)]


def _gps_raw(v: View) -> Sequence[Packed]:
    return [tm.gps_raw(v.t, v.place, v.measured.v_E)]


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


def _altitude(v: View) -> Sequence[Packed]:
    z = v.measured.r_E.z
    return [tm.altitude(v.t, v.place.alt_m, z, z - v.home.z)]


def _extended_state(v: View) -> Sequence[Packed]:
    return [tm.extended_state(v.vehicle.landed_state)]


def _home(v: View) -> Sequence[Packed]:
    if v.vehicle.home is None:
        return []
    place = to_geodetic(v.identity.origin, v.home)
    return [tm.home_position(place, v.home)]


def _origin(v: View) -> Sequence[Packed]:
    return [tm.gps_global_origin(Geodetic(*v.identity.origin))]


def _system_time(v: View) -> Sequence[Packed]:
    return [tm.system_time(time.time(), v.t)]


def _estimator(v: View) -> Sequence[Packed]:
    placed = _GLITCH if v.counters.position_off else _PLACED
    return [tm.estimator_status(v.t, _ESTIMATED | placed)]


def _odometry(v: View) -> Sequence[Packed]:
    m = v.measured
    v_B = rotate_back(matrix(m.q_EB), m.v_E)
    return [tm.odometry(v.t, m.r_E, m.q_EB, v_B, m.w_B)]


def _wind_cov(v: View) -> Sequence[Packed]:
    w = v.wind
    return [tm.wind_cov(v.t, w.v_air_E, w.variance, math.nan, v.place.alt_m)]


def _wind(v: View) -> Sequence[Packed]:
    return [tm.wind(v.wind.v_air_E)]


def _esc_status(v: View) -> Sequence[Packed]:
    Omega, spin = v.measured.Omega, v.law.spin
    rpm = [o * s * 30.0 / math.pi for o, s in zip(Omega, spin, strict=True)]
    volts, total = (v.battery.voltage, v.battery.current) if v.battery else (math.nan, math.nan)
    power = [o * o * o for o in Omega]  # a rotor's share of the current
    whole = sum(power) or 1.0
    amperes = [total * p / whole for p in power]
    return [tm.esc_status(v.t, i, rpm[i : i + 4], [volts] * 4, amperes[i : i + 4]) for i in (0, 4)]


def _esc_info(v: View) -> Sequence[Packed]:
    counter = int(v.t) & 0xFFFF
    return [tm.esc_info(v.t, i, counter, 8, 0xFF) for i in (0, 4)]


def _rotors(v: View) -> Sequence[Packed]:
    return [tm.rotors(v.t, v.measured.Omega, v.law.spin)]


def _servos(v: View) -> Sequence[Packed]:
    return [tm.servo_output_raw(v.t, v.commanded)]


def _attitude_target(v: View) -> Sequence[Packed]:
    if not v.flying:
        return []
    i = v.internals
    q = from_euler(i.angles_c.x, i.angles_c.y, i.angles_c.z)
    setpoint = v.vehicle.setpoint
    unused = IGNORE_ATTITUDE if setpoint is not None and setpoint.level > 1.0 else 0
    return [flown.attitude_target(v.t, unused, q, i.w_c, i.T_c / v.law.T_max)]


def _flown(v: View, as_global: bool) -> Sequence[Packed]:
    """The setpoint in force: a script's in its own frame and mask, else what is laid down."""
    setpoint = v.vehicle.setpoint
    if not v.flying or setpoint is None or setpoint.level > 0.0:
        return []
    message = v.vehicle.script.message
    if v.vehicle.mode is Mode.OFFBOARD and isinstance(message, SetpointMessage):
        is_global = message.geodetic is not None
        return [flown.echo(v.t, message)] if is_global == as_global else []
    now = v.vehicle.flown(round(v.t * 1e6))
    if not as_global:
        return [flown.position_target_flown(v.t, now)]
    return [flown.position_target_global_flown(v.t, to_geodetic(v.identity.origin, now.r_c), now)]


def _estimates(v: View) -> Sequence[Packed]:
    """What the law believes, by the names of the paper."""
    if not v.flying:
        return []
    s, i = v.state.s_v_hat, v.internals
    norm = math.sqrt(i.v_til.x * i.v_til.x + i.v_til.y * i.v_til.y + i.v_til.z * i.v_til.z)
    saturated = max(i.thrust_saturated, i.tilt_saturated, i.rotor_saturated)
    values = {
        "m_hat": v.state.m_hat, "s_v_x": s.x, "s_v_y": s.y, "s_v_z": s.z, "v_til": norm,
        "saturated": saturated, "projected": i.projected,
        "governed": i.governed, "margin_n": i.margin, "margin_deg": math.degrees(i.margin_tilt),
        "margin_c": i.margin_condition,
    }  # fmt: skip
    return [tm.named_value_float(v.t, name, value) for name, value in values.items()]


def _estimates_array(v: View) -> Sequence[Packed]:
    """What the law believes, what saturates, and the margins (N, rad, N)."""
    if not v.flying:
        return []
    s, i = v.state, v.internals
    data = [
        s.m_hat, *s.s_v_hat, *s.J_hat, *s.s_w_hat, *i.v_til, *i.w_til,
        i.projected, i.thrust_saturated, i.tilt_saturated, i.rotor_saturated,
        i.governed, i.margin, i.margin_tilt, i.margin_condition,
    ]  # fmt: skip
    return [tm.debug_float_array(v.t, "mmrac", 0, data)]


def _current_mode(v: View) -> Sequence[Packed]:
    number = modes.custom_mode(v.vehicle.mode)
    return [answers.current_mode(MODES[v.vehicle.mode].standard, number, number)]


def _modes_monitor(v: View) -> Sequence[Packed]:
    return [answers.available_modes_monitor(0)]


def available_modes(which: int) -> Sequence[Packed]:
    """AVAILABLE_MODES of one mode, counted from 1, or of all (0)."""
    return [
        answers.available_modes(
            len(MODES), index, row.standard, modes.custom_mode(mode), _AUTO_MODE, mode.value
        )
        for index, (mode, row) in enumerate(MODES.items(), start=1)
        if which in (0, index)
    ]


# id, ground station, script (Hz)
STREAMS = {
    stream.id: stream
    for stream in (
        Stream(1, 1.0, 5.0, _sys_status),
        Stream(2, 1.0, 1.0, _system_time),
        Stream(24, 5.0, 5.0, _gps_raw),
        Stream(30, 15.0, 100.0, _attitude),
        Stream(31, 10.0, 50.0, _attitude_quaternion),
        Stream(32, 10.0, 30.0, _local_position),
        Stream(33, 5.0, 50.0, _global_position),
        Stream(36, 1.0, 10.0, _servos),
        Stream(GPS_GLOBAL_ORIGIN, 0.5, 0.5, _origin),
        Stream(74, 4.0, 10.0, _vfr_hud),
        Stream(83, 2.0, 10.0, _attitude_target),
        Stream(85, 1.5, 10.0, lambda v: _flown(v, False)),
        Stream(87, 1.5, 10.0, lambda v: _flown(v, True)),
        Stream(141, 1.0, 10.0, _altitude),
        Stream(147, 0.5, 0.5, _battery),
        Stream(168, 0.5, 1.0, _wind),
        Stream(230, 0.5, 1.0, _estimator),
        Stream(231, 0.5, 10.0, _wind_cov),
        Stream(HOME_POSITION, 0.5, 0.5, _home),
        Stream(245, 1.0, 5.0, _extended_state),
        Stream(251, 1.0, 10.0, _estimates),
        Stream(290, 1.0, 1.0, _esc_info),
        Stream(291, 1.0, 10.0, _esc_status),
        Stream(331, 0.0, 30.0, _odometry),
        Stream(350, 0.0, 0.0, _estimates_array),
        Stream(375, 0.0, 10.0, _rotors),
        Stream(436, 0.5, 0.5, _current_mode),
        Stream(437, 0.3, 0.3, _modes_monitor),
    )
}
