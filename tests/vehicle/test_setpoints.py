"""A script's setpoints: what is flown of them, in which frame, and when they are a stream."""

from __future__ import annotations

import math

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.messages import Setpoint
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.mavlink.ground_link import GroundCodec
from fcu.vehicle.plans import STILL, Pose
from fcu.vehicle.setpoints import Script, SetpointLimits, of_position

EAST_30 = math.radians(30.0)
POSE = Pose(Vec3(10.0, 20.0, 30.0), Vec3(1.0, 0.0, 0.0), EAST_30)  # heading 60 deg from North
FLOWN = Setpoint(Vec3(9.0, 19.0, 29.0), Vec3(0.5, 0.0, 0.0), STILL, 0.1, 0.0)
HOME = Vec3(0.0, 0.0, 0.3)
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
