"""Programs run as a person runs them, and a mission flown over the wire and in process."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import gcs_tools
from tests.patience import PATIENCE_S

WAYS = "wire", "process"


def run(*arguments: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """A module of ours and its arguments, in a folder, to its end."""
    return subprocess.run(
        [sys.executable, "-m", *map(str, arguments)], cwd=folder, capture_output=True, text=True,
        stdin=subprocess.DEVNULL, timeout=PATIENCE_S,
    )  # fmt: skip


def both(mission: Path, folder: Path) -> dict[str, dict[str, Any]]:
    """What result.json says of a mission flown each way; its runs are folder/wire and folder/process."""
    for way, options in {"wire": (), "process": ("--in-process", "--figure", "never")}.items():
        done = run("gcs_tools", "fly", mission, "--out", folder / way, *options, folder=folder)
        assert done.returncode == 0, done.stderr
    return {way: json.loads((folder / way / "result.json").read_text()) for way in WAYS}


def fly(mission: Path, folder: Path, way: str, **options: Any) -> Any:
    """The result of a mission flown one way, with its run in folder/WAY. Every expectation is met."""
    result = gcs_tools.fly(
        str(mission), in_process=way == "process", out=folder / way, figure="never", **options
    )
    assert result.error is None
    assert not [str(each) for each in result.expectations if each.is_missed]
    return result


def fly_both(mission: Path, folder: Path, **options: Any) -> dict[str, Any]:
    """The results of a mission flown each way, which have one trajectory to the bit."""
    flown = {way: fly(mission, folder, way, **options) for way in WAYS}
    assert flown["wire"].trajectory_sha256 == flown["process"].trajectory_sha256
    return flown
