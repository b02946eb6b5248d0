"""A vehicle that is up, for clients that are not ours."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from types import SimpleNamespace

import pytest

from fcu.interface.ports import INSTANCES, busy, ports
from tests.patience import PATIENCE_S
from tests.process.conftest import start_process


@pytest.fixture
def vehicle(tmp_path):
    """`vehicle(*options)`: `gcs up` of an instance from the far end, and its ports."""
    started: list[subprocess.Popen[str]] = []
    claims: list[socket.socket] = []

    def up(*options):
        for instance in reversed(range(1, INSTANCES)):
            # tests that run at the same time tell each other by a TCP port, which nobody else binds
            at = ports(instance)
            claim = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            try:
                claim.bind(("127.0.0.1", at.plant))
            except OSError:
                claim.close()
                continue
            claims.append(claim)
            if busy(
                instance, "plant", "fcu_plant", "fcu_script", "script", "fcu_station", "fcu_tcp"
            ):
                continue
            process = start_process(
                [sys.executable, "-m", "gcs_tools", "up", "--instance", str(instance), *options],
                cwd=tmp_path, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL, text=True,
            )  # fmt: skip
            started.append(process)
            assert process.stdout is not None
            if process.stdout.readline().startswith("ready"):
                return SimpleNamespace(instance=instance, ports=at, folder=tmp_path)
            process.wait()  # somebody has taken this instance in the meantime
        return pytest.fail("no instance is free")

    yield up
    for process in started:
        process.send_signal(signal.SIGTERM)
        process.wait()
        process.stdout.close()
    for claim in claims:
        claim.close()


@pytest.fixture
def run(tmp_path):
    """`run(path, *arguments)`: a script, run to its end; its output if it ended well."""

    def script(path, *arguments):
        try:
            done = subprocess.run(
                [sys.executable, str(path), *map(str, arguments)], cwd=tmp_path,
                timeout=PATIENCE_S, capture_output=True, text=True, stdin=subprocess.DEVNULL,
            )  # fmt: skip
        except subprocess.TimeoutExpired as late:
            pytest.fail(
                f"{late}, after {(late.stdout or b'').decode()}{(late.stderr or b'').decode()}"
            )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return script
