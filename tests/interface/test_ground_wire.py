"""The ground link: packed by one end, read by pymavlink or by the other end."""

from __future__ import annotations

import math

import pymavlink.dialects.v20.common as mavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.interface import frames
from fcu.interface import ground_messages as ground
from fcu.interface.ground_messages import (
    IGNORE_YAW,
    IGNORE_YAW_RATE,
    Source,
)
from fcu.interface.ground_wire import GroundCodec
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.rotations import from_euler

FCU = Source(3, 1)
SCRIPT = Source(245, 190)
SPIN = Rotors(1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0)
FLOAT32_MAX = frames.FLOAT32_MAX
NOSE_NORTH_RIGHT_DOWN = from_euler(math.radians(30.0), 0.0, math.radians(90.0))

wild = st.floats()  # NaN and infinities too
wild_vectors = st.builds(Vec3, wild, wild, wild)


@pytest.fixture
def fcu():
    return GroundCodec(*FCU)


@pytest.fixture
def script():
    return GroundCodec(*SCRIPT)


def read(datagram):
    """The messages of a datagram, by pymavlink."""
    return mavlink.MAVLink(None).parse_buffer(bytearray(datagram))


def sent(message, source=SCRIPT, sequence=0):
    """A pymavlink message as the bytes of a sender."""
    link = mavlink.MAVLink(None, srcSystem=source.system, srcComponent=source.component)
    link.seq = sequence
    return message.pack(link)


# --- telemetry


@pytest.mark.parametrize(("armed", "base_mode"), [(False, 1), (True, 129)])
def test_heartbeat_is_that_of_a_px4_octocopter(fcu, armed, base_mode):
    datagram = fcu.pack_heartbeat(
        armed, ground.MainMode.AUTO, ground.AutoMode.LAND, ground.SystemStatus.ACTIVE
    )
    custom_mode = 4 << 16 | 6 << 24
    assert datagram == sent(
        mavlink.MAVLink_heartbeat_message(14, 12, base_mode, custom_mode, 4, 3), FCU
    )
    (heartbeat,) = GroundCodec(*SCRIPT).parse(datagram)
    assert heartbeat == ground.Heartbeat(FCU, 14, 12, armed, 4, 6, 4)


def test_offboard_mode_number_is_px4s(fcu):
    (heartbeat,) = read(fcu.pack_heartbeat(True, ground.MainMode.OFFBOARD, 0, 4))
    assert heartbeat.custom_mode == 6 << 16


def test_attitude_in_aeronautical_terms(fcu):
    (m,) = read(fcu.pack_attitude(1.5, NOSE_NORTH_RIGHT_DOWN, Vec3(0.25, 0.5, 0.75)))
    half = math.radians(15.0)
    assert m.time_boot_ms == 1500
    assert (m.q1, m.q2, m.q3, m.q4) == pytest.approx((math.cos(half), math.sin(half), 0.0, 0.0))
    assert (m.rollspeed, m.pitchspeed, m.yawspeed) == (0.25, -0.5, -0.75)


def test_attitude_comes_back(fcu, script):
    (attitude,) = script.parse(fcu.pack_attitude(1.5, NOSE_NORTH_RIGHT_DOWN, Vec3(0.25, 0.5, 0.75)))
    assert attitude.q_EB == pytest.approx(NOSE_NORTH_RIGHT_DOWN, abs=1e-7)
    assert (attitude.source, attitude.time_boot_ms) == (FCU, 1500)
    assert attitude.w_B == (0.25, 0.5, 0.75)


def test_local_position_is_north_east_down_and_comes_back(fcu, script):
    datagram = fcu.pack_local_position(2.0, Vec3(1.0, 2.0, 3.0), Vec3(4.0, 5.0, 6.0))
    (m,) = read(datagram)
    assert (m.x, m.y, m.z, m.vx, m.vy, m.vz) == (2.0, 1.0, -3.0, 5.0, 4.0, -6.0)
    assert script.parse(datagram) == [
        ground.LocalPosition(FCU, 2000, Vec3(1.0, 2.0, 3.0), Vec3(4.0, 5.0, 6.0))
    ]


@pytest.mark.parametrize(("thrust", "field"), [(0.5, 0.5), (1.5, 1.0), (-1.0, 0.0)])
def test_attitude_target_has_thrust_between_zero_and_one(fcu, thrust, field):
    (m,) = read(fcu.pack_attitude_target(0.0, NOSE_NORTH_RIGHT_DOWN, Vec3(0.0, 0.5, 0.0), thrust))
    assert (m.thrust, m.type_mask, m.body_pitch_rate) == (field, 0, -0.5)


def test_rotor_speeds_are_signed_by_spin(fcu):
    (m,) = read(fcu.pack_rotors(1.25, Rotors(*[float(i) for i in range(8)]), SPIN))
    assert (m.time_usec, m.active) == (1_250_000, 0xFF)
    assert m.actuator[:9] == [0.0, -1.0, 2.0, -3.0, 4.0, -5.0, 6.0, -7.0, 0.0]


def test_landed_state_and_times(fcu, script):
    datagram = fcu.pack_extended_state(ground.LandedState.IN_AIR)
    assert datagram == sent(mavlink.MAVLink_extended_sys_state_message(0, 2), FCU)
    assert script.parse(datagram) == [ground.ExtendedState(FCU, 2)]
    (m,) = read(fcu.pack_system_time(1.5e9, 2.5))
    assert (m.time_unix_usec, m.time_boot_ms) == (1_500_000_000_000_000, 2500)


@given(wild, wild_vectors, wild_vectors, st.builds(Quat, wild, wild, wild, wild))
def test_a_diverging_flight_does_not_crash_its_telemetry(number, a, b, q):
    fcu, script = GroundCodec(*FCU), GroundCodec(*SCRIPT)
    for datagram in (
        fcu.pack_attitude(number, q, a),
        fcu.pack_local_position(number, a, b),
        fcu.pack_attitude_target(number, q, a, number),
        fcu.pack_rotors(number, Rotors(*a, *b, number, number), SPIN),
        fcu.pack_system_time(number, number),
    ):
        assert len(read(datagram)) == 1
        script.parse(datagram)
    assert not script.dropped["wrong checksum"]


def test_values_outside_a_field_are_saturated(fcu):
    (m,) = read(fcu.pack_local_position(1e12, Vec3(1e300, -math.inf, 0.0), Vec3(0.0, 0.0, 0.0)))
    assert (m.time_boot_ms, m.y, m.x) == (2**32 - 1, FLOAT32_MAX, -FLOAT32_MAX)


@pytest.mark.parametrize(
    ("length", "sizes"),
    [(0, [0]), (1, [1]), (50, [50]), (51, [50, 1]), (100, [50, 50, 0]), (120, [50, 50, 20])],
)
def test_text_is_sent_in_chunks_that_say_where_it_ends(fcu, script, length, sizes):
    text = ("0123456789" * 20)[:length]
    chunks = script.parse(fcu.pack_text(ground.Severity.WARNING, text))
    assert [len(c.text) for c in chunks] == sizes
    assert "".join(c.text for c in chunks) == text
    assert [c.chunk for c in chunks] == list(range(len(sizes)))
    assert {c.severity for c in chunks} == {4}
    assert {c.id for c in chunks} == {0 if len(sizes) == 1 else 1}


def test_text_that_is_not_ascii_stays_readable(fcu, script):
    (chunk,) = script.parse(fcu.pack_text(ground.Severity.INFO, "wind 3 m/s²\0"))
    assert chunk.text == "wind 3 m/s??"


# --- commands


def test_command_and_its_acknowledgement(fcu, script):
    datagram = script.pack_command(FCU, ground.CommandId.ARM_DISARM, (1.0, math.nan))
    (raw,) = read(datagram)
    assert (raw.command, raw.target_system, raw.param1, raw.param3) == (400, 3, 1.0, 0.0)
    (command,) = fcu.parse(datagram)
    assert (command.source, command.command, command.frame) == (SCRIPT, 400, None)
    assert command.params[0] == 1.0
    assert math.isnan(command.params[1])
    answer = fcu.pack_command_ack(command, ground.Result.DENIED)
    assert answer == sent(mavlink.MAVLink_command_ack_message(400, 2, 255, 0, *SCRIPT), FCU)
    assert script.parse(answer) == [ground.CommandAck(FCU, *SCRIPT, 400, 2, 255)]


def test_a_command_has_seven_parameters(script):
    with pytest.raises(ValueError, match="seven"):
        script.pack_command(FCU, 400, [0.0] * 8)


@pytest.mark.parametrize(
    ("frame", "x", "y", "params"),
    [
        (6, 473977420, 85455940, (47.397742, 8.545594)),  # global: 1e-7 degrees
        (1, 125000, -5000, (12.5, -0.5)),  # local: 1e-4 m
        (6, 2**31 - 1, 2**31 - 1, (math.nan, math.nan)),  # unset
    ],
)
def test_integer_commands_are_read_in_degrees_and_metres(fcu, frame, x, y, params):
    message = mavlink.MAVLink_command_int_message(
        *FCU, frame, 22, 0, 0, 1.0, 2.0, 3.0, 4.0, x, y, 9.0
    )
    (command,) = fcu.parse(sent(message))
    assert (command.command, command.frame) == (22, frame)
    assert command.params == pytest.approx((1.0, 2.0, 3.0, 4.0, *params, 9.0), nan_ok=True)


def test_numbers_of_the_enumerations_are_mavlinks():
    pairs = [
        (ground.CommandId.LAND, mavlink.MAV_CMD_NAV_LAND),
        (ground.CommandId.TAKEOFF, mavlink.MAV_CMD_NAV_TAKEOFF),
        (ground.CommandId.SET_MODE, mavlink.MAV_CMD_DO_SET_MODE),
        (ground.CommandId.ARM_DISARM, mavlink.MAV_CMD_COMPONENT_ARM_DISARM),
        (ground.CommandId.SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL),
        (ground.CommandId.REQUEST_MESSAGE, mavlink.MAV_CMD_REQUEST_MESSAGE),
        (ground.SystemStatus.UNINITIALISED, mavlink.MAV_STATE_UNINIT),
        (ground.LandedState.UNDEFINED, mavlink.MAV_LANDED_STATE_UNDEFINED),
        (ground.LandedState.ON_GROUND, mavlink.MAV_LANDED_STATE_ON_GROUND),
        (ground.LandedState.IN_AIR, mavlink.MAV_LANDED_STATE_IN_AIR),
        (ground.LandedState.TAKING_OFF, mavlink.MAV_LANDED_STATE_TAKEOFF),
        (ground.LandedState.LANDING, mavlink.MAV_LANDED_STATE_LANDING),
        (IGNORE_YAW, mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE),
        (IGNORE_YAW_RATE, mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE),
        (ground.FORCE, mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET),
        (ground.LOCAL_NED, mavlink.MAV_FRAME_LOCAL_NED),
    ]
    for kind, prefix in (
        (ground.Result, "MAV_RESULT_"),
        (ground.Severity, "MAV_SEVERITY_"),
    ):
        pairs += [(member, getattr(mavlink, prefix + member.name)) for member in kind]
    pairs += [
        (member, getattr(mavlink, "MAV_STATE_" + member.name))
        for member in ground.SystemStatus
        if member
    ]
    for ours, theirs in pairs:
        assert ours == theirs, ours
