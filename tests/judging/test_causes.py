"""What a result says to type next can be typed."""

from __future__ import annotations

import shlex

import pytest

from gcs_tools.judging.causes import envelope_command
from gcs_tools.missions.mission import load, override, with_airframe, with_law
from tests.command_line import gcs


@pytest.mark.parametrize(
    "change",
    [
        lambda mission: with_airframe(mission, "quad"),
        lambda mission: with_law(override(mission, "law.module=px4"), "mmrac"),
        lambda mission: override(mission, "law.guard=govern"),
    ],
)
def test_the_command_that_looks_at_a_flight_looks_at_it(change):
    program, *arguments = shlex.split(envelope_command(change(load("gust_step"))))
    assert program == "gcs"
    done = gcs(*arguments)
    assert done.exit_code in (0, 1), done.stderr
    assert not done.stderr.startswith("Usage")
