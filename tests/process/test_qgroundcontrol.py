"""The buttons of QGroundControl, as its source builds their commands, pressed on a real flight.

src/FirmwarePlugin/PX4/PX4FirmwarePlugin.cc: each function below is named after the one there.
"""

from __future__ import annotations

import math

import pymavlink.dialects.v20.common as mavlink
import pytest

from tests.process.test_up import HOLD, Script

NAN = math.nan
ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
TAKEOFF = 4 << 16 | 2 << 24
CHANGE_MODE = 1  # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE


class Ground(Script):
    """A Script that presses QGroundControl's buttons."""

    def guided_mode_takeoff(self, up_m):
        altitude = self.first("GLOBAL_POSITION_INT").alt * 1e-3 + up_m
        return self.command(mavlink.MAV_CMD_NAV_TAKEOFF, -1, 0, 0, NAN, NAN, NAN, altitude)

    def pause_vehicle(self):
        return self.reposition(NAN, NAN)

    def guided_mode_change_altitude(self, altitude):
        return self.reposition(NAN, altitude)

    def guided_mode_change_heading(self, radians):
        return self.reposition(radians, NAN)

    def reposition(self, yaw, altitude):
        command = mavlink.MAV_CMD_DO_REPOSITION
        return self.command(command, -1, CHANGE_MODE, 0, yaw, NAN, NAN, altitude)

    def guided_mode_goto_location(self, lat, lon, altitude):
        message = mavlink.MAVLink_command_int_message(
            *self.target, mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_DO_REPOSITION, 0, 0,
            -1, CHANGE_MODE, 0, NAN, lat, lon, altitude,
        )  # fmt: skip
        self.send(message)
        return self.first("COMMAND_ACK", lambda m: m.command == message.command).result

    def set_armed(self):
        """`_mavCommandResult`: as soon as the takeoff is acknowledged."""
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def shows(self, custom_mode, armed):
        return self.first(
            "HEARTBEAT",
            lambda m: m.custom_mode == custom_mode and bool(m.base_mode & 128) == armed,
        )


@pytest.fixture
def ground(start, instance):
    start("fcu", "--instance", instance)
    start("sitl_plant", "--instance", instance, "--speed", 5)
    one = Ground(instance)
    one.first("HEARTBEAT", lambda m: m.system_status == mavlink.MAV_STATE_STANDBY)
    yield one
    one.close()


def test_takeoff_pause_altitude_and_heading(ground):
    above = ground.first("GLOBAL_POSITION_INT").alt * 1e-3
    assert ground.guided_mode_takeoff(4.0) == ACCEPTED
    ground.shows(TAKEOFF, armed=False)
    assert ground.set_armed() == ACCEPTED
    ground.shows(TAKEOFF, armed=True)
    ground.shows(HOLD, armed=True)
    there = ground.first("GLOBAL_POSITION_INT")
    assert there.alt * 1e-3 == pytest.approx(above + 4.0, abs=0.3)

    far = there.lat + 4500  # 50 m to the north
    assert ground.guided_mode_goto_location(far, there.lon, above + 4.0) == ACCEPTED
    ground.first("LOCAL_POSITION_NED", lambda m: m.vx > 2.0)
    assert ground.pause_vehicle() == ACCEPTED
    ground.first("LOCAL_POSITION_NED", lambda m: abs(m.vx) < 0.02)
    paused = ground.first("LOCAL_POSITION_NED")
    assert 0.5 < paused.x < 40.0

    assert ground.guided_mode_change_altitude(above + 7.0) == ACCEPTED
    ground.first("GLOBAL_POSITION_INT", lambda m: abs(m.alt * 1e-3 - above - 7.0) < 0.1)
    higher = ground.first("LOCAL_POSITION_NED")
    assert (higher.x, higher.y) == pytest.approx((paused.x, paused.y), abs=0.2)

    assert ground.guided_mode_change_heading(1.2) == ACCEPTED
    ground.first("ATTITUDE", lambda m: abs(m.yaw - 1.2) < 0.02)
    turned = ground.first("LOCAL_POSITION_NED")
    here = (turned.x, turned.y, turned.z)
    assert here == pytest.approx((higher.x, higher.y, higher.z), abs=0.3)


def test_mode_takeoff_then_arming(ground):
    """`startTakeoff`: the mode, and arming once a heartbeat shows it."""
    assert ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 2) == ACCEPTED
    ground.shows(TAKEOFF, armed=False)
    down = ground.first("LOCAL_POSITION_NED").z
    assert ground.set_armed() == ACCEPTED
    ground.shows(HOLD, armed=True)
    ground.at(0, 0, down - 2.5, 0.3)


def test_a_takeoff_that_is_taken_back_leaves_it_on_the_ground(ground):
    assert ground.guided_mode_takeoff(4.0) == ACCEPTED
    assert ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == ACCEPTED
    assert ground.set_armed() == ACCEPTED
    ground.shows(HOLD, armed=True)
    landed = ground.first("EXTENDED_SYS_STATE")
    assert landed.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
