"""A script's setpoints: whose are flown, in which frame they are, and whether they still come.

Pure: messages and times in, a Setpoint or a reason out. Two clocks: simulation time decides to
the tick; wall time keeps a stream alive that a fast simulation outruns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import euler, matrix, wrap
from fcu.laws.mmrac import reference_model
from fcu.mavlink.enums import (
    BODY_FRAMES,
    IGNORE_ACCELERATION,
    IGNORE_ATTITUDE,
    IGNORE_PITCH_RATE,
    IGNORE_POSITION,
    IGNORE_ROLL_RATE,
    IGNORE_SPIN_RATE,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    OFFSET_FRAMES,
    RELATIVE_FRAMES,
)
from fcu.mavlink.enums import Frame as MavFrame
from fcu.mavlink.geodesy import Origin, to_local
from fcu.mavlink.ground_messages import AttitudeSetpointMessage, SetpointMessage, Source
from fcu.vehicle.guidance import STILL, length

APART_US, APART_S = 500_000, 0.5  # of two setpoints that make a stream
STANDARD_GRAVITY = 9.80665  # m/s^2
POSITION, ATTITUDE, RATES = 0.0, 1.0, 2.0  # Setpoint.level


class Refused(ValueError):
    """A setpoint that must not be flown: why."""


class Pose(NamedTuple):
    """Where the vehicle is, for setpoints that are relative to it."""

    r_E: Vec3
    v_E: Vec3
    psi: float


class Frame(NamedTuple):
    """What global and relative positions are measured from."""

    origin: Origin
    home: Vec3


class Limits(NamedTuple):
    """Above these a setpoint is flown at the limit, with a warning."""

    away: float  # m from the vehicle
    below_home: float  # m: some land by a setpoint just under the ground
    across: float  # m/s
    up: float  # m/s
    down: float  # m/s
    yaw_rate: float  # rad/s
    acceleration: float = STANDARD_GRAVITY  # m/s^2: a tilt of 45 degrees


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
    message: SetpointMessage | AttitudeSetpointMessage | None = None  # as it came
    refused: int = 0
    owner: tuple[Source, object] | None = None
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

    def heard(self, owner: tuple[Source, object], at_us: int, wall_s: float, lost_us: int) -> str:
        """Why setpoints of `owner` do not count now; empty if they do."""
        if self.owner not in (None, owner) and not self.lost(at_us, wall_s, lost_us):
            assert self.owner is not None
            return f"{self.owner[0].system}/{self.owner[0].component} is sending them"
        if owner != self.owner:
            self.owner, self._stream, self._last = owner, False, None
        return ""

    def take(
        self, setpoint: Setpoint, message: SetpointMessage | AttitudeSetpointMessage,
        at_us: int, wall_s: float,
    ) -> None:  # fmt: skip
        """A valid setpoint, in effect from `at_us`."""
        last = self._last
        if last is not None:
            self._stream = at_us - last.sim_us <= APART_US or wall_s - last.wall_s <= APART_S
        self.setpoint, self.since_us, self.message = setpoint, at_us, message
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
    message: SetpointMessage, pose: Pose, frame: Frame, flown: Setpoint, limits: Limits
) -> tuple[Setpoint, str]:
    """What a position-target message asks for, and what of it was limited. Raises Refused.

    `flown`: the setpoint flown now, carried to this moment: what is left out of the message is
    taken from it. Without a position the reference moves on from where it is; without a
    velocity too, its velocity changes by the acceleration asked for.
    """
    if message.refusal:
        raise Refused(message.refusal)
    asked, warning = message.setpoint, ""
    has_position = not message.ignores(IGNORE_POSITION)
    has_velocity = not message.ignores(IGNORE_VELOCITY)
    has_acceleration = not message.ignores(IGNORE_ACCELERATION)

    turn = pose.psi if message.frame in BODY_FRAMES else 0.0
    v = turned(asked.v_c, turn) if has_velocity else STILL
    a = turned(asked.a_c, turn) if has_acceleration else STILL

    psi_dot = asked.psi_dot_c
    if abs(psi_dot) > limits.yaw_rate:
        warning = (
            f"Setpoint turns at {abs(psi_dot):.1f} rad/s: flown at {limits.yaw_rate:.1f} rad/s"
        )
        psi_dot = math.copysign(limits.yaw_rate, psi_dot)
    if message.ignores(IGNORE_YAW):
        psi = flown.psi_c
    else:
        psi = asked.psi_c
        if message.frame in OFFSET_FRAMES:
            psi = wrap(pose.psi + psi)

    if has_position:
        r = _position(message, asked.r_c, pose, frame)
        lowest = frame.home.z - limits.below_home
        if r.z < lowest:
            warning = (
                f"Setpoint {frame.home.z - r.z:.0f} m below home: flown as {limits.below_home:g} m"
            )
            r = Vec3(r.x, r.y, lowest)
        away = r - pose.r_E
        far = length(away)
        if far > limits.away:
            r = pose.r_E + (limits.away / far) * away
            warning = f"Setpoint {far:.0f} m away: flown as {limits.away:.0f} m"
    elif has_velocity:
        r = flown.r_c
    elif has_acceleration:
        r, v = flown.r_c, flown.v_c
    else:
        r = flown.r_c  # yaw alone
    allowed = _slowed(v, limits)
    if allowed != v:
        warning = f"Setpoint at {length(v):.1f} m/s: flown at {length(allowed):.1f} m/s"
        v = allowed
        if not has_velocity:
            a = STILL
    push = length(a)
    if push > limits.acceleration:
        a = (limits.acceleration / push) * a
        warning = f"Setpoint at {push:.0f} m/s^2: flown at {limits.acceleration:.0f} m/s^2"
    return Setpoint(r, v, a, psi, psi_dot), warning


def _slowed(v: Vec3, limits: Limits) -> Vec3:
    """Within the speeds across, up and down; the direction across is kept."""
    across = math.hypot(v.x, v.y)
    k = limits.across / across if across > limits.across else 1.0
    return Vec3(k * v.x, k * v.y, min(limits.up, max(-limits.down, v.z)))


def of_attitude(message: AttitudeSetpointMessage, flown: Setpoint, T_max: float) -> Setpoint:
    """What an attitude-target message asks for. Raises Refused."""
    if message.refusal:
        raise Refused(message.refusal)
    T = message.thrust * T_max
    if message.type_mask & IGNORE_ATTITUDE:
        return flown._replace(level=RATES, w_c=message.w_B, T_c=T, tilt_c=STILL, psi_dot_c=0.0)
    w = message.w_B
    if (w.x and not message.type_mask & IGNORE_ROLL_RATE) or (
        w.y and not message.type_mask & IGNORE_PITCH_RATE
    ):
        raise Refused("attitude allows a yaw rate only")
    angles = euler(matrix(message.q_EB))
    return flown._replace(
        level=ATTITUDE,
        tilt_c=Vec3(angles.x, angles.y, 0.0),
        psi_c=angles.z,
        psi_dot_c=0.0 if message.type_mask & IGNORE_SPIN_RATE else w.z,
        w_c=STILL,
        T_c=T,
    )


def anchored(flown: Setpoint | None, age_s: float, pose: Pose, near: float) -> Setpoint:
    """The setpoint flown now, as one to go on from: where the vehicle is, if that is elsewhere."""
    here = Setpoint(pose.r_E, pose.v_E, STILL, pose.psi, 0.0)
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


def _position(message: SetpointMessage, r: Vec3, pose: Pose, frame: Frame) -> Vec3:
    if message.geodetic is not None:
        lat, lon, alt = message.geodetic
        if message.frame in RELATIVE_FRAMES:
            alt += frame.origin.alt_m + frame.home.z
        return to_local(frame.origin, lat, lon, alt)
    place = r
    if message.frame == MavFrame.LOCAL_OFFSET_NED:
        place = pose.r_E + r
    elif message.frame in OFFSET_FRAMES:
        place = pose.r_E + turned(r, pose.psi)
    return place
