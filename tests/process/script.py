"""What a user's script is: nobody's code but pymavlink's, on a socket that listens on 14540 + N."""

from __future__ import annotations

import math
import select
import socket
import time

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.ports import ports
from tests.patience import PATIENCE_S

POSITION_AND_YAW = 0b100111111000  # type mask: velocity, acceleration and yaw rate out of use
OFFBOARD = 6  # PX4's main mode
HOLD = 4 << 16 | 3 << 24  # HEARTBEAT.custom_mode


class Script:
    """What a user writes: pymavlink's codec on a socket that listens on 14540 + N."""

    def __init__(self, instance: int) -> None:
        at = ports(instance)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", at.script))
        self._to = ("127.0.0.1", at.fcu_script)
        self.target = (at.system_id, 1)
        self._codec = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)

    def close(self) -> None:
        self._socket.close()

    def messages(self):
        """Messages as they come, for as long as anybody waits."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            if select.select([self._socket], [], [], 0.5)[0]:
                yield from self._codec.parse_buffer(self._socket.recv(4096)) or []
        pytest.fail(f"what was waited for did not come within {PATIENCE_S:g} s")

    def first(self, kind, which=lambda message: True):
        return next(m for m in self.messages() if m.get_type() == kind and which(m))

    def send(self, message) -> None:
        self._socket.sendto(message.pack(self._codec), self._to)

    def forget(self) -> None:
        """Whatever has come so far: what is heard next is of now."""
        while select.select([self._socket], [], [], 0)[0]:
            self._socket.recv(4096)

    def command_to(self, system, command, *params) -> None:
        """Send it, and do not wait."""
        padded = [*params, *[0.0] * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(system, 1, command, 0, *padded))

    def command(self, command, *params) -> int:
        """Its MAV_RESULT."""
        self.command_to(self.target[0], command, *params)
        return self.first("COMMAND_ACK", lambda m: m.command == command).result

    def point(self, north, east, down, yaw=0.0) -> None:
        """Send a setpoint, and do not wait."""
        where, unused = (north, east, down), (0.0,) * 6
        setpoint = mavlink.MAVLink_set_position_target_local_ned_message(
            0, *self.target, mavlink.MAV_FRAME_LOCAL_NED, POSITION_AND_YAW,
            *where, *unused, yaw, 0.0,
        )  # fmt: skip
        self.send(setpoint)

    def go(self, north, east, down, yaw=0.0) -> None:
        """Send a setpoint, and await its echo."""
        where = north, east, down
        self.point(*where, yaw)
        self.first("POSITION_TARGET_LOCAL_NED", lambda m: (m.x, m.y, m.z) == where)

    def at(self, north, east, down, within):
        def near(m):
            return math.dist((m.x, m.y, m.z), (north, east, down)) < within

        return self.first("LOCAL_POSITION_NED", near)

    def fly(self, north, east, down, yaw, within):
        """Stream a setpoint until it is there: one that is sent once is soon lost."""
        position = self.first("LOCAL_POSITION_NED")
        while math.dist((position.x, position.y, position.z), (north, east, down)) > within:
            self.go(north, east, down, yaw)
            position = self.first("LOCAL_POSITION_NED")
