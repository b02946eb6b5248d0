"""A vehicle of a user's own flies, with four rotors of eight, and no line of ours knows it."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.airframe import read as read_airframe
from gcs_tools.exit_codes import INFRASTRUCTURE
from gcs_tools.recording.reader import read
from tests.bad_input.hovering import Flight
from tests.two_ways import both, run

pytestmark = pytest.mark.slow  # starts processes

HERE = Path(__file__).parent
QUAD = HERE / "quad.toml"
LAW = ("--law", str(HERE.parent / "own_law" / "plain_cascade.py"))
ABSENT = tuple(f"r{i}" for i in range(5, 9))


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """The mission flown over the wire and in process: result.json of each, and the folders."""
    folder = tmp_path_factory.mktemp("flights")
    return folder, both(HERE / "step.toml", folder)


def test_an_own_airframe_flies_the_same_bits_both_ways(flights):
    _, results = flights
    wire, process = results["wire"], results["process"]
    assert wire["passed"]
    assert wire["trajectory_sha256"] == process["trajectory_sha256"]


def test_the_result_says_which_vehicle_flew_and_what_of_it_is_pinned(flights):
    _, results = flights
    result, file = results["wire"], read_airframe(QUAD)
    values = result["values"]
    assert result["versions"]["airframe"] == f"quad {file.sha256[:16]}"
    assert result["versions"]["truth"] == "middle of quad.toml"
    assert values["airframe"]["origin"] == "mission"
    assert values["law.m"] == {"value": 1.5, "origin": "quad.toml"}
    assert values["law.k_rate"] == {"value": 20.0, "origin": "default"}
    assert values["plant.mass_kg"] == {"value": 1.5, "origin": "middle of quad.toml"}


def test_rotors_that_are_absent_stand_still_and_are_told_nothing(flights):
    folder, _ = flights
    recording = read(folder / "wire" / "flight.mcap")
    for r in ABSENT:
        assert not np.any(recording.plant[f"state.Omega.{r}"])
        assert not np.any(recording.fcu[f"command.u.{r}"])
        assert not np.any(recording.fcu[f"outputs.thrusts.{r}"])
        assert recording.params[f"law.rotors.w.{r}"] == 0.0
    assert np.all(recording.fcu["outputs.thrusts.r4"] > 0.0)
    assert recording.metadata["airframe"] == "quad"
    assert recording.metadata["airframe_sha256"] == read_airframe(QUAD).sha256


def test_pictures_leave_them_out(flights, tmp_path):
    folder, _ = flights
    done = run(
        "gcs_tools", "plot", folder / "wire" / "flight.mcap", "--what", "limits", "--json",
        "--out", tmp_path / "limits.png", folder=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert '"rotor_room_fraction": 0.' in done.stdout


def test_a_value_of_the_mission_comes_before_one_that_the_vehicle_pins(tmp_path):
    done = run(
        "gcs_tools", "fly", HERE / "step.toml", "--in-process", "--set", "law.m=1.6", "--figure",
        "never", "--record", "none", "--set", "flight.duration_s=3", "--json", folder=tmp_path,
    )  # fmt: skip
    (result,) = json.loads(done.stdout)
    assert result["values"]["law.m"] == {"value": 1.6, "origin": "--set"}


# --- on the wire


@pytest.fixture
def flight(start, instance):
    made = Flight(start, instance, "--airframe", QUAD, *LAW, airframe=read_airframe(QUAD).rotors)
    yield made
    made.close()


def test_a_ground_station_sees_a_quadrotor(flight):
    assert flight.asked(0, "HEARTBEAT").type == mavlink.MAV_TYPE_QUADROTOR
    flight.send(mavlink.MAVLink_param_request_read_message(flight.at.system_id, 1, b"MAV_TYPE", -1))
    told = struct.pack("<f", flight.heard("PARAM_VALUE").param_value)
    assert struct.unpack("<i", told)[0] == mavlink.MAV_TYPE_QUADROTOR


def test_four_rotors_are_reported_and_no_more(flight):
    outputs = flight.asked(375, "ACTUATOR_OUTPUT_STATUS")
    assert outputs.active == 0b1111
    assert np.sign(outputs.actuator[:8]).tolist() == [1, 1, -1, -1, 0, 0, 0, 0]
    servos = flight.asked(36, "SERVO_OUTPUT_RAW")
    assert servos.servo4_raw == 1000
    assert servos.servo5_raw == servos.servo8_raw == 0
    info = flight.asked(290, "UNKNOWN_290").get_msgbuf()  # ESC_INFO
    payload = info[10:-2].ljust(46, b"\0")
    index, count, info = payload[42], payload[43], payload[45]
    assert (index, count, info) == (0, 4, 0b1111)
    flight.sync()
    flight.tick(5)
    flight.sync()
    of_esc = [m for m in flight.inbox if m.get_type() in ("UNKNOWN_290", "UNKNOWN_291")]
    assert not of_esc


def test_armed_the_absent_rotors_are_commanded_nothing(flight):
    assert flight.ask(400, 1) == mavlink.MAV_RESULT_ACCEPTED
    flight.tick(20)
    assert (flight.command[:4] > 0.1).all()
    assert (flight.command[4:] == 0.0).all()


def test_a_plant_of_other_rotors_is_not_flown_and_that_is_said(start, instance):
    """An S1000 in the simulator, and a controller that believes in a quadrotor."""
    fcu = start("fcu", "--instance", instance, "--airframe", QUAD, *LAW)
    fcu.says('"ready"')
    plant = start("sitl_plant", "--instance", instance)
    assert fcu.wait() == INFRASTRUCTURE
    assert fcu.logged("error", "simulator flies 8 rotors", "airframe has 4", "--airframe")
    plant.says("waiting for a flight controller of 8 rotors")
    right = start("fcu", "--instance", instance)
    right.says("the plant is there")


# --- files that cannot be flown

TEXT = QUAD.read_text()
BAD = {
    "three rotors": ("spin = [1, 1, -1, -1]", "spin = [1, 1, -1]", "spin"),
    "nine rotors": ("spin = [1, 1, -1, -1]", "spin = [1, -1, 1, -1, 1, -1, 1, -1, 1]", "spin"),
    "not a number": ("lag_s = 0.03", "lag_s = nan", "lag_s"),
    "endless": ("full_speed_rad_s = 950.0", "full_speed_rad_s = 1e308", "full_speed_rad_s"),
    "negative": ("thrust_coefficient = 1.1e-5", "thrust_coefficient = -1", "thrust_coefficient"),
    "too heavy": ("mass_kg = [1.3, 1.7]", "mass_kg = [1.3, 4.7]", "cannot hover"),
    "nested": ("[1.3, 1.7]", "[" * 20 + "1" + "]" * 20, "mass_kg"),
    "pinned": ("J = 0.02", "inertia = 0.02", "inertia"),
    "pinned wrong": ("J = 0.02", "J = 'light'", "J"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_vehicle_that_cannot_be_flown_is_named_by_line_and_key(tmp_path, kind):
    before, after, said = BAD[kind]
    assert before in TEXT
    text = TEXT.replace(before, after)
    (tmp_path / "mine.toml").write_text(text)
    done = run("fcu", "--airframe", "mine.toml", *LAW, folder=tmp_path)
    assert done.returncode == 2
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert "mine.toml:" in sentence
    assert said in sentence
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("words", [
    "gcs_tools fly gust_step --airframe X --in-process", "gcs_tools envelope gust_step --airframe X",
    "gcs_tools up --airframe X", "gcs_tools publish --airframe X", "sitl_plant --airframe X",
    "fcu --airframe X", "gcs_tools fly here.toml",
])  # fmt: skip
@pytest.mark.parametrize("name", ["none.toml", "s100", "broken.toml", "loop.toml", "x/../.", ""])
def test_every_program_says_which_airframe_it_cannot_use(tmp_path, words, name):
    (tmp_path / "broken.toml").write_text("[rotors\n")
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    mission = (HERE / "step.toml").read_text().replace("../own_law", str(HERE.parent / "own_law"))
    (tmp_path / "here.toml").write_text(mission.replace("quad.toml", name))
    arguments = [name if word == "X" else word for word in words.split()]
    done = run(*arguments, folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert "Error: " in done.stderr


def test_a_rotor_that_is_absent_cannot_be_lost(tmp_path):
    lost = "plant.rotor_loss=[{ rotor = 5, at_s = 1.0, effectiveness = 0.5 }]"
    done = run("gcs_tools", "fly", HERE / "step.toml", "--set", lost, folder=tmp_path)
    assert done.returncode == 2
    assert "expected 1 to 4, the rotors of quad, got 5" in done.stderr
