"""pymavlink by TCP: a script that only listens until the vehicle has spoken, and another beside it."""

from __future__ import annotations

import pytest
from pymavlink import mavutil

from tests.patience import PATIENCE_S

ACCEPTED = mavutil.mavlink.MAV_RESULT_ACCEPTED
ARM, TAKEOFF = mavutil.mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavutil.mavlink.MAV_CMD_NAV_TAKEOFF


@pytest.fixture
def connect():
    opened = []

    def one(port):
        opened.append(mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}"))
        return opened[-1]

    yield one
    for each in opened:
        each.close()


def test_a_script_that_waits_for_a_heartbeat_first_takes_off(vehicle, connect):
    up = vehicle("--speed", "4")
    script, watcher = connect(up.ports.fcu_tcp), connect(up.ports.fcu_tcp)
    assert script.wait_heartbeat(timeout=PATIENCE_S) is not None
    assert script.target_system == up.ports.system_id
    for command, params in ((ARM, (1.0,)), (TAKEOFF, (0, 0, 0, float("nan"), 0, 0, float("nan")))):
        script.mav.command_long_send(
            script.target_system, 1, command, 0, *params, *[0.0] * (7 - len(params))
        )
        ack = script.recv_match(type="COMMAND_ACK", blocking=True, timeout=PATIENCE_S)
        assert (ack.command, ack.result) == (command, ACCEPTED)
    while True:
        here = watcher.recv_match(type="LOCAL_POSITION_NED", blocking=True, timeout=PATIENCE_S)
        assert here is not None
        if here.z < -2.0:
            break
