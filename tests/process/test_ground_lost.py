"""The ground link of a mission is lost for a while: the failsafe acts, and the script takes over again."""

from __future__ import annotations

import pytest

from tests.two_ways import fly, fly_both

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


@pytest.fixture
def mission(tmp_path):
    """Writes a mission, and gives its file."""

    def write(text=TEXT):
        (tmp_path / "lost.toml").write_text(text)
        return tmp_path / "lost.toml"

    return write


def test_the_vehicle_holds_and_flies_the_script_again_over_the_wire_as_in_process(
    mission, tmp_path
):
    results = fly_both(mission(), tmp_path)
    assert all(each.failsafes[0].action == "Hold" for each in results.values())


def test_lost_to_the_end_the_failsafe_is_the_last_mode(mission, tmp_path):
    text = TEXT.replace("for_s = 3.0\n", "").replace('mode = "Offboard"', 'mode = "Hold"')
    fly(mission(text), tmp_path, "process")


def test_shorter_than_its_limit_nothing_acts(mission, tmp_path):
    text = TEXT.replace("for_s = 3.0", "for_s = 0.3").replace(
        'failsafe = { name = "offboard_lost", from = 3.5, to = 4.002 }',
        'failsafe = { name = "none" }',
    )
    assert fly(mission(text), tmp_path, "process").failsafes == []
