"""Near the ground: how a script's setpoint in it is flown, and what is flown on it.

Against the friction of the gear the loops of position wind up and tip the vehicle over. So a
vehicle that has come down is kept level with light rotors, and nothing leads it aside there
or down faster than a landing: a place in the ground is gone to above it, what moves into the
ground is stopped before it, and from there the vehicle lands where it is, until a setpoint
leads up again. Pure. Frames: Earth ENU; SI; times are simulation time in microseconds.
"""

from __future__ import annotations

import math
from enum import Enum

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.vehicle.guidance import STILL, Limits, brake, length
from fcu.vehicle.script import ATTITUDE, POSITION, Pose

CLEAR = 0.05  # m above where it stood: lower is in the ground
TOUCHING = 0.1  # m
VALLEY = 0.5  # m below where it stood: the ground is another one here, and not known
HINDERED = 0.2  # of the speed down that is asked for: something is in the way
HINDERED_US, ANYWHERE_US = 60_000, 500_000  # for so long where the ground is, and elsewhere
LAZY = 0.5  # rad/s, f_m below which the reference model is slow to take up a speed
AT_REST, FALLING = 0.25, 1.0  # m/s
LATE_S = 0.15  # after which the guard has taken up a deceleration that begins at once
ABOVE = 0.5  # m: how high a place in the ground is gone to
AHEAD_S = 0.5  # of its speed down: as much higher a place near the ground is aimed at
LOW = 1.0  # m: from here it may land
THERE, SLOW = 0.5, 0.5  # m, m/s across: as near to a place, and as still, as it has to be to land


class Way(Enum):
    """How a script's setpoint is flown."""

    AS_ASKED = "as asked"
    RAISED = "raised to above the ground"
    DOWN = "as a landing"


def way(was: Way, asked: Setpoint, pose: Pose, ground: float, limits: Limits) -> Way:
    """How `asked`, carried to this moment, is to be flown.

    `ground`: height at which the vehicle stood, m; NaN if that is not known.
    """
    if asked.level > POSITION or math.isnan(ground) or pose.r_E.z < ground - VALLEY:
        return Way.AS_ASKED
    if not _into(asked, ground, limits):
        sinking = was is Way.DOWN and asked.v_c.z < 0.0
        if sinking and asked.r_c.z <= pose.r_E.z + CLEAR:
            return Way.DOWN  # a velocity goes on from where the landing has led it
        near = asked.r_c.z < ground + CLEAR + _falls(pose)
        return Way.RAISED if near and asked.v_c == STILL else Way.AS_ASKED
    if was is Way.DOWN or pose.r_E.z < ground + TOUCHING:
        return Way.DOWN
    low = brake(pose.r_E, pose.v_E, pose.psi, limits)[1].z < ground + LOW
    if asked.v_c != STILL:
        return Way.DOWN if low else Way.AS_ASKED
    slow = math.hypot(pose.v_E.x, pose.v_E.y) < SLOW
    return Way.DOWN if low and slow and _over(asked, pose) else Way.RAISED


def landing_from(asked: Setpoint, pose: Pose, ground: float) -> Pose:
    """Where a landing begins: over a place that has all but been reached, else where it is."""
    if asked.v_c != STILL or pose.r_E.z < ground + TOUCHING or not _over(asked, pose):
        return pose._replace(psi=asked.psi_c)
    place = Vec3(asked.r_c.x, asked.r_c.y, pose.r_E.z)
    return Pose(place, Vec3(0.0, 0.0, pose.v_E.z), asked.psi_c)


def _over(asked: Setpoint, pose: Pose) -> bool:
    return math.hypot(asked.r_c.x - pose.r_E.x, asked.r_c.y - pose.r_E.y) < THERE


def _into(asked: Setpoint, ground: float, limits: Limits) -> bool:
    """Whether it lies in the ground, or could not be stopped before it."""
    up = asked.v_c.z + asked.a_c.z > 0.0  # a second on
    late = LATE_S * max(0.0, -asked.v_c.z)
    return not up and brake(asked.r_c, asked.v_c, asked.psi_c, limits)[1].z - late < ground + CLEAR


def raised(asked: Setpoint, pose: Pose, ground: float) -> Setpoint:
    """The place above one in the ground, or so near to it that a fast vehicle would touch it."""
    r = asked.r_c
    low = ground + (ABOVE if r.z < ground + CLEAR else CLEAR)
    return asked._replace(r_c=Vec3(r.x, r.y, max(r.z, low + _falls(pose))))


def _falls(pose: Pose) -> float:
    return AHEAD_S * max(0.0, -pose.v_E.z)


class Touchdown:
    """Whether a vehicle that is led down has come down."""

    def __init__(self) -> None:
        self.done = False
        self._since_us: int | None = None

    def see(
        self, flown: Setpoint, pose: Pose, ground: float, t_us: int, meant: bool = True,
        f_m: float = 1.0,
    ) -> bool:  # fmt: skip
        """One look; whether something has changed. `flown`: carried to this moment.

        `meant`: it is landing; else only a ground that is known can be what is in its way.
        f_m : rad/s, of the reference model: a lazy one lags behind the speed that is asked for.
        """
        v = pose.v_E
        if self.done:
            self.done = v.z > -FALLING  # it was a gust
            return not self.done
        if flown.v_c.z > -AT_REST or v.z < HINDERED * flown.v_c.z:
            self._since_us = None
            return False
        self._since_us = t_us if self._since_us is None else self._since_us
        here = -VALLEY < pose.r_E.z - ground < TOUCHING
        anywhere_us = ANYWHERE_US if f_m >= LAZY else round(2e6 / f_m)
        for_us = HINDERED_US if here else anywhere_us
        there = here or (meant and length(v) < AT_REST)
        self.done = there and t_us - self._since_us >= for_us
        return self.done


def resting(flown: Setpoint, thrust: float) -> Setpoint:
    """Level, on its gear, its rotors pushing with so much (N)."""
    return flown._replace(level=ATTITUDE, tilt_c=STILL, T_c=thrust, psi_dot_c=0.0)
