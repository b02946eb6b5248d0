"""Laws of users' own, each test in a process of its own: what is compiled there is counted."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.process.conftest import instance, start

__all__ = ["instance", "start"]

HERE = Path(__file__).parent
ONE_TICK = """
import json, sys
import numpy as np
from numba.core import event
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.buffers import columns, size
from fcu.laws import loader

compiled = event.RecordingListener()
event.register("numba:compile", compiled)
law = loader.load(sys.argv[1])
ticks = law.ticks
measured, row = np.zeros(size(VehicleState)), np.zeros(size(ticks.Tick))
measured[6] = 1.0
remembered, settings = np.zeros(size(ticks.Remembered)), np.ones(size(ticks.Settings))
with law.compiling():
    for engaged in (ticks.IDLE, ticks.TAKE_OVER, ticks.FLYING):
        ticks.tick(
            0.0, engaged, remembered, settings, np.zeros(size(Setpoint)), 0.0, measured, row
        )
print(json.dumps({
    "compiled": sum(at.is_start for _, at in compiled.buffer),
    "name": law.name, "digest": law.digest, "columns": columns(ticks.Tick),
    "row": dict(zip(columns(ticks.Tick), row.tolist())),
}))
"""


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache of compiled code that these tests alone use."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def own_law(tmp_path: Path) -> Path:
    """The plain cascade in a folder, its gain of yaw in a module beside it."""
    text = (HERE / "plain_cascade.py").read_text()
    text = text.replace("0.2 * wrap(", "gentle * wrap(").replace(
        "from fcu.laws.face", "from yawing import gentle\nfrom fcu.laws.face"
    )
    (tmp_path / "own.py").write_text(text)
    (tmp_path / "yawing.py").write_text("gentle = 0.2\n")
    return tmp_path / "own.py"


@pytest.fixture
def one_tick(cache: Path) -> Callable[..., dict[str, Any]]:
    """Fly three ticks of a law in a new process; what was compiled for it, and the last row."""

    def fly(law: Path | str, cache: Path = cache) -> dict[str, Any]:
        env = {**os.environ, "XDG_CACHE_HOME": str(cache)}
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", ONE_TICK, str(law)],
            env=env, capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        told: dict[str, Any] = json.loads(done.stdout)
        return told

    return fly


@pytest.fixture
def own_mission(tmp_path: Path) -> Path:
    """A copy of the law and its mission in a folder of their own."""
    for name in ("plain_cascade.py", "step_in_still_air.toml"):
        shutil.copy(HERE / name, tmp_path)
    return tmp_path / "step_in_still_air.toml"
