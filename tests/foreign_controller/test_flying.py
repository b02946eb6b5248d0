"""A controller that imports nothing of ours flies missions over the wire, and is judged by the truth."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fcu.interface.airframe import find
from gcs_tools import fly
from gcs_tools.judging import result
from gcs_tools.pictures.history import recorded
from gcs_tools.recording.reader import CONTROLLER, LAW, read
from sitl_plant.physics.types import PlantRecord
from tests.command_line import gcs

HERE = Path(__file__).parent
MISSION = HERE / "step_in_still_air.toml"
CASCADE = f"{sys.executable} {HERE / 'cascade.py'} {{instance}} {{airframe}}"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a flight by the command line."""
    folder = tmp_path_factory.mktemp("flown") / "run"
    done = subprocess.run(
        [sys.executable, "-m", "gcs_tools", "fly", MISSION, "--controller", CASCADE, "--out", folder],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_a_foreign_controller_flies_a_mission_with_a_verdict(run):
    found = result.read(run / "result.json")
    assert found.passed and found.ended == "time" and found.controller.startswith(sys.executable)
    assert {each.name for each in found.expectations} == {
        "ended", "reached", "setpoint_error_rms_settled_m",
    }  # fmt: skip
    assert found.ticks == 10_000
    with_value = {name for name, value in found.metrics.items() if value is not None}
    assert with_value == {
        "setpoint_error_rms_m", "setpoint_error_rms_settled_m", "setpoint_error_max_m",
        "setpoint_error_final_m", "energy_j", "nonfinite_samples",
    }  # fmt: skip
    assert found.metrics["setpoint_error_max_m"] == pytest.approx(np.hypot(3.0, 10.0), rel=1e-3)
    hover_J = 1170.0 * 20.0  # sitl_plant/README.md: at 8 kg, in watts
    assert found.metrics["energy_j"] == pytest.approx(hover_J, rel=0.05)
    assert not any(key.startswith("law.") for key in found.values)
    assert "law" not in found.versions


def test_the_truth_and_what_was_asked_are_recorded_and_nothing_else(run):
    flown = read(run / "flight.mcap")
    assert flown.topics.keys() == {"/plant/truth", "/plant/timing", "/mission/setpoint"}
    assert flown.metadata[CONTROLLER] == result.read(run / "result.json").controller
    assert LAW not in flown.metadata and flown.params is None
    t, r_c = flown.fcu["t"], flown.fcu["setpoint.r_c"]
    assert np.array_equal(t, flown.plant["t"])
    for at_s, place in ((0.0, (0, 0, 0)), (1.998, (0, 0, 0)), (2.0, (3, 0, 10)), (9.0, (3, 0, 0))):
        assert r_c[round(at_s * 500)].tolist() == [*place]
    truth = flown.plant.rows_of(PlantRecord)
    assert result.trajectory_sha256(truth) == result.read(run / "result.json").trajectory_sha256


def test_its_flight_is_drawn_compared_and_shown(run, tmp_path):
    done = gcs("plot", run, "--out", tmp_path, "--json")
    assert done.exit_code == 0
    drawn = json.loads(done.stdout)
    assert {name for name, found in drawn.items() if found["path"]} == {
        "flight",
        "tracking",
        "timing",
    }
    assert drawn["flight"]["setpoint_error_rms_settled_m"] < 0.1
    assert "tells nothing of itself" in drawn["estimates"]["missing"]
    asked = gcs("plot", run, "--what", "limits", "--out", tmp_path)
    assert asked.exit_code == 2 and "tells nothing of itself" in asked.stderr
    compared = gcs("compare", run, run / "flight.mcap", "--json")
    first, second = (each["metrics"] for each in json.loads(compared.stdout)["runs"])
    assert {k: v for k, v in first.items() if v is not None} == pytest.approx(
        {k: v for k, v in second.items() if v is not None}
    )
    flight = recorded(run / "flight.mcap")
    _, tilt = flight.series("pitch")
    assert 10.0 < tilt.max() < 20.0  # nose down on its way east
    t, least = flight.series("Omega_least")
    assert least[t < 2.0] == pytest.approx(346.0, abs=1.0)  # 8 kg on eight rotors


def test_the_same_flight_twice_has_the_same_bits(run, tmp_path):
    """Also in real time, four times as fast: time stands while a setpoint is sent."""
    sha256 = result.read(run / "result.json").trajectory_sha256
    for n, how in enumerate(({}, {"speed": 4.0, "record": "none"})):
        again = fly(str(MISSION), controller=CASCADE, out=tmp_path / str(n), figure="never", **how)
        assert (again.exit_code, again.trajectory_sha256) == (0, sha256)


MOVING = """
title = "A path is followed in wind."

[flight]
duration_s = 30.0
items = [
    {{ kind = "go_to", position_m = [2.0, 0.0, 1.0] }},
    {{ kind = "hold", for_s = 1.0 }},
]

[wind]
steady_m_s = [3.0, 0.0, 0.0]

[plant.noise]
position_m = 0.01

[expect]
{expect}
"""


def test_items_that_are_setpoints_are_flown_one_after_the_other(tmp_path):
    mission = tmp_path / "items.toml"
    mission.write_text(MOVING.format(expect="reached = 1.0"))
    flown = fly(str(mission), controller=CASCADE, out=tmp_path / "run", figure="never")
    assert (flown.exit_code, flown.ended) == (0, "done"), flown.error
    assert [item.ended_s is not None for item in flown.items] == [True, True]
    assert flown.sim_time_s < 29.0


def test_a_moving_setpoint_is_recorded_as_it_moves(tmp_path):
    mission = tmp_path / "curve.toml"
    mission.write_text("""
title = "A figure eight."
[flight]
duration_s = 8.0
curve = { kind = "figure_eight", size_m = [8.0, 4.0], speed_max_m_s = 2.0, ramp_s = 3.0 }
[expect]
setpoint_error_max_m = 1.0
""")
    flown = fly(str(mission), controller=CASCADE, out=tmp_path / "run", figure="never")
    assert flown.passed, flown.expectations
    found = read(tmp_path / "run" / "flight.mcap")
    r_c, v_c = found.fcu["setpoint.r_c"], found.fcu["setpoint.v_c"]
    moved = 500.0 * np.linalg.norm(np.diff(r_c, axis=0), axis=1)
    assert moved == pytest.approx(np.linalg.norm(v_c[1:], axis=1), abs=0.1)  # m/s, and no stairs
    assert moved.max() > 1.0


def test_the_airframe_of_the_mission_reaches_the_controller(tmp_path):
    """Four rotors of twice the thrust each, in a file of one's own: the same controller flies them."""
    quad = find("s1000").read_text()
    for key, value in {
        "angle_deg": "[45.0, -45.0, -135.0, 135.0]", "spin": "[1, -1, 1, -1]",
        "thrust_coefficient": "1.64e-4",
    }.items():  # fmt: skip
        quad = re.sub(rf"^{key} = .*$", f"{key} = {value}", quad, flags=re.M)
    (tmp_path / "quad.toml").write_text(quad)
    run = tmp_path / "run"
    flown = fly(
        str(MISSION), controller=CASCADE, airframe=str(tmp_path / "quad.toml"), out=run,
        settings=["flight.setpoints=[[0, 0, 0, 0], [1, 1, 1, 1]]", "flight.duration_s=8"],
        figure="never",
    )  # fmt: skip
    assert flown.passed, flown.error or flown.expectations
    recording = read(run / "flight.mcap")
    assert (recording.plant["state.Omega"] > 0.0).any(axis=0).tolist() == [True] * 4 + [False] * 4
    assert flown.versions["airframe"].startswith("quad ")
    shown = recorded(run / "flight.mcap")
    assert len(shown.limits.x) == 4, "gcs view draws as many"
    assert shown.series("Omega_least")[1].min() > 300.0, "of the rotors there are"


def test_a_vehicle_that_falls_is_a_flight_that_failed(tmp_path):
    """Rotors at a tenth of full speed: the controller did as it would, the flight was lost."""
    text = (HERE / "misbehaving.py").read_text().replace("0.6266", "0.1")
    (tmp_path / "falls.py").write_text(text)
    command = f"{sys.executable} {tmp_path / 'falls.py'} {{instance}} well {tmp_path / 'pids'} 9999"
    flown = fly(str(HERE / "hover.toml"), controller=command, out=tmp_path / "run")
    assert (flown.exit_code, flown.ended, flown.error) == (1, "crashed", None)
    assert 1.0 < flown.sim_time_s < 2.0  # ten metres
    assert any("hit the ground" in sentence for sentence in flown.causes)
    assert not any("gcs envelope" in sentence for sentence in flown.causes)


@pytest.mark.parametrize(
    ("mission", "options", "said"),
    [
        ("gust_step", (), "reference_error_max_m: cannot be judged"),
        ("square_and_land", (), "take_off is done by an autopilot"),
        (MISSION, ("--law", "mmrac"), "--law: not with --controller"),
        (MISSION, ("--in-process",), "--in-process: not with --controller"),
        (MISSION, ("--publish",), "--publish: not with --controller"),
        (MISSION, ("--set", "law.f_m=2.0"), "--set law.f_m: a controller of your own has no [law]"),
        (MISSION, ("--set", "expect.limited=true"), "limited: cannot be judged"),
        (
            MISSION,
            ("--controller", "no-such-program-here"),
            "no-such-program-here: no such program",
        ),
        (MISSION, ("--controller", ""), "expected a command"),
        (MISSION, ("--controller", "'half"), "No closing quotation"),
        (MISSION, ("--controller", "echo {instanse}"), "did you mean {instance}?"),
        (MISSION, ("--controller-timeout", "0"), "--controller-timeout"),
        (MISSION, (MISSION, "-j", "2"), "it flies one mission at a time"),  # it knows no instance
    ],
)
def test_what_cannot_be_flown_is_refused_before_the_flight(mission, options, said, tmp_path):
    command = () if "--controller" in options else ("--controller", "true")
    done = gcs("fly", mission, *command, *options, "--out", tmp_path / "run")
    assert done.exit_code == 2
    assert said in done.stderr
    assert not (tmp_path / "run").exists()
