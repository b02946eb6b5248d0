"""Many flights in this process: drawn from a seed, flown on threads, with progress for who waits.

tables, rejected = drawn(draw, lambda given: not unstable(scenario(mission(given)).law), 2000)
results = list(each(fly, tables))
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

Random = np.random.Generator
Item = TypeVar("Item")
Found = TypeVar("Found")


def drawn(
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
    log = console or Console(quiet=True)
    columns = TextColumn("[bold]{task.description}"), BarColumn(bar_width=40), MofNCompleteColumn()
    bar = Progress(*columns, console=log, transient=True, disable=not log.is_terminal)
    with bar, ThreadPoolExecutor(max(2, os.cpu_count() or 1)) as pool:
        begun = [pool.submit(work, item) for item in items]
        try:
            for future in bar.track(begun, len(begun), description=what):
                yield future.result()
        finally:
            on_end()
            pool.shutdown(wait=False, cancel_futures=True)
