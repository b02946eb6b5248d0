"""A vehicle in flight as a ground station meets it: what it sends, what it answers, what it flies."""

from __future__ import annotations

import math
import select
import socket
import struct
import time

import pymavlink.dialects.v20.common as mavlink
import pytest
from pymavlink.quaternion import QuaternionBase

from fcu.interface.airframe import believed
from fcu.vehicle.modes import Mode
from tests.bad_input.hovering import NAN, OFFBOARD, POSITION, Flight
from tests.patience import PATIENCE_S

ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
PX4_INT32 = {
    "FD_FAIL_R", "FD_FAIL_P", "CBRK_FLIGHTTERM", "MR_GUARD_ACT", "MR_LAW_ACT", "CA_FAILURE_MODE", "COM_ACT_FAIL_ACT", "FD_ACT_MOT_TOUT", "COM_FLTT_LOW_ACT", "COM_OBL_RC_ACT", "COM_LOW_BAT_ACT", "GF_ACTION", "GF_PREDICT", "COM_DL_LOSS_T", "NAV_DLL_ACT", "SYS_FAILURE_EN", "SYS_AUTOSTART",
    "MAV_SYS_ID", "MAV_TYPE", "BAT1_N_CELLS", "CA_METHOD", "CAL_ACC0_ID", "CAL_GYRO0_ID",
    "CAL_MAG0_ID", "CA_ROTOR_COUNT", "CBRK_IO_SAFETY", "CBRK_SUPPLY_CHK", "COM_ARM_WO_GPS", "COM_FLTMODE1",
    "COM_RC_IN_MODE", "NAV_RCL_ACT", "COM_RC_ARM_HYST", "MAN_ARM_GESTURE", "MPC_THR_CURVE", "FLW_TGT_ALT_M",
    "COM_RCL_EXCEPT", "RC_MAP_ROLL", "RTL_TYPE", "SENS_BOARD_ROT", "SYS_AUTOCONFIG", "SYS_HAS_MAG",
}  # fmt: skip


@pytest.fixture
def flight(start, instance):
    flight = Flight(start, instance)
    yield flight
    flight.close()


def names(flight):
    return {m.get_type() for m in flight.inbox}


def test_telemetry_comes_without_being_asked_for(flight):
    wanted = {
        "HEARTBEAT", "SYS_STATUS", "BATTERY_STATUS", "ATTITUDE", "ATTITUDE_QUATERNION", "ODOMETRY",
        "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "GPS_RAW_INT", "VFR_HUD", "ALTITUDE",
        "EXTENDED_SYS_STATE", "ESTIMATOR_STATUS", "HOME_POSITION", "GPS_GLOBAL_ORIGIN",
        "SYSTEM_TIME", "SERVO_OUTPUT_RAW",
    } - {"BATTERY_STATUS"}  # this plant has none  # fmt: skip
    until = time.monotonic() + PATIENCE_S
    while not wanted <= names(flight):
        assert time.monotonic() < until, wanted - names(flight)
        flight.inbox += flight.parser.parse_buffer(flight.script.recv(65535)) or []
        flight.tick()


def test_armed_it_tells_what_the_law_estimates_and_what_the_rotors_do(flight):
    assert flight.ask(400, 1) == ACCEPTED
    flight.tick(50)
    estimates = flight.asked(350, "DEBUG_FLOAT_ARRAY")
    assert 5.0 < estimates.data[0] < 9.0  # m_hat: it begins at 5 kg, and 8 are carried
    assert estimates.data[17:21] == [0.0, 0.0, 0.0, 0.0]  # nothing saturates, nothing is governed
    assert 10.0 < estimates.data[21] < 100.0  # margin of force, N
    assert 0.3 < estimates.data[22] < 0.8  # of tilt, rad
    assert estimates.data[23] < estimates.data[21]  # of the condition, N
    assert not any(estimates.data[24:])
    esc = flight.asked(291, "UNKNOWN_291")
    assert esc.get_msgbuf()
    wind = flight.asked(231, "WIND_COV")
    until = time.monotonic() + PATIENCE_S
    while math.isnan(wind.wind_x):  # not looked at yet: that is by the wall
        assert time.monotonic() < until
        flight.tick(10)
        wind = flight.asked(231, "WIND_COV")
    assert math.isnan(wind.wind_z)


def test_every_parameter_is_listed_once(flight):
    flight.send(mavlink.MAVLink_param_request_list_message(flight.at.system_id, 1))
    first = flight.heard("PARAM_VALUE")
    listed = {first.param_index: first}
    while len(listed) < first.param_count:
        flight.tick()
        value = flight.heard("PARAM_VALUE")
        listed[value.param_index] = value
    assert sorted(listed) == list(range(first.param_count))
    assert first.param_count > 60
    by_name = {v.param_id: v for v in listed.values()}
    whole = {name for name, v in by_name.items() if v.param_type != mavlink.MAV_PARAM_TYPE_REAL32}
    assert whole == PX4_INT32
    numbers = {name: struct.pack("<f", by_name[name].param_value) for name in whole}
    assert struct.unpack("<i", numbers["MAV_SYS_ID"])[0] == flight.at.system_id
    assert struct.unpack("<i", numbers["SYS_AUTOSTART"])[0] > 1000


@pytest.mark.parametrize("value", [struct.unpack("<f", struct.pack("<i", 4))[0], 4.0])
def test_an_integer_is_set_by_its_bytes_or_cast(flight, value):
    """As MAVSDK and QGroundControl send it to PX4, and as they send it to others."""
    fields = flight.at.system_id, 1, b"COM_OBL_RC_ACT", value, mavlink.MAV_PARAM_TYPE_INT32
    flight.send(mavlink.MAVLink_param_set_message(*fields))
    answer = flight.heard("PARAM_VALUE")
    assert answer.param_type == mavlink.MAV_PARAM_TYPE_INT32
    assert struct.pack("<f", answer.param_value) == struct.pack("<i", 4)


@pytest.mark.parametrize("autopilot", ["px4", "generic"])
def test_integers_are_sent_by_their_bytes_and_that_is_told(start, instance, autopilot):
    """MAVSDK and QGroundControl read bytes of whatever is not ArduPilot's."""
    flight = Flight(start, instance, "--autopilot", autopilot)
    can = flight.asked(148, "AUTOPILOT_VERSION").capabilities
    assert (can & 16, can & 1 << 17) == (16, 0)  # PARAM_ENCODE_BYTEWISE, _C_CAST
    read = mavlink.MAVLink_param_request_read_message(flight.at.system_id, 1, b"MAV_SYS_ID", -1)
    flight.send(read)
    sent = struct.pack("<f", flight.heard("PARAM_VALUE").param_value)
    assert struct.unpack("<i", sent)[0] == flight.at.system_id
    flight.close()


def test_every_mode_has_a_name(flight):
    assert flight.ask(512, 435) == ACCEPTED
    named = set()
    while len(named) < len(Mode):
        packet = flight.heard("UNKNOWN_435").get_msgbuf()
        named.add(bytes(packet[10 + 11 : -2]).split(b"\0")[0].decode())
    assert {"Hold", "Offboard", "Return", "Figure eight"} <= named


def test_clocks_are_compared_by_timesync(flight):
    flight.send(mavlink.MAVLink_timesync_message(0, 123_456_789))
    answer = flight.heard("TIMESYNC", lambda m: m.tc1 != 0)
    assert answer.ts1 == 123_456_789
    flight.tick(500)
    flight.send(mavlink.MAVLink_timesync_message(0, 7))
    answer = flight.heard("TIMESYNC", lambda m: m.ts1 == 7)
    boot_ms = flight.asked(32, "LOCAL_POSITION_NED").time_boot_ms
    assert boot_ms == (flight.ticks - 1) * 2
    assert answer.tc1 == boot_ms * 1_000_000


def test_a_vehicle_that_is_no_hardware_says_nothing_of_hardware(flight):
    """MAVSDK takes the flag for a simulation of sensors on a real board."""
    assert not flight.asked(0, "HEARTBEAT").base_mode & mavlink.MAV_MODE_FLAG_HIL_ENABLED


def test_only_what_is_present_is_healthy(flight):
    status = flight.asked(1, "SYS_STATUS")
    present = status.onboard_control_sensors_present
    assert status.onboard_control_sensors_health & ~present == 0
    assert status.onboard_control_sensors_enabled & ~present == 0


def test_what_a_client_asked_for_is_not_what_the_next_one_gets(flight):
    """Both at 14540: pymavlink, say, and after it MAVSDK."""
    flight.sync()
    assert flight.ask(511, 30, -1) == ACCEPTED
    assert flight.ask(510, 30) == ACCEPTED
    assert flight.heard("MESSAGE_INTERVAL").interval_us == -1
    flight.script.close()
    flight.tick(10)
    until = time.monotonic() + 0.5
    while time.monotonic() < until:  # some telemetry is refused meanwhile
        flight.tick()
    flight.script = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    flight.script.bind(("127.0.0.1", flight.at.script))
    flight.script.settimeout(PATIENCE_S)
    assert flight.ask(510, 30) == ACCEPTED
    assert flight.heard("MESSAGE_INTERVAL").interval_us == 10_000


@pytest.mark.parametrize("size", [296, 512])
def test_a_client_that_reads_so_many_bytes_loses_nothing(flight, size):
    """296: MAVROS (libmavconn, `MsgBuffer::MAX_SIZE`); 512: gomavlib (`bufferSize`)."""
    for number in (30, 31, 32, 33, 36, 331, 350, 375):
        assert flight.ask(511, number, 20_000) == ACCEPTED
    flight.sync()
    flight.drain()
    heard = []
    while len(heard) < 400:
        flight.tick()
        if select.select([flight.script], [], [], 0)[0]:
            read = flight.script.recv(size)
            assert (read[0], len(read)) == (0xFD, 12 + read[1])  # a frame, whole, and no more
            heard.append(read[4])
    assert heard == [(heard[0] + n) % 256 for n in range(400)]


def test_protocols_that_it_has_nothing_of_answer(flight):
    """A client waits for an answer, not for a feature."""
    system = flight.at.system_id
    for kind in (0, 1, 2):  # mission, fence, rally
        flight.send(mavlink.MAVLink_mission_request_list_message(system, 1, kind))
        plan = flight.heard("MISSION_COUNT")
        assert (plan.count, plan.mission_type) == (0, kind)
    flight.send(mavlink.MAVLink_mission_write_partial_list_message(system, 1, 0, 3))
    assert flight.heard("MISSION_ACK").type == mavlink.MAV_MISSION_INVALID_SEQUENCE
    flight.send(mavlink.MAVLink_log_request_data_message(system, 1, 5, 90, 1000))
    log = flight.heard("LOG_DATA")
    assert (log.id, log.ofs, log.count) == (5, 90, 0)
    flight.send(mavlink.MAVLink_param_ext_request_list_message(system, 1))
    assert flight.heard("PARAM_EXT_VALUE").param_count == 0
    flight.send(mavlink.MAVLink_param_ext_request_read_message(system, 1, b"CAM_MODE", -1))
    assert flight.heard("PARAM_EXT_VALUE").param_id == "CAM_MODE"
    assert flight.heard("PARAM_ERROR").error == 1
    flight.send(mavlink.MAVLink_param_ext_set_message(system, 1, b"CAM_MODE", b"1", 1))
    refused = flight.heard("PARAM_EXT_ACK")
    assert (refused.param_id, refused.param_result) == (
        "CAM_MODE", mavlink.PARAM_ACK_VALUE_UNSUPPORTED,
    )  # fmt: skip
    typed = b"ver all\n".ljust(70, b"\0")
    shell = mavlink.SERIAL_CONTROL_DEV_SHELL
    flight.send(mavlink.MAVLink_serial_control_message(shell, 22, 0, 0, 8, list(typed)))
    answer = flight.heard("SERIAL_CONTROL")
    assert (answer.device, answer.flags) == (shell, mavlink.SERIAL_CONTROL_FLAG_REPLY)
    assert bytes(answer.data[: answer.count]).endswith(b"console.\n")


def test_what_is_not_taken_is_told_once_while_it_streams(flight):
    controls = mavlink.MAVLink_set_actuator_control_target_message(
        0, 0, flight.at.system_id, 1, [0.0] * 8
    )
    for _ in range(30):
        flight.send(controls)
        flight.tick(100)  # six seconds of simulation time in all
        flight.sync()
    told = [m.text for m in flight.inbox if m.get_type() == "STATUSTEXT"]
    assert told.count("SET_ACTUATOR_CONTROL_TARGET is ignored") == 1


def test_what_displays_ask_for_is_told_as_far_as_there_is_any(flight):
    assert flight.asked(65, "RC_CHANNELS").chancount == 0
    mission = flight.asked(42, "MISSION_CURRENT")
    assert (mission.total, mission.mission_state) == (0, mavlink.MISSION_STATE_NO_MISSION)
    flight.sync()
    flight.drain()
    assert flight.ask(512, 241) == mavlink.MAV_RESULT_UNSUPPORTED  # it has no IMU that shakes
    assert flight.ask(400, 1) == ACCEPTED
    flight.tick(5)
    place = mavlink.MAVLink_command_int_message(
        flight.at.system_id, 1, 6, 192, 0, 0, -1, 1, 0, NAN, 474_000_000, 85_000_000, 30.0
    )
    origin = flight.asked(49, "GPS_GLOBAL_ORIGIN")
    place.x, place.y = origin.latitude + 900, origin.longitude  # 10 m to the north
    flight.send(place)
    assert flight.heard("COMMAND_ACK", lambda m: m.command == 192).result == ACCEPTED
    flight.tick(7000)  # the setpoint has moved there, and this plant stays where it is
    output = flight.asked(62, "NAV_CONTROLLER_OUTPUT")
    assert output.wp_dist == pytest.approx(10, abs=1)
    assert output.target_bearing == 0


def test_home_is_moved_and_told(flight):
    origin = flight.asked(49, "GPS_GLOBAL_ORIGIN")
    message = mavlink.MAVLink_command_int_message(
        flight.at.system_id, 1, 5, 179, 0, 0, 0, 0, 0, 0,
        origin.latitude + 10_000, origin.longitude, origin.altitude / 1000 + 1.0,
    )  # fmt: skip
    flight.send(message)
    assert flight.heard("COMMAND_ACK").result == ACCEPTED
    home = flight.heard("HOME_POSITION", lambda m: m.latitude == origin.latitude + 10_000)
    assert home.x == pytest.approx(111.19, abs=0.01)  # 1e-3 deg, to the north
    assert home.z == pytest.approx(-1.0, abs=1e-3)


@pytest.mark.parametrize(("roll", "side"), [(0.2, 1.0), (-0.2, -1.0)])
def test_an_attitude_is_flown(flight, roll, side):
    """Right side down: the rotors on the left push harder."""

    def ask():
        q = (math.cos(roll / 2), math.sin(roll / 2), 0.0, 0.0)
        message = mavlink.MAVLink_set_attitude_target_message(
            0, flight.at.system_id, 1, 7, q, 0, 0, 0, 0.4
        )
        flight.send(message)
        flight.sync()

    ask()
    ask()
    assert flight.ask(176, 1, 6) == ACCEPTED
    assert flight.ask(400, 1) == ACCEPTED
    flight.tick(10)
    left = [u for u, y in zip(flight.command, believed()[0].y, strict=True) if y > 0.0]
    right = [u for u, y in zip(flight.command, believed()[0].y, strict=True) if y < 0.0]
    assert side * (sum(left) - sum(right)) > 0.1
    assert flight.mode() == OFFBOARD


def test_sticks_fly_it_in_position_mode(flight):
    assert flight.ask(400, 1) == ACCEPTED
    assert flight.ask(176, 1, 3) == ACCEPTED
    flight.send(mavlink.MAVLink_manual_control_message(flight.at.system_id, 1000, 0, 500, 0, 0))
    flight.sync()
    flight.tick(200)
    target = flight.asked(85, "POSITION_TARGET_LOCAL_NED")
    assert target.vy > 0.1 and (target.vx, target.vz) == pytest.approx(
        (0.0, 0.0), abs=1e-3
    )  # ahead
    assert flight.mode() == POSITION


def test_a_radios_channels_tilt_it_in_stabilized(flight):
    """The mode may be chosen before a stick is heard. It is armed with a low throttle alone."""
    system = flight.at.system_id
    assert flight.ask(176, 1, 7) == ACCEPTED
    assert flight.ask(400, 1) == mavlink.MAV_RESULT_DENIED
    for throttle, armed in ((1500, mavlink.MAV_RESULT_DENIED), (1000, ACCEPTED)):
        channels = 1500, 2000, throttle, 1500, *[65535] * 4  # the pitch stick pushed
        flight.send(mavlink.MAVLink_rc_channels_override_message(system, 1, *channels))
        flight.sync()
        assert flight.ask(400, 1) == armed
    flight.tick(100)
    target = flight.asked(83, "ATTITUDE_TARGET")
    assert QuaternionBase(target.q).euler[1] < math.radians(-20.0)  # nose down, in MAVLink's frame
    assert flight.mode() == 7 << 16
