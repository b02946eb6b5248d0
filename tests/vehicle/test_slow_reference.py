"""Plans of a vehicle whose guard lets the reference change slowly: gains that leave little torque."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs_tools.recording.reader import read
from tests.command_line import gcs

HEIGHT_M = 6.0
MISSION = f"""title = "The vehicle takes off, flies across, and lands."
[flight]
duration_s = 60.0
ground_z_m = 0.0
start = {{ on_ground = true }}
items = [
    {{ kind = "take_off", height_m = {HEIGHT_M} }},
    {{ kind = "go_to", position_m = [10.0, 0.0, {HEIGHT_M}] }},
    {{ kind = "land" }},
]
[expect]
ended = "landed"
"""


@pytest.mark.parametrize("c_rate", [20.0, 30.0, 60.0, 150.0])
@pytest.mark.computes
def test_a_take_off_ends_at_its_height(c_rate: float, tmp_path: Path) -> None:
    """At 150 the guard leaves 1 m/s^3 of jerk, and a take-off to 6 m climbed to 13.6 m and stayed."""
    mission, out = tmp_path / "across.toml", tmp_path / "out"
    mission.write_text(MISSION)
    run = gcs(
        "fly", mission, "--set", f"law.c_rate={c_rate:g}", "--in-process", "--json", "--out", out
    )
    assert run.exit_code == 0, run.output
    assert json.loads(run.stdout)[0]["passed"]
    height = read(out / "flight.mcap").fcu["measured.r_E.z"]
    assert height.max() < HEIGHT_M + 0.3
