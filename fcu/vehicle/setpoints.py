"""A script's setpoints: whose are flown, whether they still come, and what each asks for.

Pure: requests and times in, a Setpoint or a reason out. Two clocks: simulation time decides to
the tick; wall time keeps a stream alive that a fast simulation outruns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from fcu.interface.messages import AttitudeRequest, PositionRequest, Setpoint
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import euler, matrix, wrap
from fcu.laws.mmrac import reference_model
from fcu.parameters import Parameters
from fcu.vehicle.plans import STILL, Pose, at, length

APART_US, APART_S = 500_000, 0.5  # of two setpoints that make a stream
STANDARD_GRAVITY = 9.80665  # m/s^2
POSITION, ATTITUDE, RATES = 0.0, 1.0, 2.0  # Setpoint.level

Owner = tuple[tuple[int, int], object]  # who sends: system and component, and from where


class SetpointLimits(NamedTuple):
    """Above these a setpoint is flown at the limit, with a warning."""

    away: float  # m from the vehicle
    below_home: float  # m: some land by a setpoint just under the ground
    across: float  # m/s
    up: float  # m/s
    down: float  # m/s
    yaw_rate: float  # rad/s
    acceleration: float = STANDARD_GRAVITY  # m/s^2: a tilt of 45 degrees


def script_limits(params: Parameters) -> SetpointLimits:
    """Those of a vehicle with these parameters."""
    return SetpointLimits(
        away=params["MR_SP_DIST"],
        below_home=params["MR_SP_BELOW"],
        across=params["MPC_XY_VEL_MAX"],
        up=params["MPC_Z_VEL_MAX_UP"],
        down=params["MPC_Z_VEL_MAX_DN"],
        yaw_rate=params.pace.yaw_rate_max,
    )


@dataclass
class Clocks:
    """When something was heard, on both clocks."""

    sim_us: int
    wall_s: float


@dataclass
class Script:
    """The stream of setpoints of one script at a time."""

    sim_only: bool  # lost by simulation time alone
    setpoint: Setpoint | None = None
    since_us: int = 0  # when it takes effect
    refused: int = 0
    owner: Owner | None = None
    _last: Clocks | None = field(default=None, repr=False)
    _stream: bool = field(default=False, repr=False)

    def ready(self, now_us: int, wall_s: float, lost_us: int) -> bool:
        """Whether there is a stream that a vehicle could be flown by."""
        return self._stream and not self.lost(now_us, wall_s, lost_us)

    def lost(self, now_us: int, wall_s: float, lost_us: int) -> bool:
        """Whether the last setpoint is older than `lost_us` (simulation time, and by the wall too)."""
        if self._last is None:
            return True
        if now_us - self._last.sim_us <= lost_us:
            return False
        return self.sim_only or (wall_s - self._last.wall_s) * 1e6 > lost_us

    def deadline_us(self, lost_us: int) -> int:
        """The first microsecond at which the stream may be lost."""
        return self._last.sim_us + lost_us + 1 if self._last is not None else 0

    def heard(self, owner: Owner, at_us: int, wall_s: float, lost_us: int) -> Told | None:
        """Why setpoints of `owner` do not count now; None if they do."""
        if self.owner not in (None, owner) and not self.lost(at_us, wall_s, lost_us):
            assert self.owner is not None
            return Told(Code.ANOTHER_SENDS, self.owner[0])
        if owner != self.owner:
            self.owner, self._stream, self._last = owner, False, None
        return None

    def take(self, setpoint: Setpoint, at_us: int, wall_s: float) -> None:
        """A valid setpoint, in effect from `at_us`."""
        last = self._last
        if last is not None:
            self._stream = at_us - last.sim_us <= APART_US or wall_s - last.wall_s <= APART_S
        self.setpoint, self.since_us = setpoint, at_us
        self._last = Clocks(at_us, wall_s)

    def keep(self, at_us: int, wall_s: float) -> None:
        """The script speaks, and what it says is not flown: on as before, at a steady velocity."""
        was = self.setpoint
        if was is None or was.level > POSITION:
            return
        self._last = Clocks(at_us, wall_s)
        if was.a_c != STILL:
            now: Setpoint = reference_model.carried(was, (at_us - self.since_us) * 1e-6)
            self.setpoint, self.since_us = now._replace(a_c=STILL), at_us

    def forget(self) -> None:
        """A new stream has to begin."""
        self.setpoint, self.owner, self._last, self._stream = None, None, None, False


def of_position(
    asked: PositionRequest, pose: Pose, home: Vec3, flown: Setpoint, limits: SetpointLimits
) -> tuple[Setpoint, Told | None]:
    """What a request asks for, and what of it was limited.

    `flown`: the setpoint flown now, carried to this moment: what the request leaves out is
    taken from it. Without a position the reference moves on from where it is; without a
    velocity too, its velocity changes by the acceleration asked for.
    """
    warning = None
    turn = pose.psi if asked.along_heading else 0.0
    v = STILL if asked.v is None else turned(asked.v, turn)
    a = STILL if asked.a is None else turned(asked.a, turn)

    psi_dot = asked.psi_dot
    if abs(psi_dot) > limits.yaw_rate:
        warning = Told(Code.SETPOINT_TURNS, (abs(psi_dot), limits.yaw_rate))
        psi_dot = math.copysign(limits.yaw_rate, psi_dot)
    psi = flown.psi_c if asked.psi is None else asked.psi
    if asked.psi is not None and asked.along_heading and asked.from_here:
        psi = wrap(pose.psi + psi)

    if asked.r is not None:
        r = asked.r
        if asked.from_here:
            r = pose.r_E + (turned(r, pose.psi) if asked.along_heading else r)
        lowest = home.z - limits.below_home
        if r.z < lowest:
            warning = Told(Code.SETPOINT_LOW, (home.z - r.z, limits.below_home))
            r = Vec3(r.x, r.y, lowest)
        away = r - pose.r_E
        far = length(away)
        if far > limits.away:
            r = pose.r_E + (limits.away / far) * away
            warning = Told(Code.SETPOINT_FAR, (far, limits.away))
    else:
        r = flown.r_c  # its velocity, its acceleration, or its yaw alone
        if asked.v is None and asked.a is not None:
            v = flown.v_c
    allowed = _slowed(v, limits)
    if allowed != v:
        warning = Told(Code.SETPOINT_FAST, (length(v), length(allowed)))
        v = allowed
        if asked.v is None:
            a = STILL
    push = length(a)
    if push > limits.acceleration:
        a = (limits.acceleration / push) * a
        warning = Told(Code.SETPOINT_HARD, (push, limits.acceleration))
    return Setpoint(r_c=r, v_c=v, a_c=a, psi_c=psi, psi_dot_c=psi_dot), warning


def _slowed(v: Vec3, limits: SetpointLimits) -> Vec3:
    """Within the speeds across, up and down; the direction across is kept."""
    across = math.hypot(v.x, v.y)
    k = limits.across / across if across > limits.across else 1.0
    return Vec3(k * v.x, k * v.y, min(limits.up, max(-limits.down, v.z)))


def of_attitude(
    asked: AttitudeRequest, flown: Setpoint, T_max: float
) -> tuple[Setpoint | None, Told | None]:
    """What a request asks for; None, and why it must not be flown."""
    T = asked.thrust * T_max
    if asked.q_EB is None:
        flat = flown._replace(level=RATES, w_c=asked.w_B, T_c=T, tilt_c=STILL, psi_dot_c=0.0)
        return flat, None
    if asked.w_B.x or asked.w_B.y:
        return None, Told(Code.YAW_RATE_ONLY)
    angles = euler(matrix(asked.q_EB))
    lies = flown._replace(
        level=ATTITUDE,
        tilt_c=Vec3(angles.x, angles.y, 0.0),
        psi_c=angles.z,
        psi_dot_c=asked.w_B.z,
        w_c=STILL,
        T_c=T,
    )
    return lies, None


def anchored(flown: Setpoint | None, age_s: float, pose: Pose, near: float) -> Setpoint:
    """The setpoint flown now, as one to go on from: where the vehicle is, if that is elsewhere."""
    here = at(pose.r_E, pose.psi, v=pose.v_E)
    if flown is None:
        return here
    now: Setpoint = reference_model.carried(flown, age_s)
    if now.level > POSITION or length(now.r_c - pose.r_E) > near:
        return here._replace(psi_c=now.psi_c if now.level < RATES else pose.psi)
    return now


def turned(v: Vec3, psi: float) -> Vec3:
    """A vector of the heading frame in Earth axes."""
    c, s = math.cos(psi), math.sin(psi)
    return Vec3(c * v.x - s * v.y, s * v.x + c * v.y, v.z)
