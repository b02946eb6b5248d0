"""Sticks: whose are heard, and the setpoints that they ask for, mode by mode.

Five modes are flown by sticks, as on a PX4: Position asks for a velocity, Altitude for a tilt and
a vertical speed, Stabilized and Manual for a tilt and a thrust, Acro for body rates and a thrust.
Curves, filters and their parameters are PX4's. Position goes through the law's position control
and the guard. The others do not: their setpoints are of attitude or rates. Altitude holds its
height by a loop of its own here, since laws take a thrust below the position level. Pure. Frames are
Earth ENU and body FLU, units SI, times simulation time in microseconds, unless they are called wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import NamedTuple

from fcu.interface.airframe import STANDARD_GRAVITY
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.rotations import matrix, wrap
from fcu.parameters import Parameters
from fcu.vehicle.modes import Mode
from fcu.vehicle.plans import STILL, PlanLimits, Pose, at
from fcu.vehicle.setpoints import ATTITUDE, RATES, Clocks, Owner, Throttle, is_lost, turned

STEP_US = 20_000  # between two setpoints that are laid down from sticks
TAKES_OFF = 0.3  # throttle above which a vehicle leaves the ground: 65 % of the way, as PX4's
CENTER, LOW = 0.2, -0.8  # throttle above which arming is denied where it climbs, and elsewhere
SEIZES, ASIDE = 0.9, 0.1  # yaw of an arming gesture, and how far the other stick may be aside

# the loop of the height in mode Altitude
HEIGHT, SPEED, STEADY = 1.0, 4.0, 2.0  # 1/s, 1/s, 1/s^2: gains of height, speed and their integral
LEASH = 1.0  # m: the height that is asked for stays as near
TRIM = 0.5  # of the weight: how much the integral may add or take
LEAST_LEAN = 0.5  # cosine of the tilt down to which thrust makes up for it


class Sticks(NamedTuple):
    """Positions of the sticks, -1 to 1 each."""

    roll: float = 0.0  # right
    pitch: float = 0.0  # forward
    yaw: float = 0.0  # clockwise
    throttle: float = 0.0  # up; 0: half of the way


CENTERED = Sticks()


class StickSource(Enum):
    """Messages that sticks are sent by."""

    JOYSTICK = "MANUAL_CONTROL"
    RADIO = "RC_CHANNELS_OVERRIDE"


class Accepts(IntEnum):
    """Sources that are heard: COM_RC_IN_MODE, by PX4's numbers."""

    RADIO = 0
    JOYSTICK = 1
    EITHER = 2  # one of them until it is lost, then the other
    FIRST = 3  # the first of them that is heard, for good
    NEITHER = 4


class Gesture(Enum):
    """Requests by a low throttle and a yaw to the side, held for a while."""

    ARM = "arm"
    DISARM = "disarm"


@dataclass
class StickInput:
    """The sticks of one sender at a time."""

    sim_only: bool  # lost by simulation time alone
    now: Sticks = CENTERED
    owner: Owner | None = None
    source: StickSource | None = None  # the first that was heard
    _last: Clocks | None = field(default=None, repr=False)
    _gesture: Gesture | None = field(default=None, repr=False)
    _gesture_us: int = field(default=0, repr=False)
    _gesture_done: bool = field(default=False, repr=False)

    def lost(self, now_us: int, wall_s: float, lost_us: int) -> bool:
        """Return true if no stick was heard for `lost_us` (simulation time, and by the wall too)."""
        return is_lost(self._last, now_us, wall_s, lost_us, self.sim_only)

    def counts(
        self, source: StickSource, owner: Owner, accepts: Accepts, at_us: int, wall_s: float,
        lost_us: int,
    ) -> bool:  # fmt: skip
        """Return true if sticks of a sender are heard now. Changes nothing."""
        if accepts is Accepts.NEITHER:
            return False
        only = {Accepts.RADIO: StickSource.RADIO, Accepts.JOYSTICK: StickSource.JOYSTICK}
        first = self.source if accepts is Accepts.FIRST else None
        if source is not only.get(accepts, first or source):
            return False
        return self.owner in (None, owner) or self.lost(at_us, wall_s, lost_us)

    def take(
        self, sticks: Sticks, source: StickSource, owner: Owner, at_us: int, wall_s: float
    ) -> None:
        """Take sticks that count."""
        self.now, self.owner = sticks, owner
        self.source = self.source or source
        self._last = Clocks(at_us, wall_s)

    def gesture(self, hold_us: int) -> Gesture | None:
        """The gesture that the sticks have made just now, once, when it was held for long enough."""
        made = _gesture(self.now)
        at_us = 0 if self._last is None else self._last.sim_us
        if made is not self._gesture:
            self._gesture, self._gesture_us, self._gesture_done = made, at_us, False
        if made is None or self._gesture_done or at_us - self._gesture_us < hold_us:
            return None
        self._gesture_done = True
        return made


def _gesture(sticks: Sticks) -> Gesture | None:
    centered = abs(sticks.roll) < ASIDE and abs(sticks.pitch) < ASIDE
    if not centered or sticks.throttle >= LOW or abs(sticks.yaw) <= SEIZES:
        return None
    return Gesture.ARM if sticks.yaw > 0.0 else Gesture.DISARM


# --- curves


def past_dead_zone(x: float, zone: float) -> float:
    """A stick without its dead zone: 0 within it, and straight from its edge to the end."""
    return math.copysign(max(abs(x) - zone, 0.0) / (1.0 - zone), x)


def expo(x: float, e: float) -> float:
    """A stick's curve: straight for e = 0, cubic for e = 1."""
    return (1.0 - e) * x + e * x * x * x


def superexpo(x: float, e: float, g: float) -> float:
    """The curve of Acro's sticks, which g bends still more towards the ends."""
    return expo(x, e) * (1.0 - g) / (1.0 - abs(x) * g)


def within_circle(ahead: float, right: float) -> tuple[float, float]:
    """Two sticks of one plane, together no farther out than one of them goes."""
    far = math.hypot(ahead, right)
    return (ahead / far, right / far) if far > 1.0 else (ahead, right)


def thrust_curve(throttle: float, landed: bool, p: Parameters) -> float:
    """Thrust (0 to 1) of a throttle in Stabilized: its middle hovers, or by a straight line."""
    low = 0.0 if landed else p["MPC_MANTHR_MIN"]
    top, hover = p["MPC_THR_MAX"], p["MPC_THR_HOVER"]
    if p["MPC_THR_CURVE"] == 1.0:
        return low + 0.5 * (throttle + 1.0) * (top - low)
    below, above = min(throttle, 0.0) + 1.0, max(throttle, 0.0)
    return low + below * (hover - low) + above * (top - hover)


def _filtered(was: float, new: float, tau_s: float, dt_s: float) -> float:
    """A filter of first order, one step on."""
    return new if tau_s <= 0.0 else was + dt_s / (tau_s + dt_s) * (new - was)


def _slewed(was: float, to: float, most: float) -> float:
    return was + min(most, max(-most, to - was))


# --- what is flown


class Seen(NamedTuple):
    """State of the vehicle, and its limits, that a setpoint of sticks goes by."""

    measured: VehicleState
    pose: Pose
    flown: Setpoint  # the setpoint flown now, to go on from
    height: float  # m above the ground, or above home where that is not known
    landed: bool
    led: PlanLimits
    throttle: Throttle
    weight: float  # N, believed
    c_T: Rotors  # N s^2, believed
    yaw_rate_max: float  # rad/s, that the law follows
    phi_star: float  # rad, tilt limit of the law


class StickFlight:
    """Setpoints of sticks in one mode, from its begin on: filters, heading and height."""

    def __init__(self, mode: Mode, p: Parameters, seen: Seen) -> None:
        self._mode = mode
        self._p = p
        self._tilt = 0.0, 0.0  # ahead and right, of full stick, filtered
        self._psi_dot = 0.0  # rad/s, counter-clockwise, filtered
        self._psi = seen.flown.psi_c if mode is Mode.POSITION else seen.pose.psi
        self._z, self._v_z = seen.pose.r_E.z, seen.pose.v_E.z
        self._trim = 0.0 if seen.landed else self._carried(seen) - seen.weight

    def setpoint(self, sticks: Sticks, seen: Seen, dt_s: float) -> Setpoint:
        """The setpoint of the next `dt_s`."""
        if self._mode is Mode.ACRO:
            return self._rates(sticks, seen)
        if self._mode is Mode.POSITION:
            return self._moves(sticks, seen, dt_s)
        thrust = None if self._mode is Mode.ALTITUDE else sticks.throttle
        return self._lies(sticks, thrust, seen, dt_s)

    def rests(self, sticks: Sticks, seen: Seen, light: float) -> Setpoint | None:
        """The setpoint on the ground, until the throttle lifts the vehicle. None: it does.

        light : thrust (N) of rotors that do not carry the vehicle.
        """
        if self._mode in (Mode.POSITION, Mode.ALTITUDE):
            if sticks.throttle > TAKES_OFF:
                return None
            T = light
        else:
            T = seen.throttle.force(self._thrust(sticks.throttle, landed=True))
        self._psi, self._psi_dot, self._tilt = seen.pose.psi, 0.0, (0.0, 0.0)
        self._z, self._v_z, self._trim = seen.pose.r_E.z, 0.0, 0.0
        return at(seen.pose.r_E, self._psi)._replace(level=ATTITUDE, tilt_c=STILL, T_c=T)

    # --- the modes

    def _moves(self, sticks: Sticks, seen: Seen, dt_s: float) -> Setpoint:
        """Position: a velocity along the heading, taken up within the limits of acceleration."""
        p, led, now = self._p, seen.led, seen.flown
        zone, bend = p["MAN_DEADZONE"], p["MPC_XY_MAN_EXPO"]
        bent = (expo(past_dead_zone(n, zone), bend) for n in (sticks.pitch, sticks.roll))
        ahead, right = within_circle(*bent)
        speed = min(p["MPC_VEL_MANUAL"], led.cruise)
        self._turn(sticks, expo_of_yaw(sticks.yaw, p), seen, dt_s)
        wanted = turned(Vec3(speed * ahead, -speed * right, 0.0), seen.pose.psi)
        change = Vec3(wanted.x - now.v_c.x, wanted.y - now.v_c.y, 0.0)
        most, size = led.acceleration * dt_s, math.hypot(change.x, change.y)
        if size > most:
            change = (most / size) * change
        elif size < 1e-6:
            now, change = now._replace(v_c=Vec3(wanted.x, wanted.y, now.v_c.z)), STILL
        v_z = _slewed(now.v_c.z, self._climb(sticks, seen), led.acceleration_up * dt_s)
        a = (1.0 / dt_s) * Vec3(change.x, change.y, v_z - now.v_c.z)
        asked = at(now.r_c, self._psi, v=now.v_c, a=a)
        return asked._replace(psi_dot_c=self._psi_dot)

    def _lies(self, sticks: Sticks, thrust: float | None, seen: Seen, dt_s: float) -> Setpoint:
        """Altitude, Stabilized, Manual: a tilt, and a thrust or the one that holds the height."""
        p = self._p
        ahead, right = within_circle(sticks.pitch, sticks.roll)
        tau = p["MC_MAN_TILT_TAU"]
        self._tilt = (
            _filtered(self._tilt[0], ahead, tau, dt_s),
            _filtered(self._tilt[1], right, tau, dt_s),
        )
        most = min(math.radians(p["MPC_MAN_TILT_MAX"]), seen.phi_star)
        far = math.hypot(*self._tilt)
        angle = math.atan(far * math.tan(most)) if thrust is None else far * most
        k = math.sin(angle) / far if far > 1e-9 else 0.0
        out_ahead, out_right, out_up = k * self._tilt[0], k * self._tilt[1], math.cos(angle)
        pitch = math.atan2(out_ahead, out_up)
        roll = math.atan2(out_right, math.hypot(out_ahead, out_up))
        bent = expo_of_yaw(sticks.yaw, p) if thrust is None else sticks.yaw
        self._turn(sticks, bent, seen, dt_s)
        if thrust is None:
            T = self._holding(sticks, seen, dt_s)
        else:
            T = seen.throttle.force(self._thrust(thrust, landed=False))
        lies = at(seen.pose.r_E, self._psi)
        return lies._replace(
            level=ATTITUDE, tilt_c=Vec3(roll, pitch, 0.0), psi_dot_c=self._psi_dot, T_c=T
        )

    def _rates(self, sticks: Sticks, seen: Seen) -> Setpoint:
        p = self._p
        bend = p["MC_ACRO_EXPO"], p["MC_ACRO_SUPEXPO"]
        yaw = superexpo(sticks.yaw, p["MC_ACRO_EXPO_Y"], p["MC_ACRO_SUPEXPOY"])
        degrees = Vec3(
            superexpo(sticks.roll, *bend) * p["MC_ACRO_R_MAX"],
            superexpo(sticks.pitch, *bend) * p["MC_ACRO_P_MAX"],
            -yaw * p["MC_ACRO_Y_MAX"],
        )
        turns = at(seen.pose.r_E, seen.pose.psi)
        T = seen.throttle.force(self._thrust(sticks.throttle, landed=False))
        return turns._replace(level=RATES, w_c=math.radians(1.0) * degrees, T_c=T)

    # --- their parts

    def _thrust(self, throttle: float, landed: bool) -> float:
        """Thrust, 0 to 1: in Acro as the stick is, else by the curve."""
        if self._mode is Mode.ACRO:
            return 0.5 * (throttle + 1.0)
        return thrust_curve(throttle, landed, self._p)

    def _turn(self, sticks: Sticks, stick: float, seen: Seen, dt_s: float) -> None:
        """The heading: turned by its stick, held where that is let go."""
        p = self._p
        self._psi = float(wrap(self._psi + dt_s * self._psi_dot))
        most = min(math.radians(p["MPC_MAN_Y_MAX"]), seen.yaw_rate_max)
        rate = _filtered(self._psi_dot, -stick * most, p["MPC_MAN_Y_TAU"], dt_s)
        self._psi_dot = 0.0 if stick == 0.0 and abs(rate) < 1e-3 else rate

    def _climb(self, sticks: Sticks, seen: Seen) -> float:
        """Speed upwards (m/s) that the throttle asks for: slower near the ground, both ways."""
        p, led = self._p, seen.led
        stick = expo(past_dead_zone(sticks.throttle, p["MAN_DEADZONE"]), p["MPC_Z_MAN_EXPO"])
        v_z = stick * (led.up if stick > 0.0 else led.down)
        low, high = p["MPC_LAND_ALT2"], p["MPC_LAND_ALT1"]
        far = (
            min(1.0, max(0.0, (seen.height - low) / (high - low)))
            if high > low
            else float(seen.height > low)
        )
        down = min(led.down, p["MPC_LAND_SPEED"]) * (1.0 - far) + led.down * far
        up = min(led.up, p["MPC_TKO_SPEED"]) * (1.0 - far) + led.up * far
        return min(up, max(-down, v_z))

    def _holding(self, sticks: Sticks, seen: Seen, dt_s: float) -> float:
        """Thrust (N) that climbs as the throttle asks for, or holds the height."""
        z, v_z = seen.pose.r_E.z, seen.pose.v_E.z
        was = self._v_z
        self._v_z = _slewed(was, self._climb(sticks, seen), seen.led.acceleration_up * dt_s)
        self._z += 0.5 * (was + self._v_z) * dt_s
        self._z = min(z + LEASH, max(z - LEASH, self._z))
        error = self._v_z + HEIGHT * (self._z - z) - v_z
        weight = seen.weight
        mass = weight / STANDARD_GRAVITY
        wanted = weight + self._trim + mass * ((self._v_z - was) / dt_s + SPEED * error)
        lean = _upright(seen)
        T = min(seen.throttle.T_max, max(0.0, wanted / lean))
        if wanted / lean == T:
            most = TRIM * weight
            self._trim = min(most, max(-most, self._trim + mass * STEADY * error * dt_s))
        return T

    def _carried(self, seen: Seen) -> float:
        """Force upwards (N) of the rotors."""
        pairs = zip(seen.c_T, seen.measured.Omega, strict=True)
        T = sum(float(c_T) * float(Omega) * float(Omega) for c_T, Omega in pairs)
        most, lift = TRIM * seen.weight, T * _upright(seen)
        return min(seen.weight + most, max(seen.weight - most, lift))


def _upright(seen: Seen) -> float:
    """Cosine of the tilt, as far as thrust makes up for it."""
    return max(LEAST_LEAN, float(matrix(seen.measured.q_EB).e3.z))


def expo_of_yaw(stick: float, p: Parameters) -> float:
    """The yaw stick of Position and Altitude, by its curve."""
    return expo(past_dead_zone(stick, p["MAN_DEADZONE"]), p["MPC_YAW_EXPO"])
