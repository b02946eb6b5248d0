"""Workers of a Dask scheduler, which come and go, and which of them may fly.

A worker flies once its fingerprint is that of who leads the campaign: the same sources and versions,
and the same bits of a short flight. Dask sends batches only to such workers, and sends those of one
that has gone to another.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from distributed import Client
from distributed.scheduler import KilledWorker

from gcs_tools.campaigns.batch import OrderedFlight, Row, fly_batch
from gcs_tools.campaigns.fingerprint import fingerprint
from gcs_tools.campaigns.running import RunningError
from gcs_tools.campaigns.store import differences

LOOK_S = 0.5  # wall: between two looks at who is there
CONNECT_S = 10.0  # wall: for the scheduler to answer

Note = Callable[[str], None]


@dataclass
class _Batch:
    """A batch on its way."""

    plan: str
    asked: list[OrderedFlight]
    told: Future[list[Row]] = field(default_factory=Future)
    sent: Any = None  # Dask's future; None: it waits for a worker
    to: frozenset[str] = frozenset()  # addresses of workers that may fly it


class Cluster:
    """What `running.run` sends batches to."""

    def __init__(self, client: Any, ours: Mapping[str, str], wait_s: float, note: Note) -> None:
        """`ours`: the fingerprint here; `wait_s`: without any worker, until it gives up."""
        self._client = client
        self._ours = dict(ours)
        self._wait_s = wait_s
        self._note = note
        self._asked: dict[str, Any] = {}  # address -> Dask's future of its fingerprint
        self._threads: dict[str, int] = {}  # of workers that may fly
        self._batches: list[_Batch] = []
        self._looked_at = -LOOK_S
        self._alone_since = time.monotonic()

    def submit(self, plan: str, batch: Sequence[OrderedFlight]) -> Future[list[Row]]:
        """Fly a batch on some worker."""
        made = _Batch(plan, list(batch))
        self._batches.append(made)
        self._send(made)
        return made.told

    def count(self) -> int:
        """Threads of the workers that may fly, at the last look. Raises RunningError when it gives up."""
        now = time.monotonic()
        if now - self._looked_at >= LOOK_S:
            self._looked_at = now
            self._look()
            if self._threads:
                self._alone_since = now
            elif now - self._alone_since > self._wait_s:
                raise RunningError(
                    f"no worker that may fly for {self._wait_s:g} s; what was flown is kept, and the"
                    " same command goes on from there (--wait: longer)"
                )
        return sum(self._threads.values())

    def apart(self, plan: str, asked: Sequence[OrderedFlight]) -> Iterator[list[Row]]:
        """Raise RunningError: of a worker elsewhere nobody here knows what it has died of."""
        raise RunningError("a worker process was killed")

    def _look(self) -> None:
        """See who has come, who has gone, and who may fly."""
        if self._client.status != "running":
            raise _lost()
        there = self._workers()
        for address in there.keys() - self._asked.keys():
            self._asked[address] = self._client.submit(
                fingerprint, workers=[address], pure=False, key=f"fingerprint-{address}-{time.time_ns()}"
            )  # fmt: skip
        for address in self._asked.keys() - there.keys():
            del self._asked[address]
            if self._threads.pop(address, None) is not None:
                self._note(f"worker {address} has gone; {len(self._threads)} left")
        for address, asked in self._asked.items():
            if asked is not None and asked.done():
                self._asked[address] = None
                if why := self._refusal(asked):
                    self._note(f"worker {address} is refused: {why}")
                else:
                    self._threads[address] = there[address]
                    self._note(f"worker {address} flies; {len(self._threads)} in all")
        self._batches = [batch for batch in self._batches if not batch.told.done()]
        for batch in self._batches:
            if not batch.to & self._threads.keys():  # it would wait for who has gone
                self._send(batch)

    def _workers(self) -> dict[str, int]:
        """Address and threads of every worker."""
        try:
            told = self._client.scheduler_info(n_workers=-1)["workers"]
        except (OSError, KeyError, TypeError) as error:
            raise _lost() from error
        return {address: int(each["nthreads"]) for address, each in told.items()}

    def _refusal(self, asked: Any) -> str:
        """Why a worker may not fly; empty: it may."""
        if asked.status != "finished":
            return f"it cannot fly ({asked.exception()!r})"
        theirs = asked.result()
        other = differences(theirs, self._ours)
        return f"it has {other}; its flights would not be the same" if other else ""

    def _send(self, batch: _Batch) -> None:
        """To the workers that may fly now; to nobody as long as there is none."""
        before, batch.to = batch.sent, frozenset(self._threads)
        batch.sent = None
        if before is not None:
            before.cancel()
        if batch.to:
            batch.sent = self._client.submit(
                fly_batch, batch.plan, batch.asked, workers=sorted(batch.to), pure=False
            )
            batch.sent.add_done_callback(lambda sent: self._heard(batch, sent))

    def _heard(self, batch: _Batch, sent: Any) -> None:
        """In a thread of Dask's: a batch has ended, or was sent anew."""
        if batch.sent is not sent or batch.told.done() or batch.told.cancelled():
            return
        if sent.status == "finished":
            batch.told.set_result(sent.result())
        elif sent.status == "cancelled" or self._client.status != "running":
            batch.told.set_exception(_lost())
        else:
            batch.told.set_exception(_failed(batch, sent.exception()))


def _failed(batch: _Batch, error: BaseException) -> RunningError:
    first, last = batch.asked[0].number, batch.asked[-1].number
    named = f"flights {first} to {last}"
    if isinstance(error, KilledWorker):
        return RunningError(f"{named}: every worker that flew them was killed (out of memory?)")
    return RunningError(f"{named}: {error!r}")


def _lost() -> RunningError:
    return RunningError(
        "the scheduler is lost; what was flown is kept, and the same command goes on from there"
    )


@contextmanager
def cluster(address: str, ours: Mapping[str, str], wait_s: float, note: Note) -> Iterator[Cluster]:
    """The workers of a scheduler. Raises RunningError if it does not answer."""
    logging.getLogger("distributed.client").setLevel(
        logging.CRITICAL
    )  # what is lost we say ourselves
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False, name="gcs-campaign")
    except (OSError, ValueError) as error:
        raise RunningError(f"--scheduler {address}: no scheduler answers ({error})") from error
    except (TypeError, RuntimeError) as error:  # TLS without certificates
        raise RunningError(
            f"--scheduler {address}: {str(error).splitlines()[0]} (Dask's own settings name the"
            " certificates: docs/campaigns.md)"
        ) from error
    try:
        yield Cluster(client, ours, wait_s, note)
    finally:
        client.close(timeout=CONNECT_S)
