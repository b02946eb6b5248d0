"""What the ground script makes of answers that come in pieces, one datagram each."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import common

from fcu.mavlink.definitions import CommandId, MissionType
from gcs_tools.flight.ground_script import Refused, Vehicle, VehicleError

LONG = "Arming refused: the setpoint is 990 m away, and what it would take exceeds what the rotors give"
VEHICLE = common.MAVLink(None, srcSystem=1, srcComponent=1)


class Slow:
    """A link to a vehicle that answers with one datagram at a time."""

    def __init__(self, datagrams: list[bytes]) -> None:
        self._to_come = datagrams
        self._there: list[bytes] = []

    def send(self, datagram: bytes) -> None:
        """Lose it: the answers are known."""

    def receive(self) -> bytes | None:
        """What has come."""
        return self._there.pop(0) if self._there else None

    def wait(self, timeout_s: float) -> bool:
        """The next has come; none before something was asked."""
        self._there += self._to_come[:1]
        del self._to_come[:1]
        return bool(self._there)

    def fileno(self) -> int:
        """None."""
        return -1

    def close(self) -> None:
        """Nothing to give back."""


def packed(message: common.MAVLink_message) -> bytes:
    return bytes(message.pack(VEHICLE))


@pytest.mark.parametrize("text", [LONG, LONG[:50], LONG[:100].ljust(100, "."), "No."])
def test_a_reason_is_heard_to_its_end(text):
    """It comes after the refusal, among telemetry, in chunks of 50 characters."""
    whole = len(text) < 50
    parts = [text] if whole else [text[i : i + 50] for i in range(0, len(text) + 1, 50)]
    answers = [
        common.MAVLink_command_ack_message(CommandId.ARM_DISARM, common.MAV_RESULT_DENIED),
        common.MAVLink_local_position_ned_message(0, 0, 0, 0, 0, 0, 0),
    ]
    for i, part in enumerate(parts):
        answers.append(common.MAVLink_statustext_message(4, part.encode(), 0 if whole else 7, i))
        answers.append(common.MAVLink_local_position_ned_message(1, 0, 0, 0, 0, 0, 0))
    vehicle = Vehicle(0, Slow([b"", *map(packed, answers)]))
    with pytest.raises(VehicleError) as refused:
        vehicle.arm()
    assert str(refused.value) == f"ARM_DISARM refused: {text}"


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize("says", ["Mission denied: item 2: fence forbids the way", None])
def test_the_text_of_the_upload_before_is_no_reason(together, says):
    """It comes after the acknowledgement, so that the next upload has begun when it is heard."""
    refusal = common.MAVLink_mission_ack_message(255, 190, common.MAV_MISSION_DENIED, 0)
    late = common.MAVLink_statustext_message(6, b"Rally points: 1 items taken")
    answers = [packed(late), packed(refusal)]
    if says is not None:
        answers.append(packed(common.MAVLink_statustext_message(4, says.encode())))
    if together:
        answers = [b"".join(answers)]
    with pytest.raises(Refused) as refused:
        Vehicle(0, Slow([b"", *answers])).upload(MissionType.MISSION, ())
    assert str(refused.value) == f"MISSION refused: {says or 'DENIED'}"


def test_the_text_of_an_upload_is_no_reason_of_a_command():
    answers = [
        common.MAVLink_statustext_message(6, b"Mission: 7 items taken"),
        common.MAVLink_command_ack_message(CommandId.MISSION_START, common.MAV_RESULT_DENIED),
        common.MAVLink_statustext_message(4, b"Mode Mission denied: the fence forbids it"),
    ]
    with pytest.raises(Refused, match="refused: Mode Mission denied: the fence forbids it"):
        Vehicle(0, Slow([b"", *map(packed, answers)])).start_mission()


@pytest.mark.parametrize(
    "says",
    [
        common.MAVLink_local_position_ned_message(0, 0, 0, 0, 0, 0, 0),
        common.MAVLink_heartbeat_message(2, 12, 0, 0, common.MAV_STATE_STANDBY, 3),
    ],
)
def test_a_vehicle_is_ready_once_it_says_where_it_is(says):
    """Its next heartbeat may be a second away."""
    booting = common.MAVLink_heartbeat_message(2, 12, 0, 0, common.MAV_STATE_BOOT, 3)
    rest = [packed(booting)]
    link = Slow([packed(booting), packed(says), *rest])
    Vehicle(0, link).wait_ready(timeout_s=0.5)
    assert link._to_come == rest


def test_a_vehicle_that_boots_is_not_ready():
    booting = common.MAVLink_heartbeat_message(2, 12, 0, 0, common.MAV_STATE_BOOT, 3)
    with pytest.raises(VehicleError, match="no vehicle ready"):
        Vehicle(0, Slow([packed(booting)])).wait_ready(timeout_s=0.1)
