"""What a verdict says of whole flights that go another way than their mission asks for."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

import gcs_tools
from gcs_tools.cli.program import main
from gcs_tools.flight import run
from gcs_tools.judging.preflight_check import unflyable

ROOT = Path(gcs_tools.__file__).parents[1]
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
        return gcs_tools.fly(name, settings=settings, **{"out": tmp_path / "run", **options})

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


def test_what_is_limited_in_flight_is_told_before_it_in_the_same_words(flown):
    """Governed, in wind: the vehicle is not at the setpoint before it."""
    places = (
        "flight.setpoints=[[0.0, 0.0, 0.0, 0.0], [5.0, 90.0, 0.0, 0.0], [11.0, 180.0, 0.0, 20.0]]"
    )
    chosen = places, "flight.arena_m=1000", "law.guard='govern'", "wind.steady_m_s=[8.0, 2.0, 0.0]"
    (each,) = unflyable(*run.prepared("gust_step", chosen))
    (warned,) = [line for line in flown("gust_step", *chosen).warnings if "away" in line.text]
    assert (each.at_s, each.why) == (11.0, "far")
    assert warned.time_s == pytest.approx(11.0, abs=0.01)
    assert f'"{warned.text}"' in each.text


def test_a_flight_that_leaves_its_arena_as_told_says_so_and_how_to_raise_it(flown, tmp_path):
    out = FAR.replace("1000.0", "90.0")
    settings = "flight.duration_s=40", "law.f_m=0.5"
    flight = flown(out, "flight.arena_m=30", *settings)
    assert flight.ended == "diverged"
    (cause,) = flight.causes
    assert "flight.arena_m is 30 m" in cause
    assert "more time" not in missed(flight)["reached"].why
    (raised,) = re.findall(r"--set (flight\.arena_m=\S+)", cause)
    assert flown(out, *settings, raised, out=tmp_path / "higher").ended == "time"


def test_a_setpoint_below_the_ground_is_told_in_one_way(flown):
    below = FAR.replace("10.0, 0.0, 0.0]", "0.0, 0.0, 3.0]").replace(
        "1000.0, 0.0, 0.0]", "0.0, 0.0, -20.0]"
    )
    flight = flown(below, "flight.start={on_ground=true}", "flight.ground_z_m=0.0")
    found = missed(flight)
    for line in (found["reached"], found["limited"]):
        assert "(0, 0, -20) m, which is below the ground (flight.ground_z_m is 0 m" in line.why
    assert "more time" not in found["reached"].why
    assert not any("The guard slowed" in cause for cause in flight.causes)
    assert not any("limited" in warned.text for warned in flight.warnings)


def test_a_setpoint_that_was_missed_since_the_guard_governed_says_so(flown, tmp_path):
    """And points at the command that states how long the way may take."""
    late = FAR.replace("1000.0", "60.0")
    (cause,) = flown(late, "law.guard='govern'").causes
    assert "setpoint of 10 s for 100 % of the time" in cause
    assert cause.partition(": ")[2].startswith("gcs envelope")
    warned = flown(late, "law.guard='warn'", "law.f_m=0.3", out=tmp_path / "warn")
    assert "reached" in missed(warned)
    assert not any("The guard slowed" in each for each in warned.causes)


def test_a_terminal_shows_why_and_what_the_vehicle_warned_of(tmp_path):
    (tmp_path / "far.toml").write_text(FAR)
    done = CliRunner().invoke(
        main,
        ["fly", str(tmp_path / "far.toml"), "--in-process", "--record", "none", "--figure", "never",
         "--set", "law.f_m=1.5", "--out", str(tmp_path / "run")],
    )  # fmt: skip
    assert done.exit_code == 1
    lines = done.stdout.splitlines()
    assert lines[1] == "changed: law.f_m = 1.5 (--set)"
    command = "  gcs envelope "  # in one piece, to copy
    assert max(len(line) for line in lines[:-1] if not line.startswith(command)) <= 80
    assert sum(line.startswith("  ") for line in lines) > 3  # what follows a sentence's first line
    for start in (
        "reached: the setpoint of 10 s at (1000, 0, 0) m was not reached",
        "limited: the setpoint of 10 s, (1000, 0, 0) m, was flown as (110, 0, 0) m",
        "10.0 s: Setpoint 990 m away limited to 100 m",
    ):
        assert any(line.startswith(start) for line in lines), done.stdout


def test_a_figure_is_titled_with_what_was_changed(flown, monkeypatch):
    from gcs_tools.pictures.plot import overview

    titles = []
    monkeypatch.setattr(overview, "flight_figure", lambda *given: titles.append(given[3]))
    flown("gust_step", "flight.duration_s=0.5", figure="always", seed=4)
    assert titles[0].endswith("only. (flight.duration_s = 0.5 (--set), flight.seed = 4 (--seed))")


def test_a_mission_passes_where_it_says_so(flown):
    flight = flown(FAR, "expect.reached=false", "expect.limited=true")
    assert flight.passed
    assert [line.name for line in flight.expectations][:2] == ["ended", "limited"]


def test_a_setpoint_refused_in_flight_is_missed_and_the_flight_goes_on(flown, monkeypatch):
    """Nobody has looked at it before flight: the vehicle itself refuses it."""
    monkeypatch.setattr(run, "refusal", lambda scene, expected: "")
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
         ["Contradicts assumptions", "Setpoint 990 m away limited to 100 m"]),
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


@pytest.mark.parametrize(
    ("mission", "settings", "told"),
    [
        ("paper_printed_fast", [],
         ["diverged at 7.91 s: 100 m", "the tilt command from 1.59 s to the end (80 %",
          "11.6 m/s, within the 12 m/s believed", "gcs envelope missions/paper_printed_fast.toml"]),
        ("gust_step", ["plant.mass_kg=25.0"],
         ["hit the ground", "the thrust command", "The mass was 25 kg; 7 to 9 kg",
          "gcs envelope missions/gust_step.toml --set plant.mass_kg=25.0"]),
        ("paper_fast_governed", ["wind.steady_m_s=[20.0, 0.0, 0.0]"],
         ["the tilt command first at", "28.7 m/s, more than the 12 m/s believed",
          "--set 'wind.steady_m_s=[20.0, 0.0, 0.0]'"]),
    ],
    ids=["diverged", "crashed", "saturated"],
)  # fmt: skip
def test_a_flight_that_saturates_or_is_lost_says_why(flown, mission, settings, told, monkeypatch):
    monkeypatch.chdir(ROOT)  # where missions are named from
    flight = flown(mission, *settings)
    text = "\n".join(flight.causes)
    for part in told:
        assert part in text


def test_beliefs_that_follow_from_an_airframe_are_told_in_three_digits(flown):
    causes = flown("paper_nominal", "airframe='quad'").causes
    wind = next(line for line in causes if line.startswith("The wind reached"))
    assert "the 7.41 m/s believed; it changed by up to 18.5 m/s^2 (12.4 believed)" in wind


@pytest.mark.parametrize("mission", ["gust_step", "paper_fast_governed", "noisy_state"])
def test_a_flight_that_does_not_says_nothing(flown, mission):
    assert flown(mission).causes == []


def test_the_command_that_is_pointed_at_looks_at_what_was_flown(flown, tmp_path):
    """With the settings of the flight, quoted as a shell needs them."""
    setting = "flight.setpoints=[{at_s = 0.0, position_m = [4.0, 7.0, 18.0]}]"
    flight = flown("paper_fast", setting, "law.f_m=1.5", "expect.reached=0.001", seed=3)
    assert flight.changes == [
        "flight.setpoints = [{at_s = 0.0, position_m = [4.0, 7.0, 18.0]}] (--set)",
        "law.f_m = 1.5 (--set)", "expect.reached = 0.001 (--set)", "flight.seed = 3 (--seed)",
    ]  # fmt: skip
    command = shlex.split(flight.causes[-1].partition(": ")[2])
    done = CliRunner().invoke(main, [*command[1:], "--json"])
    assert done.exit_code == 1, done.output
    assert json.loads(done.stdout)["holds"] is False


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (
            "setpoints = [[0, 0, 0, 0]]\nyaw = { amplitude_rad = 3.0, frequency_rad_s = 4.0 }",
            "yaw rate is above 10 rad/s, at 0 s",
        ),
        (
            "curve = { kind = 'figure_eight', size_m = [50, 50], speed_max_m_s = 300, ramp_s = 1 }",
            "acceleration is above 100 m/s^2, at 0.",
        ),
    ],
)
def test_a_setpoint_that_no_vehicle_takes_is_named_before_flight(tmp_path, asked, said):
    """A mistake in the mission, not of what flies it."""
    path = tmp_path / "turning.toml"
    path.write_text(f'title = "It turns."\n[flight]\nduration_s = 5.0\n{asked}\n')
    done = CliRunner().invoke(
        main, ["fly", str(path), "--in-process", "--out", str(tmp_path / "run")]
    )
    assert done.exit_code == 2
    assert f"{path}: [flight] {said}" in done.stderr
    assert not (tmp_path / "run").exists()
