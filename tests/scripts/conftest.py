"""Flights of hop.py by missions. Programs end with the test, as those of the processes' own tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_tools.judging import result
from tests.process.conftest import start

__all__ = ["start"]

HERE = Path(__file__).parent


@pytest.fixture
def fly(start, tmp_path):
    """`fly(setting, ...)`: flies hop.toml, and gives its exit code and its result."""
    flown: list[Path] = []

    def one(*settings: str) -> tuple[int, result.Result]:
        while True:  # begun again as long as other tests have all the instances
            flown.append(tmp_path / f"run-{len(flown)}")
            options = [word for each in settings for word in ("--set", each)]
            program = start(
                "gcs_tools", "fly", HERE / "hop.toml", "--allow-commands", *options,
                "--out", flown[-1], "--figure", "never", "--record", "none",
            )  # fmt: skip
            code = program.wait()
            if "all have a port in use" not in program.text():
                return code, result.read(flown[-1] / "result.json")

    return one
