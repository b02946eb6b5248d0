"""Every shipped airframe flies the missions that are written for any, on gains that follow from it."""

from __future__ import annotations

import pytest

import gcs_tools
from fcu.interface.airframe import SHIPPED

MISSIONS = ("airframe_step", "airframe_eight", "airframe_noise", "airframe_tour")


@pytest.mark.parametrize("mission", MISSIONS)
@pytest.mark.parametrize("airframe", SHIPPED)
def test_an_airframe_flies_its_missions(airframe, mission, tmp_path):
    flight = gcs_tools.fly(
        mission, airframe=airframe, in_process=True, figure="never", record="none",
        out=tmp_path / "run",
    )  # fmt: skip
    assert [line.name for line in flight.expectations if not line.passed] == []
    assert flight.exit_code == 0
