"""The process that compiles a law beside its flight controller."""

from __future__ import annotations

import os
import subprocess
import sys

from fcu.laws import loader
from fcu.process import law_compiler
from tests.patience import until
from tests.process.conftest import alive

STARTER = """
import sys, time
from fcu.laws import loader
from fcu.process import law_compiler
law_compiler._cores = lambda: 2
with law_compiler.law_compiler(loader.load()) as other:
    print(other._process.pid, flush=True)
    time.sleep(600.0)
"""


def test_a_law_that_is_compiled_needs_no_process():
    with law_compiler.law_compiler(None) as other:
        other.wait()
        assert other._process is None


def test_on_one_core_there_is_no_process(monkeypatch):
    monkeypatch.setattr(law_compiler, "_cores", lambda: 1)
    with law_compiler.law_compiler(loader.load()) as other:
        assert other._process is None


def test_the_compiler_ends_with_its_starter(tmp_path):
    cold = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    starter = subprocess.Popen(
        [sys.executable, "-c", STARTER], stdout=subprocess.PIPE, text=True, env=cold
    )
    assert starter.stdout is not None
    with starter.stdout:
        pid = int(starter.stdout.readline())
    starter.kill()
    starter.wait()
    until(lambda: not alive(pid), "the compiler has ended")


def test_the_compiler_does_not_outlive_its_purpose(monkeypatch):
    monkeypatch.setattr(law_compiler, "_cores", lambda: 2)
    with law_compiler.law_compiler(loader.load()) as other:
        process = other._process
    assert process is not None
    assert process.returncode is not None
