"""Sticks by message: MANUAL_CONTROL of a joystick, RC_CHANNELS_OVERRIDE of a radio's channels."""

from __future__ import annotations

import math
from collections.abc import Callable

from fcu.interface.status_texts import Code, Told
from fcu.mavlink.definitions import Severity
from fcu.mavlink.requests import ChannelsOverride, ManualControl
from fcu.services.ground_port import Link
from fcu.vehicle.state_machine import StateMachine
from fcu.vehicle.sticks import Sticks, StickSource


class StickProtocol:
    """One for all links."""

    def __init__(self, vehicle: StateMachine, tell: Callable[[Told, Severity], None]) -> None:
        """`tell`: to everyone."""
        self._vehicle = vehicle
        self._tell = tell

    def take(
        self, link: Link, message: ManualControl | ChannelsOverride, t_us: int, now: float
    ) -> None:
        """Fly by sticks from `t_us` on. `now`: wall, s. A gesture of arming is told of."""
        owner = message.source, link.address
        sticks, source = sticks_of(message)
        if sticks is None or self._vehicle.state is None:
            return
        answer = self._vehicle.fly_by(sticks, source, owner, t_us, now)
        if answer is None or answer.told is None:
            return
        if answer.granted:
            self._tell(answer.told, Severity.INFO)
        else:
            self._tell(Told(Code.DENIED, ("Arming gesture", answer.told)), Severity.WARNING)


def sticks_of(message: ManualControl | ChannelsOverride) -> tuple[Sticks | None, StickSource]:
    """The sticks of a message, None if it has not one. A stick that is left out is in its middle."""
    if isinstance(message, ManualControl):
        source = StickSource.JOYSTICK
        given = message.y, message.x, message.r, 2.0 * message.z - 1.0
    else:
        source = StickSource.RADIO
        roll, pitch, throttle, yaw = message.channels
        # high is forward, as PX4 reads a channel that is not reversed (RC2_REV 1)
        given = roll, pitch, yaw, throttle
    if all(map(math.isnan, given)):
        return None, source
    return Sticks(*(0.0 if math.isnan(n) else n for n in given)), source
