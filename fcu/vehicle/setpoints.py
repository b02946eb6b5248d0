"""A script's setpoints: whose are flown, whether they still come, and what each asks for.

Pure: requests and times in, a Setpoint or a reason out. Two clocks: simulation time decides to
the tick; wall time keeps a stream alive that a fast simulation outruns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from fcu.interface.airframe import STANDARD_GRAVITY
from fcu.interface.messages import AttitudeRequest, PositionRequest, Setpoint
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import euler, matrix, wrap
from fcu.laws.setpoint import carried
from fcu.parameters import Parameters
from fcu.vehicle.plans import STILL, Pose, at, length, tilted

APART_US, APART_S = 500_000, 0.5  # of two setpoints that make a stream
SILENT_US = 500_000  # after so long another sender's setpoints count
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
    acceleration: float = STANDARD_GRAVITY  # m/s^2
    across_acceleration: float = math.inf  # m/s^2, by the tilt that is allowed


def script_limits(params: Parameters) -> SetpointLimits:
    """Those of a vehicle with these parameters."""
    return SetpointLimits(
        away=params["MR_SP_DIST"],
        below_home=params["MR_SP_BELOW"],
        across=params["MPC_XY_VEL_MAX"],
        up=params["MPC_Z_VEL_MAX_UP"],
        down=params["MPC_Z_VEL_MAX_DN"],
        yaw_rate=params.pace.yaw_rate_max,
        across_acceleration=tilted(params) if params["MPC_TILTMAX_AIR"] < 45.0 else math.inf,
    )


@dataclass
class Clocks:
    """When something was heard, on both clocks."""

    sim_us: int
    wall_s: float


def is_lost(
    last: Clocks | None, now_us: int, wall_s: float, lost_us: int, sim_only: bool
) -> bool:  # fmt: skip
    """Return true if the last message is older than `lost_us` on both clocks, or there is none.

    sim_only : by simulation time alone.
    """
    if last is None:
        return True
    if now_us - last.sim_us <= lost_us:
        return False
    return sim_only or (wall_s - last.wall_s) * 1e6 > lost_us


@dataclass
class Script:
    """The stream of setpoints of one script at a time."""

    sim_only: bool  # lost by simulation time alone
    changed: Callable[[], None] = field(
        default=lambda: None, repr=False
    )  # called by what changes it
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
        return is_lost(self._last, now_us, wall_s, lost_us, self.sim_only)

    @property
    def heard_us(self) -> float:
        """Simulation time of the last setpoint, us, or -inf before the first."""
        return -math.inf if self._last is None else self._last.sim_us

    def heard(self, owner: Owner, at_us: int, wall_s: float, lost_us: int) -> Told | None:
        """Why setpoints of `owner` do not count now. None if they do. Changes nothing.

        The first sender owns the stream until it is silent for SILENT_US, or lost. The sender of
        the next valid setpoint owns it then.
        """
        silent_us = min(lost_us, SILENT_US)
        if self.owner not in (None, owner) and not self.lost(at_us, wall_s, silent_us):
            assert self.owner is not None
            return Told(Code.ANOTHER_SENDS, self.owner[0])
        return None

    def take(
        self, setpoint: Setpoint, at_us: int, wall_s: float, owner: Owner | None = None
    ) -> None:  # fmt: skip
        """Take a valid setpoint, in effect from `at_us`.

        Its sender owns the stream from now on. `owner` None: the one that owns it.
        """
        if owner not in (None, self.owner):
            self.owner, self._stream, self._last = owner, False, None
        last = self._last
        if last is not None:
            self._stream = at_us - last.sim_us <= APART_US or wall_s - last.wall_s <= APART_S
        self.setpoint, self.since_us = setpoint, at_us
        self._last = Clocks(at_us, wall_s)
        self.changed()

    def keep(self, at_us: int, wall_s: float) -> None:
        """The script speaks, and what it says is not flown: on as before, at a steady velocity."""
        was = self.setpoint
        if was is None or was.level > POSITION:
            return
        self._last = Clocks(at_us, wall_s)
        if was.a_c != STILL:
            now: Setpoint = carried(was, (at_us - self.since_us) * 1e-6)
            self.setpoint, self.since_us = now._replace(a_c=STILL), at_us
        self.changed()

    def forget(self) -> None:
        """A new stream has to begin."""
        self.setpoint, self.owner, self._last, self._stream = None, None, None, False
        self.changed()


def of_position(
    asked: PositionRequest, pose: Pose, home: Vec3, flown: Setpoint, limits: SetpointLimits
) -> tuple[Setpoint, Told | None]:
    """What a request asks for, and what of it was limited.

    `flown`: the setpoint flown now, carried to this moment: what the request leaves out is
    taken from it, each axis for itself. Without a position the reference moves on from where it
    is. Without a velocity too, its velocity changes by the acceleration asked for.
    """
    warning = None
    v_asked = _in_earth(asked.v, asked, pose)
    a_asked = _in_earth(asked.a, asked, pose)

    psi_dot = asked.psi_dot
    if abs(psi_dot) > limits.yaw_rate:
        warning = Told(Code.SETPOINT_TURNS, (abs(psi_dot), limits.yaw_rate))
        psi_dot = math.copysign(limits.yaw_rate, psi_dot)
    psi = flown.psi_c if asked.psi is None else asked.psi
    if asked.psi is not None and asked.along_heading and asked.from_here:
        psi = wrap(pose.psi + psi)

    r_asked = LEFT_OUT if asked.r is None else asked.r
    if asked.from_here:
        r_asked = pose.r_E + _in_earth(asked.r, asked, pose)
    axes = zip(r_asked, v_asked, a_asked, flown.r_c, flown.v_c, strict=True)
    r, v, a = (Vec3(*row) for row in zip(*(_axis(*axis) for axis in axes), strict=True))
    if asked.r is not None:
        lowest = home.z - limits.below_home
        if r_asked.z < lowest:
            warning = Told(Code.SETPOINT_LOW, (home.z - r.z, limits.below_home))
            r = Vec3(r.x, r.y, lowest)
        away = r - pose.r_E
        far = length(away)
        if far > limits.away:
            r = pose.r_E + (limits.away / far) * away
            warning = Told(Code.SETPOINT_FAR, (far, limits.away))
    allowed = _slowed(v, limits)
    if allowed != v:
        warning = Told(Code.SETPOINT_FAST, (length(v), length(allowed)))
        # a velocity that was worked up by an acceleration alone has come to its end
        ends = (
            math.isnan(each) and k != kept
            for each, k, kept in zip(v_asked, v, allowed, strict=True)
        )
        a = Vec3(*(0.0 if end else each for end, each in zip(ends, a, strict=True)))
        v = allowed
    aside = math.hypot(a.x, a.y)
    if aside > limits.across_acceleration:
        k = limits.across_acceleration / aside
        a = Vec3(k * a.x, k * a.y, a.z)
        warning = Told(Code.SETPOINT_HARD, (aside, limits.across_acceleration))
    push = length(a)
    if push > limits.acceleration:
        a = (limits.acceleration / push) * a
        warning = Told(Code.SETPOINT_HARD, (push, limits.acceleration))
    return Setpoint(r_c=r, v_c=v, a_c=a, psi_c=psi, psi_dot_c=psi_dot), warning


LEFT_OUT = Vec3(math.nan, math.nan, math.nan)


def _in_earth(part: Vec3 | None, asked: PositionRequest, pose: Pose) -> Vec3:
    """A vector of a request in Earth axes, NaN where it is left out.

    Ahead and left turn together: along the heading one that is left out beside the other is 0.
    """
    if part is None:
        return LEFT_OUT
    if not asked.along_heading or (math.isnan(part.x) and math.isnan(part.y)):
        return part
    x, y = (0.0 if math.isnan(c) else c for c in part[:2])
    return turned(Vec3(x, y, part.z), pose.psi)


def _axis(r: float, v: float, a: float, r_0: float, v_0: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration on one axis. r_0, v_0 : flown now.

    What is left out (NaN) is gone on from: a velocity goes on from r_0, an acceleration alone from
    v_0 too. An axis of which nothing is asked for is held.
    """
    alone = math.isnan(r) and math.isnan(v) and not math.isnan(a)
    if math.isnan(v):
        v = v_0 if alone else 0.0
    return r_0 if math.isnan(r) else r, v, 0.0 if math.isnan(a) else a


def _slowed(v: Vec3, limits: SetpointLimits) -> Vec3:
    """Within the speeds across, up and down; the direction across is kept."""
    across = math.hypot(v.x, v.y)
    k = limits.across / across if across > limits.across else 1.0
    return Vec3(k * v.x, k * v.y, min(limits.up, max(-limits.down, v.z)))


class Throttle(NamedTuple):
    """The scale of a script's thrust, 0 to 1: straight to hover, and straight from there to full thrust."""

    hover: float  # MPC_THR_HOVER
    T_hover: float  # weight of the believed vehicle, N, at most `hover` of full thrust
    T_max: float  # full thrust, N

    def force(self, throttle: float) -> float:
        """The total thrust of a throttle, N."""
        if throttle <= self.hover:
            return throttle / self.hover * self.T_hover
        above = (throttle - self.hover) / (1.0 - self.hover)
        return self.T_hover + above * (self.T_max - self.T_hover)

    def of(self, T: float) -> float:
        """The throttle of a total thrust, N."""
        if self.T_hover >= T:
            return self.hover * T / self.T_hover
        above = (T - self.T_hover) / (self.T_max - self.T_hover)
        return self.hover + above * (1.0 - self.hover)


def of_attitude(
    asked: AttitudeRequest, flown: Setpoint, throttle: Throttle
) -> tuple[Setpoint | None, Told | None]:
    """The setpoint that a request asks for. None, and why it must not be flown."""
    T = throttle.force(asked.thrust)
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
    now: Setpoint = carried(flown, age_s)
    if now.level > POSITION or length(now.r_c - pose.r_E) > near:
        return here._replace(psi_c=now.psi_c if now.level < RATES else pose.psi)
    return now


def anchored_by_axis(flown: Setpoint | None, age_s: float, pose: Pose, near: float) -> Setpoint:
    """The same, each axis for itself: one that is held stays where it is, however another leads."""
    whole = anchored(flown, age_s, pose, near)
    if flown is None or flown.level > POSITION:
        return whole
    now: Setpoint = carried(flown, age_s)
    close = [abs(r - at) <= near for r, at in zip(now.r_c, pose.r_E, strict=True)]
    r_c = Vec3(
        *(r if is_close else at for r, at, is_close in zip(now.r_c, pose.r_E, close, strict=True))
    )
    v_c = Vec3(
        *(v if is_close else at for v, at, is_close in zip(now.v_c, pose.v_E, close, strict=True))
    )
    return whole._replace(r_c=r_c, v_c=v_c)


def turned(v: Vec3, psi: float) -> Vec3:
    """A vector of the heading frame in Earth axes."""
    c, s = math.cos(psi), math.sin(psi)
    return Vec3(c * v.x - s * v.y, s * v.x + c * v.y, v.z)
