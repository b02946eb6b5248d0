"""What each mode flies that nobody streams setpoints to, and following it in time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import chain

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.parameters import Parameters
from fcu.vehicle import guidance
from fcu.vehicle.guidance import STILL, Limits, Piece
from fcu.vehicle.modes import Mode
from fcu.vehicle.script import Pose

NEVER_US = 2**62
HOME_CLOSE = 2.0  # m across: no need to climb for the way home
SLOW_BELOW = 5.0  # m above home: from there a landing is slow


class Leader:
    """Which piece of a plan is flown, and until when. Times: simulation time, us."""

    def __init__(self) -> None:
        self.setpoint: Setpoint | None = None
        self.since_us = 0  # when the setpoint took effect
        self.until_us = NEVER_US
        self._plan: Iterator[Piece] = iter(())
        self._ends = False

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


def limits(params: Parameters, cruise: float | None) -> Limits:
    """How fast it is led. `cruise`: m/s as told; None: MPC_XY_CRUISE."""
    p = params
    return Limits(
        min(p["MPC_XY_CRUISE"] if cruise is None else cruise, p["MPC_XY_VEL_MAX"]),
        p["MPC_Z_VEL_MAX_UP"],
        p["MPC_Z_VEL_MAX_DN"],
        p["MPC_ACC_HOR"],
        p["MPC_ACC_UP_MAX"],
    )


def settle_s(params: Parameters) -> float:
    """Time in which the vehicle catches up with a setpoint that has come to rest, s."""
    return 4.0 / params["MR_F_M"]


def take_off(here: Pose, height: float, led: Limits, settle: float) -> list[Piece]:
    """Straight up by `height` (m), from rest."""
    up = here.r_E + Vec3(0.0, 0.0, height)
    return guidance.through(here.r_E, STILL, [up], here.psi, led, settle)


def asks_too_much(mode: Mode, p: Parameters) -> str:
    """Why what a mode would fly, as its parameters are, is more than the vehicle is led with."""
    if mode is not Mode.FIGURE_EIGHT:
        return ""
    size, most = (p["REF_8_LEN"], p["REF_8_WIDTH"]), p["MPC_ACC_HOR"]
    asks = guidance.eight_acceleration(size, p["REF_8_SPEED"])
    return f"it asks {asks:.1f} m/s^2 (MPC_ACC_HOR {most:g})" if asks > most else ""


def plan_of(mode: Mode, here: Pose, home: Vec3, p: Parameters, led: Limits) -> Iterable[Piece]:
    """What a mode flies from here, keeping its yaw."""
    r, v, psi = here
    if mode is Mode.LAND:
        return guidance.descent(r, v, psi, home.z + SLOW_BELOW, p["MPC_LAND_SPEED"], led)
    if mode is Mode.RETURN:
        return guidance.through(r, v, _way_home(here, home, p, led), psi, led, settle_s(p))
    if mode is Mode.TAKEOFF:
        return take_off(here, p["MIS_TAKEOFF_ALT"], led, settle_s(p))
    if mode in (Mode.STEP, Mode.FIGURE_EIGHT):
        stopping, rest = guidance.brake(r, v, psi, led)
        return chain(stopping, _generated(mode, rest, psi, p))
    return guidance.through(r, v, [], psi, led)


def _generated(mode: Mode, r: Vec3, psi: float, p: Parameters) -> Iterator[Piece]:
    if mode is Mode.STEP:
        away = Vec3(p["REF_STEP_E"], p["REF_STEP_N"], p["REF_STEP_U"])
        return guidance.steps(r, away, p["REF_STEP_T"], psi)
    return guidance.figure_eight(r, (p["REF_8_LEN"], p["REF_8_WIDTH"]), p["REF_8_SPEED"], psi)


def _way_home(here: Pose, home: Vec3, p: Parameters, led: Limits) -> list[Vec3]:
    _, stop = guidance.brake(here.r_E, here.v_E, here.psi, led)
    if math.hypot(stop.x - home.x, stop.y - home.y) < HOME_CLOSE:
        return []
    top = max(stop.z, home.z + p["RTL_RETURN_ALT"])
    return [Vec3(stop.x, stop.y, top), Vec3(home.x, home.y, top)]
