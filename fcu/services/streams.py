"""What the vehicle sends of itself: how often by default, how each message is built, and when.

Default rates are PX4's, of its `normal` link for ground stations and its `onboard` link for
scripts, so that what a client displays or waits for arrives as it is used to. Streams are paced
by the wall clock, as clients time them: a flight at a hundred times real time does not flood its
listeners, and one that is slow or held still does not lose them. What is due at one moment is
built once, from one View.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from fcu.guard.types import GuardInternals
from fcu.interface.messages import Battery, VehicleState
from fcu.interface.status_texts import Told, brief
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import field_type, from_buffer
from fcu.kernel.rotations import euler, from_euler, matrix, rotate_back
from fcu.kernel.rows import column
from fcu.laws.face import Outputs, SharedTick
from fcu.mavlink import replies, setpoints
from fcu.mavlink import telemetry as tm
from fcu.mavlink.definitions import (
    AUTO_MODE,
    IGNORE_ATTITUDE,
    Estimated,
    Frame,
    ModeFlag,
    Packed,
    Sensor,
    definition,
)
from fcu.mavlink.geodesy import Geodetic, Origin, to_geodetic
from fcu.mavlink.plan_messages import fence_status
from fcu.mavlink.px4_modes import MainMode
from fcu.mavlink.setpoints import AttitudeSetpointMessage, SetpointMessage
from fcu.parameters import Parameters
from fcu.process.tick import Internals, State
from fcu.services.ground_port import GroundPort, Link
from fcu.services.plan_protocol import PlanProtocol
from fcu.services.status import MODES, custom_mode, landed_state, system_status
from fcu.services.wind import Wind
from fcu.vehicle.fence import Breach
from fcu.vehicle.modes import BY_STICKS, Mode
from fcu.vehicle.returning import battery_left_s
from fcu.vehicle.state_machine import StateMachine

Row = np.ndarray[Any, np.dtype[np.float64]]


AVAILABLE_MODES, CURRENT_MODE, HOME_POSITION = (
    definition(name).id for name in ("AVAILABLE_MODES", "CURRENT_MODE", "HOME_POSITION")
)

_ESTIMATED = Estimated.ATTITUDE | Estimated.VELOCITY_ACROSS | Estimated.VELOCITY_UP
_PLACED = (
    Estimated.POSITION_RELATIVE | Estimated.POSITION | Estimated.HEIGHT
    | Estimated.PREDICTS_RELATIVE | Estimated.PREDICTS_POSITION  # scripts wait for these
)  # fmt: skip
_SENSORS = (
    Sensor.GYRO | Sensor.ACCEL | Sensor.MAG | Sensor.PRESSURE | Sensor.GPS | Sensor.MOTORS
    | Sensor.AHRS | Sensor.BATTERY | Sensor.PREARM
)  # fmt: skip

HEARTBEAT_S = 1.0
GRID_S = 0.005  # streams are looked at so often; none is faster
FASTEST_HZ = 200.0


# --- the vehicle at one moment


@dataclass(frozen=True)
class Identity:
    """Who the vehicle is to ground stations, from its start to its end."""

    system_id: int
    autopilot: int  # MAV_AUTOPILOT
    origin: Origin  # of local positions
    drag: Vec3  # believed, N/(m/s)^2: only the wind that is shown depends on it


@dataclass
class Counters:
    """What the loop knows for SYS_STATUS and ESTIMATOR_STATUS."""

    load: float = 0.0  # fraction of the control period that a tick takes
    errors: int = 0  # messages of ground stations that were dropped
    position_off: float = 0.0  # m: how far the plant's is off; 0: it is believed


@dataclass
class View:
    """The vehicle at one tick. `row` is the Tick just flown, or zeros before the first."""

    identity: Identity
    vehicle: StateMachine
    params: Parameters
    wind: Wind
    row: Row
    measured: VehicleState
    t: float  # simulation time, s
    flying: bool  # whether the law ran at this tick
    asked: (
        SetpointMessage | AttitudeSetpointMessage | None
    )  # the script's last setpoint, as it came
    plans: PlanProtocol
    counters: Counters = field(default_factory=Counters)

    @property
    def law(self) -> Any:
        """The law's parameters in force."""
        return self.params.law

    @property
    def battery(self) -> Battery | None:
        """As last reported; None if the plant has none."""
        return self.vehicle.battery

    @property
    def adapts(self) -> bool:
        """Whether the law is that of the paper: what it estimates is told."""
        flown = self.params.flown
        kinds = {"state": State, "internals": Internals, "guard": GuardInternals}
        tells = all(flown.tells(name, kind) for name, kind in kinds.items())
        return tells and not self.vehicle.is_by_baseline

    def _told(self, name: str) -> Any:
        """A field of the Tick."""
        tick = self.params.flown.ticks.Tick
        return from_buffer(field_type(tick, name), column(tick, self.row, name))

    @cached_property
    def state(self) -> State:
        """What the law remembers after this tick, if it `adapts`."""
        state: State = self._told("state")
        return state

    @cached_property
    def outputs(self) -> Outputs:
        """What the law told of this tick."""
        outputs: Outputs = self._told("outputs")
        return outputs

    @cached_property
    def internals(self) -> Internals:
        """What the law computed at this tick, if it `adapts`."""
        internals: Internals = self._told("internals")
        return internals

    @cached_property
    def guard(self) -> GuardInternals:
        """What the guard did at this tick, if the law `adapts`."""
        guard: GuardInternals = self._told("guard")
        return guard

    @cached_property
    def angles(self) -> Vec3:
        """Roll, pitch, yaw, rad."""
        angles: Vec3 = euler(matrix(self.measured.q_EB))
        return angles

    @cached_property
    def place(self) -> Geodetic:
        """Where it is on Earth."""
        return to_geodetic(self.identity.origin, self.measured.r_E)

    @property
    def commanded(self) -> list[float]:
        """Rotor speeds as commanded, over full speed, 0 to 1."""
        commanded: list[float] = column(SharedTick, self.row, "command").tolist()
        return commanded

    @property
    def home(self) -> Vec3:
        """Where a return flies to, m, E."""
        return self.vehicle.home or self.measured.r_E

    @cached_property
    def ground_speed(self) -> float:
        """m/s."""
        return math.hypot(self.measured.v_E.x, self.measured.v_E.y)

    @cached_property
    def throttle(self) -> float:
        """Achieved total thrust over full thrust, 0 to 1, by the believed coefficient."""
        Omega, c_T = self.measured.Omega, self.law.rotors.c_T
        T: float = sum(float(c) * float(w) * float(w) for c, w in zip(c_T, Omega, strict=True))
        T_max: float = self.law.limits.T_max
        return T / T_max


# --- the messages

Build = Callable[[View], Sequence[Packed]]


class Stream(NamedTuple):
    """One message."""

    name: str
    station_hz: float  # 0: on request
    script_hz: float
    build: Build


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
    return [tm.extended_state(landed_state(v.vehicle))]


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
    placed = Estimated.POSITION_JUMPS if v.counters.position_off else _PLACED
    return [tm.estimator_status(v.t, _ESTIMATED | placed)]


def _odometry(v: View) -> Sequence[Packed]:
    m = v.measured
    v_B = rotate_back(matrix(m.q_EB), m.v_E)
    return [tm.odometry(v.t, m.r_E, m.q_EB, v_B, m.w_B)]


def _wind_cov(v: View) -> Sequence[Packed]:
    w = v.wind
    known = [tm.wind_cov(v.t, w.v_air_E, w.variance, math.nan, v.place.alt_m)]
    return known if v.adapts else []


def _wind(v: View) -> Sequence[Packed]:
    return [tm.wind(v.wind.v_air_E)] if v.adapts else []


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


def _rotors(v: View) -> Sequence[Packed]:
    return [tm.rotors(v.t, v.measured.Omega, v.law.rotors.spin)]


def _servos(v: View) -> Sequence[Packed]:
    return [tm.servo_output_raw(v.t, v.commanded[: v.law.rotors.n])]


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


def _mission_current(v: View) -> Sequence[Packed]:
    return [v.plans.current()]


def _fence_status(v: View) -> Sequence[Packed]:
    """The fence. None without one."""
    fence = v.vehicle.fence
    if not fence.is_set:
        return []
    border = fence.border if fence.is_breached else Breach.NONE
    since_ms = fence.since_us // 1000
    return [fence_status(fence.is_breached, fence.breaches, border, since_ms)]


def _rc_channels(v: View) -> Sequence[Packed]:
    return [tm.rc_channels(v.t)]


def _flight_information(v: View) -> Sequence[Packed]:
    return [tm.flight_information(v.t, *v.vehicle.flight_times)]


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


def _current_mode(v: View) -> Sequence[Packed]:
    number = custom_mode(v.vehicle.mode)
    return [replies.current_mode(MODES[v.vehicle.mode].standard, number, number)]


def _modes_monitor(v: View) -> Sequence[Packed]:
    return [replies.available_modes_monitor(0)]


def available_modes(which: int) -> Sequence[Packed]:
    """AVAILABLE_MODES of one mode, counted from 1, or of all (0)."""
    return [
        replies.available_modes(
            len(MODES), index, row.standard, custom_mode(mode), AUTO_MODE, mode.value
        )
        for index, (mode, row) in enumerate(MODES.items(), start=1)
        if which in (0, index)
    ]


# ground station, script (Hz)
STREAMS = {
    definition(stream.name).id: stream
    for stream in (
        Stream("SYS_STATUS", 1.0, 5.0, _sys_status),
        Stream("SYSTEM_TIME", 1.0, 1.0, _system_time),
        Stream("GPS_RAW_INT", 5.0, 5.0, _gps_raw),
        Stream("ATTITUDE", 15.0, 100.0, _attitude),
        Stream("ATTITUDE_QUATERNION", 10.0, 50.0, _attitude_quaternion),
        Stream("LOCAL_POSITION_NED", 10.0, 30.0, _local_position),
        Stream("GLOBAL_POSITION_INT", 5.0, 50.0, _global_position),
        Stream("SERVO_OUTPUT_RAW", 1.0, 10.0, _servos),
        Stream("GPS_GLOBAL_ORIGIN", 0.5, 0.5, _origin),
        Stream("VFR_HUD", 4.0, 10.0, _vfr_hud),
        Stream("ATTITUDE_TARGET", 2.0, 10.0, _attitude_target),
        Stream("POSITION_TARGET_LOCAL_NED", 1.5, 10.0, lambda v: _flown(v, False)),
        Stream("POSITION_TARGET_GLOBAL_INT", 1.5, 10.0, lambda v: _flown(v, True)),
        Stream("ALTITUDE", 1.0, 10.0, _altitude),
        Stream("NAV_CONTROLLER_OUTPUT", 1.0, 0.0, _nav_controller),
        Stream("MISSION_CURRENT", 1.0, 1.0, _mission_current),
        Stream("FENCE_STATUS", 1.0, 1.0, _fence_status),
        Stream("RC_CHANNELS", 0.0, 0.0, _rc_channels),
        Stream("FLIGHT_INFORMATION", 0.0, 0.0, _flight_information),
        Stream("BATTERY_STATUS", 0.5, 0.5, _battery),
        Stream("WIND", 0.5, 1.0, _wind),
        Stream("ESTIMATOR_STATUS", 0.5, 1.0, _estimator),
        Stream("WIND_COV", 0.5, 10.0, _wind_cov),
        Stream("HOME_POSITION", 0.5, 0.5, _home),
        Stream("EXTENDED_SYS_STATE", 1.0, 5.0, _extended_state),
        Stream("NAMED_VALUE_FLOAT", 1.0, 10.0, _estimates),
        Stream("ESC_INFO", 1.0, 1.0, _esc_info),
        Stream("ESC_STATUS", 1.0, 10.0, _esc_status),
        Stream("ODOMETRY", 0.0, 30.0, _odometry),
        Stream("DEBUG_FLOAT_ARRAY", 0.0, 0.0, _estimates_array),
        Stream("ACTUATOR_OUTPUT_STATUS", 0.0, 10.0, _rotors),
        Stream("ORBIT_EXECUTION_STATUS", 2.0, 2.0, _orbit),
        Stream("CURRENT_MODE", 0.5, 0.5, _current_mode),
        Stream("AVAILABLE_MODES_MONITOR", 0.3, 0.3, _modes_monitor),
    )
}


# --- when


class Streams:
    """The streams of every link."""

    def __init__(
        self, ports: Sequence[GroundPort], station: GroundPort, vehicle: StateMachine, kind: int,
        autopilot: int,
    ) -> None:  # fmt: skip
        """`station`: the one of `ports` whose rates are those of ground stations.

        kind, autopilot : MAV_TYPE and MAV_AUTOPILOT of the HEARTBEAT.
        """
        self._ports = ports
        self._station = station
        self._vehicle = vehicle
        self._kind, self._autopilot = kind, autopilot
        self._heartbeat_due = 0.0
        self._last: tuple[object, ...] | None = None
        self._next = 0.0

    def heartbeat(self, now: float) -> None:
        """Send one if a second has passed, or if it would say something else. `now`: monotonic, s."""
        status = self._status()
        if now < self._heartbeat_due and status == self._last:
            return
        self._heartbeat_due = now + HEARTBEAT_S
        self._beat(status)

    def tell_change(self) -> None:
        """Send a heartbeat if it says something else than the last one."""
        status = self._status()
        if self._last is not None and status != self._last:
            self._beat(status)

    def _status(self) -> tuple[object, ...]:
        v = self._vehicle
        return v.armed, v.mode, system_status(v)

    def _beat(self, status: tuple[object, ...]) -> None:
        self._last, v = status, self._vehicle
        packed = heartbeat(v, self._kind, self._autopilot)
        for port in self._ports:
            port.broadcast(packed)

    def begin(self) -> None:
        """Let all be due at once, and then by the clock that is told from now on."""
        self._heartbeat_due = self._next = 0.0
        for port in self._ports:
            for link in port.links():
                for stream in link.streams.values():
                    stream[1] = 0.0

    @property
    def due_s(self) -> float:
        """Wall, monotonic, s: when it is time to look at the streams."""
        return self._next

    def is_due(self, now: float) -> bool:
        """Whether it is time to look at the streams."""
        return now >= self._next

    def send(self, view: View, now: float) -> None:
        """Send what is due."""
        self._next = now + GRID_S
        built: dict[int, Sequence[Packed]] = {}
        for port in self._ports:
            for link in port.links():
                due: list[Packed] = []
                self._known(port, link)
                for number, stream in link.streams.items():
                    interval, at = stream
                    if now >= at:
                        # on its own grid, so that looking late does not slow the stream down
                        stream[1] = at + interval if at + interval > now else now + interval
                        if number not in built:
                            built[number] = STREAMS[number].build(view)
                        due += built[number]
                if due:
                    port.send(link, *due)

    def default_hz(self, port: GroundPort, number: int) -> float:
        """The rate of a message on a link that has not asked for another."""
        stream = STREAMS[number]
        return stream.station_hz if port is self._station else stream.script_hz

    def set_rate(self, port: GroundPort, link: Link, number: int, hz: float) -> None:
        """From now on; 0: never."""
        self._known(port, link)
        if hz <= 0.0:
            link.streams.pop(number, None)
        else:
            link.streams[number] = [1.0 / min(hz, FASTEST_HZ), 0.0]

    def interval_us(self, port: GroundPort, link: Link, number: int) -> int:
        """MESSAGE_INTERVAL: us between two; -1 not sent."""
        self._known(port, link)
        stream = link.streams.get(number)
        return -1 if stream is None else round(stream[0] * 1e6)

    def _known(self, port: GroundPort, link: Link) -> None:
        """A link starts with the default rates."""
        if link.has_rates:
            return
        link.has_rates = True
        for number in STREAMS:
            hz = self.default_hz(port, number)
            if hz > 0.0:
                link.streams[number] = [1.0 / hz, 0.0]

    def text(self, severity: int, told: Told) -> None:
        """STATUSTEXT to everyone who hears telemetry."""
        self.broadcast(replies.status_text(severity, brief(told)))

    def broadcast(self, *messages: Packed) -> None:
        """Something of interest to everyone, at once."""
        for port in self._ports:
            port.broadcast(*messages)
