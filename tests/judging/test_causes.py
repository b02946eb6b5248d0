"""What a result says to type next can be typed."""

from __future__ import annotations

import shlex

import numpy as np
import pytest

from gcs_tools.judging.causes import causes, envelope_command
from gcs_tools.judging.metrics import EngagedTicks
from gcs_tools.missions.mission import load, override, with_airframe, with_law
from gcs_tools.recording.table import Table
from tests.command_line import gcs


@pytest.mark.parametrize(
    "change",
    [
        lambda mission: with_airframe(mission, "quad"),
        lambda mission: with_law(override(mission, "law.module=px4"), "mmrac"),
        lambda mission: override(mission, "law.guard=govern"),
    ],
)
@pytest.mark.computes
def test_the_command_that_looks_at_a_flight_looks_at_it(change):
    program, *arguments = shlex.split(envelope_command(change(load("gust_step"))))
    assert program == "gcs"
    done = gcs(*arguments)
    assert done.exit_code in (0, 1), done.stderr
    assert not done.stderr.startswith("Usage")


def test_a_flight_that_is_over_before_its_last_setpoint_has_a_cause():
    """Rotors that are stopped on the ground at once: the second setpoint comes at 8 s."""
    n = 4
    plant = Table(np.zeros((n, 3)), [f"state.r_E.{axis}" for axis in "xyz"])
    told = np.zeros(n)
    flight = EngagedTicks(
        t=np.arange(n) * 0.1, reference_error=told, has_reference=False, setpoint_error=told,
        is_asked=told > 0.0, is_grounded=told < 1.0, plant=plant, fcu=plant, settle_from_s=0.0,
        computed=[],
    )  # fmt: skip
    assert len(causes(load("take_off"), flight, "time", False, {})) == 1
