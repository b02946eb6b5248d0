"""Where the vehicle is led when nobody streams setpoints: pieces of constant acceleration.

The law carries a setpoint along its own velocity and acceleration, so a trapezoid of speed is
three setpoints, exact at every tick between. What each mode flies is made of them, and a Leader
follows them in time. Frames: Earth ENU; SI; times are simulation time in microseconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from fcu.guard.admission import Pace
from fcu.interface.airframe import STANDARD_GRAVITY
from fcu.interface.messages import Setpoint, VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3, hypot, maximum, minimum, norm, select, select3
from fcu.kernel.buffers import from_buffer, packer, size, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, matrix, wrap
from fcu.parameters import Parameters
from fcu.vehicle.modes import Mode
from fcu.vehicle.returning import Ending

Row = np.ndarray[Any, np.dtype[np.float64]]

ENDLESS = Pace()
STILL = Vec3(0.0, 0.0, 0.0)
SLOW = 0.05  # m/s under which there is nothing to brake
EIGHT_HZ = 20.0  # at which the figure of eight is laid down
EIGHT_RAMP_S = 5.0  # from rest to full speed
ORBIT_HZ = 20.0  # at which the circle of an orbit is laid down
ORBIT_RAMP = 0.5  # of the limit: the acceleration along the circle, from rest to full speed
NEVER_US = 2**62
RADIUS_LEAST, RADIUS_MOST = 1.0, 1000.0  # m, of an orbit, as PX4's
AT_CENTER = 0.1  # m from the centre of a circle, within which the heading is the way out
HOME_CLOSE = 2.0  # m across: no need to climb for the way home
Around = Callable[[Vec3, Vec3], list[Vec3]]  # the places of a way from one to another, m, E
FOREVER_S = 1e9  # so long a plan waits that is not to go on
SLOW_BELOW = 5.0  # m above home: from there a landing is slow


class Pose(NamedTuple):
    """Where the vehicle is."""

    r_E: Vec3
    v_E: Vec3
    psi: float


class Piece(NamedTuple):
    """A setpoint, and for how long (s) it is carried; inf: until something else is wanted."""

    setpoint: Setpoint
    for_s: float


LATE_S = 0.15  # s, after which a deceleration that begins at once has been taken up, at least
TAKES_UP = 1.25  # of the time that the guard's jerk takes: attitude and rates come after it
SINKS = 1.0  # m/s^2: a speed down is taken up so gently that what lags does not catch up with it


class PlanLimits(NamedTuple):
    """How fast the vehicle is led. m/s, m/s^2."""

    cruise: float
    up: float
    down: float
    acceleration: float  # across
    acceleration_up: float  # up and down
    late_s: float = LATE_S  # after which the guard has taken up a deceleration that begins at once


def length(v: Vec3) -> float:
    """Of a vector."""
    return math.sqrt(v.x * v.x + v.y * v.y + v.z * v.z)


def at(r: Vec3, psi: float, v: Vec3 = STILL, a: Vec3 = STILL) -> Setpoint:
    """The setpoint at r without a yaw rate; it stands still if neither v nor a is given."""
    return Setpoint(r_c=r, v_c=v, a_c=a, psi_c=psi, psi_dot_c=0.0)


def rest(r: Vec3, psi: float) -> Piece:
    """Stay at r."""
    return Piece(at(r, psi), math.inf)


class Stop(NamedTuple):
    """Where a vehicle that brakes comes to rest, and in what time (s); 0: it all but rests."""

    r_E: Vec3
    after_s: float


@kernel
def pose_of(measured):
    """The Pose of a VehicleState."""
    return Pose(r_E=measured.r_E, v_E=measured.v_E, psi=euler(matrix(measured.q_EB)).z)


_unpack_state, _pack_pose = unpacker(VehicleState), packer(Pose)


@kernel
def _pose_at(state, pose):
    _pack_pose(pose, pose_of(_unpack_state(state)))


def pose_at(state: Row) -> Pose:
    """The Pose of a VehicleState's buffer: for Python, as a value handed to a kernel costs far more."""
    pose = np.empty(size(Pose))
    _pose_at(state, pose)
    return from_buffer(Pose, pose)


@kernel
def stop(r, v, limits):
    """The Stop from r at velocity v, within the PlanLimits."""
    speed = norm(v)
    least = minimum(
        limits.acceleration * speed / maximum(hypot(v.x, v.y), 1e-9),
        limits.acceleration_up * speed / maximum(abs(v.z), 1e-9),
    )
    rests = speed < SLOW
    time = select(rests, 0.0, speed / least)
    return Stop(r_E=select3(rests, r, r + (0.5 * time) * v), after_s=time)


def brake(r: Vec3, v: Vec3, psi: float, limits: PlanLimits) -> tuple[list[Piece], Vec3]:
    """From r at velocity v to a stop; returns the pieces and where it stops."""
    place, time = stop(r, v, limits)
    if time == 0.0:
        return [], r
    return [Piece(at(r, psi, v, (-1.0 / time) * v), time)], place


def limits_along(ahead: Vec3, limits: PlanLimits) -> tuple[float, float]:
    """The greatest speed (m/s) and acceleration (m/s^2) along a direction, a unit vector."""
    across, climb = math.hypot(ahead.x, ahead.y), ahead.z
    vertical = limits.up if climb > 0.0 else limits.down
    speed = min(limits.cruise / max(across, 1e-9), vertical / max(abs(climb), 1e-9))
    a = min(limits.acceleration / max(across, 1e-9), limits.acceleration_up / max(abs(climb), 1e-9))
    return speed, a


def line(start: Vec3, end: Vec3, psi: float, limits: PlanLimits) -> list[Piece]:
    """From rest at `start` straight to rest at `end`, within the limits; without the rest there."""
    way = end - start
    far = length(way)
    if far < 1e-6:
        return []
    ahead = (1.0 / far) * way
    speed, a = limits_along(ahead, limits)
    speed = min(speed, math.sqrt(a * far))  # a triangle if the way is short
    ramp, flat = speed / a, far / speed - speed / a
    pieces, r = [], start
    for v, accel, time in ((0.0, a, ramp), (speed, 0.0, flat), (speed, -a, ramp)):
        if time > 1e-9:
            pieces.append(Piece(at(r, psi, v * ahead, accel * ahead), time))
            r = r + (v * time + 0.5 * accel * time * time) * ahead
    return pieces


def through(
    r: Vec3, v: Vec3, points: list[Vec3], psi: float, limits: PlanLimits, settle_s: float = 0.0
) -> list[Piece]:
    """Stop, then from point to point; ends with the rest at the last, `settle_s` after arriving."""
    pieces, here = brake(r, v, psi, limits)
    for point in points:
        pieces += line(here, point, psi, limits)
        here = point
    last = rest(here, psi)
    return [*pieces, *([last._replace(for_s=settle_s)] if settle_s > 0.0 else []), last]


def descent(
    r: Vec3, v: Vec3, psi: float, slow_below: float, speed: float, limits: PlanLimits
) -> list[Piece]:
    """Stop, go down at the limit to `slow_below` (m), then at `speed` until something is touched."""
    pieces, here = brake(r, v, psi, limits)
    if here.z > slow_below + 1.0:
        low = Vec3(here.x, here.y, slow_below)
        pieces += line(here, low, psi, limits)
        here = low
    down, takes = Vec3(0.0, 0.0, -SINKS), speed / SINKS
    pieces.append(Piece(at(here, psi, a=down), takes))
    here = here + (0.5 * takes * takes) * down
    return [*pieces, Piece(at(here, psi, v=Vec3(0.0, 0.0, -speed)), math.inf)]


def steps(r: Vec3, away: Vec3, period_s: float, psi: float) -> Iterator[Piece]:
    """There and back, each held for a period, as steps: the reference model is to shape them."""
    every = period_s if period_s > 0.0 else math.inf
    while True:
        yield Piece(at(r + away, psi), every)
        yield Piece(at(r, psi), every)


def eight_acceleration(size: tuple[float, float], speed: float) -> float:
    """The greatest acceleration (m/s^2) along a figure of eight, at full speed."""
    a, b = size
    rate = speed / math.hypot(0.5 * a, b)
    p = [math.pi * k / 180.0 for k in range(360)]
    return rate * rate * max(
        math.hypot(0.5 * a * math.sin(q), 2.0 * b * math.sin(2.0 * q)) for q in p
    )  # fmt: skip


def figure_eight(r: Vec3, size: tuple[float, float], speed: float, psi: float) -> Iterator[Piece]:
    """x = a/2 sin p, y = b/2 sin 2p about r, from rest; `speed` (m/s) where it crosses."""
    a, b = size
    rate = speed / math.hypot(0.5 * a, b)  # of p, at full speed
    k = 0
    while True:
        t = k / EIGHT_HZ
        if t < EIGHT_RAMP_S:
            p, p_dot, p_ddot = (
                0.5 * rate * t * t / EIGHT_RAMP_S,
                rate * t / EIGHT_RAMP_S,
                rate / EIGHT_RAMP_S,
            )
        else:
            p, p_dot, p_ddot = rate * (t - 0.5 * EIGHT_RAMP_S), rate, 0.0
        s, c, s2, c2 = math.sin(p), math.cos(p), math.sin(2.0 * p), math.cos(2.0 * p)
        here = at(
            r + Vec3(0.5 * a * s, 0.5 * b * s2, 0.0),
            psi,
            v=Vec3(0.5 * a * c * p_dot, b * c2 * p_dot, 0.0),
            a=Vec3(
                0.5 * a * (c * p_ddot - s * p_dot * p_dot),
                b * (c2 * p_ddot - 2.0 * s2 * p_dot * p_dot),
                0.0,
            ),
        )
        yield Piece(here, 1.0 / EIGHT_HZ)
        k += 1


class OrbitYaw(Enum):
    """Directions in which the vehicle faces on the circle, by number of ORBIT_YAW_BEHAVIOUR."""

    CENTER = 0
    INITIAL = 1
    TANGENT = 3


class Circle(NamedTuple):
    """Level circle of an orbit about `center`, at the height of `center`."""

    center: Vec3  # m, E
    radius: float  # m
    speed: float  # m/s along the circle
    clockwise: bool  # seen from above
    yaw: OrbitYaw


def orbit_acceleration(circle: Circle) -> float:
    """Return the acceleration (m/s^2) that the full speed on a circle demands."""
    return circle.speed * circle.speed / circle.radius


def entry_of(r: Vec3, psi: float, circle: Circle) -> Vec3:
    """Return the nearest point (m, E) of a circle, or the one ahead from its centre."""
    out = Vec3(r.x - circle.center.x, r.y - circle.center.y, 0.0)
    angle = psi if length(out) < AT_CENTER else math.atan2(out.y, out.x)
    entry: Vec3 = circle.center + circle.radius * Vec3(math.cos(angle), math.sin(angle), 0.0)
    return entry


def orbit(r: Vec3, psi: float, circle: Circle, yaw_rate: float, led: PlanLimits) -> Iterator[Piece]:
    """Fly from rest at r to the nearest point of a circle, turn there, then fly round the circle.

    The speed rises evenly from rest. `yaw_rate`: rad/s, with which the vehicle turns at the entry.
    """
    entry = entry_of(r, psi, circle)
    angle = math.atan2(entry.y - circle.center.y, entry.x - circle.center.x)
    yield from line(r, entry, psi, led)
    yield from _turn(entry, psi, _faces(circle, angle, psi), yaw_rate)
    way = -1.0 if circle.clockwise else 1.0
    top = circle.speed / circle.radius  # rad/s
    # whole pieces, so that the acceleration ends where a piece does
    ramps = max(1, math.ceil(ORBIT_HZ * circle.speed / (ORBIT_RAMP * led.acceleration)))
    ramps_s, k = ramps / ORBIT_HZ, 0
    ramp = top / ramps_s
    while True:
        t = k / ORBIT_HZ
        ramping = k < ramps
        turned = 0.5 * ramp * t * t if ramping else top * (t - 0.5 * ramps_s)
        rate, rises = (ramp * t, ramp) if ramping else (top, 0.0)
        q = angle + way * turned
        outward = Vec3(math.cos(q), math.sin(q), 0.0)
        along = way * Vec3(-outward.y, outward.x, 0.0)
        here = at(
            circle.center + circle.radius * outward,
            _faces(circle, q, psi),
            v=(circle.radius * rate) * along,
            a=circle.radius * (rises * along - (rate * rate) * outward),
        )
        spins = 0.0 if circle.yaw is OrbitYaw.INITIAL else way * rate
        yield Piece(here._replace(psi_dot_c=spins), 1.0 / ORBIT_HZ)
        k += 1


def _faces(circle: Circle, angle: float, initial: float) -> float:
    """Return the yaw at an angle of the circle, rad."""
    if circle.yaw is OrbitYaw.INITIAL:
        return initial
    if circle.yaw is OrbitYaw.CENTER:
        return float(wrap(angle + math.pi))
    return float(wrap(angle + (-0.5 if circle.clockwise else 0.5) * math.pi))


def _turn(r: Vec3, psi: float, to: float, rate: float) -> list[Piece]:
    """Turn at rest at r, the shorter way round, from one yaw to another."""
    away = float(wrap(to - psi))
    if abs(away) < 1e-6:
        return []
    turning = at(r, psi)._replace(psi_dot_c=math.copysign(rate, away))
    return [Piece(turning, abs(away) / rate)]


# --- what each mode flies


def limits(params: Parameters, cruise: float | None, pace: Pace = ENDLESS) -> PlanLimits:
    """How fast it is led. `cruise`: m/s as told; None: MPC_XY_CRUISE.

    pace : what the guard lets the reference model follow: what is led faster is overshot.
    """
    p, top = params, pace.top
    acceleration_up = min(p["MPC_ACC_UP_MAX"], pace.acceleration)
    return PlanLimits(
        cruise=min(p["MPC_XY_CRUISE"] if cruise is None else cruise, p["MPC_XY_VEL_MAX"], top),
        up=min(p["MPC_Z_VEL_MAX_UP"], top),
        down=min(p["MPC_Z_VEL_MAX_DN"], pace.down),
        acceleration=min(p["MPC_ACC_HOR"], tilted(p), pace.acceleration),
        acceleration_up=acceleration_up,
        late_s=max(LATE_S, TAKES_UP * acceleration_up / pace.jerk),
    )


def tilted(params: Parameters) -> float:
    """The acceleration across (m/s^2) that MPC_TILTMAX_AIR leaves."""
    return STANDARD_GRAVITY * math.tan(math.radians(params["MPC_TILTMAX_AIR"]))


def settle_s(params: Parameters) -> float:
    """Time in which the vehicle catches up with a setpoint that has come to rest, s."""
    return 4.0 / params.pace.f_m


def take_off(here: Pose, height: float, led: PlanLimits, settle: float) -> list[Piece]:
    """Straight up by `height` (m), from rest."""
    up = here.r_E + Vec3(0.0, 0.0, height)
    return through(here.r_E, STILL, [up], here.psi, led, settle)


def asks_too_much(mode: Mode, p: Parameters) -> Told | None:
    """Why what a mode would fly, as its parameters are, is more than the vehicle is led with."""
    if mode is not Mode.FIGURE_EIGHT:
        return None
    size, most = (p["REF_8_LEN"], p["REF_8_WIDTH"]), p["MPC_ACC_HOR"]
    asks = eight_acceleration(size, p["REF_8_SPEED"])
    return Told(Code.ASKS_TOO_MUCH, (asks, most)) if asks > most else None


def plan_of(
    mode: Mode, here: Pose, to: Ending, p: Parameters, led: PlanLimits, around: Around
) -> Iterable[Piece]:
    """What a mode flies from here, keeping its yaw. `to`: the end of a return, else home."""
    r, v, psi = here
    if mode is Mode.LAND:
        return descent(r, v, psi, to.place.z + SLOW_BELOW, p["MPC_LAND_SPEED"], led)
    if mode is Mode.RETURN and to.along:
        return _return_along(here, to, p, led, around)
    if mode is Mode.RETURN:
        return _return(here, to.place, p, led, around)
    if mode in (Mode.STEP, Mode.FIGURE_EIGHT):
        stopping, stop = brake(r, v, psi, led)
        return chain(stopping, _generated(mode, stop, psi, p))
    return through(r, v, [], psi, led)


def _generated(mode: Mode, r: Vec3, psi: float, p: Parameters) -> Iterator[Piece]:
    if mode is Mode.STEP:
        away = Vec3(p["REF_STEP_E"], p["REF_STEP_N"], p["REF_STEP_U"])
        return steps(r, away, p["REF_STEP_T"], psi)
    return figure_eight(r, (p["REF_8_LEN"], p["REF_8_WIDTH"]), p["REF_8_SPEED"], psi)


def _return(here: Pose, home: Vec3, p: Parameters, led: PlanLimits, around: Around) -> list[Piece]:
    """Home, and there wait as RTL_LAND_DELAY says, at RTL_DESCEND_ALT at the highest."""
    r, v, psi = here
    way, waits = _way_home(here, home, p, led, around), p["RTL_LAND_DELAY"]
    if waits != 0.0:
        last = way[-1] if way else brake(r, v, psi, led)[1]
        way.append(Vec3(last.x, last.y, min(last.z, home.z + p["RTL_DESCEND_ALT"])))
    return through(r, v, way, psi, led, settle_s(p) + (FOREVER_S if waits < 0.0 else waits))


def _return_along(
    here: Pose, to: Ending, p: Parameters, led: PlanLimits, around: Around
) -> Iterator[Piece]:
    """By places of the plan, and over the place of its end at the height of the last of them.

    One at a time: a plan may have many.
    """
    stopping, r = brake(here.r_E, here.v_E, here.psi, led)
    first, last = to.along[0], to.along[-1]
    begin = [first]
    if to.straight:
        top = max(r.z, first.z, to.place.z + p["RTL_RETURN_ALT"])
        up = Vec3(r.x, r.y, top)
        begin = [up, *around(up, Vec3(first.x, first.y, top)), first]
    elif math.hypot(r.x - first.x, r.y - first.y) >= HOME_CLOSE:
        *between, _ = around(r, first)
        begin = [*between, first]
    yield from stopping
    for place in chain(begin, to.along[1:], around(last, Vec3(to.place.x, to.place.y, last.z))):
        yield from line(r, place, here.psi, led)
        r = place
    yield rest(r, here.psi)._replace(for_s=settle_s(p))
    yield rest(r, here.psi)


def _way_home(here: Pose, home: Vec3, p: Parameters, led: PlanLimits, around: Around) -> list[Vec3]:
    _, stop = brake(here.r_E, here.v_E, here.psi, led)
    if math.hypot(stop.x - home.x, stop.y - home.y) < HOME_CLOSE:
        return []
    top = max(stop.z, home.z + p["RTL_RETURN_ALT"])
    up = Vec3(stop.x, stop.y, top)
    return [up, *around(up, Vec3(home.x, home.y, top))]


# --- following in time


class Leader:
    """Which piece of a plan is flown, and until when. Times: simulation time, us."""

    def __init__(self, until: Row) -> None:
        """`until`: float64[1], shared with compiled code: when the piece that is flown ends, us."""
        self.setpoint: Setpoint | None = None
        self.since_us = 0  # when the setpoint took effect
        self._until = until
        self.until_us = NEVER_US
        self._plan: Iterator[Piece] = iter(())
        self._ends = False

    @property
    def until_us(self) -> int:
        """When the piece that is flown ends."""
        return int(self._until[0])

    @until_us.setter
    def until_us(self, t_us: int) -> None:
        self._until[0] = t_us

    def take(self, setpoint: Setpoint | None, since_us: int) -> None:
        """Somebody else's setpoint; None: nothing is flown."""
        self.setpoint, self.since_us, self.until_us = setpoint, since_us, NEVER_US
        self._plan, self._ends = iter(()), False

    def follow(self, plan: Iterable[Piece], t_us: int, ends: bool = False) -> None:
        """A plan, from now; `ends`: its last piece is worth telling of."""
        self._plan, self._ends, self.until_us = iter(plan), ends, t_us

    def advance(self, t_us: int) -> bool:
        """On to the piece of this moment; whether that was the last one of a plan that ends."""
        while t_us >= self.until_us:
            piece = next(self._plan)
            self.setpoint, self.since_us = piece.setpoint, self.until_us
            if math.isinf(piece.for_s):
                self.until_us = NEVER_US
                ended, self._ends = self._ends, False
                return ended
            self.until_us += round(piece.for_s * 1e6)
        return False
