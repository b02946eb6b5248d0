"""Many flights of laws alone, eight at a time on each core where that can be: the rows of `law_alone.fly`.

Flights that share a law, a control rate and the number of plant steps in a tick are flown side by side
in lanes (`lane_flights`). One by one fly those that find nobody to share with, those of a law that
cannot be compiled for lanes, and those of lanes that part: that take different branches of a law which
branches on data. Rows are the same bits either way; `Flown.in_lanes` says which it was.

Lanes are compiled once for a version, a law, and settings that are alike or not, which takes as long as
some millions of ticks: flights fly one by one where lanes are not compiled yet, and too few to repay it.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
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
from gcs_tools.recording.table import Table
from sitl_plant.physics import dynamics
from sitl_plant.physics.types import PlantRecord

__all__ = [
    "ALWAYS",
    "EVERYTHING",
    "REPAID",
    "Keep",
    "LawFlown",
    "each",
    "fly",
    "groups",
    "is_compiled",
    "of_rows",
    "repays",
    "tables",
    "warm_up",
]

Rows = np.ndarray[Any, np.dtype[np.float64]]

_ENDED = column_of(PlantRecord, "ended")
REPAID = 40e6  # ticks, from which lanes save more time than it takes to compile them
ROOM = 500_000_000  # bytes, of the rows of flights beside each other
ALWAYS = math.inf  # flights in all: compile, whatever it takes
# laws that cannot be compiled for lanes: which, and whether with settings that are alike
_never: set[tuple[str, bool]] = set()
_ready: set[tuple[str, bool]] = set()  # packages of laws that are compiled


class LawFlown(NamedTuple):
    """One flight: what was asked for of its rows, and how it ended."""

    plant: Rows  # (n, columns), of PlantRecord
    law: Rows  # of the law's Tick
    ticks: int  # that the law flew
    ended: int  # dynamics.FLYING, DIVERGED or CRASHED
    in_lanes: bool  # beside others; else by itself


def fly(
    scenes: Sequence[Scenario],
    keep: Keep = EVERYTHING,
    width: int = WIDTH,
    in_all: float | None = None,
) -> list[LawFlown]:
    """Fly each of the scenes; the result of each, in their order. On one core, without the GIL.

    width : of the lanes, 8 or 4: what suits this machine.  in_all : how many flights these are some of,
    for which lanes are compiled if they repay it; default: there are no others.  Raises LawError.
    """
    found = dict(each(scenes, keep, width, in_all))
    for flown in found.values():
        if isinstance(flown, LawError):
            raise flown
    return [flown for _, flown in sorted(found.items()) if isinstance(flown, LawFlown)]


def each(
    scenes: Sequence[Scenario],
    keep: Keep = EVERYTHING,
    width: int = WIDTH,
    in_all: float | None = None,
) -> Iterator[tuple[int, LawFlown | LawError]]:
    """Number and result of each of the scenes, group by group, in any order: what goes wrong is its own.

    Arguments as for `fly`.
    """
    for group in groups(scenes, min(width, _room(scenes, keep)), in_all):
        beside = _beside([scenes[i] for i in group], keep, width) if len(group) > 1 else {}
        for at, i in enumerate(group):
            try:
                yield i, beside.get(at) or by_itself(scenes[i], keep)
            except LawError as error:
                yield i, error


def _room(scenes: Sequence[Scenario], keep: Keep) -> int:
    """How many of the flights have room in memory beside each other."""
    longest = max(scenes, key=lambda scene: scene.ticks, default=None)
    if longest is None:
        return 1
    tick = longest.flown.ticks.Tick
    columns = len(keep.columns(PlantRecord, keep.plant)) + len(keep.columns(tick, keep.law))
    return max(1, ROOM // (1 + 8 * columns * (longest.ticks // keep.every)))


def repays(scene: Scenario, n: int) -> bool:
    """Whether lanes are sooner for `n` flights such as this: they are compiled, or it is worth it."""
    package = scene.flown.package
    ready = is_compiled(package) or is_compiled(package, alike=False)
    return (
        not scene.legs and not scene.parameters and n > 1 and (ready or n * scene.ticks >= REPAID)
    )


def is_compiled(package: str, alike: bool = True, told: bool = False) -> bool:
    """Whether a law's lanes are compiled, for settings that are alike or not: on disk, or in this process.

    told : if not, whoever asks says that they are compiled.
    """
    if (package, alike) not in _ready:
        of_law = "tick.lanes_at" if alike else "tick.lanes_each_at"
        root = package.partition(".")[0]
        ready = is_cached(f"{package}.{of_law}", root, told)
        if ready and is_cached("lane_flights.burst", told=told):
            _ready.add((package, alike))
    return (package, alike) in _ready


def warm_up(scenes: Sequence[Scenario]) -> None:
    """Compile the lanes of such flights, by flying a tick of them. What cannot be compiled flies alone."""
    ticks = [
        replace(scene, ticks=1, sent_at=scene.sent_at[:1], sent=scene.sent[:1]) for scene in scenes
    ]
    for group in groups(ticks, in_all=ALWAYS):
        _beside([ticks[i] for i in group], EVERYTHING, WIDTH)


def groups(
    scenes: Sequence[Scenario], width: int = WIDTH, in_all: float | None = None
) -> Iterator[list[int]]:
    """The numbers of the scenes that are flown together, at most `width`.

    Of the same settings, where at least half of the lanes are taken so; alone, where lanes would have to
    be compiled and would not repay it. Arguments as for `fly`.
    """
    found = list(_groups(scenes, width))
    kinds = [(scenes[numbers[0]].flown.package, _alike(scenes, numbers)) for numbers in found]
    ticks: dict[tuple[str, bool], int] = defaultdict(int)
    for kind, numbers in zip(kinds, found, strict=True):
        ticks[kind] += sum(scenes[i].ticks for i in numbers) if len(numbers) > 1 else 0
    times = 1.0 if in_all is None else in_all / max(1, len(scenes))
    in_lanes = {
        kind for kind, n in ticks.items() if n and (times * n >= REPAID or is_compiled(*kind))
    }
    for kind, numbers in zip(kinds, found, strict=True):
        yield from [numbers] if kind in in_lanes else [[i] for i in numbers]


def _alike(scenes: Sequence[Scenario], numbers: Sequence[int]) -> bool:
    """Whether flights have the same settings."""
    return len({to_buffer(scenes[i].settings).tobytes() for i in numbers}) == 1  # 0.0 is not -0.0


def _choices(scene: Scenario) -> tuple[Any, ...]:
    """What is chosen by a word: what a law may branch on that lanes then share."""
    rows = scene.flown.settings.PARAMETERS
    return tuple(row.get(scene.settings) for row in rows if row.words)


def field_of(scene: Scenario) -> str:
    """The field of wind that lanes share, as a path. Empty without one."""
    layers = scene.layers
    return "" if layers is None or layers.field is None else layers.field.path


def _groups(scenes: Sequence[Scenario], width: int) -> Iterator[list[int]]:
    alike: dict[Any, list[int]] = defaultdict(list)
    in_time = sorted(range(len(scenes)), key=lambda i: scenes[i].ticks)  # lanes end together
    for i in in_time:
        scene = scenes[i]
        kind = (
            scene.flown.package, scene.period_us, scene.world.steps, bool(scene.legs),
            scene.wind is None, scene.layers is None, field_of(scene), not scene.faults, bool(scene.parameters),
            _choices(scene),
        )  # fmt: skip
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


def _beside(scenes: list[Scenario], keep: Keep, width: int) -> dict[int, LawFlown]:
    """The flights of a group, those that could be flown in lanes."""
    alike = _alike(scenes, range(len(scenes)))
    law = scenes[0].flown.package, alike
    first = scenes[0]
    # what lanes do not fly, or what no law alone does: by itself each is flown, or refused by name
    if first.legs or first.parameters or first.faults or law in _never:
        return {}
    try:
        pointer = scenes[0].flown.ticks.compiled_for_lanes(width, alike)
    except (
        Exception
    ):  # numba has many for what it cannot compile; by itself the law flies, or says why
        _never.add(law)
        return {}
    _ready.add((scenes[0].flown.package, alike))
    group = Group(scenes, width, keep, pointer, alike)
    if not group.fly():
        return {}
    each = {lane: group.flown(lane) for lane in range(len(scenes))}
    return {
        lane: LawFlown(*flown, in_lanes=True) for lane, flown in each.items() if flown[3] != REFUSED
    }


def by_itself(scene: Scenario, keep: Keep = EVERYTHING) -> LawFlown:
    """One flight, by `law_alone.fly`. Raises LawError."""
    return of_rows(scene, *law_alone.fly(scene), keep)


def of_rows(scene: Scenario, plant: Rows, law: Rows, keep: Keep = EVERYTHING) -> LawFlown:
    """One flight by its rows, of which `keep` is kept.  plant, law : as of `law_alone.fly`."""
    ended = int(plant[-1, _ENDED]) if len(plant) else int(dynamics.FLYING)
    of_plant = keep.columns(PlantRecord, keep.plant)
    of_law = keep.columns(scene.flown.ticks.Tick, keep.law)
    return LawFlown(
        plant=plant if keep == EVERYTHING else np.ascontiguousarray(plant[:: keep.every, of_plant]),
        law=law if keep == EVERYTHING else np.ascontiguousarray(law[:: keep.every, of_law]),
        ticks=len(law),
        ended=ended,
        in_lanes=False,
    )


def tables(scene: Scenario, flown: LawFlown, keep: Keep = EVERYTHING) -> tuple[Table, Table]:
    """The rows of a flight of `scene`, of the plant and of the law, with the names of what was kept."""
    ticks = scene.flown.ticks.Tick
    return (
        Table(flown.plant, keep.names(PlantRecord, keep.plant)),
        Table(flown.law, keep.names(ticks, keep.law)),
    )
