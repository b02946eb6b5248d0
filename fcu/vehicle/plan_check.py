"""The condition along a plan, looked at before it is accepted, a little at a time.

The pieces are those that `mission_flight` lays down, in still air and with a vehicle that follows them. What
depends on the flight alone is left out: holds take no time, a jump back is taken once, a circle is flown until it is at
its speed, and the look ends where the vehicle returns or stays for ever. With jumps it also ends after MOST_STEPS. Take-off and descent are left out too, as in
all looks: the vehicle has to get up and down somehow. Pure. Frame: Earth ENU, SI.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from fcu.guard.admission import Look, Tightest
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import to_buffer
from fcu.laws.setpoint import carried
from fcu.vehicle import plans
from fcu.vehicle.mission import FLOWN, Do, Mission, Step, placed
from fcu.vehicle.mission_flight import MissionFlight, Sees
from fcu.vehicle.plans import STILL, Piece, PlanLimits, Pose

TOGETHER = 40  # pieces of one look, at most
AT_A_TIME = 16  # items and pieces that are laid down from one pause to the next
STEPS_AT_A_TIME = 64  # that are made ready for it
STEADY_S = 2.0  # on a circle, at its speed
MOST_STEPS = 4000  # that are looked at: jumps in jumps lead through more than anybody can look at
_PASSED = frozenset({Do.TURN, Do.LOOK_AT, Do.LOOK_AHEAD, Do.HOME, Do.LANDING_BEGINS})


class ItemMargin(NamedTuple):
    """The point of the way to one item at which the condition holds by least."""

    item: int  # from 0
    tightest: Tightest  # `at`: s, from where the plan begins
    far: float = 0.0  # m, of the way that was looked at


class Ground(NamedTuple):
    """The vehicle as a plan finds it, and what it asks of it."""

    pose: Pose
    landed: bool
    home: Vec3
    is_clear: Callable[[Vec3, Vec3], bool]
    limits: Callable[[float | None], PlanLimits]  # of a cruise speed, m/s
    parameter: Callable[[str], float]


def along(
    steps: tuple[Step, ...], begin: Ground, look: Look | None, first: int = 0
) -> Iterator[ItemMargin | None]:
    """Look along a plan. Yields an ItemMargin when one has been found, and None to pause meanwhile.

    An item may have several: of parts of its way.  look : None for a law without a condition: there is nothing to see.
    first : the step that is flown first.
    """
    if look is None:
        return
    flight = _Laid(begin)
    yield from flight.take(steps)
    flight.mission.set_current(first)
    laid: list[Piece] = []
    at_s = 0.0
    last, a = (
        plans.at(begin.pose.r_E, 0.0),
        STILL,
    )  # the end of what was looked at, and how it came there
    for each in flight.pieces():
        if each is None:
            yield None
            continue
        item, piece = each
        laid.append(piece)
        if not flight.is_over(item) and len(laid) < TOGETHER:
            continue
        begins, end = laid[0].setpoint, _end(piece)
        goes_on = plans.length(last.v_c) > plans.SLOW and last.r_c == begins.r_c
        # the acceleration of a piece ends with it: from there the reference model has to come
        reference = np.concatenate([
            to_buffer(part)
            for part in ((last.r_c, last.v_c, a) if goes_on else (begins.r_c, STILL, STILL))
        ])  # fmt: skip
        way = [(part.setpoint, part.for_s) for part in laid]
        found = look.tightest([*way, (end._replace(a_c=STILL), math.inf)], reference)
        far = plans.length(end.r_c - begins.r_c)
        yield ItemMargin(item, found._replace(at=at_s + found.at), far)
        at_s += sum(part.for_s for part in laid)
        last, a, laid = end, piece.setpoint.a_c, []


def _end(piece: Piece) -> Setpoint:
    end: Setpoint = carried(piece.setpoint, piece.for_s)
    return end


class _Laid:
    """The pieces of a plan, each with its item, laid down without a vehicle."""

    def __init__(self, begin: Ground) -> None:
        self._begin = begin
        self._landed = begin.landed
        self._cruise: float | None = None  # m/s
        self._here = begin.pose
        self.mission = Mission()

    def take(self, steps: tuple[Step, ...]) -> Iterator[None]:
        """Take the steps as they are looked at, some from one pause to the next."""
        looked: list[Step] = []
        for number, step in enumerate(steps):
            if number and number % STEPS_AT_A_TIME == 0:
                yield
            looked.append(self._looked(number, step))
        self.mission.replace(tuple(looked))

    def _looked(self, number: int, step: Step) -> Step:
        """The step without what takes time alone.

        A jump back is taken once: what follows the jump, and the steps before it at the speed that they end with, are
        then looked at. A jump ahead without end always skips the steps between.
        """
        if step.do in _PASSED:
            return Step(Do.NOTHING)
        if step.do is Do.JUMP:
            return (
                step
                if step.to > number and step.times < 0
                else step._replace(times=min(1, abs(step.times)))
            )
        if step.do is Do.CIRCLE:
            led = self._begin.limits(None)
            most = math.sqrt(0.5 * led.acceleration * abs(step.radius))
            speed = min(led.cruise, most)
            far = speed * speed / led.acceleration + STEADY_S * speed
            return step._replace(value=min(step.value, far / (2.0 * math.pi * abs(step.radius))))
        return step._replace(hold_s=0.0, psi=None, stops=step.stops or step.hold_s > 0.0)

    def is_over(self, item: int) -> bool:
        """Tell whether the next piece is of another item."""
        return self._next != item

    def pieces(self) -> Iterator[tuple[int, Piece] | None]:
        """All of them, none without end, each one before the next is asked for. None to pause."""
        pending: tuple[int, Piece] | None = None
        for each in self._all():
            if each is None:
                yield None
                continue
            self._next = each[0]
            if pending is not None:
                yield pending
            pending = each
        self._next = -1
        if pending is not None:
            yield pending

    def _all(self) -> Iterator[tuple[int, Piece] | None]:
        mission = self.mission
        laid = paused = 0
        while mission.current < len(mission.steps):
            self._take_off()
            flight = MissionFlight(mission, self._sees(), self._here, cut_s=math.inf)
            for piece in flight.pieces():
                item = mission.current
                if not math.isfinite(piece.for_s):
                    break
                if mission.changed > MOST_STEPS:
                    return
                laid += 1
                if laid + mission.changed >= paused + AT_A_TIME:
                    paused = laid + mission.changed
                    yield None
                if piece.for_s > 0.0:
                    end = _end(piece)
                    self._here = Pose(end.r_c, end.v_c, end.psi_c)
                    if not mission.lands:
                        yield item, piece
            is_landing = mission.lands and item < len(mission.steps)
            if not is_landing or mission.hands_over:
                return
            # down: what is behind the landing begins on the ground
            self._landed, mission.lands = True, False
            begin = self._begin
            z = begin.pose.r_E.z if begin.landed else begin.home.z
            self._here = Pose(self._here.r_E._replace(z=z), STILL, self._here.psi)
            mission.done()

    def _take_off(self) -> None:
        """Be above the ground, at the height to which the next step that flies has the vehicle climb."""
        steps = self.mission.steps[self.mission.current :]
        flown = next((step for step in steps if step.do in FLOWN), None)
        if flown is None or not self._landed:
            return
        here, begin = self._here, self._begin
        z = here.r_E.z + begin.parameter("MIS_TAKEOFF_ALT")
        place = placed(flown, begin.home)
        if place is not None and math.isfinite(place.z):
            z = max(z, place.z)
        self._landed = False
        self._here = Pose(here.r_E._replace(z=z), STILL, here.psi)

    def _sees(self) -> Sees:
        begin = self._begin

        def set_cruise(speed: float) -> None:
            self._cruise = None if speed < 0.0 else speed

        return Sees(
            off=lambda r: 0.0, pose=lambda: Pose(self._here.r_E, STILL, self._here.psi),
            is_landed=lambda: self._landed, home=lambda: begin.home,
            ground=lambda: begin.pose.r_E.z if begin.landed else math.nan,
            is_clear=begin.is_clear,
            limits=lambda cruise: begin.limits(self._cruise if cruise is None else cruise),
            set_cruise=set_cruise, set_home=lambda home: None, light=lambda: 0.0,
            takes_off=lambda: None, parameter=begin.parameter, yaw_rate=lambda: math.inf,
        )  # fmt: skip
