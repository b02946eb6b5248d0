"""A vehicle that is up in real time, met by `gcs setpoint` and by a script of nobody's but pymavlink's."""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import subprocess

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.ports import INSTANCES, ports
from gcs_tools.cli.setpoint import not_met
from tests.patience import PATIENCE_S
from tests.process.script import HOLD, OFFBOARD, Script


def test_setpoint_brings_a_vehicle_that_is_up_somewhere(start, instance, gone):
    up = start("gcs_tools", "up", "--instance", instance, "--speed", 4)
    said = up.says("ready")
    at = ports(instance)
    for number in (at.script, at.fcu_script, at.station, at.fcu_station):
        assert str(number) in said
    pids = up.started()
    go = start("gcs_tools", "setpoint", 3, -2, 4, "--yaw-deg", 90, "--instance", instance, "--json")
    assert go.wait() == 0, go.text()
    assert go.text().count("aking off") == 1
    assert f"met system {at.system_id} (instance {instance})" in go.err.read_text()
    there = json.loads(go.out.read_text())
    assert math.dist(there["position_m"], (3, -2, 4)) == pytest.approx(there["error_m"])
    assert there["error_m"] < 0.3
    again = start("gcs_tools", "setpoint", 2, -2, 4, "--instance", instance)
    assert again.wait() == 0, again.text()
    assert "Armed" not in again.text()
    assert again.out.read_text().startswith("there: (")
    assert up.interrupted() == 0
    gone(pids)


def test_a_vehicle_that_was_not_met_is_named_with_its_option(instance):
    at = ports(instance)
    other = (instance + 1) % INSTANCES
    said = f"system {at.system_id} (--instance {instance})"
    assert said not in not_met(other)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", at.fcu_script))
        assert said in not_met(other)
        assert said not in not_met(instance)


@pytest.fixture
def flying(start, instance):
    """A `gcs setpoint` to a place, on its way, of a vehicle that is up at four times real time."""

    def begin(*place):
        up = start("gcs_tools", "up", "--instance", instance, "--speed", 4)
        up.says("ready")
        go = start("gcs_tools", "setpoint", *place, "--instance", instance)
        go.says("flying to")
        return go, up

    return begin


def test_setpoint_below_the_ground_is_refused_and_in_the_air_ends_in_a_landing(
    flying, start, instance
):
    """A place in the ground, and aside: the vehicle in the air lands there, upright."""
    first, _ = flying(1, 0, 2)
    assert first.wait() == 0, first.text()
    below = "setpoint", 1, 1, -3, "--instance", instance
    go = start("gcs_tools", *below)
    assert go.wait() == 3
    assert "landed, 3." in go.err.read_text()
    assert "(1, 1, -3) m is below the ground" in go.err.read_text()
    script = Script(instance)
    try:
        script.first("HEARTBEAT", lambda m: not m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    finally:
        script.close()
    again = start("gcs_tools", *below)
    assert again.wait() == 3
    assert "(1, 1, -3) m is below the ground" in again.err.read_text()
    assert "Armed" not in again.text()


def test_setpoint_ends_where_the_time_for_it_is_over(flying, start, instance):
    first, _ = flying(0, 0, 2)
    assert first.wait() == 0, first.text()
    go = start("gcs_tools", "setpoint", 0, 0, 50, "--instance", instance, "--within", 0.5)
    assert go.wait() == 3
    assert "not there after 0.5 s" in go.text()
    assert "--within" in go.text()


def test_setpoint_ends_once_somebody_else_has_the_vehicle(flying, instance):
    go, _ = flying(0, 0, 50)
    at = ports(instance)
    codec = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
    land = mavlink.MAVLink_command_long_message(at.system_id, 1, 21, 0, *[0.0] * 7)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.sendto(land.pack(codec), ("127.0.0.1", at.fcu_station))
        assert go.wait() == 3
    assert "mode" in go.err.read_text()


def test_setpoint_that_is_interrupted_has_the_vehicle_hold(flying, start, instance):
    go, _ = flying(0, 0, 50)
    second = start("gcs_tools", "setpoint", 1, 2, 3, "--instance", instance)
    assert second.wait() == 3
    for who in (f"instance {instance}", str(ports(instance).script)):
        assert who in second.err.read_text()
    assert go.interrupted() == 130
    assert "Traceback" not in go.text()
    script = Script(instance)  # the port is free again
    try:
        assert script.first("HEARTBEAT").custom_mode == HOLD
    finally:
        script.close()


def test_setpoint_is_interrupted_though_the_vehicle_is_gone(flying, gone):
    go, up = flying(0, 0, 50)
    pids = up.started()
    up.process.kill()
    up.wait()
    gone(pids)
    go.signal(signal.SIGINT)
    assert go.wait() == 130
    assert "interrupted" in go.text()


def test_a_killed_up_leaves_nobody(start, instance, gone):
    up = start("gcs_tools", "up", "paper_nominal", "--instance", instance)
    up.says("ready")
    pids = up.started()
    up.process.kill()
    up.wait()
    gone(pids)


def test_up_ends_with_the_program_that_holds_its_standard_input(start, instance, gone):
    options = "--instance", instance, "--until-eof"
    up = start("gcs_tools", "up", *options, stdin=subprocess.PIPE)
    up.says("ready")
    pids = up.started()
    up.process.stdin.write(b"still there\n")
    up.process.stdin.flush()
    go = start("gcs_tools", "setpoint", 0, 0, 2, "--instance", instance)
    assert go.wait() == 0, go.text()
    assert up.process.poll() is None
    up.process.stdin.close()
    assert up.wait() == 0
    gone(pids)


def test_up_says_which_process_ended(start, instance, gone):
    up = start("gcs_tools", "up", "--instance", instance)
    up.says("ready")
    pids = up.started()
    os.kill(pids["sitl_plant"], signal.SIGTERM)
    assert up.wait() == 3
    assert "plant" in up.err.read_text() and "code 0" in up.err.read_text()
    gone(pids)


def test_no_vehicle_is_up(start, instance):
    go = start("gcs_tools", "setpoint", 1, 2, 3, "--instance", instance, "--timeout", 0.5)
    assert go.wait() == 3
    assert f"instance {instance} after 0.5 s" in go.text()


def test_setpoint_waits_for_a_vehicle_that_is_yet_to_come_up(start, instance):
    patient = "--instance", instance, "--timeout", PATIENCE_S
    go = start("gcs_tools", "setpoint", 1, 2, 3, *patient)
    go.says("waiting for a vehicle to be up")
    up = start("gcs_tools", "up", "--instance", instance, "--speed", 4)
    assert go.wait() == 0, go.text()
    assert go.out.read_text().startswith("there: (")
    assert up.interrupted() == 0


def test_setpoint_says_when_the_vehicle_is_not_ready_in_time(start, instance, bound):
    bound("fcu_script", "script")
    go = start("gcs_tools", "setpoint", 1, 2, 3, "--instance", instance, "--timeout", 0)
    assert go.wait() == 3
    assert "no vehicle is ready" in go.text()


def test_a_plain_script_flies_and_lands(start, instance, script):
    """Time runs five times as fast: scripts that hold no grant work in arrival time."""
    fcu = start("fcu", "--instance", instance)
    start("sitl_plant", "--instance", instance, "--speed", 5)
    script.first("HEARTBEAT", lambda m: m.system_status == mavlink.MAV_STATE_STANDBY)

    start_z = script.first("LOCAL_POSITION_NED").z
    takeoff = (0, 0, 0, math.nan, math.nan, math.nan, 2.0)
    # on the ground it may be told to land, and is not armed in that mode, as PX4
    assert script.command(mavlink.MAV_CMD_NAV_LAND) == mavlink.MAV_RESULT_ACCEPTED
    denied = script.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert denied == mavlink.MAV_RESULT_DENIED
    script.first("STATUSTEXT", lambda m: m.severity <= mavlink.MAV_SEVERITY_WARNING)
    assert script.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == 0
    assert script.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
    script.first("HEARTBEAT", lambda m: m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    assert script.command(mavlink.MAV_CMD_NAV_TAKEOFF, *takeoff) == 0
    script.first("HEARTBEAT", lambda m: m.custom_mode == HOLD)
    script.at(0, 0, start_z - 2, 0.5)

    for _ in range(2):
        script.go(2.0, -1.0, -3.0, yaw=1.0)
    assert script.command(mavlink.MAV_CMD_DO_SET_MODE, 1, OFFBOARD, 0) == 0
    script.fly(2.0, -1.0, -3.0, 1.0, 0.2)
    turned = script.first(
        "ATTITUDE_QUATERNION", lambda m: abs(2 * math.atan2(m.q4, m.q1) - 1) < 0.1
    )
    assert abs(turned.q2) < 0.1
    assert script.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == mavlink.MAV_RESULT_DENIED

    assert script.command(mavlink.MAV_CMD_NAV_LAND) == 0
    script.first("HEARTBEAT", lambda m: not m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    down = script.first("LOCAL_POSITION_NED")
    assert (down.x, down.y) == pytest.approx((2.0, -1.0), abs=0.3)
    assert down.z == pytest.approx(start_z, abs=0.02)
    landed = script.first("EXTENDED_SYS_STATE")
    assert landed.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
    assert fcu.interrupted() == 0


def test_standing_armed_on_the_ground_contradicts_no_belief(start, instance, script):
    """In Hold with its motors idling, until it disarms because nobody takes off."""
    start("gcs_tools", "up", "--instance", instance, "--speed", "max")
    script.first("HEARTBEAT", lambda m: m.system_status == mavlink.MAV_STATE_STANDBY)
    assert script.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
    said = []
    script.first("STATUSTEXT", lambda m: said.append(m.text) or "no takeoff" in m.text)
    assert not [text for text in said if "believed" in text]


def test_interrupted_before_it_is_up_it_ends_with_130(start, instance, tmp_path, gone):
    cold = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    up = start("gcs_tools", "up", "--instance", instance, env=cold)
    pids = up.started()
    assert up.interrupted() == 130
    assert "stopped" in up.text() and "Traceback" not in up.text()
    gone(pids)


def test_a_publisher_that_died_is_told_and_the_vehicle_stays_up(start, instance, until, alive):
    up = start("gcs_tools", "up", "--instance", instance)
    up.says("Zenoh")
    pids = up.children()
    os.kill(pids["gcs_tools"], signal.SIGKILL)
    up.says(f"gcs publish --instance {instance}")
    assert alive(pids["fcu"]) and alive(pids["sitl_plant"])
    assert up.interrupted() == 0


def test_setpoint_names_the_vehicle_and_refuses_another(start, instance, bound):
    """Another autopilot answers at the port of this instance, as system 77."""
    at = ports(instance)
    other = bound("fcu_script", "script")
    codec = mavlink.MAVLink(None, srcSystem=77, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 81, 4 << 16 | 3 << 24, 3, 3)
    go = start("gcs_tools", "setpoint", 1, 2, 3, "--instance", instance)
    heard = []
    while go.process.poll() is None:
        other.send(beat.pack(codec))
        if other.wait(0.1):
            heard += codec.parse_buffer(other.receive() or b"") or []
    assert go.wait() == 3
    assert (
        f"system 77 on the link of instance {instance}, which is system {at.system_id}" in go.text()
    )
    assert {m.get_type() for m in heard} <= {"HEARTBEAT"}  # it was asked for nothing
