"""The configurations of docs/zenoh made fit for a test, certificates, and a vehicle of made-up ticks."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import trustme

from fcu.interface.publisher_feed import PublisherFeed
from fcu.kernel.buffers import size
from fcu.kernel.rows import column_of
from fcu.laws import loader
from gcs_tools.recording.schema import FcuRow, PlantRow

EXAMPLES = Path(__file__).parents[2] / "docs" / "zenoh"
HERE = "127.0.0.1"
ADDRESSES = ("192.0.2.10:7447", f"{HERE}:7440")  # what a reader of the examples changes
PASSWORD = "change me"
RATE_HZ = 200.0
RUN = "r"
FOR_S = 1.5  # of flight that a tool records


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HERE, 0))
        return int(probe.getsockname()[1])


class Authority:
    """A certificate authority, and a folder of what it has signed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._authority = trustme.CA()
        folder.mkdir()
        self._authority.cert_pem.write_to_path(str(folder / "ca.pem"))
        self.sign("vehicle", HERE, "localhost")
        self.sign("gcs")

    def sign(
        self, name: str, *addresses: str, file: str = "", until: datetime | None = None
    ) -> None:
        issued = self._authority.issue_cert(
            *(addresses or (name,)), common_name=name, not_after=until
        )
        issued.cert_chain_pems[0].write_to_path(str(self.folder / f"{file or name}.pem"))
        issued.private_key_pem.write_to_path(str(self.folder / f"{file or name}.key"))

    def tls(self, name: str) -> dict[str, Any]:
        """How somebody of this name connects."""
        return {
            "root_ca_certificate": str(self.folder / "ca.pem"),
            "connect_certificate": str(self.folder / f"{name}.pem"),
            "connect_private_key": str(self.folder / f"{name}.key"),
            "enable_mtls": True,
        }


def example(name: str, port: int, into: Path, changes: dict[str, str] | None = None) -> Path:
    """A file of docs/zenoh with its address, and what else is changed, written to a folder."""
    text = (EXAMPLES / name).read_text()
    for address in ADDRESSES:
        text = text.replace(address, f"{HERE}:{port}")
    for old, new in (changes or {}).items():
        assert old in text, old
        text = text.replace(old, new)
    path = into / name
    path.write_text(text)
    return path


def of_stranger(
    port: int, into: Path, protocol: str, tls: object = None, user: object = None
) -> Path:
    """A configuration that goes on trying to connect, and keeps no rules."""
    path = into / "stranger.json5"
    path.write_text(json.dumps({
        "mode": "peer",
        "connect": {
            "endpoints": [f"{protocol}/{HERE}:{port}"],
            "retry": {"period_init_ms": 100, "period_max_ms": 100},
        },
        "listen": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"link": {"tls": tls or {}}, "auth": {"usrpwd": user or {}}},
    }))  # fmt: skip
    return path


class Stranger:
    """tests/bus/stranger.py, trying everything until it is told to stop."""

    def __init__(self, config: Path, run: str, vehicle: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, Path(__file__).with_name("stranger.py"), config, run, vehicle],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stdout is not None
        self._guard = threading.Timer(60.0, self.process.kill)  # a hang ends the lines below
        self._guard.start()
        assert self.process.stdout.readline() == "trying\n"

    def gave_up(self) -> dict[str, Any]:
        """What came of it."""
        said, _ = self.process.communicate()
        return dict(json.loads(said))

    def close(self) -> None:
        self._guard.cancel()
        self.process.kill()
        self.process.communicate()


class Vehicle(threading.Thread):
    """Feeds the publisher of an instance as both flying processes do, with ticks of zeros."""

    def __init__(self, instance: int) -> None:
        super().__init__(daemon=True)
        self._feeds = [
            (PublisherFeed(instance, who, loader.load().identity), np.zeros(size(kind)), kind)
            for who, kind in (("fcu", FcuRow), ("plant", PlantRow))
        ]
        self._landed = threading.Event()

    def run(self) -> None:
        began = time.monotonic()
        n = 0
        while not self._landed.wait(max(began + n / RATE_HZ - time.monotonic(), 0.0)):
            for feed, row, kind in self._feeds:
                feed.find(time.monotonic())
                row[0] = n / RATE_HZ
                row[column_of(kind, "timing.sequence")] = n
                feed.send(row)
            n += 1

    def land(self) -> None:
        self._landed.set()
        self.join()
        for feed, _, _ in self._feeds:
            feed.close()
