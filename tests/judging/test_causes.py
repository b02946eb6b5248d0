"""What a result says to type next can be typed."""

from __future__ import annotations

import shlex

import pytest

import gcs_tools
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


def test_a_flight_that_is_over_before_its_last_setpoint_has_a_cause():
    """The rotors are stopped on the ground at once, long before the setpoint at 8 s."""
    flown = gcs_tools.fly(
        "take_off",
        settings=[
            "flight.duration_s=9.0", "plant.faults=[{kind='motor_off',at_s=0.0,rotor=1}]",
            "vehicle.params={COM_ACT_FAIL_ACT=4}",
        ],
        in_process=True,
    )  # fmt: skip
    assert (flown.passed, flown.ended) == (False, "time")
    assert flown.why
