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
from enum import Enum
from typing import Any

import numpy as np

from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import column_of, slice_of
from fcu.vehicle.plans import STILL, PlanLimits, Pose, brake, length
from fcu.vehicle.setpoints import ATTITUDE, POSITION

Row = np.ndarray[Any, np.dtype[np.float64]]

# standing
STANDS = 0.25  # m/s, of a vehicle at rest
HELD_FOR_US = 500_000  # simulation time
STOOD_US = 100_000  # simulation time: what falls is at rest for a quarter of that
LIGHT = 0.5  # of the thrust in flight
LEARNT = 0.01  # of the thrust of one look: two seconds' worth
AIRBORNE = 0.15  # m above where it stood: in the air whatever the rotors do

_Z, _V = column_of(VehicleState, "r_E.z"), slice_of(VehicleState, "v_E")
_OMEGA = slice_of(VehicleState, "Omega")

# coming down
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


class LandedDetector:
    """Whether it stands on the ground. Unknown (taken for landed) until the first state was seen."""

    def __init__(self, c_T: float, T_first: float) -> None:
        """`c_T`: believed thrust coefficient. `T_first`: thrust (N) expected in flight before one."""
        self._c_T = c_T
        self._T_flight = T_first
        self._since_us: int | None = None
        self._stood_at = math.nan  # height at which it was last seen standing
        self.ground = math.nan  # height (m, E) at which it has stood for a while
        self.landed = True
        self.has_flown = False  # since it was last on the ground for certain

    @property
    def light(self) -> float:
        """Thrust (N) of rotors that do not carry the vehicle, by far."""
        return 0.5 * LIGHT * self._T_flight

    def see(self, state: Row, time_us: int) -> bool:
        """One look, some 50 times a second; whether it is on the ground."""
        Omega, v = state[_OMEGA], state[_V]
        T = self._c_T * float(Omega @ Omega)
        still = float(v @ v) < STANDS * STANDS
        height = float(state[_Z])
        carried = LIGHT * self._T_flight < T  # by its rotors
        if self.landed:
            first = math.isnan(self._stood_at)
            if first:
                self._stood_at = height
            if not still:
                self._since_us = None
            elif self._since_us is None:
                self._since_us = time_us
            elif time_us - self._since_us >= STOOD_US:
                self.ground = self._stood_at
            if height > self._stood_at + AIRBORNE or (first and carried):
                self.landed, self.has_flown, self._since_us = False, True, None
        elif carried or not still:
            self._since_us = None
            if still:  # at rest in the air: what it takes to stay there
                self._T_flight += LEARNT * (T - self._T_flight)
        else:
            self._since_us = time_us if self._since_us is None else self._since_us
            if time_us - self._since_us >= HELD_FOR_US:
                self.landed, self._stood_at = True, height
        return self.landed


class Approach(Enum):
    """How a script's setpoint is flown."""

    AS_ASKED = "as asked"
    RAISED = "raised to above the ground"
    DOWN = "as a landing"


def approach(
    was: Approach, asked: Setpoint, pose: Pose, ground: float, limits: PlanLimits
) -> Approach:
    """How `asked`, carried to this moment, is to be flown.

    `ground`: height at which the vehicle stood, m; NaN if that is not known.
    """
    if asked.level > POSITION or math.isnan(ground) or pose.r_E.z < ground - VALLEY:
        return Approach.AS_ASKED
    if not _into(asked, ground, limits):
        sinking = was is Approach.DOWN and asked.v_c.z < 0.0
        if sinking and asked.r_c.z <= pose.r_E.z + CLEAR:
            return Approach.DOWN  # a velocity goes on from where the landing has led it
        near = asked.r_c.z < ground + CLEAR + _falls(pose)
        return Approach.RAISED if near and asked.v_c == STILL else Approach.AS_ASKED
    if was is Approach.DOWN or pose.r_E.z < ground + TOUCHING:
        return Approach.DOWN
    low = brake(pose.r_E, pose.v_E, pose.psi, limits)[1].z < ground + LOW
    if asked.v_c != STILL:
        return Approach.DOWN if low else Approach.AS_ASKED
    slow = math.hypot(pose.v_E.x, pose.v_E.y) < SLOW
    return Approach.DOWN if low and slow and _over(asked, pose) else Approach.RAISED


def landing_from(asked: Setpoint, pose: Pose, ground: float) -> Pose:
    """Where a landing begins: over a place that has all but been reached, else where it is."""
    if asked.v_c != STILL or pose.r_E.z < ground + TOUCHING or not _over(asked, pose):
        return pose._replace(psi=asked.psi_c)
    place = Vec3(asked.r_c.x, asked.r_c.y, pose.r_E.z)
    return Pose(place, Vec3(0.0, 0.0, pose.v_E.z), asked.psi_c)


def _over(asked: Setpoint, pose: Pose) -> bool:
    return math.hypot(asked.r_c.x - pose.r_E.x, asked.r_c.y - pose.r_E.y) < THERE


def _into(asked: Setpoint, ground: float, limits: PlanLimits) -> bool:
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


class TouchdownDetector:
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
