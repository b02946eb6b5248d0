"""The publisher: what the two flying processes feed it goes out on Zenoh, every tick of it.

A process of its own, so that Zenoh's threads, its waits and its end touch no flight. It wakes a
hundred times a second, takes what has come and publishes it: ticks share a sample. It sleeps
rather than waits for a row, since waking it would cost the control thread more than the row.

FeedListener is its end of the feed, PublishedVehicle what others see of it, Publisher the two
joined. A replay is a PublishedVehicle too.
"""

from __future__ import annotations

import json
import select
import signal
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from fcu.interface import airframe as airframes
from fcu.interface import event_log, publisher_feed
from fcu.interface import topics as keys
from fcu.interface.event_log import Event
from fcu.interface.ports import ports
from fcu.interface.starter import announce
from fcu.interface.status_texts import Code
from fcu.kernel.buffers import columns, size
from fcu.kernel.rows import column
from fcu.laws.loader import Law
from gcs_tools.live import bus, samples
from gcs_tools.live.samples import Numbers, Packer
from gcs_tools.live.subscriber import printable
from gcs_tools.recording import events
from gcs_tools.recording.reader import AIRFRAME, LAW, LAW_SOURCES, SCHEMA_VERSION, flies_with
from gcs_tools.recording.schema import FCU, PARAMS, PLANT, Kinds, Topic
from gcs_tools.recording.table import Rows

AT_ONCE = 1024  # datagrams taken in one go
SOURCES = 8  # connected at once; two fly
H_MIN = 1e-6  # s, of a control period
HELLO_S = 1.0  # wall: who says nothing for so long is hung up on

WHO = (FCU, PLANT)  # flies

_EXACT = 2.0**53  # numbers of ticks, and ns, below which a float64 is a whole number
_T_MAX = _EXACT * 1e-9  # s

ANSWERS = 16  # given in one go: who asks without end must not keep ticks waiting
LOOK_S = 0.01  # wall: between two looks for somebody who listens
TOGETHER = 64  # ticks in a sample, at most: it stays below Zenoh's 64 KiB

PERIOD_S = 0.01  # wall: between two looks at what has come
LEAVE_S = 0.6  # wall: for what is still on its way when a flight has ended
SAY_AGAIN_S = 0.05  # wall: between two words that it has ended, which a busy machine may drop
IDLE_S = 0.05  # the same, while nobody flies
_OF_PLANS = (Code.PLAN_ITEMS.name, Code.PLAN_AT.name, Code.HOME_AT.name)
MOST_PARTS = 1000  # events that are kept of a plan
KNOCK_S = 0.25  # wall: within it who was there before a publisher has found it
LISTEN_S = 1.0  # wall: and within it who has found it listens
LAST_S = 2.0  # wall: for what has still come when it ends, should more come all the time


class FeedError(ValueError):
    """What no flying process of this version sends: in words."""


@dataclass
class Taken:
    """What one process has sent since it was last asked."""

    rows: Rows  # (n, columns of its row)
    sequence: Numbers  # (n,), ascending
    time_ns: Numbers  # (n,)
    params: Rows | None = None  # the law's, with the time before them, if they were told anew
    said: list[dict[str, Any]] = field(default_factory=list)


class Source:
    """One flying process."""

    def __init__(self, connected: socket.socket, law: Law) -> None:
        """`connected`: its end, non-blocking.  `law`: that is flown, whose rows it is to send."""
        self._socket = connected
        self._law = law
        self._rows = _rows(law)
        self._since = time.monotonic()
        self.pid = publisher_feed.peer_pid(connected)
        self.who = ""  # fcu or plant, as it says
        self.ended = False
        self.next = -1  # number of the row that comes next
        self._begins_again = False  # its rows do: it was reset
        self.lost = 0  # rows that did not reach us since it said hello
        self._dropped = 0  # rows for which it had no room before that
        self._width = 0  # float64 in one of its rows
        self._params_width = size(Kinds.of(law).params_row)
        self._buffer = np.zeros((AT_ONCE, max(map(size, self._rows.values()))))
        self._bytes = bytearray(publisher_feed.GREATEST_BYTES)

    def take(self) -> Taken:
        """All that is there, at most AT_ONCE datagrams, and at most to where its rows begin again.

        Raises FeedError: then hang up.
        """
        if self._begins_again:
            self.next, self._begins_again = -1, False
        n = 0
        said: list[dict[str, Any]] = []
        params: Rows | None = None
        for _ in range(AT_ONCE):
            try:
                got = self._socket.recv_into(self._bytes)
            except BlockingIOError:
                break
            except OSError:
                got = 0
            width = self._width
            if got == 0:
                self.ended = True
                break
            if got % 8:
                said.append(self._word(bytes(self._bytes[:got])))
                if "reset" in said[-1]:
                    self._begins_again = True
                    break
            elif got == 8 * width:
                self._buffer[n, :width] = np.frombuffer(self._bytes, "<f8", width)
                n += 1
            elif got == 8 * self._params_width:
                told = np.frombuffer(self._bytes, "<f8", self._params_width).copy()
                params = _checked(self._law, told)
            else:
                raise FeedError(f"rows of {got} bytes (of another version?)")
        if not self.who and time.monotonic() - self._since > HELLO_S:
            raise FeedError("no hello")
        rows = self._buffer[:n, : self._width].copy()
        taken = Taken(rows, *self._numbers(rows), params, said)
        if said and "bye" in said[-1]:
            self._count_last(said[-1]["dropped"])
        return taken

    def _numbers(self, rows: Rows) -> tuple[Numbers, Numbers]:
        """Of rows their numbers and times, counting those that are missing."""
        n = len(rows)
        if n == 0:
            return np.zeros(0, np.uint64), np.zeros(0, np.uint64)
        kind = self._rows[self.who]
        sequence, t = (column(kind, rows, name) for name in ("timing.sequence", "t"))
        if not ((sequence >= 0.0) & (sequence < _EXACT) & (t >= 0.0) & (t < _T_MAX)).all():
            raise FeedError("rows without a number or a time")
        first, last = int(sequence[0]), int(sequence[-1])
        if first < self.next or (np.diff(sequence) < 1.0).any():
            raise FeedError("rows that go back")
        if self.next >= 0:
            self.lost += first - self.next
        self.lost += last + 1 - first - n
        self.next = last + 1
        return sequence.astype(np.uint64), np.rint(t * 1e9).astype(np.uint64)

    def _count_last(self, dropped: int) -> None:
        """Rows after the last that has come: by the count of who had no room for them."""
        missing = max(dropped - self._dropped - self.lost, 0)
        self.lost += missing
        if self.next >= 0:
            self.next += missing

    def _word(self, data: bytes) -> dict[str, Any]:
        """What is said, if it is one of the four things that are."""
        try:
            word: dict[str, Any] = json.loads(data)
            if "hello" in word:
                if self.who or word["hello"] not in WHO:
                    raise FeedError("a hello of nobody known")
                if word["hello"] == FCU and word["law"] != self._law.identity:
                    raise FeedError(
                        f"ticks of the law {printable(str(word['law']))}, expected"
                        f" {self._law.identity} (see gcs publish --law)"
                    )
                self.who, self._dropped = word["hello"], _count(word["dropped"])
                self._width = size(self._rows[self.who])
            elif "reset" in word and self.who:
                pass
            elif "bye" in word:
                word["dropped"] = _count(word["dropped"])
            else:
                told = event_log.of_json(word)
                events.encode(told)
                if not 0.0 <= told.t < _T_MAX:
                    raise FeedError("an event at no time")
        except FeedError:
            raise
        except (ValueError, AttributeError, KeyError, OverflowError, TypeError, RecursionError):
            raise FeedError("neither rows nor words of ours") from None
        return word

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


def _checked(law: Law, params: Rows) -> Rows:
    """The parameters of a law. Raises FeedError."""
    kind = Kinds.of(law).params_row
    t, h = column(kind, params, "t"), column(kind, params, "law.h")
    if not (np.isfinite(params).all() and _T_MAX > t >= 0.0 and h > H_MIN):
        raise FeedError("parameters that are none of a law")
    return params


def _count(told: Any) -> int:
    """A number of rows. Raises ValueError."""
    if not 0 <= int(told) < _EXACT:
        raise ValueError(f"not a number of rows: {told}")
    return int(told)


class FeedListener:
    """All flying processes of one instance."""

    def __init__(self, instance: int, law: Law) -> None:
        """`law`: that is flown. Raises PortBusy when another publisher listens."""
        self._law = law
        self._listener = publisher_feed.listen(instance)
        self.sources: list[Source] = []

    def accept(self) -> None:
        """Take in who has come; only of our own user, and not too many."""
        for _ in range(SOURCES):
            try:
                connected, _ = self._listener.accept()
            except OSError:  # nobody, or no file descriptor to spare
                return
            if len(self.sources) >= SOURCES or not publisher_feed.is_ours(connected):
                connected.close()
                continue
            connected.setblocking(False)
            self.sources.append(Source(connected, self._law))

    def hang_up(self, source: Source) -> None:
        """One has ended, or is not to be heard any more."""
        self.sources.remove(source)
        source.close()

    def close(self) -> None:
        """Hang up on all."""
        self._listener.close()
        for source in self.sources:
            source.close()


def _rows(law: Law) -> dict[str, Any]:
    """By who flies, the class of its rows."""
    kinds = Kinds.of(law)
    return {FCU: kinds.fcu_row, PLANT: kinds.plant_row}


@cache
def _packer(law: Law, who: str) -> Packer:
    """Rows of "fcu" or "plant", or the law's "params", into samples."""
    topics, params_row = Kinds.of(law).topics, Kinds.of(law).params_row
    if who == "params":
        return Packer([topics[PARAMS]], columns(params_row))
    of_them = [t for name, t in topics.items() if name.startswith(f"/{who}/") and name != PARAMS]
    return Packer(of_them, columns(_rows(law)[who]))


class PublishedVehicle:
    """One vehicle on the bus: its topics, who of it is alive, and answers to who comes late.

    Of a flight nothing here waits: a sample for which there is no room on its way is dropped, and
    its numbers are missing. The session has the namespace of the run.
    """

    def __init__(
        self, session: zenoh.Session, vehicle: str, topics: Mapping[str, Topic],
        law: Law | None = None,
    ) -> None:  # fmt: skip
        """`topics`: those of numbers, by name. `law`: that is flown, whose rows are published.

        Without a law it is no flight: it waits for room, rather than drop.
        """
        self._topics = topics
        self._law = law
        self._session = session
        control = zenoh.CongestionControl
        self._congestion = control.DROP if law else control.BLOCK
        self._vehicle = vehicle
        self._publishers: dict[str, Any] = {}
        self._tokens: dict[str, Any] = {}
        self._last: dict[str, tuple[bytes, str]] = {}  # by topic: a sample of its last tick
        self._latest: dict[str, tuple[Packer, Rows, Numbers, Numbers]] = {}
        self._flown: dict[str, int] = {}  # by topic: number of the last tick there was
        self._plan: dict[tuple[Any, ...], tuple[int, int, bytes]] = {}  # by part: number, ns, event
        self._counts = {"params": 0, keys.EVENTS: 0}
        self.about: dict[str, Any] = {}
        self._queries = session.declare_queryable(
            keys.relative(vehicle, "**"), handler=bus.channel()
        )

    # --- what is published

    def rows(self, who: str, rows: Rows, sequence: Numbers, time_ns: Numbers) -> None:
        """Ticks of "fcu" or "plant", or the law's "params": whole rows."""
        if not len(rows):
            return
        packer = self._packer(who)
        for i in range(0, len(rows), TOGETHER):
            part = slice(i, i + TOGETHER)
            packed = packer.pack(rows[part], sequence[part], time_ns[part])
            for topic, sample in zip(packer.topics, packed, strict=True):
                self._put(topic.name, topic.encoding, sample)
        self._latest[who] = packer, rows[-1:].copy(), sequence[-1:], time_ns[-1:]
        self.flown(who, int(sequence[-1]))

    def flown(self, who: str, number: int) -> None:
        """There have been ticks up to this one, whether or not we have got them to publish."""
        for topic in self._packer(who).topics:
            self._flown[topic.name] = number

    def _packer(self, who: str) -> Packer:
        assert self._law is not None
        return _packer(self._law, who)

    def params(self, row: Rows) -> None:
        """The law's parameters in force from row[0] (s) on."""
        self.rows("params", row[None, :], *self._numbered("params", float(row[0])))

    def event(self, event: Event) -> None:
        """Something happened."""
        numbered, message = self._numbered(keys.EVENTS, event.t), events.encode(event)
        self._put(events.TOPIC, events.encoding(), samples.pack_messages(*numbered, [message]))
        self._keep(event, int(numbered[0][0]), int(numbered[1][0]), message)
        self._flown[events.TOPIC] = int(numbered[0][0])

    def _keep(self, event: Event, number: int, time_ns: int, message: bytes) -> None:
        """Keep the last event for who comes late, with those that tell of the plan in force."""
        if event.code in _OF_PLANS:
            is_part = event.code == Code.PLAN_ITEMS.name
            key = (event.code, *event.values[:2]) if is_part else (event.code,)
            if is_part and event.values[1:2] == (0.0,):  # the first of a new upload
                for old in [old for old in self._plan if old[1:2] == event.values[:1]]:
                    del self._plan[old]
            self._plan.pop(key, None)
            if len(self._plan) < MOST_PARTS:
                self._plan[key] = number, time_ns, message
        last = number, time_ns, message
        kept = sorted({each[0]: each for each in (*self._plan.values(), last)}.values())
        numbers, times, told = zip(*kept, strict=True)
        sample = samples.pack_messages(
            np.array(numbers, np.uint64), np.array(times, np.uint64), list(told)
        )
        self._last[events.TOPIC] = sample, events.encoding()

    def messages(
        self, topic: str, encoding: str, sequence: Numbers, time_ns: Numbers,
        messages: Sequence[bytes],
    ) -> None:  # fmt: skip
        """Ticks of one topic as they are on file."""
        for i in range(0, len(messages), TOGETHER):
            part = slice(i, i + TOGETHER)
            sample = samples.pack_messages(sequence[part], time_ns[part], messages[part])
            self._put(topic, encoding, sample)
        if len(messages):
            last = samples.pack_messages(sequence[-1:], time_ns[-1:], messages[-1:])
            self._last[topic] = last, encoding
            self._flown[topic] = int(sequence[-1])

    def _numbered(self, what: str, t: float) -> tuple[Numbers, Numbers]:
        n = self._counts[what]
        self._counts[what] = n + 1
        return np.array([n], np.uint64), np.array([max(round(t * 1e9), 0)], np.uint64)

    def _put(self, topic: str, encoding: str, sample: bytes) -> None:
        self._publisher(topic, encoding).put(sample)

    def _publisher(self, topic: str, encoding: str) -> Any:
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._publishers[topic] = self._session.declare_publisher(
                keys.relative(self._vehicle, topic),
                encoding=encoding,
                congestion_control=self._congestion,
                priority=zenoh.Priority.DATA_LOW,
            )
        return publisher

    def is_heard(self) -> bool:
        """Whether somebody listens to any topic."""
        for topic in self._topics.values():
            self._publisher(topic.name, topic.encoding)
        return any(publisher.matching_status.matching for publisher in self._publishers.values())

    # --- who is there

    def is_met(self) -> bool:
        """Whether anybody is connected who does not listen yet."""
        return bus.connected(self._session) and not self.is_heard()

    def alive(self, process: str, there: bool) -> None:
        """Show or take back the token of a process."""
        if there and process not in self._tokens:
            key = keys.relative(self._vehicle, f"{keys.ALIVE}/{process}")
            self._tokens[process] = self._session.liveliness().declare_token(key)
        elif not there and process in self._tokens:
            self._tokens.pop(process).undeclare()

    def leave(self, bound_s: float) -> None:
        """Say what there was, and wait until nobody listens any more, so long at most (wall).

        Closing a session discards what is still on its way; who listens leaves when all has come.
        """
        self.ended()
        for process in list(self._tokens):
            self.alive(process, False)
        now = time.monotonic()
        until, due = now + bound_s, now + SAY_AGAIN_S
        while self.is_heard() and (now := time.monotonic()) < until:
            if now > due:
                self.ended()
                due = now + SAY_AGAIN_S
            self.serve()
            time.sleep(LOOK_S)

    def ended(self) -> None:
        """Nobody flies any more: say what there was, for who counts."""
        self._session.put(  # ahead of the ticks: there is room for it when there is none for them
            keys.relative(self._vehicle, keys.ENDED),
            json.dumps(self._flown).encode(),
            encoding="application/json",
            congestion_control=self._congestion,
            priority=zenoh.Priority.DATA_HIGH,
        )

    # --- answers

    def serve(self) -> None:
        """Answer what was asked since the last call."""
        for _ in range(ANSWERS):
            query = self._queries.try_recv()
            if query is None:
                return
            with query:
                self._answer(query)

    def _answer(self, query: Any) -> None:
        """What is asked for of: `about`, `schemas`, and the last tick of each topic."""
        for packer, row, sequence, time_ns in self._latest.values():
            packed = packer.pack(row, sequence, time_ns)
            for topic, sample in zip(packer.topics, packed, strict=True):
                self._last[topic.name] = sample, topic.encoding
        self._latest.clear()
        told = {
            keys.ABOUT: (json.dumps(self.about).encode(), "application/json"),
            keys.SCHEMAS: (samples.describe(self._topics), "application/json"),
        }
        for topic_name, (sample, encoding) in {**self._last, **told}.items():
            key = keys.relative(self._vehicle, topic_name)
            if query.key_expr.intersects(zenoh.KeyExpr(key)):
                query.reply(key, sample, encoding=encoding)


class Publisher:
    """Between the feed of one instance and its vehicle on the bus."""

    def __init__(
        self, feeds: FeedListener, vehicle: PublishedVehicle, law: Law, lifeline: int | None,
        write: Callable[[Event], None] = event_log.write,
    ) -> None:  # fmt: skip
        """`law`: that is flown.  `lifeline`: a file descriptor at whose end of file it ends.

        `write`: takes an event.
        """
        self._feeds = feeds
        self._write = write
        self._params = columns(Kinds.of(law).params_row)
        self._vehicle = vehicle
        self._lifeline = select.poll()
        if lifeline is not None:
            self._lifeline.register(lifeline, 0)  # a hang-up is told without being asked for
        self.stopping = False
        self.published = dict.fromkeys(WHO, 0)
        self.lost = dict.fromkeys(WHO, 0)  # rows that did not reach us
        self._before = dict.fromkeys(WHO, 0)  # added to numbers, which begin anew with a process
        self._next = dict.fromkeys(WHO, 0)  # number that the next row has
        self._refused: set[str] = set()  # why somebody was: said once

    def welcome(self) -> None:
        """Wait, a bounded time, until those listen who have waited for a publisher.

        A flight begins when its publisher is ready: they are to have its first tick.
        """
        began = time.monotonic()
        while not self._is_over():
            waited = time.monotonic() - began
            if waited > LISTEN_S or (waited > KNOCK_S and not self._vehicle.is_met()):
                return
            self.pass_on()
            self._vehicle.serve()
            time.sleep(LOOK_S)

    def _is_over(self) -> bool:
        return self.stopping or bool(self._lifeline.poll(0))

    def run(self) -> None:
        """Until told to stop, or whoever started us is gone."""
        due = time.monotonic()
        while not self._is_over():
            self.pass_on()
            self._vehicle.serve()
            due += PERIOD_S if self._feeds.sources else IDLE_S
            now = time.monotonic()
            if due > now:
                time.sleep(due - now)
            else:
                due = now  # behind: what came meanwhile waits in the feed, or is dropped there
        until = time.monotonic() + LAST_S  # the last words of a flight that has ended
        while self.pass_on() and time.monotonic() < until:
            self._vehicle.serve()
        for who, lost in self.lost.items():
            if lost:
                flown = self.published[who] + lost
                say(
                    "warning",
                    f"{lost} of {flown} ticks of the {who} came too fast to be published",
                    self._write,
                )

    def pass_on(self) -> bool:
        """Publish what has come; whether anything has."""
        self._feeds.accept()
        came = False
        for source in list(self._feeds.sources):
            try:
                came |= self._pass_on(source)
            except FeedError as error:
                self._refuse(source, str(error))
        return came

    def _pass_on(self, source: Source) -> bool:
        before, was = source.lost, source.who
        taken = source.take()
        if source.who != was:
            self._meet(source)
        for said in taken.said:
            self._say(source, said)
        if taken.params is not None:
            self._told(taken.params)
        if source.who:
            self._publish(source, taken, source.lost - before)
        if source.ended:
            self._end(source)
        return bool(len(taken.rows) or taken.said)

    def _publish(self, source: Source, taken: Taken, lost: int) -> None:
        who = source.who
        if len(taken.rows) and int(taken.sequence[0]) + self._before[who] < self._next[who]:
            self._before[who] = self._next[who]
        self._vehicle.rows(
            who, taken.rows, taken.sequence + np.uint64(self._before[who]), taken.time_ns
        )
        self.published[who] += len(taken.rows)
        self.lost[who] += lost
        if source.next > 0:
            self._next[who] = self._before[who] + source.next
            self._vehicle.flown(who, self._next[who] - 1)

    def _meet(self, source: Source) -> None:
        if any(other.who == source.who for other in self._feeds.sources if other is not source):
            raise FeedError(f"what another {source.who} feeds already")
        self._vehicle.alive(source.who, True)
        self._vehicle.about["processes"][source.who] = {"pid": source.pid}

    def _end(self, source: Source) -> None:
        self._feeds.hang_up(source)
        if source.who and not any(other.who == source.who for other in self._feeds.sources):
            self._vehicle.alive(source.who, False)
            if not any(other.who for other in self._feeds.sources):
                self._vehicle.ended()

    def _refuse(self, source: Source, why: str) -> None:
        self._end(source)
        if why not in self._refused:
            self._refused.add(why)
            say("warning", f"process {source.pid} feeds {why}: not published", self._write)

    def _say(self, source: Source, said: dict[str, Any]) -> None:
        if "event" in said:
            self._vehicle.event(event_log.of_json(said)._replace(who=source.who))

    def _told(self, row: np.ndarray[Any, np.dtype[np.float64]]) -> None:
        named = dict(zip(self._params, row.tolist(), strict=True))
        del named["t"]
        self._vehicle.about["params"] = named
        self._vehicle.about["rate_hz"] = 1.0 / named["law.h"]
        self._vehicle.params(row)


def about(run: str, instance: int, law: Law, flies: dict[str, Any]) -> dict[str, Any]:
    """What a vehicle says of itself. `flies`: mission, seed and what else its starter knows."""
    return {
        "run": run,
        "vehicle": str(ports(instance).system_id),
        "instance": instance,
        "schema_version": SCHEMA_VERSION,
        LAW: law.name,
        LAW_SOURCES: law.digest,
        "version": version("m-mrac"),
        "started": time.time(),
        "processes": {},
        "mission": None,
        **({} if AIRFRAME in flies else flies_with(airframes.read())),
        **flies,
    }


def publish(
    instance: int, law: Law, run: str, flies: dict[str, Any], config: Path | None,
    lifeline: int | None, write: Callable[[Event], None] = event_log.write,
) -> None:  # fmt: skip
    """Publish an instance until told to stop by a signal, or by the end of `lifeline`.

    `config`: Zenoh's own. `write`: takes an event. Raises BusError, and PortBusy when another publisher has the instance.
    """
    feeds = FeedListener(instance, law)
    try:
        with bus.session(bus.for_publisher(instance, run, config)) as session:
            topics = Kinds.of(law).topics
            vehicle = PublishedVehicle(session, str(ports(instance).system_id), topics, law)
            vehicle.about = about(run, instance, law, flies)
            vehicle.alive("publisher", True)
            publisher = Publisher(feeds, vehicle, law, lifeline, write)

            def stop(_signal: int, _frame: object) -> None:
                publisher.stopping = True

            signal.signal(signal.SIGTERM, stop)
            signal.signal(signal.SIGINT, stop)
            publisher.welcome()
            announce({"ready": "publisher", "instance": instance, "run": run})
            publisher.run()
            vehicle.leave(LEAVE_S)
            announce(
                {"ended": "publisher", "published": publisher.published, "lost": publisher.lost}
            )
    finally:
        feeds.close()


def say(level: str, text: str, write: Callable[[Event], None] = event_log.write) -> None:
    """An event of the publisher."""
    write(event_log.event(event_log.BEFORE_S, level, "pub", text))
