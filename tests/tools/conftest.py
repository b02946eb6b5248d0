"""A recording, replayed for the tools that listen."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs_tools.flight.run import fly
from gcs_tools.recording.reader import Recording, read
from tests.process.conftest import _until, claimed_instance, instance, start

__all__ = ["_until", "instance", "start"]


@pytest.fixture(scope="session")
def recording(tmp_path_factory) -> Recording:
    """Six seconds of the paper's flight, flown by both processes."""
    folder = tmp_path_factory.mktemp("flight") / "run"
    with claimed_instance() as number:
        flown = fly(
            "paper_nominal", settings=["flight.duration_s=6"], out=folder, instance=number,
            figure="never",
        )  # fmt: skip
    assert flown.error is None
    return read(folder / "flight.mcap")


@pytest.fixture
def replay(start, instance, recording):
    """`replay(*options)`: the recording on its way, as `instance`."""

    def begin(*options: object):
        return start("gcs_tools", "replay", recording.path, "--instance", instance, *options)

    return begin


@pytest.fixture
def tool(start, instance):
    """`tool("topics", ...)`: what a tool prints as JSON, listening to `instance`."""

    def output(*arguments: object) -> dict:
        program = start("gcs_tools", *arguments, "--json", "--instance", instance)
        assert program.wait() == 0, program.text()
        return json.loads(program.out.read_text())

    return output


@pytest.fixture
def recorded(tmp_path) -> Path:
    return tmp_path / "recorded.mcap"
