"""The ground link of a mission is lost for a while: the failsafe acts, and the script takes over again."""

from __future__ import annotations

import pytest

import gcs_tools

pytestmark = pytest.mark.slow  # flies

TEXT = """title = "The ground link is lost for 3 s."
[flight]
duration_s = 12.0
setpoints = [[0.0, 0.0, 0.0, 5.0]]
start = { position_m = [0.0, 0.0, 5.0] }
[vehicle.params]
COM_OBL_RC_ACT = 5
[[plant.faults]]
kind = "ground_lost"
at_s = 3.0
for_s = 3.0
[expect]
failsafe = { name = "offboard_lost", from = 3.5, to = 4.002 }
mode = "Offboard"
reached = 0.2
"""


def flown(tmp_path, way, text=TEXT):
    (tmp_path / "lost.toml").write_text(text)
    result = gcs_tools.fly(
        str(tmp_path / "lost.toml"), in_process=way == "process", out=tmp_path / way, figure="never"
    )
    assert not [str(each) for each in result.expectations if each.is_missed]
    return result


def test_the_vehicle_holds_and_flies_the_script_again_over_the_wire_as_in_process(tmp_path):
    results = [flown(tmp_path, way) for way in ("wire", "process")]
    assert all(each.failsafes[0].action == "Hold" for each in results)
    assert len({each.trajectory_sha256 for each in results}) == 1


def test_lost_to_the_end_the_failsafe_is_the_last_mode(tmp_path):
    text = TEXT.replace("for_s = 3.0\n", "").replace('mode = "Offboard"', 'mode = "Hold"')
    flown(tmp_path, "process", text)


def test_shorter_than_its_limit_nothing_acts(tmp_path):
    text = TEXT.replace("for_s = 3.0", "for_s = 0.3").replace(
        'failsafe = { name = "offboard_lost", from = 3.5, to = 4.002 }',
        'failsafe = { name = "none" }',
    )
    assert flown(tmp_path, "process", text).failsafes == []
