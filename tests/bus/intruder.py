"""A program of somebody else's that does what it should not, as fast as it can, until it is ended.

    python -m tests.bus.intruder puts MODE PORT KEY...     samples, Zenoh in mode peer or client
    python -m tests.bus.intruder queries MODE PORT KEY...  questions
    python -m tests.bus.intruder bytes PORT                garbage to a TCP port
    python -m tests.bus.intruder feed INSTANCE             garbage, and lies, to a publisher's feed

Says on standard output how often it has.
"""

from __future__ import annotations

import json
import random
import socket
import sys
from collections.abc import Iterator

import zenoh

from fcu.interface import publisher_feed
from fcu.kernel.buffers import size
from fcu.laws import loader
from gcs_tools.recording.schema import FcuRow, ParamsRow, PlantRow

RANDOM = random.Random(4)


def session(mode: str, port: str) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    return zenoh.open(config)


def puts(mode: str, port: str, *keys: str) -> Iterator[int]:
    bus = session(mode, port)
    tokens = [bus.liveliness().declare_token(key) for key in keys if "*" not in key]
    assert tokens
    while True:
        for key in keys:
            bus.put(key, RANDOM.randbytes(RANDOM.randrange(2000)))
        yield len(keys)


def queries(mode: str, port: str, *keys: str) -> Iterator[int]:
    bus = session(mode, port)
    while True:
        for key in keys:
            bus.get(key, handler=zenoh.handlers.RingChannel(1))
        yield len(keys)


def garbage(port: str) -> Iterator[int]:
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as one:
            one.connect(("127.0.0.1", int(port)))
            try:
                for _ in range(20):
                    one.sendall(RANDOM.randbytes(RANDOM.randrange(1, 4000)))
            except OSError:
                pass  # hung up on
        yield 1


# what the flight controller says first
HELLO = json.dumps({"hello": "fcu", "dropped": 0, "law": loader.load().identity})


def words() -> Iterator[bytes]:
    for text in (
        "{", "[" * 5000, "5", "[]", "null", '{"hello": "fcu"}', HELLO,
        '{"hello": "fcu", "dropped": 0}', '{"hello": "fcu", "dropped": 0, "law": "\\u001b[2J"}',
        '{"hello": ["fcu"], "dropped": 0}', '{"bye": "fcu", "dropped": "x"}', '{"event": "x"}',
        '{"event": "x", "t": NaN}', '{"event": "x", "t": 1e300}', '{"event": "\\ud800", "t": 1}',
        '{"event": "x", "t": ' + "9" * 5000 + "}", '{"event": 5, "t": 1, "level": []}',
        '{"event": "x", "t": 1, "code": 5}', '{"event": "x", "t": 1, "code": "A", "values": 5}',
        '{"event": "x", "t": 1, "values": [null]}', '{"event": "x", "t": 1, "values": [NaN]}',
        '{"event": "x", "t": 1, "values": [{"code": "A"}]}',
        '{"event": "x", "t": 1, "values": ' + '[{"code": "A", "values": ' * 99 + "[]" + "}]" * 99 + "}",
    ):  # fmt: skip
        data = text.encode()
        yield data if len(data) % 8 else data + b" "


def lies(instance: str) -> Iterator[int]:
    """Each on a connection of its own, some after a hello; and some that stay and say nothing."""
    said = list(words())
    kept = []
    sizes = [*(8 * size(kind) for kind in (FcuRow, PlantRow, ParamsRow)), 8, 65_528, 3]
    while True:
        one = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            one.connect(publisher_feed.address(int(instance)))
            if RANDOM.random() < 0.5:
                one.send(b'{"hello": "plant", "dropped": 0}')
            one.send(RANDOM.choice([RANDOM.randbytes(RANDOM.choice(sizes)), *said]))
        except OSError:
            pass  # hung up on, or not listening yet
        kept = [*kept, one] if RANDOM.random() < 0.1 else kept
        if len(kept) > 20 or one not in kept:
            (kept.pop(0) if len(kept) > 20 else one).close()
        yield 1


def main(what: str, *arguments: str) -> None:
    acts = {"puts": puts, "queries": queries, "bytes": garbage, "feed": lies}
    done, told = 0, 0
    for n in acts[what](*arguments):
        done += n
        if done >= 2 * told:
            told = done
            print(done, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
