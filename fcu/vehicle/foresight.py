"""What is asked for, looked at before it is flown: does its way meet the guard's condition?

With MR_GUARD 2 what does not is refused, with 0 it is warned of; with 1 the law sees to it by
itself, and nobody looks. What the vehicle lays down by itself (takeoff, landing, return, hold,
sticks) is not looked at: it has to get down somehow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fcu.guard.admission import Lack, Look, Way, explained, metres, most, newtons, percent, way_to
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.laws.mmrac.parameters import GOVERN, REFUSE
from fcu.parameters import Parameters
from fcu.vehicle import guidance
from fcu.vehicle.guidance import Limits, length
from fcu.vehicle.script import Pose

Row = np.ndarray[Any, np.dtype[np.float64]]

WORSE = 1.5  # a moving stream is warned of again when it falls short by so much more
ROUGHLY = 5  # halvings, of what each command costs: a flood of refused ones must not stop the loop
SAME = 0.1  # m, m/s: setpoints closer together than this are told of once


class Foresight:
    """Looks ahead for one vehicle."""

    def __init__(self, params: Parameters) -> None:
        self._params = params
        self._look = Look(params.law)
        self._told: Setpoint | None = None
        self._told_short = 0.0

    def warm_up(self) -> None:
        """Compile what a look needs."""
        still = Setpoint(guidance.STILL, guidance.STILL, guidance.STILL, 0.0, 0.0)
        Look(self._params.law).short(way_to(still), np.zeros(6))

    @property
    def refuses(self) -> bool:
        """Whether what misses the condition is not flown."""
        return self._params.law.guard.policy == REFUSE

    @property
    def refused(self) -> bool:
        """Whether the last setpoint of the script was refused."""
        return self.refuses and self._told is not None

    def short(self, setpoint: Setpoint, reference: Row) -> float:
        """By how much (N) a script's setpoint misses the condition; 0: nothing is to be said.

        reference : float64[6], where the reference model is: r_m, v_m.
        """
        if self._params.law.guard.policy == GOVERN or setpoint.level > 0.0:
            return 0.0
        short = self._looks().short(way_to(setpoint), reference)
        if short == 0.0 and (self.refuses or setpoint.v_c == guidance.STILL):
            self._told = None
        return short

    def words(self, setpoint: Setpoint, short: float, reference: Row) -> str:
        """What is to be said of a setpoint that misses it; empty once the same has been `told`."""
        if self._told is not None and (
            _same(setpoint, self._told) or self._goes_on(setpoint, short)
        ):
            return ""
        lack = explained(self._looks(), setpoint, short, reference)
        if self.refuses:
            return f"Setpoint refused: {lack}"
        return f"Setpoint at {lack.what}: {newtons(short)} short, may saturate"

    def told(self, setpoint: Setpoint, short: float) -> None:
        """It has been said."""
        self._told, self._told_short = setpoint, short

    def _goes_on(self, setpoint: Setpoint, short: float) -> bool:
        """Whether it is of a moving stream that was warned of, and hardly worse."""
        assert self._told is not None
        moves = guidance.STILL not in (setpoint.v_c, self._told.v_c)
        return moves and not self.refuses and short <= WORSE * self._told_short

    def of_move(self, here: Pose, to: Vec3, led: Limits, reference: Row) -> Lack | None:
        """What a vehicle led from `here` straight to `to` (m, E) lacks; None if nothing."""

        def way(part: float) -> Way:
            less = Limits(*(part * limit for limit in led))
            return guidance.through(here.r_E, here.v_E, [to], here.psi, less)

        what = f"{length(to - here.r_E):.1f} m at {led.cruise:g} m/s"
        return self._lack(what, way, lambda p: percent(p, "speed and acceleration"), reference)

    def of_step(self, here: Pose, away: Vec3, led: Limits, reference: Row) -> Lack | None:
        """What a step (m, E) lacks from where the vehicle, led from `here`, stops."""
        r, v, psi = here
        stopping, rest = guidance.brake(r, v, psi, led)
        far = length(away)

        def way(part: float) -> Way:
            return [*stopping, guidance.rest(rest + part * away, psi)]

        return self._lack(f"{far:.1f} m", way, lambda p: metres(p * far), reference)

    def _lack(
        self, what: str, way_of: Callable[[float], Way], part_of: Callable[[float], str],
        reference: Row,
    ) -> Lack | None:  # fmt: skip
        """way_of : of a part, from 0 to 1, of what was asked for.  part_of : the same in words."""
        if self._params.law.guard.policy == GOVERN:
            return None
        short = self._looks().short(way_of(1.0), reference)
        if short == 0.0:
            return None
        part = most(self._looks(), way_of, reference, ROUGHLY) if self.refuses else 0.0
        return Lack(what, short, part_of(part))

    def _looks(self) -> Look:
        if self._look.params is not self._params.law:
            self._look = Look(self._params.law)
        return self._look


def _same(a: Setpoint, b: Setpoint) -> bool:
    return length(a.r_c - b.r_c) < SAME and length(a.v_c - b.v_c) < SAME


def beside(lack: Lack | None) -> str:
    """What is said of a way that is flown all the same."""
    return "" if lack is None else f", {newtons(lack.short)} short: may saturate"
