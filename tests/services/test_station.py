"""The two ports of a vehicle, in memory: commands that are repeated, streams, and home."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pymavlink.dialects.v20.all as mavlink
import pytest

from fcu.interface.airframe import believed
from fcu.interface.link import MemoryNetwork
from fcu.interface.messages import VehicleState
from fcu.interface.ports import ports
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns, size
from fcu.mavlink.definitions import Autopilot
from fcu.mavlink.geodesy import Origin
from fcu.parameters import Parameters
from fcu.process.settings import settings
from fcu.services.messages import STREAMS
from fcu.services.station import Station
from fcu.services.view import Identity
from fcu.vehicle.state_machine import StateMachine

AT = ports(0)
ARM, SET_INTERVAL = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
HOME = mavlink.MAVLINK_MSG_ID_HOME_POSITION
ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED


class Met:
    """A station, the vehicle behind it, and the script that speaks to it."""

    def __init__(self):
        params = Parameters(settings(*believed(), 500.0), 1)
        self.vehicle = StateMachine(params)
        self.logged = []  # level, what was told, simulation time, us
        self.network = network = MemoryNetwork()
        identity = Identity(1, Autopilot.PX4, Origin(47.4, 8.5, 488.0), Vec3(0.0, 0.0, 0.0))
        self.station = Station(AT, identity, params, self.vehicle, None, self._log, network.socket)
        self._link = network.link(AT.script, AT.fcu_script, "script")
        self._mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)

    def _log(self, level, told, time_us=None):
        self.logged.append((level, told, time_us))

    def observe(self):
        """A first state: level, on the ground."""
        state = np.zeros(size(VehicleState))
        state[columns(VehicleState).index("q_EB.w")] = 1.0
        self.vehicle.observe(state, 0, 0.0)

    def heard(self):
        """Collect the messages that have come meanwhile."""
        messages = []
        while (datagram := self._link.receive()) is not None:
            messages += mavlink.MAVLink(None).parse_buffer(bytearray(datagram))
        return messages

    def say(self, message, now=0.0):
        """Collect the answers to a message, but for texts."""
        self._link.send(message.pack(self._mav))
        self.station.serve(self.station.script, 0, now)
        return [each for each in self.heard() if each.get_type() != "STATUSTEXT"]

    def long(self, command, params):
        return mavlink.MAVLink_command_long_message(1, 1, command, 0, *params)

    def ask(self, command, first, second=0.0, confirmation=0):
        """Give a command, and return its result."""
        long = mavlink.MAVLink_command_long_message(
            1, 1, command, confirmation, first, second, 0, 0, 0, 0, 0
        )
        *before, answer = self.say(long)
        assert all(each.get_type() == "HEARTBEAT" for each in before)
        assert (answer.get_type(), answer.command) == ("COMMAND_ACK", command)
        return answer.result


@pytest.fixture
def met():
    return Met()


def test_the_times_of_a_flight_are_told_on_request(met):
    number = mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION

    def told():
        answers = met.say(met.long(mavlink.MAV_CMD_REQUEST_MESSAGE, [number, 0, 0, 0, 0, 0, 0]))
        acknowledged = next(each for each in answers if each.get_type() == "COMMAND_ACK")
        assert acknowledged.result == ACCEPTED
        (found,) = (each for each in answers if each.get_type() == "FLIGHT_INFORMATION")
        times = found.arming_time_utc, found.takeoff_time_utc, found.landing_time
        return (found.flight_uuid, *times)

    met.observe()
    assert told() == (0, 0, 0, 0)
    assert met.vehicle.arm(3_000_000, 3.0).granted
    assert told() == (1, 3_000_000, 0, 0)


def test_a_command_whose_answer_was_lost_is_answered_and_not_done_again(met):
    met.observe()
    assert met.ask(ARM, 1.0) == ACCEPTED
    assert met.ask(ARM, 1.0, confirmation=1) == ACCEPTED
    assert met.ask(ARM, 0.0) == ACCEPTED
    assert met.ask(ARM, 1.0, confirmation=2) == DENIED  # what was asked for later stands
    assert not met.vehicle.armed


def test_home_is_told_at_once_also_to_one_who_has_no_stream_of_it(met):
    assert met.ask(SET_INTERVAL, HOME, -1.0) == ACCEPTED
    met.station.idle(0, 1.0, 1.0)
    assert "HOME_POSITION" not in {each.get_type() for each in met.heard()}
    met.observe()
    met.station.idle(0, 2.0, 2.0)
    (home,) = (each for each in met.heard() if each.get_type() == "HOME_POSITION")
    assert (home.latitude, home.longitude, home.altitude) == (474_000_000, 85_000_000, 488_000)
    met.station.idle(0, 20.0, 20.0)
    assert "HOME_POSITION" not in {each.get_type() for each in met.heard()}  # it has not moved


def test_a_client_that_shows_up_draws_no_heartbeat_between_those_of_each_second(met):
    met.observe()
    beats = []
    for look in range(301):  # three seconds, in steps of 10 ms
        if look == 120:
            beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
            assert not [m for m in met.say(beat, 101.2) if m.get_type() == "HEARTBEAT"]
        met.station.idle(0, 100.0 + 0.01 * look, 100.0)
        beats += [look for each in met.heard() if each.get_type() == "HEARTBEAT"]
    assert beats == pytest.approx([0, 100, 200, 300], abs=4)


def test_a_heartbeat_comes_at_once_when_the_vehicle_is_armed(met):
    met.observe()
    met.station.idle(0, 100.0, 100.0)
    met.heard()
    beat, answer = met.say(met.long(ARM, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    assert (beat.get_type(), answer.get_type()) == (
        "HEARTBEAT",
        "COMMAND_ACK",
    )  # clients rely on it
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    met.station.idle(0, 100.01, 100.0)
    assert "HEARTBEAT" not in {each.get_type() for each in met.heard()}


def origins(messages):
    return [
        (m.latitude, m.longitude, m.altitude)
        for m in messages
        if m.get_type() == "GPS_GLOBAL_ORIGIN"
    ]


def test_an_origin_that_is_set_is_answered_and_what_is_global_follows(met):
    met.observe()
    met.station.idle(0, 100.0, 100.0)
    met.heard()
    asked = mavlink.MAVLink_set_gps_global_origin_message(1, -353_632_600, 1_491_652_300, 584_000)
    assert origins(met.say(asked, 100.1)) == [(-353_632_600, 1_491_652_300, 584_000)]
    met.station.idle(0, 100.5, 100.0)
    heard = {m.get_type(): m for m in met.heard()}
    home, here = heard["HOME_POSITION"], heard["GLOBAL_POSITION_INT"]
    assert (home.latitude, home.longitude, home.altitude) == (-353_632_600, 1_491_652_300, 584_000)
    assert (here.lat, here.lon, here.alt, here.relative_alt) == (
        -353_632_600, 1_491_652_300, 584_000, 0,
    )  # fmt: skip
    assert (heard["LOCAL_POSITION_NED"].x, heard["LOCAL_POSITION_NED"].y) == (0.0, 0.0)
    takeoff = met.long(mavlink.MAV_CMD_NAV_TAKEOFF, (0, 0, 0, 0, -35.36326, 149.16523, 594.0))
    (ack,) = (m for m in met.say(takeoff, 100.6) if m.get_type() == "COMMAND_ACK")
    assert ack.result == ACCEPTED  # its place is here now


@pytest.mark.parametrize(
    ("lat", "lon", "alt"), [(900_000_001, 0, 0), (0, 1_800_000_001, 0), (0, 0, 100_000_000)]
)
def test_an_origin_that_is_no_place_is_answered_by_the_one_in_force(met, lat, lon, alt):
    met.observe()
    asked = mavlink.MAVLink_set_gps_global_origin_message(1, lat, lon, alt)
    assert origins(met.say(asked)) == [(474_000_000, 85_000_000, 488_000)]


def test_a_stream_that_is_looked_at_late_is_no_slower(met):
    """A look every 7 ms, and 50 messages in a second all the same."""
    met.observe()
    assert met.ask(SET_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 20_000) == ACCEPTED
    met.station.idle(0, 100.0, 100.0)
    met.heard()
    for look in range(1, 144):
        met.station.idle(0, 100.0 + 0.007 * look, 100.0)
    count = sum(each.get_type() == "ATTITUDE" for each in met.heard())
    assert count == pytest.approx(50, abs=1)


@pytest.mark.parametrize(
    ("group", "names"),
    [
        (mavlink.MAV_DATA_STREAM_RAW_SENSORS, set()),
        (mavlink.MAV_DATA_STREAM_EXTENDED_STATUS, {"GPS_RAW_INT", "EXTENDED_SYS_STATE", "SYS_STATUS"}),
        (mavlink.MAV_DATA_STREAM_POSITION, {"LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"}),
        (mavlink.MAV_DATA_STREAM_EXTRA1, {"ATTITUDE", "ATTITUDE_QUATERNION"}),
        (mavlink.MAV_DATA_STREAM_EXTRA2, {"VFR_HUD"}),
        (mavlink.MAV_DATA_STREAM_EXTRA3, set()),
    ],
)  # fmt: skip
def test_the_groups_of_a_ground_station_are_paced_together(met, group, names):
    """Groups as old ground stations name them, at 7 Hz: no message has this rate by default."""
    assert not met.say(mavlink.MAVLink_request_data_stream_message(1, 1, group, 7, 1))
    rates = met.station.script.listener.streams
    paced = {STREAMS[n].name for n, (interval, _) in rates.items() if interval == 1.0 / 7.0}
    assert paced == names
    met.say(mavlink.MAVLink_request_data_stream_message(1, 1, group, 7, 0))
    assert not names & {STREAMS[n].name for n in rates}


def test_a_script_hears_its_setpoint_in_the_message_it_has_sent(met):
    """A place on Earth is echoed as one, a local place as a local one, and nothing twice."""
    met.observe()
    echoes = {}
    for setpoint in (
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0xDF8, 3.0, 4.0, -5.0, 0, 0, 0, 0, 0, 0, 0, 0
        ),
        mavlink.MAVLink_set_position_target_global_int_message(
            0, 1, 1, 5, 0xDF8, 474_000_100, 85_000_200, 493.0, 0, 0, 0, 0, 0, 0, 0, 0
        ),
    ):
        met.say(setpoint)
        view = met.station.view()
        view.flying = True
        view.vehicle = SimpleNamespace(
            setpoint=met.vehicle.script.setpoint, mode=met.vehicle.mode.OFFBOARD
        )
        for stream in STREAMS.values():
            if stream.name.startswith("POSITION_TARGET"):
                names = [packed.definition.name for packed in stream.build(view)]
                echoes[setpoint.get_type(), stream.name] = names
    as_local, as_global = "POSITION_TARGET_LOCAL_NED", "POSITION_TARGET_GLOBAL_INT"
    assert echoes == {
        ("SET_POSITION_TARGET_LOCAL_NED", as_local): [as_local],
        ("SET_POSITION_TARGET_LOCAL_NED", as_global): [],
        ("SET_POSITION_TARGET_GLOBAL_INT", as_local): [],
        ("SET_POSITION_TARGET_GLOBAL_INT", as_global): [as_global],
    }
