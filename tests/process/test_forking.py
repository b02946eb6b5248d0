"""A process that is forked is as one just started: its own signals, files, session and end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gcs_tools.flight import forking
from tests.patience import PATIENCE_S


def about_itself():
    fds = sorted(int(fd) for fd in os.listdir("/proc/self/fd"))
    json.dump(
        {
            "fds": [fd for fd in fds if os.path.exists(f"/proc/self/fd/{fd}")],
            "session": os.getsid(0),
            "name": Path("/proc/self/comm").read_text().strip(),
            "interrupt": signal.getsignal(signal.SIGINT) is signal.default_int_handler,
            "terminate": signal.getsignal(signal.SIGTERM) is signal.SIG_DFL,
            "blocked": len(signal.pthread_sigmask(signal.SIG_BLOCK, ())),
            "input": os.readlink("/proc/self/fd/0"),
        },
        sys.stdout,
    )


def test_a_forked_process_has_its_own_session_signals_and_files(tmp_path):
    kept_out, kept_in = os.pipe()
    with (tmp_path / "said").open("w+") as said:
        before = signal.signal(signal.SIGTERM, lambda *_: None)
        try:
            process = forking.fork(about_itself, "it", [kept_in], said.fileno(), said.fileno())
        finally:
            signal.signal(signal.SIGTERM, before)
        assert process.wait(PATIENCE_S) == 0, (tmp_path / "said").read_text()
        told = json.loads((tmp_path / "said").read_text())
    os.close(kept_out)
    os.close(kept_in)
    assert set(told["fds"]) == {0, 1, 2, kept_in}
    assert told["session"] == process.pid != os.getsid(0)
    assert told["name"] == "it"
    assert told["interrupt"] and told["terminate"]
    assert told["blocked"] == 0
    assert told["input"] == os.devnull


@pytest.mark.parametrize(
    ("ends", "code", "says"),
    [
        (lambda: None, 0, ""),
        (lambda: sys.exit(5), 5, ""),
        (lambda: sys.exit("why"), 1, "why"),
        (lambda: [][0], 1, "IndexError"),
        (lambda: os.kill(os.getpid(), signal.SIGKILL), -signal.SIGKILL, ""),
        (lambda: os.kill(os.getpid(), signal.SIGTERM), -signal.SIGTERM, ""),
    ],
)
def test_exit_code_of_a_forked_process_is_a_programs(tmp_path, ends, code, says):
    with (tmp_path / "said").open("w") as said:
        process = forking.fork(ends, "it", (), said.fileno(), said.fileno())
        assert process.wait(PATIENCE_S) == process.poll() == code
    assert says in (tmp_path / "said").read_text()


def test_a_process_that_goes_on_is_waited_for_no_longer_than_asked():
    process = forking.fork(signal.pause, "it")
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.01)
    assert process.poll() is None
    process.kill()
    assert process.wait(PATIENCE_S) == -signal.SIGKILL
    process.kill()  # nobody is there any more, and nobody else is met


@pytest.mark.parametrize(
    "happens",
    [
        "import threading; threading.Thread(target=threading.Event().wait, daemon=True).start()",
        "sys.modules['zenoh'] = sys",
        "sys.platform = 'darwin'",
    ],
)
def test_what_keeps_a_process_from_being_forked(happens):
    """Asked in a process of its own, which has one thread: a worker of pytest may have more."""
    ask = "print(forking.can_fork())"
    code = f"import sys; from gcs_tools.flight import forking; {ask}\n{happens}\n{ask}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "False"]


def test_gcs_fly_imports_no_zenoh():
    """The publisher does, in a process of its own."""
    code = "import sys, gcs_tools.cli.fly, gcs_tools.flight.run, gcs_tools.cli.up; print('zenoh' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
