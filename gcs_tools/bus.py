"""Zenoh, as this project uses it; the only importer of it.

Sessions are open to this machine alone, find each other by port, and are always closed: in a
bounded time, since a peer that hangs can hold a close up for many seconds. Nothing here is a
callback: what arrives waits in a channel until it is asked for.
"""

from __future__ import annotations

import json
import os
import re
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import zenoh

from fcu.interface import topics
from fcu.interface.link import HOST
from fcu.interface.ports import INSTANCES

CLOSE_S = 2.0  # wall: how long closing may take
WAITING = 8192  # samples that a channel holds; when it is full the network waits, and then drops

# Nobody but the publisher puts anything through its session, or answers for it.
_OWN_WORDS: dict[str, Any] = {
    "enabled": True,
    "default_permission": "allow",
    "rules": [{
        "id": "theirs",
        "messages": ["put", "delete", "declare_queryable", "reply", "liveliness_token"],
        "flows": ["ingress"],
        "permission": "deny",
        "key_exprs": ["**"],
    }],
    "subjects": [{"id": "all"}],
    "policies": [{"rules": ["theirs"], "subjects": ["all"]}],
}  # fmt: skip

# Of every session that is not configured by a file.
_OWN: dict[str, Any] = {
    "mode": "peer",
    "listen/endpoints": [],
    "scouting/multicast/enabled": False,  # or every peer of the network would be met
    "scouting/gossip/enabled": False,
    "connect/timeout_ms": -1,  # whoever is not there yet is tried again, in the background
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": 2000,  # ms until one that is stopped counts as gone
    "transport/link/tx/queue/size/data_low": 16,  # batches of 64 KiB
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
    "transport/link/rx/max_message_size": 1 << 20,
    "transport/unicast/max_sessions": 16,
}

_stuck = False  # a session did not close in time: its threads would hold up our exit


class BusError(RuntimeError):
    """No session: a file that is no configuration, a port in use, a router that is not there."""


def _configured(values: dict[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in (_OWN | values).items():
        config.insert_json5(key, json.dumps(value))
    return config


def _from_file(path: Path) -> zenoh.Config:
    try:
        path.read_bytes()  # for its error
        return zenoh.Config.from_file(str(path))
    except OSError as error:
        raise BusError(f"{path}: {error.strerror}") from error
    except zenoh.ZError as error:
        raise BusError(f"{path}: not a Zenoh configuration: {_short(error)}") from error


def for_publisher(instance: int, run: str, file: Path | None = None) -> zenoh.Config:
    """Where others connect to: the instance's port, or as `file` says. Raises BusError."""
    if file is None:
        return _configured({
            "listen/endpoints": [f"tcp/{HOST}:{topics.port(instance)}"],
            "namespace": topics.namespace(run),
            "access_control": _OWN_WORDS,
        })  # fmt: skip
    config = _from_file(file)
    config.insert_json5("namespace", json.dumps(topics.namespace(run)))
    return config


def for_tool(instance: int, file: Path | None = None) -> zenoh.Config:
    """What connects to the publisher of an instance, or as `file` says. Raises BusError."""
    if file is None:
        return _configured({"connect/endpoints": [f"tcp/{HOST}:{topics.port(instance)}"]})
    return _from_file(file)


@contextmanager
def session(config: zenoh.Config) -> Iterator[zenoh.Session]:
    """A session, closed at the end. Raises BusError if it cannot be opened."""
    try:
        opened = zenoh.open(config)
    except zenoh.ZError as error:
        raise BusError(_short(error)) from error
    try:
        yield opened
    finally:
        _close(opened)


def _close(opened: zenoh.Session) -> None:
    def close() -> None:
        try:
            opened.close()
        except zenoh.ZError:
            pass  # a peer that hangs: it will find out

    thread = threading.Thread(target=close, daemon=True, name="zenoh-close")
    thread.start()
    thread.join(CLOSE_S)
    if thread.is_alive():
        global _stuck
        _stuck = True


def leave(code: int) -> NoReturn:
    """End this process, whatever threads Zenoh still has."""
    if _stuck:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)
    sys.exit(code)


def published() -> list[int]:
    """Instances whose publisher listens on this machine."""
    found = []
    for instance in range(INSTANCES):
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
            probe.settimeout(0.5)
            if probe.connect_ex((HOST, topics.port(instance))) == 0:
                found.append(instance)
    return found


def channel() -> Any:
    """A handler for what arrives."""
    return zenoh.handlers.FifoChannel(WAITING)


def _short(error: BaseException) -> str:
    """What Zenoh says, without where in its source and without brackets."""
    said = re.sub(r"\bSingle\(([^)]*)\)", r"\1", str(error).split(" at /")[0])
    return re.sub(r"[\[\]]", "", said).strip().rstrip(".!")
