"""A mission that sets the vehicle's parameters: flown over the wire and in process, and judged the same."""

from __future__ import annotations

import pytest

import gcs_tools
from gcs_tools.judging.failsafes import Failsafe

SETTINGS = (
    'plant.faults=[{kind="battery_level",at_s=2.0,remaining=0.04}]', "flight.duration_s=12",
    "flight.ground_z_m=-20", "expect={reached=false}",
    'expect.failsafe={name="battery_emergency",from=3.0,to=3.14}', 'expect.mode="Land"',
    "vehicle.params.GF_MAX_VER_DIST=100", "expect.fence_breached=false",
)  # fmt: skip


@pytest.mark.parametrize("in_process", [False, True], ids=["wire", "in process"])
def test_a_mission_orders_a_fault_and_expects_the_failsafe(tmp_path, in_process):
    flown = gcs_tools.fly(
        "gust_step", settings=SETTINGS, params=["COM_LOW_BAT_ACT=3"], in_process=in_process,
        out=tmp_path / "run", figure="never",
    )  # fmt: skip
    assert flown.error is None
    missed = [str(each) for each in flown.expectations if each.is_missed]
    assert not missed
    assert flown.mode == "Land"
    (acted,) = flown.failsafes
    assert acted == Failsafe("battery_emergency", acted.time_s, "Land")
    assert flown.values["vehicle.params.COM_LOW_BAT_ACT"].origin == "--param"
    assert [each.value for each in flown.expectations if each.name == "faults"] == ["all began"]
