"""A plan of steps that the vehicle flies in mode Mission: which step is next, and what was reached.

Pure. How a step is flown is `mission_flight`. A plan is replaced whole or not at all. Frame: Earth
ENU, SI.
"""

from __future__ import annotations

import math
from collections import ChainMap, deque
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from enum import Enum, auto
from typing import NamedTuple

from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.vehicle.fence import Way

KEPT = 64  # reached steps that are remembered until somebody tells them
LOOKED = 200  # steps without a place that a look ahead goes through, at most


class Do(Enum):
    """All that a step may have the vehicle do."""

    GO_TO = auto()
    TAKE_OFF = auto()
    LAND = auto()
    RETURN = auto()
    LOITER = auto()  # until something else is asked for
    CIRCLE = auto()
    WAIT = auto()
    TURN = auto()
    SPEED = auto()
    JUMP = auto()
    NEAR = auto()  # on the way to the next place, until that is as near as `value`, m
    HOME = auto()
    LOOK_AT = auto()
    LOOK_AHEAD = auto()
    LANDING_BEGINS = auto()  # the mark of DO_LAND_START
    NOTHING = auto()  # of a camera, a gimbal, a servo: passed over


# Steps for which a vehicle that stands on the ground takes off first.
FLOWN = frozenset({Do.GO_TO, Do.TAKE_OFF, Do.LOITER, Do.CIRCLE})
# Steps that take no time, and that a look ahead for the next place goes through.
AT_ONCE = frozenset({Do.SPEED, Do.JUMP, Do.LOOK_AT, Do.LOOK_AHEAD, Do.LANDING_BEGINS, Do.NOTHING})


class Step(NamedTuple):
    """One item of a plan, as the vehicle flies it. What a step does not need is left as it is."""

    do: Do
    place: Vec3 | None = None  # m, E; None: where it is
    above_home: bool = False  # z of `place` is a height above home
    psi: float | None = None  # rad, heading there; None: along the way
    hold_s: float = 0.0
    stops: bool = False  # comes to rest there, however short it holds
    radius: float = 0.0  # m, in which the place counts as reached (0: NAV_ACC_RAD), or of a circle
    value: float = 0.0  # m/s, rad, turns or m
    times: int = 0  # of a jump; below 0: without end
    to: int = 0  # the step that a jump leads to
    relative: bool = False  # of a turn: from the heading that the vehicle has
    way: int = 0  # of a turn: 1 clockwise, -1 counter-clockwise, 0 the shorter one


class Next(NamedTuple):
    """The place that follows a step, and the cruise speed on the way there (None: as before)."""

    step: Step
    cruise: float | None
    short: float = 0.0  # m before the place: the vehicle may have to come to rest there


class Mission:
    """A plan and how far it is flown."""

    def __init__(self) -> None:
        self.steps: tuple[Step, ...] = ()
        self.current = 0  # the step to do next, or that is being done
        self.lands = False  # the step that is flown brings the vehicle down
        self.hands_over = False  # the step that is flown is the mode Return
        self.reached: deque[int] = deque(maxlen=KEPT)  # steps done that nobody has told of yet
        self.last_reached = -1
        self.events: list[Told] = []  # to be told at the next tick
        self.begun = False
        self.is_complete = False
        self.changed = 0  # counts what MISSION_CURRENT would tell anew
        self._jumped: dict[int, int] = {}

    def replace(self, steps: tuple[Step, ...]) -> None:
        """Take another plan, from its first step."""
        self.steps = steps
        self.restart()

    def restart(self) -> None:
        """Begin with the first step, with no jump made."""
        self.current, self.last_reached = 0, -1
        self.lands = self.hands_over = self.begun = self.is_complete = False
        self._jumped = {}
        self.changed += 1

    def set_current(self, step: int) -> None:
        """Go on with this step."""
        self.current, self.is_complete = step, False
        self.lands = self.hands_over = False
        self.changed += 1

    def done(self) -> None:
        """The current step is done: on to the next."""
        self.last_reached = self.current
        self.reached.append(self.current)
        self.current = self._after(self.current, self._jumped)
        self.changed += 1

    def complete(self) -> None:
        """All steps are done."""
        self.current = len(self.steps)
        self.is_complete = True
        self.changed += 1

    def _after(self, index: int, jumped: MutableMapping[int, int]) -> int:
        """The step behind `index`, whose jumps are counted in `jumped`."""
        step = self.steps[index]
        if step.do is not Do.JUMP:
            return index + 1
        done = jumped.get(index, 0)
        if 0 <= step.times <= done:
            return index + 1
        jumped[index] = done + 1 if step.times >= 0 else 0
        return step.to

    def ahead(self) -> Next | None:
        """The place behind the current step, if the vehicle need not stop before. Else None."""
        cruise, short = None, 0.0
        for step in self._to_come():
            if step.do in (Do.GO_TO, Do.LOITER):
                return Next(step, cruise, short)
            if step.do is Do.NEAR:
                short = short or step.value
            elif (
                (short == 0.0 and step.do not in AT_ONCE)
                or step.do in FLOWN
                or step.do in (Do.LAND, Do.RETURN)
            ):
                return None
            elif step.do is Do.SPEED and short == 0.0:
                cruise = step.value
        return None

    def next_place(self) -> Step | None:
        """The next step behind the current one that leads somewhere. None: a return comes before, or the end."""
        for step in self._to_come():
            if leads(step):
                return step
            if step.do is Do.RETURN:
                return None
        return None

    def _to_come(self) -> Iterator[Step]:
        """The steps behind the current one, as they will be flown, some of them."""
        jumped: ChainMap[int, int] = ChainMap({}, self._jumped)  # `_jumped` is left as it is
        index = self.current
        for _ in range(LOOKED):
            index = self._after(index, jumped)
            if index >= len(self.steps):
                return
            yield self.steps[index]

    @property
    def landing(self) -> int | None:
        """The step that marks the begin of a landing. None without one."""
        marks = (i for i, step in enumerate(self.steps) if step.do is Do.LANDING_BEGINS)
        return next(marks, None)


def placed(step: Step, home: Vec3) -> Vec3 | None:
    """The place of a step, m, E, with home where it is now. Z may be NaN: as it is."""
    if step.place is None:
        return None
    r = step.place
    return Vec3(r.x, r.y, r.z + home.z) if step.above_home else r


def first_place(steps: tuple[Step, ...], begin: int = 0) -> int | None:
    """The first step from `begin` on that leads somewhere."""
    found = (i for i in range(begin, len(steps)) if leads(steps[i]))
    return next(found, None)


def leads(step: Step) -> bool:
    """Tell whether the vehicle flies to the place of a step."""
    return step.place is not None and step.do not in (Do.LOOK_AT, Do.HOME)


def outside(
    steps: tuple[Step, ...], home: Vec3, first_outside: Callable[[Sequence[Way]], int | None]
) -> tuple[int, Told] | None:
    """The first step whose place, or the straight way to it, is not clear, and why. None: none.

    Ways of jumps are looked at too. The first step is looked at alone: where the vehicle comes from is
    not known. home : m, E, with which heights above home are placed.  first_outside : of a Fence.
    """
    at: list[Vec3 | None] = []  # of each step, if it leads somewhere
    led_by: list[Vec3 | None] = []  # the last place before each step
    last: Vec3 | None = None
    left: Vec3 | None = None
    ways: list[tuple[int, Way]] = []
    for number, step in enumerate(steps):
        led_by.append(left)
        at.append(None)
        if leads(step):
            place = placed(step, home)
            assert place is not None
            before = home if last is None else last
            x, y = (place.x, place.y) if math.isfinite(place.x) else (before.x, before.y)
            here = Vec3(x, y, place.z if math.isfinite(place.z) else before.z)
            if step.do is Do.LAND and last is not None:
                here = Vec3(x, y, last.z)
            ways.append((number, Way(here if last is None else last, here)))
            if step.do is Do.CIRCLE:
                ways.append((number, Way(here, here, abs(step.radius))))
            last = left = at[number] = here
        elif step.do is Do.RETURN:
            last = None  # from where the way goes on, only the flight knows
    ways += _jumps(steps, at, led_by)
    crossing = first_outside([way for _, way in ways])
    if crossing is None:
        return None
    number, way = ways[crossing]
    if first_outside([Way(way.end, way.end)]) is not None:
        return number, Told(Code.PLACE_OUTSIDE)
    return number, Told(Code.CIRCLE_OUTSIDE if way.radius > 0.0 else Code.WAY_OUTSIDE)


def _jumps(
    steps: tuple[Step, ...], at: list[Vec3 | None], led_by: list[Vec3 | None]
) -> list[tuple[int, Way]]:
    """The ways from the last place before a jump to the first behind it, with the step there."""
    leads_to: list[int | None] = [None] * (len(steps) + 1)  # the first place from each step on
    for number in reversed(range(len(steps))):
        leads_to[number] = leads_to[number + 1] if at[number] is None else number
    ways = []
    for number, step in enumerate(steps):
        if step.do is Do.JUMP:
            before, to = led_by[number], leads_to[step.to]
            place = None if to is None else at[to]
            if before is not None and to is not None and place is not None:
                ways.append((to, Way(before, place)))
    return ways


def is_finite(r: Vec3) -> bool:
    """Tell whether all of a place is known."""
    return all(map(math.isfinite, r))
