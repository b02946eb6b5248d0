"""What a verdict says of whole flights that go another way than their mission asks for."""

from __future__ import annotations

import pytest

import gcs_tools
from gcs_tools.flight import run

FAR = """title = "A waypoint 1 km away."
[flight]
duration_s = 20.0
setpoints = [[0.0, 10.0, 0.0, 0.0], [10.0, 1000.0, 0.0, 0.0]]
[expect]
reference_error_rms_m = 0.05
"""


@pytest.fixture
def flown(tmp_path):
    """`flown(MISSION, "law.f_m=2")`: the result of a flight without sockets."""

    def fly(mission, *settings, **options):
        name = mission
        if "\n" in mission:
            name = str(tmp_path / "mission.toml")
            (tmp_path / "mission.toml").write_text(mission)
        options = {"in_process": True, "figure": "never", "record": "none", **options}
        return gcs_tools.fly(name, settings=settings, out=tmp_path / "run", **options)

    return fly


def missed(flight):
    return {line.name: line for line in flight.expectations if not line.passed}


def test_a_waypoint_a_kilometre_away_is_not_reached_and_was_limited(flown):
    flight = flown(FAR)
    assert (flight.exit_code, flight.settle_s) == (1, 5.0)
    assert flight.metrics["reference_error_max_m"] < 0.05
    assert flight.metrics["setpoint_error_final_m"] > 900.0
    found = missed(flight)
    assert found.keys() == {"reached", "limited"}
    assert "of 10 s at (1000, 0, 0) m was not reached" in found["reached"].why
    assert "(1000, 0, 0) m, was flown as (110, 0, 0) m" in found["limited"].why


def test_it_passes_where_the_mission_says_so(flown):
    flight = flown(FAR, "expect.reached=false", "expect.limited=true")
    assert flight.passed
    assert [line.name for line in flight.expectations][:2] == ["ended", "limited"]


def test_a_setpoint_refused_in_flight_is_missed_and_the_flight_goes_on(flown, monkeypatch):
    """Nobody has looked at it before flight: the vehicle itself refuses it."""
    monkeypatch.setattr(run, "refusal", lambda scene: "")
    far = "flight.setpoints=[[0.0, 0.0, 0.0, 3.0], [6.0, 0.0, 0.0, 40.0], [9.0, 0.0, 0.0, 8.0]]"
    flight = flown("gust_step", 'law.guard="refuse"', "law.f_m=0.8", far)
    assert (flight.exit_code, flight.ended) == (1, "time")
    assert flight.sim_time_s == pytest.approx(14.998)
    found = missed(flight)
    assert "of 6 s, (0, 0, 40) m, was flown as (0, 0, 3) m" in found["limited"].why
    assert found["limited"].value == 1.0
    assert "reached" not in found  # the one after it was flown


FAST = "flight.curve.speed_max_m_s=16.0"  # faster than the vehicle flies setpoints: told again and again


@pytest.mark.parametrize(
    ("mission", "settings", "told"),
    [
        (FAR, ["plant.mass_change={at_s=3.0, mass_kg=6.0}"],
         ["Not as believed", "Setpoint 990 m away limited to 100 m"]),
        ("figure_eight", [FAST], ["Setpoint speed"]),
    ],
    ids=["far", "fast"],
)  # fmt: skip
def test_the_vehicles_warnings_are_kept_over_the_wire_as_in_process(
    flown, tmp_path, mission, settings, told
):
    here = flown(mission, *settings)
    (tmp_path / "run").rename(tmp_path / "before")
    there = flown(mission, *settings, in_process=False)
    for start in told:
        assert any(warned.text.startswith(start) for warned in here.warnings), here.warnings
    assert [(each.time_s, each.text) for each in there.warnings] == [
        (each.time_s, each.text) for each in here.warnings
    ]
