"""What a flight needs is loaded before it is ready: a kernel from disk takes longer than a tick."""

from __future__ import annotations

import subprocess
import sys

FLY = """
import os, sys
from pathlib import Path
from fcu.kernel.cache import Cache
from gcs_tools.flight.run import fly

load_overload, starter = Cache.load_overload, os.getpid()

def load(self, *arguments):
    if os.getpid() != starter:
        print("loaded", vars(self), file=sys.stderr)
    return load_overload(self, *arguments)

Cache.load_overload = load
for n in range(2):  # the first may have to compile
    out = Path(sys.argv[1]) / str(n)
    settings = ["flight.duration_s=2.5"]
    flown = fly("paper_nominal", settings=settings, out=out, figure="never")
    assert flown.error is None
"""


def test_no_module_is_loaded_in_flight(tmp_path):
    subprocess.run([sys.executable, "-c", FLY, tmp_path], check=True, stdout=subprocess.DEVNULL)
    for name in ("fcu.log", "plant.log"):
        said = (tmp_path / "1" / name).read_text()
        assert said and "loaded" not in said
