"""Near the ground: whether the vehicle stands on it, and how it comes down.

In the air a vehicle at rest carries its own weight. One that is at rest while its rotors push
with less than half of what they pushed with in flight is carried by something else. That holds
in every mode, and it cannot end an offboard take-off: landing is only concluded after a flight.

Against the friction of the gear the loops of position wind up and tip the vehicle over. So a
vehicle that has come down is kept level with light rotors, and nothing leads it aside there
or down faster than a landing: a place in the ground is gone to above it, what moves into the
ground is stopped before it, and from there the vehicle lands where it is, until a setpoint
leads up again. Pure. Frames: Earth ENU; SI; times are simulation time in microseconds.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3, dot, hypot, maximum, norm, select, total
from fcu.kernel.buffers import packer, size, to_buffer, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rows import column_of
from fcu.laws.setpoint import carried
from fcu.vehicle.plans import STILL, PlanLimits, Pose, pose_of, stop
from fcu.vehicle.setpoints import ATTITUDE, POSITION

Row = np.ndarray[Any, np.dtype[np.float64]]

# standing
STANDS = 0.25  # m/s, of a vehicle at rest
HELD_FOR_US = 500_000  # simulation time
STOOD_US = 100_000  # simulation time: what falls is at rest for a quarter of that
LIGHT = 0.5  # of the thrust in flight
LEANS = 0.85  # of it: rotors that hold a vehicle level on a slope push with less
LEANS_US = 700_000  # simulation time: what leans is at rest for as long
LEARNT = 0.01  # of the thrust of one look: two seconds' worth
AIRBORNE = 0.15  # m above where it stood: in the air whatever the rotors do

# coming down
CLEAR = 0.05  # m above where it stood: lower is in the ground
TOUCHING = 0.1  # m
VALLEY = 0.5  # m below where it stood: the ground is another one here, and not known
HINDERED = 0.2  # of the speed down that is asked for: something is in the way
HINDERED_US, ANYWHERE_US = 60_000, 300_000  # for so long where the ground is, and elsewhere
SINKS = 0.7  # of the speed down that is asked for: nothing is in the way
STRUCK_US = 60_000  # from there to hindered: no air stops a vehicle as fast
UNLED = 2.0  # times as long elsewhere, without a reference model
LEFT_BEHIND = 0.7  # m beyond the lag of a reference model, by which a setpoint that sinks leaves it
LAZY = 0.5  # rad/s, f_m below which the reference model is slow to take up a speed
AT_REST, FALLING = 0.25, 1.0  # m/s
ABOVE = 0.5  # m: how high a place in the ground is gone to
AHEAD_S = 0.5  # of its speed down: as much higher a place near the ground is aimed at
LOW = 1.0  # m: from here it may land
THERE, SLOW = 0.5, 0.5  # m, m/s across: as near to a place, and as still, as it has to be to land


class LandedState(NamedTuple):
    """What the landed detector remembers from look to look. 0 and 1: no and yes; NaN: not known."""

    T_flight: float  # N, thrust that it takes to fly
    since_us: float  # since when it rests; NaN: it does not
    stood_at: float  # m, E: height at which it was last seen standing
    ground: float  # m, E: height at which it has stood for a while
    landed: float
    has_flown: float  # since it was last on the ground for certain
    leans_us: float = math.nan  # since when it rests with rotors that still work; NaN: it does not


class TouchdownState(NamedTuple):
    """What the touch-down detector remembers from look to look."""

    done: float  # 1: it has come down
    since_us: float  # since when something is in its way; NaN: nothing is
    # when it last sank as fast as it should; NaN: it never did, -inf: not since it was thrown up
    sank_us: float = math.nan
    struck: float = 0.0  # 1: what is in its way stopped it at once


_unpack_measured = unpacker(VehicleState)
_unpack_landed, _pack_landed = unpacker(LandedState), packer(LandedState)
_unpack_touchdown, _pack_touchdown = unpacker(TouchdownState), packer(TouchdownState)


@kernel
def stands(was, down, c_T, measured, t_us):
    """The LandedState after a look at a VehicleState, some 50 times a second.

    On a slope some feet hang in the air, and rotors that hold the vehicle level push with up to LEANS of the
    thrust in flight. An updraft that carries the rest of the weight looks alike, so that counts only once the
    vehicle has come down, when its rotors are told to push with a quarter of it.
    down : 1 if it is armed and has come down. A wind may then drag it along the ground.
    c_T : believed thrust coefficients, N s^2, a Rotors.  t_us : simulation time, us, a float.
    """
    Omega, v, height = measured.Omega, measured.v_E, measured.r_E.z
    T = total(c_T * (Omega * Omega))
    still = dot(v, v) < STANDS * STANDS or (down != 0.0 and abs(v.z) < STANDS)
    carried = LIGHT * was.T_flight < T  # by its rotors
    leans = down != 0.0 and still and LEANS * was.T_flight > T
    leans_us = select(leans, select(math.isnan(was.leans_us), t_us, was.leans_us), math.nan)
    T_flight, since_us, stood_at = was.T_flight, was.since_us, was.stood_at
    ground, landed, has_flown = was.ground, was.landed, was.has_flown
    if landed != 0.0:
        first = math.isnan(stood_at)
        if first and still:
            stood_at = height
        if not still:
            since_us = math.nan
        elif math.isnan(since_us):
            since_us = t_us
        elif t_us - since_us >= STOOD_US:
            ground = stood_at
        rises = height > stood_at + AIRBORNE
        if rises and math.isnan(ground):
            ground = stood_at  # it went up from there at once: what falls does not
        if rises or (first and carried):
            landed, has_flown, since_us = 0.0, 1.0, math.nan
    elif carried or not still:
        since_us = math.nan
        if leans and t_us - leans_us >= LEANS_US:
            landed, stood_at = 1.0, height
        elif still and not t_us - leans_us >= STOOD_US:  # in the air: what it takes to stay there
            T_flight += LEARNT * (T - T_flight)
    else:
        if math.isnan(since_us):
            since_us = t_us
        if t_us - since_us >= HELD_FOR_US:
            landed, stood_at = 1.0, height
    return LandedState(
        T_flight=T_flight,
        since_us=since_us,
        stood_at=stood_at,
        ground=ground,
        landed=landed,
        has_flown=has_flown,
        leans_us=leans_us,
    )


@kernel
def _see_landed(buffer, c_T, row, t_us):
    """`stands` on flat buffers."""
    _pack_landed(buffer, stands(_unpack_landed(buffer), 0.0, c_T, _unpack_measured(row), t_us))


class LandedDetector:
    """Whether it stands on the ground. Unknown (taken for landed) until the first state was seen."""

    def __init__(self, c_T: Rotors, T_first: float, buffer: Row | None = None) -> None:
        """`c_T`: believed thrust coefficients. `T_first`: thrust (N) expected in flight before one.

        `buffer`: float64[size(LandedState)], to remember in.
        """
        self.c_T = c_T
        self.buffer = np.empty(size(LandedState)) if buffer is None else buffer
        self.buffer[:] = to_buffer(
            LandedState(
                T_flight=T_first, since_us=math.nan, stood_at=math.nan, ground=math.nan,
                landed=1.0, has_flown=0.0,
            )
        )  # fmt: skip

    def see(self, state: Row, time_us: int) -> bool:
        """One look, some 50 times a second; whether it is on the ground."""
        _see_landed(self.buffer, self.c_T, state, float(time_us))
        return self.landed

    @property
    def light(self) -> float:
        """Thrust (N) of rotors that do not carry the vehicle, by far."""
        return 0.5 * LIGHT * float(self.buffer[_T_FLIGHT])

    @property
    def landed(self) -> bool:
        """Whether it was on the ground at the last look."""
        return bool(self.buffer[_LANDED])

    @property
    def ground(self) -> float:
        """Height (m, E) at which it has stood for a while; NaN if it has not."""
        return float(self.buffer[_GROUND])

    @ground.setter
    def ground(self, z: float) -> None:
        self.buffer[_GROUND] = z

    @property
    def has_flown(self) -> bool:
        """Whether it has, since it was last on the ground for certain."""
        return bool(self.buffer[_HAS_FLOWN])

    @has_flown.setter
    def has_flown(self, yes: bool) -> None:
        self.buffer[_HAS_FLOWN] = yes


_T_FLIGHT, _LANDED = column_of(LandedState, "T_flight"), column_of(LandedState, "landed")
_GROUND, _HAS_FLOWN = column_of(LandedState, "ground"), column_of(LandedState, "has_flown")


class Approach(IntEnum):
    """How a script's setpoint is flown."""

    AS_ASKED = 0
    RAISED = 1  # to above the ground
    DOWN = 2  # as a landing


@kernel
def approach(was, asked, pose, ground, limits):
    """How `asked`, carried to this moment, is to be flown: an Approach, as `was` is (or its int).

    ground : height at which the vehicle stood, m; NaN if that is not known.
    """
    if asked.level > POSITION or math.isnan(ground) or pose.r_E.z < ground - VALLEY:
        return Approach.AS_ASKED
    place = _is_still(asked.v_c)
    if not _into(asked, ground, limits):
        sinking = was == Approach.DOWN and asked.v_c.z < 0.0
        if sinking and asked.r_c.z <= pose.r_E.z + CLEAR:
            return Approach.DOWN  # a velocity goes on from where the landing has led it
        near = asked.r_c.z < ground + CLEAR + _falls(pose)
        return Approach.RAISED if near and place else Approach.AS_ASKED
    if was == Approach.DOWN or pose.r_E.z < ground + TOUCHING:
        return Approach.DOWN
    low = stop(pose.r_E, pose.v_E, limits).r_E.z < ground + LOW
    if not place:
        return Approach.DOWN if low else Approach.AS_ASKED
    slow = hypot(pose.v_E.x, pose.v_E.y) < SLOW
    return Approach.DOWN if low and slow and _over(asked, pose) else Approach.RAISED


_unpack_asked, _unpack_state = unpacker(Setpoint), unpacker(VehicleState)
_unpack_limits = unpacker(PlanLimits)


@kernel
def approach_at(was, asked, age, state, ground, limits):
    """`approach`, for Python: of a setpoint, `age` seconds after it took effect, from its buffer.

    asked : float64[size(Setpoint)].  state : float64[size(VehicleState)].
    limits : float64[size(PlanLimits)].
    """
    now = carried(_unpack_asked(asked), age)
    pose = pose_of(_unpack_state(state))
    return approach(was, now, pose, ground, _unpack_limits(limits))


@kernel
def _is_still(v):
    return v.x == 0.0 and v.y == 0.0 and v.z == 0.0


@kernel
def _over(asked, pose):
    return hypot(asked.r_c.x - pose.r_E.x, asked.r_c.y - pose.r_E.y) < THERE


@kernel
def _into(asked, ground, limits):
    """Whether it lies in the ground, or could not be stopped before it."""
    up = asked.v_c.z + asked.a_c.z > 0.0  # a second on
    late = limits.late_s * maximum(-asked.v_c.z, 0.0)
    return not up and stop(asked.r_c, asked.v_c, limits).r_E.z - late < ground + CLEAR


@kernel
def _falls(pose):
    return AHEAD_S * maximum(-pose.v_E.z, 0.0)


def is_below(r: Vec3, pose: Pose, ground: float) -> bool:
    """Whether a place (m, E) is below a ground (m) that is known (not NaN) where the vehicle is."""
    return r.z < ground + CLEAR and pose.r_E.z >= ground - VALLEY


def landing_from(asked: Setpoint, pose: Pose, ground: float) -> Pose:
    """Where a landing begins: over a place that has all but been reached, else where it is."""
    if asked.v_c != STILL or pose.r_E.z < ground + TOUCHING or not _over(asked, pose):
        return pose._replace(psi=asked.psi_c)
    place = Vec3(asked.r_c.x, asked.r_c.y, pose.r_E.z)
    return Pose(place, Vec3(0.0, 0.0, pose.v_E.z), asked.psi_c)


def raised(asked: Setpoint, pose: Pose, ground: float) -> Setpoint:
    """The place above one in the ground, or so near to it that a fast vehicle would touch it."""
    r = asked.r_c
    low = ground + (ABOVE if r.z < ground + CLEAR else CLEAR)
    return asked._replace(r_c=Vec3(r.x, r.y, max(r.z, low + _falls(pose))))


@kernel
def touches(was, flown, model_z, pose, ground, t_us, meant, anywhere_us, lag_s):
    """The TouchdownState after a look. `flown` : the Setpoint, carried to this moment.

    model_z : velocity up of the reference model, m/s, NaN without one. A vehicle that does as its
    reference model does is not hindered, however fast the setpoint sinks: the model lags behind it,
    by `lag_s`. Where the setpoint is much farther below, the guard leads the model by what the ground
    does to the vehicle, and the model tells nothing.
    meant : whether it is landing; else only a ground that is known can be what is in its way.
    anywhere_us : how long something has to be in its way where the ground is not, unless it was struck:
    stopped as only a ground stops it. Without a model it takes UNLED times as long, since air that rises
    may look like a ground.  lag_s : by which the model lags behind a setpoint that moves, s.
    """
    v, since_us, struck = pose.v_E, was.since_us, was.struck
    if was.done != 0.0:
        rests = flown.level > POSITION  # and does not take off
        # what rises as fast comes more than CLEAR above the ground
        left = not v.z > -FALLING or (rests and not v.z < FALLING)
        return TouchdownState(
            done=select(left, 0.0, 1.0),
            since_us=select(left, math.nan, since_us),
            sank_us=select(left, math.nan, was.sank_us),
            struck=select(left, 0.0, struck),
        )
    left_behind = pose.r_E.z - flown.r_c.z > LEFT_BEHIND - lag_s * flown.v_c.z
    lags = model_z > flown.v_c.z and not left_behind
    down = select(lags, model_z, flown.v_c.z)
    sank_us = select(v.z < SINKS * down, t_us, select(v.z > FALLING, -math.inf, was.sank_us))
    height = pose.r_E.z - ground
    here = -VALLEY < height < TOUCHING
    if math.isnan(since_us):
        struck = select(t_us - sank_us <= STRUCK_US, 1.0, 0.0)
    at_once = here or struck != 0.0
    bounces = not at_once and norm(v) > AT_REST  # the highest point of that is no ground
    # nor is that of a jump, where the vehicle is slow for long while the setpoint sinks away from it
    thrown = sank_us == -math.inf
    # a second on it leads up: a take-off that was asked for on the way down
    rises = flown.v_c.z + flown.a_c.z > 0.0
    if down > -AT_REST or v.z < HINDERED * down or bounces or thrown or rises:
        return TouchdownState(done=0.0, since_us=math.nan, sank_us=sank_us, struck=0.0)
    if math.isnan(since_us):
        since_us = t_us
    elsewhere_us = select(math.isnan(model_z), UNLED * anywhere_us, anywhere_us)
    for_us = select(at_once, HINDERED_US, elsewhere_us)
    done = (here or meant) and t_us - since_us >= for_us
    return TouchdownState(
        done=select(done, 1.0, 0.0), since_us=since_us, sank_us=sank_us, struck=struck
    )


@kernel
def _see_touchdown(buffer, flown, model_z, pose, ground, t_us, meant, f_m, anywhere_us):
    """`touches` on a flat buffer; whether something has changed."""
    was = _unpack_touchdown(buffer)
    now = touches(was, flown, model_z, pose, ground, t_us, meant, anywhere_us, 2.0 / f_m)
    _pack_touchdown(buffer, now)
    return now.done != was.done


def anywhere_us(f_m: float) -> float:
    """For how long (us) something has to be in the way where the ground is not.

    f_m : rad/s, of the reference model: a lazy one lags behind the speed that is asked for.
    """
    return float(ANYWHERE_US) if f_m >= LAZY else float(round(2e6 / f_m))


class TouchdownDetector:
    """Whether a vehicle that is led down has come down."""

    def __init__(self, buffer: Row | None = None) -> None:
        """`buffer`: float64[size(TouchdownState)], to remember in."""
        self.buffer = np.empty(size(TouchdownState)) if buffer is None else buffer
        self.reset()

    def reset(self) -> None:
        """Nothing has been in the way so far."""
        self.buffer[:] = to_buffer(TouchdownState(done=0.0, since_us=math.nan))

    @property
    def done(self) -> bool:
        """Whether it has come down."""
        return bool(self.buffer[_DONE])

    def see(
        self, flown: Setpoint, pose: Pose, ground: float, t_us: int, meant: bool = True,
        f_m: float = 1.0, model_z: float = math.nan,
    ) -> bool:  # fmt: skip
        """One look; whether something has changed. `flown`: carried to this moment.

        `meant`, `f_m`, `model_z`: as in `touches` and `anywhere_us`.
        """
        changed: bool = _see_touchdown(
            self.buffer, flown, model_z, pose, ground, float(t_us), meant, f_m, anywhere_us(f_m)
        )
        return changed


_DONE = column_of(TouchdownState, "done")


def resting(flown: Setpoint, thrust: float) -> Setpoint:
    """Level, on its gear, its rotors pushing with so much (N)."""
    return flown._replace(level=ATTITUDE, tilt_c=STILL, T_c=thrust, psi_dot_c=0.0)
