"""A script's setpoints: what is flown of them, in which frame, and when they are a stream."""

from __future__ import annotations

import math

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.messages import AttitudeRequest, PositionRequest, Setpoint
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.rotations import from_euler
from fcu.mavlink.ground_link import GroundCodec
from fcu.vehicle.plans import STILL, Pose
from fcu.vehicle.setpoints import (
    ATTITUDE,
    Script,
    SetpointLimits,
    Throttle,
    anchored_by_axis,
    of_attitude,
    of_position,
)

EAST_30 = math.radians(30.0)
POSE = Pose(Vec3(10.0, 20.0, 30.0), Vec3(1.0, 0.0, 0.0), EAST_30)  # heading 60 deg from North
FLOWN = Setpoint(Vec3(9.0, 19.0, 29.0), Vec3(0.5, 0.0, 0.0), STILL, 0.1, 0.0)
HOME = Vec3(0.0, 0.0, 0.3)
THROTTLE = Throttle(hover=0.5, T_hover=60.0, T_max=120.0)
LIMITS = SetpointLimits(away=100.0, below_home=1.0, across=12.0, up=3.0, down=1.5, yaw_rate=1.5)
AHEAD, LEFT = (math.cos(EAST_30), math.sin(EAST_30)), (-math.sin(EAST_30), math.cos(EAST_30))
CODEC, PYMAVLINK = GroundCodec(1), mavlink.MAVLink(None, srcSystem=245, srcComponent=190)


def local(frame=1, mask=0xDF8, r=(0, 0, 0), v=(0, 0, 0), a=(0, 0, 0), yaw=0.0, yaw_rate=0.0):
    packet = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, *r, *v, *a, yaw, yaw_rate
    )
    (message,) = CODEC.parse(packet.pack(PYMAVLINK))
    return of_position(message.request, POSE, HOME, FLOWN, LIMITS)


@pytest.mark.parametrize(
    ("frame", "r", "flown"),
    [
        (1, (3.0, 4.0, -5.0), (4.0, 3.0, 5.0)),  # NED to ENU
        (7, (3.0, 4.0, -5.0), (14.0, 23.0, 35.0)),  # offset from here
        (9, (2.0, 0.0, -5.0), (10.0 + 2 * AHEAD[0], 20.0 + 2 * AHEAD[1], 35.0)),  # ahead
        (12, (0.0, 2.0, 0.0), (10.0 - 2 * LEFT[0], 20.0 - 2 * LEFT[1], 30.0)),  # to the right
    ],
)
def test_positions(frame, r, flown):
    setpoint, warning = local(frame, r=r)
    assert setpoint.r_c == pytest.approx(flown, abs=1e-5)
    assert setpoint.psi_c == FLOWN.psi_c
    assert warning is None


@pytest.mark.parametrize("frame", [8, 9, 12])
def test_velocities_along_the_heading(frame):
    setpoint, _ = local(frame, mask=0xDC7, v=(2.0, 1.0, 0.5))
    across = (2 * AHEAD[0] - LEFT[0], 2 * AHEAD[1] - LEFT[1], -0.5)
    assert setpoint.v_c == pytest.approx(across, abs=1e-6)
    assert setpoint.r_c == FLOWN.r_c  # the reference moves on from where it is


def test_acceleration_alone_goes_on_from_the_velocity_that_is_flown():
    setpoint, _ = local(mask=0xC3F, a=(0.0, 2.0, -1.0))
    assert setpoint.v_c == FLOWN.v_c
    assert setpoint.a_c == pytest.approx((2.0, 0.0, 1.0))


def test_the_tilt_that_is_allowed_bounds_what_is_across_and_not_what_is_up():
    """As PX4's MPC_TILTMAX_AIR: a climb needs no tilt."""
    most = 3.5
    asked = PositionRequest(None, STILL, Vec3(0.0, 6.0, 5.0), None, 0.0)
    bound = LIMITS._replace(across_acceleration=most)
    setpoint, warning = of_position(asked, POSE, HOME, FLOWN, bound)
    assert setpoint.a_c == pytest.approx((0.0, most, 5.0))
    assert warning == Told(Code.SETPOINT_HARD, (6.0, most))
    up = asked._replace(a=Vec3(0.0, 0.0, 5.0))
    setpoint, warning = of_position(up, POSE, HOME, FLOWN, bound)
    assert (setpoint.a_c, warning) == (Vec3(0.0, 0.0, 5.0), None)


def test_a_yaw_from_north_and_one_from_the_heading():
    assert local(mask=0x9F8, yaw=0.3)[0].psi_c == pytest.approx(math.pi / 2 - 0.3)
    assert local(9, mask=0x9F8, yaw=0.3)[0].psi_c == pytest.approx(EAST_30 - 0.3)
    assert local(mask=0x5F8, yaw_rate=0.3)[0].psi_dot_c == pytest.approx(-0.3)


@pytest.mark.parametrize(
    ("given", "code", "numbers", "check"),
    [
        ({"r": (300.0, 20.0, -30.0)}, Code.SETPOINT_FAR, (280.2, 100), lambda s: math.dist(s.r_c, POSE.r_E) - 100),
        ({"mask": 0xDC7, "v": (0, 40, 0)}, Code.SETPOINT_FAST, (40, 12), lambda s: s.v_c.x - 12),
        ({"mask": 0xDC0, "v": (0, 0, 9)}, Code.SETPOINT_FAST, (9, 1.5), lambda s: s.v_c.z + 1.5),
        ({"mask": 0xC3F, "a": (0, 90, 0)}, Code.SETPOINT_HARD, (90, 9.80665), lambda s: s.a_c.x - 9.80665),
        ({"mask": 0x5F8, "yaw_rate": 9}, Code.SETPOINT_TURNS, (9, 1.5), lambda s: s.psi_dot_c + 1.5),
        ({"mask": 0x1F8, "yaw_rate": 9}, Code.SETPOINT_TURNS, (9, 1.5), lambda s: s.psi_dot_c + 1.5),
        ({"r": (0, 0, 3.0)}, Code.SETPOINT_LOW, (3.3, 1), lambda s: s.r_c.z + 0.7),
    ],
)  # fmt: skip
def test_what_is_too_much_is_flown_at_the_limit_and_told(given, code, numbers, check):
    setpoint, warning = local(**given)
    assert warning == Told(code, tuple(pytest.approx(n, rel=1e-2) for n in numbers))
    assert check(setpoint) == pytest.approx(0.0, abs=1e-4)


def test_a_stream_is_two_in_half_a_second_each_time():
    script = Script(sim_only=True)

    def at(us):
        assert script.heard("who", us, us * 1e-6, 1_000_000) is None
        script.take(FLOWN, us, us * 1e-6)
        return script.ready(us, us * 1e-6, 1_000_000)

    assert not at(0)
    assert at(500_000)
    assert not at(1_000_001)
    assert at(1_500_001)
    assert not at(60_000_000)  # one, after a minute of nothing
    assert at(60_400_000)


def test_another_sender_waits_until_the_first_is_silent_by_both_clocks():
    script, one, other = Script(False, lambda: None), ("one", 1), ("other", 2)
    t_us, lost_us = 10_000_000, 1_000_000
    assert script.heard(one, t_us, 10.0, lost_us) is None
    script.take(FLOWN, t_us, 10.0, one)
    assert script.heard(other, t_us + 500_000, 10.5, lost_us).code is Code.ANOTHER_SENDS
    assert script.heard(other, t_us + 500_000, 12.0, lost_us).code is Code.ANOTHER_SENDS
    assert script.heard(other, t_us + 2_000_000, 10.5, lost_us).code is Code.ANOTHER_SENDS
    assert script.heard(other, t_us + 2_000_000, 12.0, lost_us) is None


@pytest.mark.parametrize(
    ("mask", "r", "v"),
    [
        (0xDE3, (9.0, 19.0, 5.0), (2.0, 1.0, 0.0)),  # vx, vy, z: height held, as MAVROS sends it
        (0x5E3, (9.0, 19.0, 5.0), (2.0, 1.0, 0.0)),  # with a rate of yaw
        (0xDC6, (9.0, 3.0, 29.0), (2.0, 0.0, 3.0)),  # x north, and velocities east and up
        (0xDFE, (9.0, 3.0, 29.0), (0.0, 0.0, 0.0)),  # x alone: the other axes are held
        (0xDEF, (9.0, 19.0, 29.0), (2.0, 0.0, 0.0)),  # vy alone
    ],
)
def test_each_axis_is_flown_for_itself(mask, r, v):
    mask |= 0x8 if mask == 0xDC6 else 0
    found, told = local(1, mask, (3.0, 4.0, -5.0), (1.0, 2.0, -3.0))
    assert told is None
    assert (found.r_c, found.v_c) == (Vec3(*r), Vec3(*v))


def test_along_the_heading_what_is_left_out_is_still():
    found, _ = local(8, 0xDC7 | 0x10, v=(2.0, math.nan, 0.0))
    assert found.v_c == pytest.approx((2.0 * AHEAD[0], 2.0 * AHEAD[1], 0.0))


def test_another_sender_owns_the_stream_once_the_first_is_silent_for_half_a_second():
    script, one, other = Script(True), ("one", 1), ("other", 2)
    lost_us = 1_000_000
    assert script.heard(one, 0, 0.0, lost_us) is None
    script.take(FLOWN, 0, 0.0, one)
    assert script.heard(other, 500_000, 0.5, lost_us).code is Code.ANOTHER_SENDS
    assert script.heard(other, 502_000, 0.502, lost_us) is None
    assert not script.lost(900_000, 0.9, lost_us)  # by what it may say: that is not flown yet
    script.take(FLOWN, 502_000, 0.502, other)
    assert not script.lost(1_400_000, 1.4, lost_us)  # the vehicle never was without
    assert script.heard(one, 600_000, 0.6, lost_us).code is Code.ANOTHER_SENDS


def test_an_attitude_leaves_roll_and_pitch_to_the_tilt_and_yaw_to_the_heading():
    """With no body rate but that of yaw."""
    asked = AttitudeRequest(from_euler(0.2, -0.1, 0.7), Vec3(0.0, 0.0, 0.3), 0.25)
    setpoint, refusal = of_attitude(asked, FLOWN, THROTTLE)
    assert refusal is None
    assert setpoint.tilt_c == pytest.approx((0.2, -0.1, 0.0))
    assert (setpoint.level, setpoint.T_c, setpoint.w_c) == (ATTITUDE, 30.0, STILL)
    assert (setpoint.psi_c, setpoint.psi_dot_c) == pytest.approx((0.7, 0.3))
    assert setpoint.r_c == FLOWN.r_c
    rolling = asked._replace(w_B=Vec3(0.1, 0.0, 0.3))
    assert of_attitude(rolling, FLOWN, THROTTLE) == (None, Told(Code.YAW_RATE_ONLY))


@pytest.mark.parametrize(
    ("thrust", "T"), [(0.0, 0.0), (0.3, 36.0), (0.6, 72.0), (0.8, 136.0), (1.0, 200.0)]
)
def test_thrust_is_straight_to_hover_and_straight_from_there_to_the_full_one(thrust, T):
    throttle = Throttle(hover=0.6, T_hover=72.0, T_max=200.0)
    assert throttle.force(thrust) == pytest.approx(T)
    assert throttle.of(T) == pytest.approx(thrust)


def test_an_acceleration_alone_ends_at_the_limit_of_its_own_axis():
    """Velocities north and east are asked for, and up an acceleration."""
    found = FLOWN._replace(v_c=Vec3(0.0, 0.0, 2.9))
    asked = PositionRequest(
        None, Vec3(1.0, 0.5, math.nan), Vec3(math.nan, math.nan, 9.0), None, 0.0
    )
    for v_z, a_z in ((2.9, 9.0), (3.5, 0.0)):
        made, _ = of_position(asked, POSE, HOME, found._replace(v_c=Vec3(0.0, 0.0, v_z)), LIMITS)
        assert made.v_c == Vec3(1.0, 0.5, min(v_z, 3.0))
        assert made.a_c == Vec3(0.0, 0.0, a_z)


def test_an_axis_that_is_held_stays_while_another_one_leads():
    flown = Setpoint(Vec3(20.0, 20.0, 30.0), Vec3(5.0, 0.0, 0.0), STILL, 0.0, 0.0)
    pose = Pose(Vec3(10.0, 19.0, 29.5), Vec3(4.0, 0.3, -0.2), 0.0)
    now = anchored_by_axis(flown, 0.0, pose, 2.0)
    assert now.r_c == Vec3(10.0, 20.0, 30.0)  # east the vehicle is too far behind
    assert now.v_c == Vec3(4.0, 0.0, 0.0)
