"""A campaign flown: batches of flights on whatever executor there is, kept as they come.

Which flights are flown, what is drawn for them and at which number a campaign ends follows from the
campaign alone. Executor, workers and interruptions decide when and where, and nothing else.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from gcs_tools.campaigns.batch import OrderedFlight, Row, ended_its_process, fly_batch
from gcs_tools.campaigns.campaign_file import Campaign
from gcs_tools.campaigns.looks import Looks
from gcs_tools.campaigns.statistics import Share, share
from gcs_tools.campaigns.store import SUCCESS, Store
from gcs_tools.flight.interrupts import how_ended, interrupts_wait, is_of_code

BATCH = 8  # flights of each law that a worker is sent at once, to fly side by side
AHEAD = 3  # batches that wait or fly, for each worker
LOOK_S = 0.2  # wall: between two looks for an interruption

Told = Callable[["CampaignProgress"], None]


class RunningError(Exception):
    """What flies a campaign has failed; what was flown is kept."""


class Workers(Protocol):
    """What flies batches."""

    def submit(self, plan: str, batch: Sequence[OrderedFlight]) -> Future[list[Row]]:
        """Fly a batch, some time."""

    def count(self) -> int:
        """How many there are at the moment."""

    def apart(self, plan: str, asked: Sequence[OrderedFlight]) -> Iterator[list[Row]]:
        """Fly what a worker has died of, apart. One that dies of a flight makes that a lost one.

        Raises RunningError where it was no flight's doing.
        """


@dataclass(frozen=True)
class CampaignProgress:
    """How far a campaign is."""

    flown: int  # flights of all laws
    of: int
    shares: tuple[Share, ...]  # so far, one a law


class End(Protocol):
    """What is to be flown, and when it is enough."""

    numbers: range

    def look(self) -> bool:
        """Whether it is."""

    def so_far(self) -> tuple[Share, ...]:
        """Of the flights that are there, one share a law."""


class Outcomes(Protocol):
    """What has come of flights so far: a Store's."""

    @property
    def outcome(self) -> np.ndarray[Any, np.dtype[np.int8]]:
        """int8[laws, n]: UNKNOWN, FAILURE or SUCCESS."""

    @property
    def whole(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """bool[n]: whether each number is flown, by every law."""


class Ending:
    """At how many flights a campaign ends, found from its outcomes in the order of their numbers."""

    def __init__(self, looks: Looks, confidence: float, store: Outcomes) -> None:
        self.confidence = confidence
        self.looks = looks
        self.numbers = range(self.looks.at[-1])
        self._store = store
        self._left = list(self.looks.at)
        self.n: int | None = None  # flights of each law, once it is known

    @classmethod
    def of(cls, campaign: Campaign, store: Store) -> Ending:
        """That of a campaign."""
        return cls(campaign.looks, campaign.document.confidence, store)

    def look(self) -> bool:
        """Whether the end is known. A look is taken when all flights before it are there."""
        whole = self._store.whole
        first = int(np.argmin(whole)) if not whole.all() else len(whole)
        while self.n is None and self._left and self._left[0] <= first:
            at = self._left.pop(0)
            if not self._left or self.looks.ends(self.shares(at)):
                self.n = at
        return self.n is not None

    def shares(self, n: int) -> list[Share]:
        """Of the first n flights of each law, with the intervals that hold at every look."""
        confidence = self.looks.confidence(self.confidence)
        outcome = self._store.outcome[:, :n]
        return [share(int((law == SUCCESS).sum()), n, confidence) for law in outcome]

    def so_far(self) -> tuple[Share, ...]:
        """Of all flights that are there."""
        confidence = self.looks.confidence(self.confidence)
        return tuple(
            share(int((law == SUCCESS).sum()), int((law >= 0).sum()), confidence)
            for law in self._store.outcome
        )


class Stage:
    """Flights of some numbers, all of them."""

    def __init__(self, store: Store, numbers: range) -> None:
        self.numbers = numbers
        self._store = store

    def look(self) -> bool:
        """Whether all are there."""
        return bool(self._store.whole[self.numbers.start : self.numbers.stop].all())

    def so_far(self) -> tuple[Share, ...]:
        """Of no use: they are not drawn as flights are."""
        return ()


def run(
    campaign: Campaign, store: Store, workers: Workers, ending: End, told: Told = lambda at: None
) -> None:
    """Fly what is missing, until it is enough. Raises RunningError, OSError, KeyboardInterrupt.

    However it ends, the flights that are there by then are on disk, if it can be written to.
    """
    plan, batches = campaign.plan(), _batches(campaign, store, ending.numbers)
    pending: dict[Future[list[Row]], list[OrderedFlight]] = {}
    total = len(campaign.variants) * campaign.n
    with interrupts_wait() as interrupts:
        try:
            while not ending.look():
                while len(pending) < AHEAD * max(1, workers.count()):
                    if (batch := next(batches, None)) is None:
                        break
                    pending[workers.submit(plan, batch)] = batch
                done, _ = wait(pending, LOOK_S, FIRST_COMPLETED)
                if any(isinstance(_failure(future), BrokenProcessPool) for future in done):
                    done, _ = wait(pending)  # it has broken for all
                ended = [(future, pending.pop(future)) for future in done]
                store.add(row for future in done if not _failure(future) for row in future.result())
                left: list[OrderedFlight] = []
                for future, batch in ended:
                    failure = _failure(future)
                    if isinstance(failure, BrokenProcessPool):
                        left += batch
                    elif failure is not None:
                        raise failure
                if left:
                    for rows in workers.apart(plan, sorted(left, key=lambda one: one[:2])):
                        store.add(rows)
                        interrupts.look()
                if done:
                    told(CampaignProgress(store.flown, total, ending.so_far()))
                interrupts.look()
        finally:
            for future in pending:
                future.cancel()
            store.flush()


def _failure(future: Future[list[Row]]) -> BaseException | None:
    return CancelledError() if future.cancelled() else future.exception()


def _batches(campaign: Campaign, store: Store, numbers: range) -> Iterator[list[OrderedFlight]]:
    """The flights that are missing, in the order of their numbers."""
    laws = range(len(campaign.variants))
    batch: list[OrderedFlight] = []
    missing = ~store.whole[numbers.start : numbers.stop]
    for number in (numbers.start + np.flatnonzero(missing)).tolist():
        quantities = campaign.draws.quantities(number)
        for law in laws:
            if store.outcome[law, number] < 0:
                base = campaign.variants[law].base
                batch.append(
                    OrderedFlight(number, law, campaign.draws.values(number, quantities, base))
                )
        if len(batch) >= BATCH * len(laws):
            yield batch
            batch = []
    if batch:
        yield batch


# --- workers on this machine


class Processes:
    """Worker processes here: around the kernels of a flight runs so much Python that threads wait."""

    def __init__(self, n: int) -> None:
        self._n = n
        self._others = set(multiprocessing.active_children())
        self._workers = set[Any]()  # all that there were
        self._pool = _pool(n)

    def submit(self, plan: str, batch: Sequence[OrderedFlight]) -> Future[list[Row]]:
        """Fly a batch in one of them."""
        try:
            told = self._pool.submit(fly_batch, plan, batch)
        except BrokenProcessPool as error:
            told = Future()
            told.set_exception(error)
        self._workers |= set(multiprocessing.active_children()) - self._others
        return told

    def count(self) -> int:
        """How many there are."""
        return self._n

    def apart(self, plan: str, asked: Sequence[OrderedFlight]) -> Iterator[list[Row]]:
        """Fly what was on its way when a worker died: in halves, until a flight that ends its process is found.

        Raises RunningError where a worker was killed from outside.
        """
        self._check_ended_by_code()
        self._pool = _pool(self._n)
        yield from self._halves(plan, asked)

    def _halves(self, plan: str, asked: Sequence[OrderedFlight]) -> Iterator[list[Row]]:
        told = self.submit(plan, asked)
        try:
            yield told.result()
            return
        except BrokenProcessPool:
            codes = self._check_ended_by_code()
            self._pool = _pool(self._n)
        if len(asked) == 1:
            yield [ended_its_process(plan, asked[0], how_ended(codes[0]))]
            return
        laws = sorted({one.law for one in asked})
        is_first = [one.law == laws[0] for one in asked]
        if len(laws) == 1:
            is_first = [i < len(asked) // 2 for i in range(len(asked))]
        for which in (True, False):
            yield from self._halves(
                plan, [one for one, first in zip(asked, is_first, strict=True) if first is which]
            )

    def _check_ended_by_code(self) -> list[int]:
        """The exit codes of workers that were ended by what they flew. Raises RunningError without any."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        codes = [worker.exitcode for worker in self._workers if worker.exitcode is not None]
        self._workers.clear()
        found = [code for code in codes if is_of_code(code)]
        if -signal.SIGKILL in codes or not found:
            raise RunningError(
                "a worker process was killed (out of memory?); what was flown is kept, and the same"
                " command goes on from there (-j: fewer workers)"
            )
        return sorted(found)

    def end(self, at_once: bool) -> None:
        """Wait for the workers to end.  at_once : nobody waits for the batches that fly."""
        if at_once:
            for worker in set(multiprocessing.active_children()) - self._others:
                worker.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)


def _pool(n: int) -> ProcessPoolExecutor:
    """Workers, forked from a process that has loaded what they fly by (elsewhere started anew)."""
    how = "forkserver" if sys.platform == "linux" else "spawn"
    context = multiprocessing.get_context(how)
    if how == "forkserver":
        context.set_forkserver_preload(["gcs_tools.campaigns.batch"])
    return ProcessPoolExecutor(n, mp_context=context, initializer=_begin)


@contextmanager
def processes(n: int) -> Iterator[Processes]:
    """So many workers. They end with the block."""
    workers, at_once = Processes(n), True
    try:
        yield workers
        at_once = False
    finally:
        workers.end(at_once)


def _begin() -> None:
    """In a worker: interruptions are its parent's business, and its parent's end is its own."""
    for number in (signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def watch() -> None:
            parent.join()
            os._exit(0)

        threading.Thread(target=watch, daemon=True).start()
