"""What is asked for, looked at before it is flown: does its way meet the guard's condition?

With MR_GUARD 2 what does not is refused, with 0 it is warned of; with 1 the law sees to it by
itself, and nobody looks. What the vehicle lays down by itself (takeoff, landing, return, hold,
sticks) is not looked at: it has to get down somehow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fcu.guard.admission import Look, Pace, Way, lack_of, most, way_to
from fcu.guard.parameters import GOVERN, REFUSE
from fcu.interface.messages import Setpoint
from fcu.interface.status_texts import Code, Told, lacks, setpoint_asked
from fcu.kernel.algebra import Vec3
from fcu.parameters import Parameters
from fcu.vehicle.plans import STILL, PlanLimits, Pose, at, brake, length, rest, through

Row = np.ndarray[Any, np.dtype[np.float64]]

WORSE = 1.5  # a moving stream is warned of again when it falls short by so much more
ROUGHLY = 5  # halvings, of what each command costs: a flood of refused ones must not stop the loop
SCALED = tuple(name for name in PlanLimits._fields if name != "late_s")  # of a smaller part
SAME = 0.1  # m, m/s: setpoints closer together than this are told of once


class Shortfall(NamedTuple):
    """A way that misses the condition."""

    short: float  # N, that are missing
    reason: Told
    item: int = -1  # of a plan, from 0


class FeasibilityCheck:
    """Looks ahead for one vehicle."""

    def __init__(self, params: Parameters) -> None:
        self._params = params
        self._looks_ahead = params.flown.guard is not None
        if self._looks_ahead:
            self._look, self._settings = Look(params.guard, params.law), params.settings
        self._told: Setpoint | None = None
        self._told_short = 0.0

    def end(self) -> None:
        """Look at nothing any more: another law flies, of which the condition says nothing."""
        self._looks_ahead, self._told = False, None

    def warm_up(self) -> None:
        """Compile what a look needs."""
        if not self._looks_ahead:
            return
        look = Look(self._params.guard, self._params.law)
        lack_of(look, at(STILL, 0.0), 0.0, np.zeros(9))

    @property
    def pace(self) -> Pace:
        """What the reference model follows; endless without a guard."""
        return self._looks().pace if self._looks_ahead else Pace()

    @property
    def policy(self) -> float:
        """The guard's; without one nobody looks ahead, as where it governs."""
        return self._params.guard.policy if self._looks_ahead else GOVERN

    @property
    def refuses(self) -> bool:
        """Whether what misses the condition is not flown."""
        return self.policy == REFUSE

    @property
    def look(self) -> Look | None:
        """The look at what is asked for. None: nobody looks, as where the guard governs."""
        return None if self.policy == GOVERN else self.look_anyhow

    @property
    def look_anyhow(self) -> Look | None:
        """The same whatever the guard does. None: the law has no condition."""
        return self._looks() if self._looks_ahead else None

    @property
    def refused(self) -> bool:
        """Whether the last setpoint of the script was refused."""
        return self.refuses and self._told is not None

    def short(self, setpoint: Setpoint, reference: Row) -> float:
        """By how much (N) a script's setpoint misses the condition; 0: nothing is to be said.

        reference : float64[9], where the reference model is: r_m, v_m, a_m.
        """
        if self.policy == GOVERN or setpoint.level > 0.0:
            return 0.0
        short = self._looks().short(way_to(setpoint), reference)
        if short == 0.0 and (self.refuses or setpoint.v_c == STILL):
            self._told = None
        return short

    def complaint(self, setpoint: Setpoint, short: float, reference: Row) -> Told | None:
        """What is to be said of a setpoint that misses it; None once the same has been `told`."""
        if self._told is not None and (
            _same(setpoint, self._told) or self._goes_on(setpoint, short)
        ):
            return None
        lack = lack_of(self._looks(), setpoint, short, reference)
        if self.refuses:
            return Told(Code.SETPOINT_REFUSED, (lacks(*lack),))
        return Told(Code.SETPOINT_SHORT, (setpoint_asked(lack.far, lack.speed), short))

    def told(self, setpoint: Setpoint, short: float) -> None:
        """It has been said."""
        self._told, self._told_short = setpoint, short

    def _goes_on(self, setpoint: Setpoint, short: float) -> bool:
        """Whether it is of a moving stream that was warned of, and hardly worse."""
        assert self._told is not None
        moves = STILL not in (setpoint.v_c, self._told.v_c)
        return moves and not self.refuses and short <= WORSE * self._told_short

    def of_move(
        self, here: Pose, to: Vec3, led: PlanLimits, reference: Row, by: Vec3 | None = None
    ) -> Shortfall | None:
        """What a vehicle led from `here` straight to `to` (m, E) lacks; None if nothing.

        by : a place (m, E) on the way, at which it stops.
        """

        def way(part: float) -> Way:
            less = led._replace(**{name: part * getattr(led, name) for name in SCALED})
            return through(here.r_E, here.v_E, [to] if by is None else [by, to], here.psi, less)

        what = Told(Code.WAY_LED, (length(to - here.r_E), led.cruise))
        return self._shortfall(what, way, lambda p: Told(Code.PERCENT_LED, (p,)), reference)

    def of_step(self, here: Pose, away: Vec3, led: PlanLimits, reference: Row) -> Shortfall | None:
        """What a step (m, E) lacks from where the vehicle, led from `here`, stops."""
        r, v, psi = here
        stopping, stop = brake(r, v, psi, led)
        far = length(away)

        def way(part: float) -> Way:
            return [*stopping, rest(stop + part * away, psi)]

        def would_do(part: float) -> Told:
            return Told(Code.METRES_OF_IT, (part * far,))

        return self._shortfall(Told(Code.WAY, (far,)), way, would_do, reference)

    def _shortfall(
        self, what: Told, way_of: Callable[[float], Way], would_do: Callable[[float], Told],
        reference: Row,
    ) -> Shortfall | None:  # fmt: skip
        """way_of : of a part, from 0 to 1, of what was asked for.  would_do : the same, told."""
        if self.policy == GOVERN:
            return None
        short = self._looks().short(way_of(1.0), reference)
        if short == 0.0:
            return None
        part = most(self._looks(), way_of, reference, ROUGHLY) if self.refuses else 0.0
        return Shortfall(short, Told(Code.LACKS, (what, short, would_do(part))))

    def _looks(self) -> Look:
        if self._settings is not self._params.settings:
            self._settings = self._params.settings
            self._look = Look(self._params.guard, self._params.law)
        return self._look


def _same(a: Setpoint, b: Setpoint) -> bool:
    return length(a.r_c - b.r_c) < SAME and length(a.v_c - b.v_c) < SAME
