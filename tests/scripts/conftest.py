"""Flights of hop.py by missions. Programs end with the test, as those of the processes' own tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_tools.judging import result
from tests.patience import with_room
from tests.process.conftest import start

__all__ = ["start"]

HERE = Path(__file__).parent


@pytest.fixture
def fly(start, tmp_path):
    """`fly(setting, ...)`: flies hop.toml, and gives its exit code and its result."""
    flown: list[Path] = []

    def one(*settings: str) -> tuple[int, result.Result]:
        options = [word for each in settings for word in ("--set", each)]

        def once() -> tuple[int, str]:
            flown.append(tmp_path / f"run-{len(flown)}")
            program = start(
                "gcs_tools", "fly", HERE / "hop.toml", "--allow-commands", *options,
                "--out", flown[-1], "--figure", "never", "--record", "none",
            )  # fmt: skip
            return program.wait(), program.text()

        code, _ = with_room(once)
        return code, result.read(flown[-1] / "result.json")

    return one
