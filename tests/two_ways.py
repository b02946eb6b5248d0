"""Programs run as a person runs them, and a mission flown over the wire and in process."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.patience import PATIENCE_S


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
    return {
        way: json.loads((folder / way / "result.json").read_text()) for way in ("wire", "process")
    }
