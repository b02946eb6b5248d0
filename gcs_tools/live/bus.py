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
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import zenoh

from fcu.interface import topics
from fcu.interface.files import input_file
from fcu.interface.link import HOST
from fcu.interface.ports import INSTANCES

CLOSE_S = 2.0  # wall: how long closing may take
TAKEN_S, AGAIN_S = 2.0, 0.1  # wall: how long a port may be taken, how often to try
TAKEN = "Address already in use"
UNCONNECTED = "nobody is there, or one refuses the other (RUST_LOG=warn tells why)"
MOST_BYTES, DEEPEST = input_file.MIB, 64  # of a configuration
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

# Of every session; a file's own values go before.
_OWN: dict[str, Any] = {
    "scouting/multicast/enabled": False,  # or every peer of the network would be met
    "scouting/gossip/enabled": False,
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": 2000,  # ms until one that is stopped counts as gone
    "transport/link/tx/queue/size/data_low": 16,  # batches of 64 KiB
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
    "transport/link/rx/max_message_size": 1 << 20,
    "transport/unicast/max_sessions": 16,
}

# Of a session that is not configured by a file.
_PLAIN: dict[str, Any] = {
    "mode": "peer",
    "listen/endpoints": [],
    "connect/timeout_ms": -1,  # whoever is not there yet is tried again, in the background
    "connect/retry": {  # a refusal on this machine costs nothing; `publisher.KNOCK_S` counts on it
        "period_init_ms": 50, "period_max_ms": 50, "period_increase_factor": 1.0,
    },
}  # fmt: skip

# Files that a configuration names.
_FILES = (
    "transport/link/tls/root_ca_certificate",
    "transport/link/tls/listen_certificate",
    "transport/link/tls/listen_private_key",
    "transport/link/tls/connect_certificate",
    "transport/link/tls/connect_private_key",
    "transport/auth/usrpwd/dictionary_file",
)

_stuck = False  # a session did not close in time: its threads would hold up our exit


class BusError(RuntimeError):
    """No session: a port in use, a router that is not there or refuses us."""

    exit_code = 3  # of a program that ends with it


class ConfigError(BusError):
    """A file that is no configuration, or names files that cannot be read."""

    exit_code = 2


def _configured(values: dict[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in (_OWN | _PLAIN | values).items():
        config.insert_json5(key, json.dumps(value))
    return config


def _from_file(path: Path, namespace: str | None) -> zenoh.Config:
    """What the file says; what it leaves as Zenoh has it is as without a file."""
    try:
        _check_depth(input_file.text(path, MOST_BYTES), path)
        config = zenoh.Config.from_file(str(path))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: expected UTF-8 text ({error.reason})") from error
    except zenoh.ZError as error:
        raise ConfigError(f"{path}: not a Zenoh configuration: {_short(error)}") from error
    _check_files(path, config)
    zenohs = zenoh.Config()

    def says(key: str) -> bool:
        return bool(config.get_json(key) != zenohs.get_json(key))

    own = {key: value for key, value in _OWN.items() if not says(key)}
    own["namespace"] = namespace
    if not says("listen/endpoints") and config.get_json("scouting/multicast/enabled") != "true":
        own["listen/endpoints"] = []  # Zenoh's own: a port that the whole network reaches
        if not says("connect/endpoints"):
            raise ConfigError(f"{path}: neither connect/endpoints nor listen/endpoints is set")
    for key, value in own.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _check_depth(text: str, path: Path) -> None:
    """Zenoh's own parser would run out of stack. Brackets in strings and comments count too."""
    depth = 0
    for bracket in re.findall(r"[\[\]{}]", text):
        depth += 1 if bracket in "[{" else -1
        if depth > DEEPEST:
            raise ConfigError(f"{path}: expected at most {DEEPEST} objects within one another")


def _check_files(path: Path, config: zenoh.Config) -> None:
    """Zenoh itself would name none of them, or try again for ever."""
    for key in _FILES:
        name = json.loads(config.get_json(key))
        if name is None:
            continue
        try:
            input_file.opened(Path(name)).close()
        except OSError as error:
            where = Path(name).absolute()  # Zenoh begins at the working directory too
            raise ConfigError(f"{path}: {key}: {where}: {error.strerror}") from error


def for_publisher(instance: int, run: str, file: Path | None = None) -> zenoh.Config:
    """Where others connect to: the instance's port, or as `file` says. Raises BusError."""
    if file is None:
        return _configured({
            "listen/endpoints": [f"tcp/{HOST}:{topics.port(instance)}"],
            "namespace": topics.namespace(run),
            "access_control": _OWN_WORDS,
        })  # fmt: skip
    return _from_file(file, topics.namespace(run))


def for_tool(instance: int, file: Path | None = None) -> zenoh.Config:
    """What connects to the publisher of an instance, or as `file` says. Raises BusError."""
    if file is None:
        return _configured({"connect/endpoints": [f"tcp/{HOST}:{topics.port(instance)}"]})
    return _from_file(file, None)


@contextmanager
def session(config: zenoh.Config) -> Iterator[zenoh.Session]:
    """A session, closed at the end. Raises BusError if it cannot be opened."""
    if "RUST_LOG" in os.environ:  # or Zenoh says nothing
        zenoh.try_init_log_from_env()
    opened = _open(config)
    try:
        yield opened
    finally:
        _close(opened)


def _open(config: zenoh.Config) -> zenoh.Session:
    """Raises BusError. A port may still be of a publisher that is about to end: that is waited for."""
    until = time.monotonic() + TAKEN_S
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            if TAKEN not in str(error) or time.monotonic() > until:
                raise BusError(_short(error)) from error
        time.sleep(AGAIN_S)


def _close(opened: zenoh.Session) -> None:
    def close() -> None:
        try:
            opened.close()
        except zenoh.ZError:
            pass  # a peer that hangs: it will find out

    global _stuck
    _stuck = True  # also if we are interrupted meanwhile
    thread = threading.Thread(target=close, daemon=True, name="zenoh-close")
    thread.start()
    thread.join(CLOSE_S)
    _stuck = thread.is_alive()


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


def connected(opened: zenoh.Session) -> bool:
    """Whether a session has a link to anybody."""
    return bool(opened.info.routers_zid() or opened.info.peers_zid())


def _short(error: BaseException) -> str:
    """The part of what Zenoh says that is for its user: then come the files of its source."""
    text = str(error).split(" at /")[0].strip().rstrip(".!")
    if syntax := re.search(r"--> (\d+):(\d+).*= (.*)", text, re.DOTALL):
        return f"line {syntax[1]}, column {syntax[2]}: {syntax[3]}"
    if content := re.search(r'msg: "(.*)", location: (.*)', text):
        where = re.search(r"line: (\d+), column: (\d+)", content[2])
        said = content[1].replace('\\"', '"')
        return f"line {where[1]}, column {where[2]}: {said}" if where else said
    if alone := re.search(r"Unable to connect to any of \[(.*)\]", text):
        endpoints = re.sub(r"Single\((.*?)\)", r"\1", alone[1])
        return f"no connection to {endpoints}: {UNCONNECTED}"
    return text.replace("[", "").replace("]", "")
