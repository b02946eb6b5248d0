"""Sticks by message: which end of a stick is which, and what a gesture tells."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fcu.interface.status_texts import Code, Told
from fcu.mavlink.definitions import Severity
from fcu.mavlink.framing import Source
from fcu.mavlink.requests import ChannelsOverride, ManualControl
from fcu.services.sticks import StickProtocol, sticks_of
from fcu.vehicle.state_machine import Answer
from fcu.vehicle.sticks import Sticks, StickSource

FROM = Source(245, 190)
NAN = np.nan


@pytest.mark.parametrize(
    ("message", "sticks"),
    [
        (ManualControl(FROM, 1, 1.0, 0.5, 1.0, -1.0), Sticks(0.5, 1.0, -1.0, 1.0)),
        (ManualControl(FROM, 1, 0.0, 0.0, 0.5, 0.0), Sticks(0.0, 0.0, 0.0, 0.0)),
        (ManualControl(FROM, 1, 0.0, 0.0, 0.0, NAN), Sticks(0.0, 0.0, 0.0, -1.0)),
        (ManualControl(FROM, 1, NAN, NAN, NAN, NAN), None),
        # high is forward, as PX4 reads a channel that is not reversed
        (ChannelsOverride(FROM, 1, 1, (0.5, 1.0, 1.0, -1.0)), Sticks(0.5, 1.0, -1.0, 1.0)),
        (ChannelsOverride(FROM, 1, 1, (NAN, NAN, -1.0, NAN)), Sticks(0.0, 0.0, 0.0, -1.0)),
        (ChannelsOverride(FROM, 1, 1, (NAN, NAN, NAN, NAN)), None),
    ],
)
def test_sticks_of_a_message(message, sticks):
    source = StickSource.JOYSTICK if isinstance(message, ManualControl) else StickSource.RADIO
    assert sticks_of(message) == (sticks, source)


def test_what_a_gesture_came_to_is_told():
    told, answers = [], [None, Answer(True, Told(Code.ARMED)), Answer(False, Told(Code.IN_FLIGHT))]
    vehicle = SimpleNamespace(state=np.zeros(1), fly_by=lambda *given: answers.pop(0))
    protocol = StickProtocol(vehicle, lambda *each: told.append(each))
    for _ in range(3):
        link = SimpleNamespace(address="here")
        protocol.take(link, ManualControl(FROM, 1, 0.0, 0.0, 0.0, 1.0), 0, 0.0)
    assert told == [
        (Told(Code.ARMED), Severity.INFO),
        (Told(Code.DENIED, ("Arming gesture", Told(Code.IN_FLIGHT))), Severity.WARNING),
    ]
