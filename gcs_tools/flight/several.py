"""Many flights of laws alone, eight at a time on each core where that can be: the rows of `law_alone.fly`.

Flights that share a law, a control rate and the number of plant steps in a tick are flown side by side
in lanes (`lane_flights`). One by one fly those that find nobody to share with, those of a law that
cannot be compiled for lanes, and those of lanes that part: that take different branches of a law which
branches on data. Rows are the same bits either way; `Flown.in_lanes` says which it was.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from fcu.kernel.buffers import to_buffer
from fcu.kernel.compile import is_cached
from fcu.kernel.lanes import WIDTH
from fcu.kernel.rows import column_of
from fcu.laws.loader import LawError
from gcs_tools.flight import law_alone
from gcs_tools.flight.lane_flights import EVERYTHING, REFUSED, Group, Keep
from gcs_tools.flight.scenario import Scenario
from sitl_plant.physics import dynamics
from sitl_plant.physics.types import PlantRecord

__all__ = [
    "EVERYTHING",
    "Flown",
    "Keep",
    "each",
    "fly",
    "groups",
    "is_compiled",
    "repays",
    "warm_up",
]

Rows = np.ndarray[Any, np.dtype[np.float64]]

MANY = 2000  # flights, from which lanes repay that they are compiled first

_ENDED = column_of(PlantRecord, "ended")
# laws that cannot be compiled for lanes: which, and whether with settings that are alike
_never: set[tuple[str, bool]] = set()


class Flown(NamedTuple):
    """One flight: what was asked for of its rows, and how it ended."""

    plant: Rows  # (n, columns), of PlantRecord
    law: Rows  # of the law's Tick
    ticks: int  # that the law flew
    ended: int  # dynamics.FLYING, DIVERGED or CRASHED
    in_lanes: bool  # beside others; else by itself


def fly(scenes: Sequence[Scenario], keep: Keep = EVERYTHING, width: int = WIDTH) -> list[Flown]:
    """Fly each of the scenes; the result of each, in their order. On one core, without the GIL.

    width : of the lanes, 8 or 4: what suits this machine. Raises LawError.
    """
    found = dict(each(scenes, keep, width))
    for flown in found.values():
        if isinstance(flown, LawError):
            raise flown
    return [flown for _, flown in sorted(found.items()) if isinstance(flown, Flown)]


def each(
    scenes: Sequence[Scenario], keep: Keep = EVERYTHING, width: int = WIDTH, lanes: bool = True
) -> Iterator[tuple[int, Flown | LawError]]:
    """Number and result of each of the scenes, group by group, in any order: what goes wrong is its own.

    lanes : whether to fly in them at all.
    """
    for group in groups(scenes, width) if lanes else [[i] for i in range(len(scenes))]:
        beside = _beside([scenes[i] for i in group], keep, width) if len(group) > 1 else {}
        for at, i in enumerate(group):
            try:
                yield i, beside.get(at) or by_itself(scenes[i], keep)
            except LawError as error:
                yield i, error


def repays(scene: Scenario, n: int) -> bool:
    """Whether lanes are sooner for `n` flights such as this: they are compiled, or it is worth it."""
    return not scene.legs and (n >= MANY or is_compiled(scene.flown.package))


@cache
def is_compiled(package: str) -> bool:
    """Whether a law's lanes were on disk when this was first asked."""
    of_law = ("tick.lanes_at", "tick.lanes_each_at")
    return is_cached("lane_flights.burst", "gcs_tools") and any(
        is_cached(n, package) for n in of_law
    )


def warm_up(scenes: Sequence[Scenario]) -> None:
    """Compile the lanes of such flights, by flying a tick of them. What cannot be compiled flies alone."""
    ticks = [
        replace(scene, ticks=1, sent_at=scene.sent_at[:1], sent=scene.sent[:1]) for scene in scenes
    ]
    for group in groups(ticks):
        _beside([ticks[i] for i in group], EVERYTHING, WIDTH)


def groups(scenes: Sequence[Scenario], width: int = WIDTH) -> Iterator[list[int]]:
    """The numbers of the scenes that are flown together, at most `width`.

    Of the same settings, where at least half of the lanes are taken so.
    """
    alike: dict[Any, list[int]] = defaultdict(list)
    for i, scene in enumerate(scenes):
        kind = scene.flown.source, scene.period_us, scene.world.steps, bool(scene.legs)
        alike[kind, to_buffer(scene.settings).tobytes()].append(i)
    rest: dict[Any, list[int]] = defaultdict(list)
    for (kind, _), numbers in alike.items():
        whole = (
            len(numbers) if 2 * (len(numbers) % width) >= width else len(numbers) // width * width
        )
        for at in range(0, whole, width):
            yield numbers[at : min(at + width, whole)]
        rest[kind] += numbers[whole:]
    for numbers in rest.values():
        for at in range(0, len(numbers), width):
            yield numbers[at : at + width]


def _beside(scenes: list[Scenario], keep: Keep, width: int) -> dict[int, Flown]:
    """The flights of a group, those that could be flown in lanes."""
    settings = {to_buffer(scene.settings).tobytes() for scene in scenes}  # 0.0 is not -0.0
    alike = len(settings) == 1
    law = scenes[0].flown.source, alike
    if scenes[0].legs or law in _never:
        return {}
    try:
        pointer = scenes[0].flown.ticks.compiled_for_lanes(width, alike)
    except (
        Exception
    ):  # numba has many for what it cannot compile; by itself the law flies, or says why
        _never.add(law)
        return {}
    group = Group(scenes, width, keep, pointer, alike)
    if not group.fly():
        return {}
    each = {lane: group.flown(lane) for lane in range(len(scenes))}
    return {
        lane: Flown(*flown, in_lanes=True) for lane, flown in each.items() if flown[3] != REFUSED
    }


def by_itself(scene: Scenario, keep: Keep = EVERYTHING) -> Flown:
    """One flight, by `law_alone.fly`. Raises LawError."""
    plant, law = law_alone.fly(scene)
    ended = int(plant[-1, _ENDED]) if len(plant) else int(dynamics.FLYING)
    of_plant = keep.columns(PlantRecord, keep.plant)
    of_law = keep.columns(scene.flown.ticks.Tick, keep.law)
    return Flown(
        plant=plant if keep == EVERYTHING else plant[:: keep.every, of_plant],
        law=law if keep == EVERYTHING else law[:: keep.every, of_law],
        ticks=len(law),
        ended=ended,
        in_lanes=False,
    )
