"""A vehicle that is up holds where it begins in the air, outlives a crash, and is reset."""

from __future__ import annotations

import json
import math
import os
import signal

import numpy as np
import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.airframe import believed
from fcu.interface.messages import RotorCommand, VehicleState
from fcu.interface.status_texts import Code
from fcu.kernel.buffers import columns, size
from fcu.mavlink.plant_link import PlantCodec
from gcs_tools.recording.reader import read
from tests.patience import PATIENCE_S, until
from tests.process.script import HOLD

ARM, TAKE_OFF, REBOOT = 400, 22, 246
KILL = 21196.0  # disarm in flight
FORCE = 20190226.0  # MAVLink's REBOOT_SHUTDOWN_CONDITIONS_FORCE
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
NAN = math.nan
STREAMED = 60  # setpoints at once: a socket has room for a few hundred datagrams

IN_THE_AIR = """
title = "A script takes over in the air."

[flight]
duration_s = 60.0
start = {{ position_m = [1.0, 2.0, 10.0], yaw_deg = 30.0 }}
setpoints = [{{ at_s = 0.0, position_m = [1.0, 2.0, 10.0] }}]
ground_z_m = {ground_z_m}
arena_m = {arena_m}

[plant]
noise = {{ position_m = 0.002 }}
"""


@pytest.fixture
def mission(tmp_path):
    """A mission that begins 10 m above the ground, in an arena of 100 m; its file."""

    def written(ground_z_m=0.0, arena_m=100.0):
        file = tmp_path / "in_the_air.toml"
        file.write_text(IN_THE_AIR.format(ground_z_m=ground_z_m, arena_m=arena_m))
        return file

    return written


@pytest.fixture
def up(start, instance):
    """`up(mission, "--speed", 3)`: `gcs up`, and ready."""

    def program(*arguments):
        made = start("gcs_tools", "up", *arguments, "--instance", instance)
        made.says("ready")
        return made

    return program


@pytest.fixture
def reset(start, instance):
    """`reset("--force")`: the exit code of `gcs reset`, and what it said."""

    def ended(*arguments):
        program = start("gcs_tools", "reset", "--instance", instance, *arguments)
        return program.wait(), program.text()

    return ended


def is_armed(heartbeat):
    return bool(heartbeat.base_mode & ARMED)


def holds(script, until_ms, begins_ms=0):
    """The largest distance (m) from the start, of what is reported from one time to another."""
    script.first("LOCAL_POSITION_NED", lambda m: m.time_boot_ms >= begins_ms)
    places = []
    while not places or places[-1].time_boot_ms < until_ms:
        places.append(script.first("LOCAL_POSITION_NED"))
    return max(math.dist((m.x, m.y, m.z), (2.0, 1.0, -10.0)) for m in places)


@pytest.mark.parametrize("speed", ["1", "3", "max"])
def test_a_vehicle_whose_start_is_in_the_air_holds_there(up, script, mission, speed):
    vehicle = up(mission(), "--speed", speed)
    assert holds(script, 4000) < 0.1
    beat = script.first("HEARTBEAT")
    assert is_armed(beat) and beat.custom_mode == HOLD
    landed = script.first("EXTENDED_SYS_STATE").landed_state
    assert landed == mavlink.MAV_LANDED_STATE_IN_AIR
    yaw = math.pi / 2 - script.first("ATTITUDE").yaw
    assert math.degrees(yaw) == pytest.approx(30.0, abs=1.0)
    assert vehicle.interrupted() == 0


def test_a_script_takes_it_from_there(up, script, mission):
    up(mission(), "--speed", 3)
    script.first("HEARTBEAT", is_armed)  # reads on: an answer needs room in the socket
    assert script.command(21) == ACCEPTED  # land
    script.first("HEARTBEAT", lambda m: not is_armed(m))
    assert script.first("LOCAL_POSITION_NED").z > -1.0
    assert script.command(REBOOT, 1) == ACCEPTED
    script.first("HEARTBEAT", is_armed)
    assert holds(script, 2000, begins_ms=1) < 0.1


@pytest.mark.parametrize("speed", ["1", "3", "max"])
@pytest.mark.parametrize(
    ("ground_z_m", "arena_m", "ending"), [(0.0, 100.0, "ground"), (-1000.0, 9.0, "arena")]
)
def test_a_crash_does_not_end_it_and_a_reset_puts_it_back(
    up, script, mission, reset, speed, ground_z_m, arena_m, ending
):
    vehicle = up(mission(ground_z_m, arena_m), "--speed", speed)
    script.first("HEARTBEAT", is_armed)
    assert script.command(ARM, 0, KILL) == ACCEPTED
    told = script.first("STATUSTEXT", lambda m: ending in m.text)
    assert told.severity == mavlink.MAV_SEVERITY_CRITICAL and "gcs reset" in told.text
    assert ending in vehicle.says("gcs reset")
    beat = script.first("HEARTBEAT", lambda m: m.system_status == mavlink.MAV_STATE_EMERGENCY)
    assert not is_armed(beat)
    lies = script.first("LOCAL_POSITION_NED", lambda m: m.vz == 0.0)
    again = script.first("LOCAL_POSITION_NED")  # telemetry goes on
    assert (again.x, again.y, again.z) == (lies.x, lies.y, lies.z)
    assert script.command(ARM, 1) == DENIED
    assert vehicle.process.poll() is None
    code, said = reset()
    assert code == 0, said
    script.forget()
    assert is_armed(script.first("HEARTBEAT"))
    assert holds(script, 1000, begins_ms=1) < 0.1
    assert vehicle.interrupted() == 0


def test_what_counts_seconds_of_simulation_ends_where_time_stands(up, start, script, mission, instance, tmp_path):  # fmt: skip
    """Over a crashed vehicle, from which nothing new comes, and over one that crashes meanwhile."""
    up(mission(), "--speed", 3)
    script.first("HEARTBEAT", is_armed)
    file = tmp_path / "crash.mcap"
    counts = "--for", 1000, "--timeout", 2, "--instance", instance
    meanwhile = start("gcs_tools", "record", file, *counts)
    meanwhile.says("met vehicle")
    script.forget()
    assert script.command(ARM, 0, KILL) == ACCEPTED
    script.first("STATUSTEXT", lambda m: m.severity == mavlink.MAV_SEVERITY_CRITICAL)
    monitor = start("gcs_tools", "monitor", "--json", *counts)
    afterwards = start("gcs_tools", "record", tmp_path / "lies.mcap", *counts, "--json")
    for program in (meanwhile, monitor, afterwards):
        assert program.wait() == 3, program.text()
        said = program.text()
        assert "simulation time stands: " in said and "hit the ground" in said
    recorded = read(file)
    assert len(recorded.fcu["t"]) > 100
    assert any(event.code == Code.CRASHED.name for event in recorded.events)
    assert json.loads(monitor.out.read_text())["time_s"] > 0.0
    assert json.loads(afterwards.out.read_text())["ended"].startswith("simulation time stands")
    ends = {Code.CRASHED.name, Code.FLIGHT_ENDED.name}
    assert ends & {event.code for event in read(tmp_path / "lies.mcap").events}


def climb(script, to_z):
    """Arm, take off by MIS_TAKEOFF_ALT, and wait until it is there."""
    script.first("HEARTBEAT", lambda m: m.system_status == mavlink.MAV_STATE_STANDBY)
    assert script.command(ARM, 1) == ACCEPTED
    assert script.command(TAKE_OFF, 0, 0, 0, NAN, NAN, NAN, NAN) == ACCEPTED
    script.first("LOCAL_POSITION_NED", lambda m: abs(m.z + to_z) < 0.1)


def test_a_reset_vehicle_takes_off_again_and_keeps_parameters(up, script, reset):
    up("--speed", 4)
    name, system = b"MIS_TAKEOFF_ALT", script.target[0]
    script.send(mavlink.MAVLink_param_set_message(system, 1, name, 6.0, 9))
    script.first("PARAM_VALUE", lambda m: m.param_id == name.decode() and m.param_value == 6.0)
    height = 6.3  # of a centre of mass that stood at 0.3 m
    climb(script, height)
    assert script.command(ARM, 0, KILL) == ACCEPTED
    script.first("STATUSTEXT", lambda m: m.severity == mavlink.MAV_SEVERITY_CRITICAL)
    code, said = reset()
    assert code == 0, said
    script.forget()
    stands = script.first("LOCAL_POSITION_NED")
    assert stands.z == pytest.approx(-0.3, abs=0.05)
    home = script.first("HOME_POSITION")
    assert home.z == pytest.approx(-0.3, abs=0.05)
    climb(script, height)


def test_mavlink_resets_it_as_a_reboot(up, script):
    """The acknowledgement comes first, then time from 0; refused where PX4 refuses it."""
    up("--speed", 4)
    script.first("LOCAL_POSITION_NED", lambda m: m.time_boot_ms > 2000)
    assert script.command(REBOOT, 0) == ACCEPTED  # nothing
    for what in (2, 3):  # shut down, bootloader
        assert script.command(REBOOT, what) == DENIED
    script.first("STATUSTEXT", lambda m: "expected 0 or 1" in m.text)
    assert script.first("LOCAL_POSITION_NED").time_boot_ms > 2000
    script.command_to(0, REBOOT, 1)
    assert script.first("COMMAND_ACK", lambda m: m.command == REBOOT).result == DENIED
    assert script.command(REBOOT, 1) == ACCEPTED
    script.first("STATUSTEXT", lambda m: m.severity == mavlink.MAV_SEVERITY_NOTICE)
    assert script.first("LOCAL_POSITION_NED").time_boot_ms < 2000
    script.first("LOCAL_POSITION_NED", lambda m: m.time_boot_ms > 2000)


def test_reset_in_flight_is_refused_unless_forced(up, script, mission, reset):
    up(mission(), "--speed", 3)
    script.first("HEARTBEAT", is_armed)
    code, said = reset()
    script.forget()
    assert code == 3 and "armed" in said and "--force" in said
    assert script.command(REBOOT, 1) == DENIED
    assert "armed" in script.first("STATUSTEXT").text
    assert holds(script, 3000, begins_ms=2000) < 0.1  # time has not begun again
    code, said = reset("--force")
    assert code == 0, said
    script.forget()
    script.first("LOCAL_POSITION_NED", lambda m: m.time_boot_ms > 4000)
    assert script.command(REBOOT, 1, 0, 0, 0, 0, FORCE) == ACCEPTED
    script.first("LOCAL_POSITION_NED", lambda m: m.time_boot_ms < 2000)


def test_two_resets_in_a_row_come_to_one_start(up, script, mission):
    """The second comes while the vehicle of the first is not armed, or just is."""
    up(mission(), "--speed", 3)
    script.first("HEARTBEAT", is_armed)
    for _ in range(4):
        assert script.command(REBOOT, 1, 0, 0, 0, 0, FORCE) == ACCEPTED
    script.first("HEARTBEAT", is_armed)
    assert holds(script, 3000, begins_ms=1) < 0.1


def test_a_reset_among_streaming_setpoints_forgets_them(up, script):
    up("--speed", 4)
    climb(script, 2.8)
    for _ in range(2):
        script.go(2.0, -1.0, -3.0)
    assert script.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6, 0) == ACCEPTED
    for _ in range(STREAMED):
        script.point(2.0, -1.0, -3.0)
    script.command_to(script.target[0], REBOOT, 1, 0, 0, 0, 0, FORCE)
    for _ in range(STREAMED):
        script.point(2.0, -1.0, -3.0)
    assert script.first("COMMAND_ACK", lambda m: m.command == REBOOT).result == ACCEPTED
    script.first("STATUSTEXT", lambda m: m.severity == mavlink.MAV_SEVERITY_NOTICE)
    beat = script.first("HEARTBEAT")
    assert not is_armed(beat) and beat.custom_mode == HOLD
    climb(script, 2.8)


@pytest.mark.alone  # a recorder keeps up with three times real time
def test_a_flight_after_a_reset_is_the_same_to_the_bit_and_is_recorded(
    up, start, script, mission, reset, instance, tmp_path
):
    """Of a vehicle with noise; `gcs record` goes on."""
    up(mission(), "--speed", 3)
    file = tmp_path / "lives.mcap"
    record = start("gcs_tools", "record", file, "--instance", instance)
    record.says("met vehicle")
    for _ in range(2):
        code, said = reset("--force")
        assert code == 0, said
        script.forget()
        script.first("LOCAL_POSITION_NED", lambda m: m.time_boot_ms > 3000)
    assert record.interrupted() == 0, record.text()
    fcu = read(file).fcu
    begins = np.flatnonzero(np.diff(fcu["t"]) < 0.0) + 1
    assert len(begins) == 2
    one, other = fcu.rows[begins[0] : begins[1]], fcu.rows[begins[1] :]
    shared, in_one, in_other = np.intersect1d(one[:, 0], other[:, 0], return_indices=True)
    assert len(shared) > 1000
    assert one[in_one].tobytes() == other[in_other].tobytes()


@pytest.mark.alone  # it is silent for seconds of the wall's clock
def test_a_plant_that_resets_too_late_does_not_end_the_vehicle(up, script, reset):
    """It was asked, was silent for longer than that is waited for, and then did as it was asked."""
    program = up("--speed", 3, "--no-publish")
    plant = program.started()["sitl_plant"]
    script.first("LOCAL_POSITION_NED", lambda m: m.time_boot_ms >= 1000)
    os.kill(plant, signal.SIGSTOP)
    try:
        code, said = reset("--force")
    finally:
        os.kill(plant, signal.SIGCONT)
    assert (code, "plant does not answer" in said) == (3, True)
    program.says("reset: the vehicle stands at the start")
    code, said = reset("--force")
    assert code == 0, said
    script.first("LOCAL_POSITION_NED", lambda m: m.time_boot_ms >= 1000)


def test_no_vehicle_is_up(start, instance):
    program = start("gcs_tools", "reset", "--instance", instance, "--timeout", 0.5)
    assert program.wait() == 3
    assert f"instance {instance} after 0.5 s" in program.text()


def test_reset_waits_for_a_vehicle_that_is_yet_to_come_up(start, instance):
    program = start("gcs_tools", "reset", "--instance", instance, "--timeout", PATIENCE_S)
    program.says("waiting for a vehicle to be up")
    up = start("gcs_tools", "up", "--instance", instance)
    assert program.wait() == 0, program.text()
    assert "at its start" in program.text()
    up.says("ready")
    assert up.interrupted() == 0


def test_a_vehicle_that_does_not_answer_ends_with_3(start, instance, bound):
    bound("fcu_script", "script"), bound("fcu_station", "station")
    program = start("gcs_tools", "reset", "--instance", instance, "--timeout", 1)
    assert program.wait() == 3
    assert "no vehicle is ready" in program.text()


def test_a_plant_that_cannot_reset_is_flown_on(start, instance, bound, script):
    """Of another make: it goes on asking about its state, and is answered once the time is up."""
    fcu = start("fcu", "--instance", instance)
    fcu.says('"ready"')
    plant, codec = bound("plant", "fcu_plant"), PlantCodec(instance + 1, believed()[0].spin)
    state = np.zeros(size(VehicleState))
    state[columns(VehicleState).index("q_EB.w")] = 1.0
    plant.send(codec.pack_state(0, state))
    assert plant.wait(PATIENCE_S)
    assert codec.parse_controls(plant.receive(), np.zeros(size(RotorCommand)))[0] == 0
    assert script.command(REBOOT, 1) == ACCEPTED
    asked = set()

    def is_answered():
        plant.send(codec.pack_state(2000, state))
        plant.wait(0.05)
        while (datagram := plant.receive()) is not None:
            asked.add(codec.is_reset(datagram))
            if not codec.is_reset(datagram):
                return codec.parse_controls(datagram, np.zeros(size(RotorCommand)))[0] == 2000
        return False

    until(is_answered, "an answer")
    assert asked == {True, False}
    assert fcu.logged("warning", "Not reset")
