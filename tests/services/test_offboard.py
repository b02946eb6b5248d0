"""Setpoints on their way to the vehicle: places on Earth, and complaints."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.airframe import believed
from fcu.interface.messages import VehicleState
from fcu.interface.status_texts import Code, Told, words
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import size
from fcu.kernel.rows import column_of
from fcu.mavlink.definitions import Severity
from fcu.mavlink.geodesy import Origin, to_geodetic
from fcu.mavlink.ground_link import GroundCodec
from fcu.parameters import Parameters
from fcu.process.settings import settings
from fcu.services.offboard import COMPLAIN_S, COMPLAINTS, OffboardProtocol
from fcu.vehicle.state_machine import StateMachine

ORIGIN = Origin(47.4, 8.5, 488.0)


@pytest.fixture
def told():
    return []


@pytest.fixture
def protocol(told):
    params = Parameters(settings(*believed(), 500.0), 1)
    vehicle = StateMachine(params)
    vehicle.home = Vec3(0.0, 0.0, 0.3)
    return OffboardProtocol(vehicle, params, ORIGIN, lambda *each: told.append(each))


@pytest.mark.parametrize(
    ("frame", "above"), [(5, 488.0), (0, 488.0), (6, 0.0), (3, 0.0), (10, 0.0), (11, 0.0)]
)
def test_global_places(protocol, frame, above):
    wanted = Vec3(40.0, -30.0, 12.0)
    place = to_geodetic(ORIGIN, wanted)
    alt = wanted.z + above - (0.3 if frame in (3, 6, 10, 11) else 0.0)
    packet = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, 0xDF8, round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), alt,
        0, 0, 0, 0, 0, 0, 0, 0,
    )  # fmt: skip
    (message,) = GroundCodec(1).parse(packet.pack(mavlink.MAVLink(None, srcSystem=245)))
    assert protocol._request(message).r == pytest.approx(wanted, abs=0.02)  # degE7 are 1 cm


def test_what_differs_in_numbers_only_is_told_once_a_while(protocol, told):
    far, farther = (Told(Code.SETPOINT_FAR, (n, 100.0)) for n in (200.0, 300.0))
    assert protocol.complain(far, 0.0)
    assert not protocol.complain(farther, 0.9 * COMPLAIN_S)
    assert protocol.complain(farther, 1.1 * COMPLAIN_S)
    assert told == [(far, Severity.WARNING), (farther, Severity.WARNING)]


class Port:
    def send(self, link, datagram):
        """An echo that nobody hears."""


def test_of_a_setpoint_that_is_repeated_a_limit_is_told_once(protocol, told):
    """The vehicle comes nearer meanwhile, so the text would be another every time."""
    vehicle, link = protocol._vehicle, SimpleNamespace(address=("127.0.0.1", 1))
    state = np.zeros(size(VehicleState))
    state[column_of(VehicleState, "q_EB.w")] = 1.0
    x = column_of(VehicleState, "r_E.x")

    def stream(east, until_s):
        for tenth in range(10 * until_s):
            state[x] += 0.5
            vehicle.state = state
            packet = mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0xDF8, 0.0, east, -5.0, 0, 0, 0, 0, 0, 0, 0, 0
            )
            (message,) = GroundCodec(1).parse(packet.pack(mavlink.MAVLink(None, srcSystem=245)))
            stream.now_s += 0.1
            protocol.take(Port(), link, message, tenth * 100_000, stream.now_s)
        return [words(each) for each, _ in told]

    stream.now_s = 0.0
    assert stream(300.0, 5) == ["Setpoint 300 m away limited to 100 m"]
    assert len(stream(400.0, 5)) == 2  # another target
    assert len(stream(50.0, 1)) == 2  # none is too far
    assert len(stream(400.0, 5)) == 3


def test_of_kinds_only_some_are_told_at_once(protocol, told):
    names = ("position", "velocity", "acceleration", "yaw", "yaw rate", "height", "place")
    for name in names:
        protocol.complain(Told(Code.SETPOINT_REFUSED, (Told(Code.NOT_FINITE, (name,)),)), 0.0)
    assert len(told) == COMPLAINTS < len(names)
