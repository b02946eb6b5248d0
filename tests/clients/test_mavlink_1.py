"""A client that knows MAVLink 1 alone flies: whatever it hears is MAVLink 1, and whole in each datagram."""

from __future__ import annotations

import math
import socket
import time

import pymavlink.dialects.v10.common as v1
import pytest

from tests.patience import PATIENCE_S

ARM, TAKEOFF, ACCEPTED = v1.MAV_CMD_COMPONENT_ARM_DISARM, v1.MAV_CMD_NAV_TAKEOFF, 0


class Client:
    def __init__(self, at):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(PATIENCE_S)
        self._to = "127.0.0.1", at.fcu_script
        self._mav = v1.MAVLink(None, srcSystem=255, srcComponent=190)
        self._system = at.system_id

    def send(self, message):
        self._socket.sendto(message.pack(self._mav), self._to)

    def beat(self):
        self.send(v1.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def command(self, number, *params):
        seven = (*params, *[0.0] * (7 - len(params)))
        self.send(v1.MAVLink_command_long_message(self._system, 1, number, 0, *seven))
        return self.wait("COMMAND_ACK", lambda ack: ack.command == number).result

    def wait(self, kind, condition):
        """The next message of a kind that meets a condition. Every other is read too."""
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            datagram = self._socket.recv(300)
            assert datagram[0] == 0xFE
            (message,) = v1.MAVLink(None).parse_buffer(bytearray(datagram))
            if message.get_type() == kind and condition(message):
                return message
        raise AssertionError(f"no such {kind}")

    def close(self):
        self._socket.close()


@pytest.fixture
def client(vehicle):
    made = Client(vehicle("--speed", "4").ports)
    yield made
    made.close()


def test_a_take_off(client):
    client.beat()
    client.wait("HEARTBEAT", lambda beat: beat.autopilot == v1.MAV_AUTOPILOT_PX4)
    assert client.command(ARM, 1.0) == ACCEPTED
    assert client.command(TAKEOFF, 0, 0, 0, math.nan, 0, 0, math.nan) == ACCEPTED
    client.wait("STATUSTEXT", lambda said: said.severity == v1.MAV_SEVERITY_INFO)
    client.wait("LOCAL_POSITION_NED", lambda here: here.z < -2.0)
