"""Programs that tests start end with them, also where a worker of pytest is killed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
WORKER = """
import signal, sys
from tests.process.conftest import start_process
print(start_process([sys.executable, "-c", "import signal; signal.pause()"]).pid, flush=True)
signal.pause()
"""


def test_a_program_ends_with_the_worker_that_is_killed(until, alive):
    words = [sys.executable, "-c", WORKER]
    with subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True) as worker:
        pid = int(worker.stdout.readline())
        assert alive(pid)
        worker.kill()
        worker.wait()
        try:
            until(lambda: not alive(pid), "no orphan")
        finally:
            if alive(pid):
                os.kill(pid, 9)
