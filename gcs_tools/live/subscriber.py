"""A vehicle on the bus as who listens sees it: who it is, what comes of it, what of that got lost."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import zenoh

from fcu.interface import topics as keys
from fcu.interface.topics import Key
from gcs_tools.live import bus, samples
from gcs_tools.live.samples import Sample, SampleError
from gcs_tools.recording import events
from gcs_tools.recording.reader import SCHEMA_VERSION
from gcs_tools.recording.schema import Topic

ASK_S = 0.5  # wall: between two questions for who is there
ANSWER_S = 2.0  # wall: how long a vehicle may take to say what it is
FORWARD = 1_000_000  # ticks: who is farther ahead is somebody else
RATE_S = 2.0  # wall: over which a rate is seen
LOOK_S = 0.005  # wall: between two looks for what has come


@dataclass
class Counted:
    """What has come of one topic."""

    encoding: str = ""
    samples: int = 0
    ticks: int = 0
    bytes: int = 0
    lost: int = 0  # ticks missing between the first and the last
    unreadable: int = 0  # samples that were none of this topic
    late: int = 0  # samples from before the last: they count as lost
    first: int = -1  # sequence numbers
    last: int = -1
    seen: deque[tuple[float, int]] = field(default_factory=deque)  # wall, ticks: of RATE_S

    def see(self, now: float, n: int) -> None:
        """So many ticks have come now (wall, s)."""
        self.ticks += n
        self.seen.append((now, n))
        self._forget(now)

    def rate_hz(self, now: float) -> float:
        """Ticks a second of late, by the wall."""
        self._forget(now)
        return sum(n for _, n in self.seen) / RATE_S

    def _forget(self, now: float) -> None:
        while self.seen and now - self.seen[0][0] > RATE_S:
            self.seen.popleft()


class Subscriber:
    """One vehicle. Poll it; it keeps nothing but counts."""

    def __init__(self, session: zenoh.Session, vehicle: str = "*") -> None:
        """`vehicle`: its MAVLink system id; "*": the first that is there."""
        self._session = session
        self._vehicle = vehicle
        self._alive = alive = f"{keys.PREFIX}/*/{vehicle}/{keys.ALIVE}/*"
        self._tokens = session.liveliness().declare_subscriber(
            alive, handler=bus.channel(), history=True
        )
        self._subscriber: Any = None
        self._early: list[tuple[str, Sample]] = []
        self.key: Key | None = None  # run and vehicle that are watched
        self.others: set[tuple[str, str]] = set()  # run and vehicle of those that are there too
        self.about: dict[str, Any] = {}
        self.topics: dict[str, Topic] = {}  # those of numbers, as the vehicle describes them
        self.alive: set[str] = set()  # its processes
        self.counted: dict[str, Counted] = {}
        self.unknown = 0  # samples of topics that no vehicle has
        self.gone = False  # the vehicle has left the bus: a publisher may stay
        self.succeeded = False  # and another has come
        self._flew = False
        self._ended: dict[str, int] | None = None  # by topic: its last tick, as told at the end

    def find(self, check: Callable[[], None] = lambda: None) -> None:
        """Wait for a vehicle and ask it what it is. `check` is called meanwhile, and may raise.

        Raises BusError when it is there and does not answer, or speaks another version.
        """
        due = time.monotonic() + ASK_S
        while self.key is None:
            check()
            self._see_tokens()
            if self.key is None:
                time.sleep(LOOK_S)
            if self.key is None and time.monotonic() > due:  # a token may have been missed
                due = time.monotonic() + ASK_S
                self._ask_who_is_there()
        within = f"{keys.namespace(self.key.run)}/{self.key.vehicle}/**"
        self._subscriber = self._session.declare_subscriber(within, handler=bus.channel())
        self._ask(within)
        if not self._speaks_our_version:
            version = self.about.get("schema_version")
            raise bus.BusError(
                f"the vehicle publishes version {version}; this program reads {SCHEMA_VERSION}"
            )

    @property
    def _speaks_our_version(self) -> bool:
        return bool(self.about.get("schema_version") == SCHEMA_VERSION)

    def _ask_who_is_there(self) -> None:
        """Ask for the tokens that there are, whatever was heard of them."""
        for reply in self._session.liveliness().get(self._alive, timeout=ASK_S):
            if reply.ok is not None:
                self._see(str(reply.ok.key_expr), True)

    def _ask(self, selector: str) -> None:
        until = time.monotonic() + ANSWER_S
        while not (self.about and (self.topics or not self._speaks_our_version)):
            if time.monotonic() > until:
                raise bus.BusError(f"{selector}: there is a vehicle, but it does not answer")
            for reply in self._session.get(selector, timeout=ANSWER_S):
                if reply.ok is None:
                    continue
                key = keys.take_apart(str(reply.ok.key_expr))
                data = reply.ok.payload.to_bytes()
                if key is None:
                    continue
                if key.topic == keys.ABOUT:
                    self.about = _object(data)
                elif key.topic == keys.SCHEMAS:
                    self.topics = _topics(data)
                else:
                    self._keep_early(key.topic, data)

    def _keep_early(self, topic: str, data: bytes) -> None:
        try:
            self._early.append((f"/{topic}", samples.unpack(data)))
        except SampleError:
            pass  # it will be counted if it comes again

    def _see_tokens(self) -> None:
        while (token := self._tokens.try_recv()) is not None:
            self._see(str(token.key_expr), token.kind == zenoh.SampleKind.PUT)

    def _see(self, token: str, there: bool) -> None:
        """A process is there, or is there no more."""
        key = keys.take_apart(token)
        if key is None:
            return
        if self.key is None and there:
            self.key = key
        if self.key is None:
            return
        if key[:2] != self.key[:2]:
            (self.others.add if there else self.others.discard)((key.run, key.vehicle))
            self.succeeded = self.succeeded or (there and self.gone)
            return
        process = key.topic.removeprefix(f"{keys.ALIVE}/")
        (self.alive.add if there else self.alive.discard)(process)
        flying = self.alive - {keys.PUBLISHER}
        self._flew = self._flew or bool(flying)
        self.gone = not (flying if self._flew else self.alive)

    def latest(self) -> list[tuple[str, Sample]]:
        """The last tick of each topic before it was watched, once; (topic, sample)."""
        early, self._early = self._early, []
        return early

    def take(self) -> Iterator[tuple[str, Sample]]:
        """What has come since the last call: (topic, sample), as they came."""
        self._see_tokens()
        assert self._subscriber is not None
        now = time.monotonic()
        for _ in range(bus.WAITING):
            sample = self._subscriber.try_recv()
            if sample is None:
                return
            key = keys.take_apart(str(sample.key_expr))
            if key is None:
                continue
            if key.topic == keys.ENDED:
                self._hear_the_end(sample.payload.to_bytes())
                continue
            if f"/{key.topic}" not in (*self.topics, events.TOPIC):
                self.unknown += 1
                continue
            counted = self.counted.setdefault(f"/{key.topic}", Counted())
            data = sample.payload.to_bytes()
            counted.samples += 1
            counted.bytes += len(data)
            counted.encoding = str(sample.encoding)
            try:
                found = samples.unpack(data)
            except SampleError:
                counted.unreadable += 1
                continue
            if _count(counted, found, now):
                yield f"/{key.topic}", found

    def _hear_the_end(self, data: bytes) -> None:
        told = _object(data)
        self._ended = {topic: n for topic, n in told.items() if isinstance(n, int)}

    @property
    def has_ended(self) -> bool:
        """Whether the vehicle has said that it ends: without, it was killed or lost from sight."""
        return self._ended is not None

    def missing(self) -> dict[str, int]:
        """Ticks that are still to come after the last of each topic, by what was said at the end."""
        told = self._ended or {}
        return {
            topic: n - counted.last
            for topic, counted in self.counted.items()
            if counted.last >= 0 and (n := told.get(topic, -1)) > counted.last
        }

    def give_up(self) -> None:
        """What is still to come is lost."""
        for topic, n in self.missing().items():
            self.counted[topic].lost += n
            self.counted[topic].last += n

    def close(self) -> None:
        """Hear nothing more."""
        self._tokens.undeclare()
        if self._subscriber is not None:
            self._subscriber.undeclare()


def _count(counted: Counted, found: Sample, now: float) -> bool:
    """Whether the sample goes on from those before it.

    One goes back when a connection broke that it was waiting in, and another is there already.
    """
    first, last, n = int(found.sequence[0]), int(found.sequence[-1]), len(found.ticks)
    if last - first >= FORWARD:
        counted.unreadable += 1
        return False
    if counted.first < 0:
        counted.first = first
    elif first <= counted.last:
        counted.late += 1
        return False
    elif first >= counted.last + FORWARD:
        counted.unreadable += 1
        return False
    else:
        counted.lost += first - counted.last - 1
    counted.lost += last - first + 1 - n
    counted.last = last
    counted.see(now, n)
    return True


def printable(text: str) -> str:
    """`text` without what a terminal would act on, or could not show."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


def _printable(found: Any) -> Any:
    if isinstance(found, str):
        return printable(found)
    if isinstance(found, dict):
        return {printable(name): _printable(value) for name, value in found.items()}
    return [_printable(value) for value in found] if isinstance(found, list) else found


def _topics(data: bytes) -> dict[str, Topic]:
    try:
        return samples.described(data)
    except SampleError:
        return {}


def _object(data: bytes) -> dict[str, Any]:
    try:
        found = _printable(json.loads(data))
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
