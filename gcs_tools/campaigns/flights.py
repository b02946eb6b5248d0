"""Many flights in this process: drawn from a seed, flown on threads, with progress for who waits.

tables, rejected = accepted_draws(draw, lambda given: not unstable(scenario(mission(given)).law), 2000)
results = list(each(fly, tables))
results = list(flown(lambda given: [Asked(scenario(mission(given)), look)], tables))  # in lanes
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from fcu.laws.loader import LawError
from gcs_tools.flight import law_flights
from gcs_tools.flight.law_flights import EVERYTHING, Keep
from gcs_tools.flight.scenario import Scenario
from gcs_tools.recording.table import Table

Random = np.random.Generator
Item = TypeVar("Item")
Found = TypeVar("Found")

# items of a chunk: enough to fill lanes with what can share them, few enough for the room that they take
LEAST, MOST = 16, 64
CHUNKS = 3  # a thread, where that makes neither fewer items of a chunk nor more


class LawFlight(NamedTuple):
    """A flight that is over, of a law alone."""

    scene: Scenario
    plant: Table  # what was kept of its rows, of PlantRecord
    law: Table  # of the law's Tick
    ticks: int  # that the law flew
    ended: int  # as law_flights.LawFlown

    @property
    def lasted(self) -> bool:
        """Whether it flew to the end of its time."""
        return self.ticks == self.scene.ticks


class LawFlightOrder(NamedTuple, Generic[Found]):
    """A flight that is to be flown, and what is looked for in it."""

    scene: Scenario
    look: Callable[[LawFlight], Found]


def accepted_draws(
    draw: Callable[[Random], Item], accepts: Callable[[Item], bool], n: int, seed: int = 1
) -> tuple[list[Item], int]:
    """The first `n` draws that are accepted, and how many were rejected before the last of them."""
    random, kept, rejected = np.random.default_rng(seed), list[Item](), 0
    while len(kept) < n:
        item = draw(random)
        if accepts(item):
            kept.append(item)
        else:
            rejected += 1
    return kept, rejected


def each(
    work: Callable[[Item], Found], items: Sequence[Item], what: str = "flying",
    console: Console | None = None, on_end: Callable[[], None] = lambda: None,
) -> Iterator[Found]:  # fmt: skip
    """What `work` gives for each item, in their order: a thread a core (two at least): flights hold no lock.

    what : what goes on, said with a bar on `console` (None: not) where that is a terminal.
    on_end : called when nothing more is asked for, before what has begun is waited for.
    Raises what `work` raises, at its item; items that were not begun are then left out.
    """
    return chunked(lambda some: [work(item) for item in some], items, 1, what, console, on_end)


def chunked(
    work: Callable[[Sequence[Item]], Sequence[Found]], items: Sequence[Item], n: int | None = None,
    what: str = "flying", console: Console | None = None, on_end: Callable[[], None] = lambda: None,
) -> Iterator[Found]:  # fmt: skip
    """The same of a `work` that takes `n` items at a time, by default as suits lanes."""
    threads = max(2, os.cpu_count() or 1)
    if n is None:
        n = min(max(LEAST, len(items) // (CHUNKS * threads)), MOST, -(-len(items) // threads) or 1)
    chunks = [items[at : at + n] for at in range(0, len(items), n)]
    log = console or Console(quiet=True)
    columns = TextColumn("[bold]{task.description}"), BarColumn(bar_width=40), MofNCompleteColumn()
    bar = Progress(*columns, console=log, transient=True, disable=not log.is_terminal)
    pool, waits = ThreadPoolExecutor(threads), True
    with bar:
        task = bar.add_task(what, total=len(items))
        begun = [pool.submit(work, chunk) for chunk in chunks]
        try:
            for future in begun:
                found = future.result()
                bar.advance(task, len(found))
                yield from found
        except (KeyboardInterrupt, GeneratorExit):
            waits = False  # a law may go round and round
            raise
        finally:
            on_end()
            pool.shutdown(wait=waits, cancel_futures=True)


def flown(
    make: Callable[[Item], Sequence[LawFlightOrder[Found]]], items: Sequence[Item], keep: Keep = EVERYTHING,
    what: str = "flying", console: Console | None = None,
) -> Iterator[list[Found]]:  # fmt: skip
    """For each item what is found in the flights that `make` makes of it; in lanes where that can be.

    keep : what is kept of their rows, until they have been looked at.  what, console : as for `each`.
    Raises LawError, and what `make` raises.
    """

    def work(some: Sequence[Item]) -> list[list[Found]]:
        made = [make(item) for item in some]
        asked = [one for of_item in made for one in of_item]
        found = iter(fly(asked, keep, len(asked) * len(items) / len(some)))
        return [[next(found) for _ in of_item] for of_item in made]

    return chunked(work, items, None, what, console)


def fly(
    asked: Sequence[LawFlightOrder[Found]], keep: Keep = EVERYTHING, in_all: float | None = None,
    on_error: Callable[[LawError], Found] | None = None,
) -> list[Found]:  # fmt: skip
    """What is found in each of the flights, on this thread; rows are dropped once they are looked at.

    in_all : how many flights these are some of (`several.fly`).
    on_error : what is found in a flight whose law raises. Default: raise its LawError.
    """
    scenes, found = [one.scene for one in asked], dict[int, Found]()
    for i, flight in law_flights.each(scenes, keep, in_all=in_all):
        if isinstance(flight, LawError):
            if on_error is None:
                raise flight
            found[i] = on_error(flight)
            continue
        plant, law = law_flights.tables(scenes[i], flight, keep)
        found[i] = asked[i].look(LawFlight(scenes[i], plant, law, flight.ticks, flight.ended))
    return [found[i] for i in range(len(asked))]
