"""One vehicle on the bus: its topics, who of it is alive, and answers to who comes late.

Used by the publisher of a flight and by the replay of a recording. Of a flight nothing here
waits: a sample for which there is no room on its way is dropped, and its numbers are missing.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import zenoh

from fcu.interface import topics as keys
from fcu.kernel.buffers import columns
from fcu.settings import Settings
from gcs_tools.live import bus, ticks
from gcs_tools.live.ticks import Numbers, Packer
from gcs_tools.recording import events
from gcs_tools.recording.events import Event
from gcs_tools.recording.layout import Rows
from gcs_tools.recording.schema import FCU_COLUMNS, OF_FCU, OF_PLANT, PARAMS, PLANT_COLUMNS, TOPICS

ANSWERS = 16  # given in one go: who asks without end must not keep ticks waiting
LOOK_S = 0.01  # wall: between two looks for somebody who listens
TOGETHER = 64  # ticks in a sample, at most: it stays below Zenoh's 64 KiB
PARAM_COLUMNS = ["t", *columns(Settings)]


class Outlet:
    """What a session publishes of one vehicle. The session has the namespace of the run."""

    def __init__(self, session: zenoh.Session, vehicle: str, waits: bool = False) -> None:
        """`waits`: for room, rather than drop; for what is no flight."""
        self._session = session
        control = zenoh.CongestionControl
        self._congestion = control.BLOCK if waits else control.DROP
        self._vehicle = vehicle
        self._publishers: dict[str, Any] = {}
        self._tokens: dict[str, Any] = {}
        self._last: dict[str, tuple[bytes, str]] = {}  # by topic: a sample of its last tick
        self._latest: dict[str, tuple[Packer, Rows, Numbers, Numbers]] = {}
        self._flown: dict[str, int] = {}  # by topic: number of the last tick there was
        self._packers = {
            "fcu": Packer(OF_FCU, FCU_COLUMNS),
            "plant": Packer(OF_PLANT, PLANT_COLUMNS),
            "params": Packer((PARAMS,), PARAM_COLUMNS),
        }
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
        packer = self._packers[who]
        for i in range(0, len(rows), TOGETHER):
            part = slice(i, i + TOGETHER)
            samples = packer.pack(rows[part], sequence[part], time_ns[part])
            for topic, sample in zip(packer.topics, samples, strict=True):
                self._put(topic.name, ticks.encoding(topic), sample)
        self._latest[who] = packer, rows[-1:].copy(), sequence[-1:], time_ns[-1:]
        self.flown(who, int(sequence[-1]))

    def flown(self, who: str, number: int) -> None:
        """There have been ticks up to this one, whether or not we have got them to publish."""
        for topic in self._packers[who].topics:
            self._flown[topic.name] = number

    def params(self, row: Rows) -> None:
        """The law's parameters in force from row[0] (s) on."""
        self.rows("params", row[None, :], *self._numbered("params", float(row[0])))

    def event(self, event: Event) -> None:
        """Something happened."""
        numbered = self._numbered(keys.EVENTS, event.t)
        sample = ticks.pack_messages(*numbered, [events.encode(event)])
        self._put(events.TOPIC, events.ENCODING, sample)
        self._last[events.TOPIC] = sample, events.ENCODING
        self._flown[events.TOPIC] = int(numbered[0][0])

    def messages(
        self, topic: str, encoding: str, sequence: Numbers, time_ns: Numbers,
        messages: Sequence[bytes],
    ) -> None:  # fmt: skip
        """Ticks of one topic as they are on file."""
        for i in range(0, len(messages), TOGETHER):
            part = slice(i, i + TOGETHER)
            sample = ticks.pack_messages(sequence[part], time_ns[part], messages[part])
            self._put(topic, encoding, sample)
        if len(messages):
            last = ticks.pack_messages(sequence[-1:], time_ns[-1:], messages[-1:])
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
        for topic in TOPICS:
            self._publisher(topic.name, ticks.encoding(topic))
        return any(publisher.matching_status.matching for publisher in self._publishers.values())

    # --- who is there

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
        until = time.monotonic() + bound_s
        while self.is_heard() and time.monotonic() < until:
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
        """What is asked for of: `about`, and the last tick of each topic."""
        for packer, row, sequence, time_ns in self._latest.values():
            samples = packer.pack(row, sequence, time_ns)
            for topic, sample in zip(packer.topics, samples, strict=True):
                self._last[topic.name] = sample, ticks.encoding(topic)
        self._latest.clear()
        about = json.dumps(self.about).encode(), "application/json"
        for topic_name, (sample, encoding) in {**self._last, keys.ABOUT: about}.items():
            key = keys.relative(self._vehicle, topic_name)
            if query.key_expr.intersects(zenoh.KeyExpr(key)):
                query.reply(
                    key, sample, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
                )
