"""Mode Follow Me: a target that reports where it is, and how the vehicle keeps beside it.

Parameters FLW_TGT_* and what they mean are PX4's: the vehicle stays FLW_TGT_DST away from the
target, at the angle FLW_TGT_FA to its course, at FLW_TGT_HT above home or above the target, and
faces it. It is led there within the limits of modes that lead it, so the guard's promise holds.
Pure. Frames are Earth ENU, units SI, times simulation time in microseconds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import wrap
from fcu.parameters import Parameters
from fcu.vehicle.plans import STILL, PlanLimits, Pose, at

FOLLOW_US = 50_000  # between two setpoints that are laid down
KNOWN_US = 3_000_000  # for so long a report counts, as PX4's
AHEAD_S = 1.5  # for so long a target is taken to move on as it was reported
MOVES = 0.5  # m/s, from which a target has a course
CLOSES = 0.8  # 1/s: distance to the place beside the target becomes speed
NEAR = 1.0  # m across: nearer to the target there is no way to face it
LOWEST = 1.0  # m above home: not lower, wherever the target says that it is, as PX4's
TRACKS_HEIGHT = 2.0  # FLW_TGT_ALT_M: height above the target, else above home


class Report(NamedTuple):
    """One report of a target."""

    r_E: Vec3  # m; z NaN: without a height
    v_E: Vec3 | None  # m/s; None: not said


class Target:
    """A target as its reports have it."""

    def __init__(self) -> None:
        self._last: Report | None = None
        self._heard_us = 0
        self._v = STILL
        self._says_speed = False  # it has told of a speed: 0 is one too

    def take(self, report: Report, at_us: int) -> None:
        """Take a report."""
        last, since_s = self._last, (at_us - self._heard_us) * 1e-6
        told = report.v_E
        self._says_speed |= told is not None and (told.x != 0.0 or told.y != 0.0)
        if told is not None and self._says_speed:
            self._v = told
        elif last is None or at_us - self._heard_us > KNOWN_US:
            self._v = STILL
        elif since_s > 0.0:
            moved = report.r_E - last.r_E
            self._v = (1.0 / since_s) * Vec3(moved.x, moved.y, 0.0)
        else:
            return
        self._last, self._heard_us = report, at_us

    def known(self, t_us: int) -> bool:
        """Return true if the target has been heard of late."""
        return self._last is not None and t_us - self._heard_us <= KNOWN_US

    def at(self, t_us: int) -> tuple[Vec3, Vec3]:
        """Place and velocity (m, m/s) at a time, while it is known."""
        assert self._last is not None
        age, v = (t_us - self._heard_us) * 1e-6, Vec3(self._v.x, self._v.y, 0.0)
        r: Vec3 = self._last.r_E + min(age, AHEAD_S) * v
        return r, v if age <= AHEAD_S else STILL


class Follower:
    """The way beside a target, step by step, from the mode's begin on."""

    def __init__(self, p: Parameters) -> None:
        self._p = p
        self._side: float | None = None  # rad, of the way from the target to the vehicle
        self._psi: float | None = None

    def setpoint(
        self, target: Target, now: Setpoint, pose: Pose, home: Vec3, led: PlanLimits, t_us: int
    ) -> Setpoint:
        """The setpoint of the next FOLLOW_US. `now`: the one flown now, to go on from."""
        p, dt = self._p, FOLLOW_US * 1e-6
        psi = now.psi_c if self._psi is None else self._psi
        if not target.known(t_us):
            return _moved(now, STILL, led, dt, psi)
        r, v = target.at(t_us)
        away = Vec3(pose.r_E.x - r.x, pose.r_E.y - r.y, 0.0)
        fastest = min(p["FLW_TGT_MAX_VEL"], led.cruise)
        side = self._beside(away, v, pose, fastest, dt)
        distance = p["FLW_TGT_DST"]
        tracks = p["FLW_TGT_ALT_M"] == TRACKS_HEIGHT and not math.isnan(r.z)
        height = (r.z if tracks else home.z) + p["FLW_TGT_HT"]
        place = Vec3(
            r.x + distance * math.cos(side),
            r.y + distance * math.sin(side),
            max(height, home.z + LOWEST),
        )
        wanted = _towards(place - now.r_c, v, fastest, led)
        rate = min(math.radians(p["MPC_MAN_Y_MAX"]), p.pace.yaw_rate_max)
        turn = 0.0
        if math.hypot(away.x, away.y) > NEAR:
            error = float(wrap(math.atan2(-away.y, -away.x) - psi))
            turn = min(rate, max(-rate, error / dt))
        self._psi = float(wrap(psi + dt * turn))
        return _moved(now, wanted, led, dt, psi)._replace(psi_dot_c=turn)

    def _beside(self, away: Vec3, v: Vec3, pose: Pose, fastest: float, dt: float) -> float:
        """The side of the target on which the vehicle stays, rad, turned to at a limited rate.

        Without a course it is the side where the vehicle is.
        """
        if self._side is None:
            far = math.hypot(away.x, away.y) > NEAR
            self._side = math.atan2(away.y, away.x) if far else float(wrap(pose.psi + math.pi))
        if math.hypot(v.x, v.y) > MOVES:  # FLW_TGT_FA is clockwise from the course
            wanted = math.atan2(v.y, v.x) - math.radians(self._p["FLW_TGT_FA"])
            most = fastest / self._p["FLW_TGT_DST"] * dt
            self._side += min(most, max(-most, float(wrap(wanted - self._side))))
        return self._side


def _approach(a: float, x: float) -> float:
    """The speed (m/s) towards a place x (m) away: close by CLOSES x, then one that `a` stops in time."""
    knee = a / CLOSES
    if CLOSES * x <= knee:
        return CLOSES * x
    return math.sqrt(2.0 * a * x - knee * knee)


def _towards(away: Vec3, v: Vec3, fastest: float, led: PlanLimits) -> Vec3:
    """The velocity (m/s) that goes to a place that moves at v, and stops there in time."""
    aside = math.hypot(away.x, away.y)
    speed = _approach(0.5 * led.acceleration, aside)
    k = speed / aside if aside > 1e-9 else 0.0
    x, y = k * away.x + v.x, k * away.y + v.y
    size = math.hypot(x, y)
    if size > fastest:
        x, y = x * fastest / size, y * fastest / size
    climb = _approach(0.5 * led.acceleration_up, abs(away.z))
    return Vec3(x, y, min(led.up, climb) if away.z > 0.0 else -min(led.down, climb))


def _moved(now: Setpoint, wanted: Vec3, led: PlanLimits, dt: float, psi: float) -> Setpoint:
    """The setpoint that takes up a velocity within the limits of acceleration."""
    x, y, z = wanted - now.v_c
    size = math.hypot(x, y)
    k = min(1.0, led.acceleration * dt / size) if size > 1e-9 else 0.0
    most = led.acceleration_up * dt
    a = (1.0 / dt) * Vec3(k * x, k * y, min(most, max(-most, z)))
    return at(now.r_c, psi, v=now.v_c, a=a)
