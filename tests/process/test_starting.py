"""What can happen while a flight begins: a process that hangs, a signal, a port that is taken."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest

from fcu.interface.ports import ports
from fcu.kernel import compile
from gcs_tools.flight import processes
from gcs_tools.flight.processes import Child, InfrastructureError
from gcs_tools.judging import result
from tests.patience import PATIENCE_S, until
from tests.process.conftest import alive

SAID_WITHIN_S = 10.0


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSTOP)", "stopped"),
        ("import signal; signal.pause()", "did nothing"),
    ],
)
def test_a_process_that_hangs_at_its_start_is_named(tmp_path, monkeypatch, code, said):
    assert processes.HANGS_S < SAID_WITHIN_S
    (tmp_path / "hangs.py").write_text(code)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(processes, "HANGS_S", 1.0)
    child = Child("plant", "hangs", [], tmp_path / "log", ())
    try:
        with pytest.raises(InfrastructureError, match=f"the plant was not ready.*{said}"):
            child.wait_ready(lambda: None)
    finally:
        child.stop()
    assert not alive(child.process.pid)


def test_a_process_that_works_at_its_start_is_waited_for(tmp_path, monkeypatch):
    (tmp_path / "works.py").write_text(
        "import time\nend = time.monotonic() + 2.0\nwhile time.monotonic() < end: pass\n"
        "print('{\"ready\": 1}', flush=True)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(processes, "HANGS_S", 0.7)
    child = Child("plant", "works", [], tmp_path / "log", ())
    try:
        child.wait_ready(lambda: None)
    finally:
        child.stop()


def test_a_process_that_waits_for_one_that_works_for_it_is_waited_for(tmp_path, monkeypatch):
    (tmp_path / "busy.py").write_text(
        "import time\nend = time.monotonic() + 2.0\nwhile time.monotonic() < end: pass\n"
    )
    (tmp_path / "waits.py").write_text(
        "import subprocess, sys\nsubprocess.run([sys.executable, '-m', 'busy'], check=True)\n"
        "print('{\"ready\": 1}', flush=True)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(processes, "HANGS_S", 0.7)
    child = Child("plant", "waits", [], tmp_path / "log", ())
    try:
        child.wait_ready(lambda: None)
    finally:
        child.stop()


@pytest.mark.slow
def test_a_first_flight_tells_how_far_it_has_compiled(fly, tmp_path):
    """It lacks the kernels of the plant's process alone: a cache that is empty takes a minute to fill."""
    warm = compile._folders["fcu"].path
    folder = tmp_path / "cache" / "m-mrac" / warm.name
    folder.mkdir(mode=0o700, parents=True)
    for file in warm.glob("*-*.*"):
        if not file.name.startswith("sitl_plant.burst."):
            shutil.copy(file, folder)
    before = len(list(folder.iterdir()))
    cold = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    program = fly("gust_step", "--figure", "never", "--set", "flight.duration_s=0.5", env=cold)
    program.wait()
    assert result.read(tmp_path / "run" / "result.json").error is None
    told = [int(n) for n in re.findall(r"(\d+) of about \d+", program.text())]
    assert told
    assert told == sorted(set(told))
    files = list((tmp_path / "cache").rglob("*-*.*"))
    assert {file.suffix for file in files} == {".kernel", ".inner"}
    assert told[-1] <= len(files) - before


@pytest.mark.parametrize(
    ("module", "name"), [("fcu", "flight controller"), ("sitl_plant", "plant")]
)
def test_a_process_stopped_at_its_start_is_named_and_ended(fly, tmp_path, module, name):
    cold = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}  # both start anew, and compile
    program = fly("gust_step", "--figure", "never", env=cold)
    pids = program.started()
    os.kill(pids[module], signal.SIGSTOP)
    began = time.monotonic()
    assert program.wait() == 3
    assert name in result.read(tmp_path / "run" / "result.json").error
    assert "SIGSTOP" in program.text()
    assert time.monotonic() - began < 3.0 * SAID_WITHIN_S  # a busy machine's, and its ending
    until(lambda: not any(map(alive, pids.values())), "no orphan")


INTERRUPTED = """
import runpy, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            raise KeyboardInterrupt

sys.modules.pop({name!r}, None)
sys.meta_path.insert(0, Finder())
sys.argv = ["x", "--help"]
runpy.run_module({module!r}, run_name="__main__")
"""


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("gcs_tools", "gcs_tools.flight.interrupts"), ("gcs_tools", "threading"),
        ("gcs_tools", "click"), ("fcu", "pathlib"), ("fcu", "click"),
        ("fcu", "fcu.interface.ports"), ("sitl_plant", "pathlib"), ("sitl_plant", "click"),
        ("sitl_plant", "fcu.interface.ports"),
    ],
)  # fmt: skip
def test_an_interrupt_of_an_import_leaves_no_traceback(module, name):
    words = [sys.executable, "-c", INTERRUPTED.format(name=name, module=module)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_a_busy_instance_is_answered_with_a_free_one_and_leaves_no_folder(
    start, bound, instance, tmp_path
):
    bound("fcu_script", "script")
    program = start("gcs_tools", "up", "--instance", instance, "--no-publish")
    assert program.wait() == 3
    assert str(ports(instance).fcu_script) in program.text()
    assert f"--instance {instance}" not in program.text()
    assert "free: --instance " in program.text()
    assert list(program.folder.glob("runs/*")) == []


@pytest.mark.parametrize(
    "words",
    [
        ("topics", "--for", "0.3"), ("topics", "--timeout", "0.3"),
        ("monitor", "--once", "--timeout", "0.3"), ("record", "x.mcap", "--for", "0.3"),
        ("record", "x.mcap", "--timeout", "0.3"),
        ("view", "--no-open", "--timeout", "0.3"),
    ],
)  # fmt: skip
def test_a_vehicle_that_does_not_come_is_waited_for_so_long(start, instance, words):
    program = start("gcs_tools", *words, "--instance", instance)
    assert program.wait() == 3
    assert "did not publish within 0.3 s" in program.text()
    assert not (program.folder / "x.mcap").exists()
