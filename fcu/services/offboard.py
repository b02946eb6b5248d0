"""The offboard protocol: a script's setpoints, from their arrival to what is flown.

A setpoint that is flown is echoed to its sender; one that is not, or not as it is, is told of:
once, not at the stream's rate.
"""

from __future__ import annotations

from collections.abc import Callable

from fcu.interface.messages import AttitudeRequest, PositionRequest, Setpoint
from fcu.interface.status_texts import Code, Told
from fcu.mavlink.definitions import IGNORE_POSITION, RELATIVE_FRAMES, Severity
from fcu.mavlink.geodesy import Origin, to_local
from fcu.mavlink.setpoints import AttitudeSetpointMessage, SetpointMessage, echo, placed
from fcu.parameters import Parameters
from fcu.services.ground_port import GroundPort, Link
from fcu.vehicle.state_machine import StateMachine

COMPLAINTS, COMPLAIN_S = 5, 1.0  # about setpoints, each another, in so long by the wall


class OffboardProtocol:
    """One for all links."""

    def __init__(
        self, vehicle: StateMachine, params: Parameters, origin: Origin,
        tell: Callable[[Told, Severity], None],
    ) -> None:  # fmt: skip
        """`tell`: to everyone."""
        self._vehicle = vehicle
        self._params = params
        self.origin = origin  # of local positions: may be set anew
        self._tell = tell
        self.message: SetpointMessage | AttitudeSetpointMessage | None = None  # last accepted
        self._complained: dict[tuple[object, ...], float] = {}  # by kind: when, wall
        self._limited: tuple[object, ...] | None = None  # the last one so told of, and whose it is
        self._short_due = 0.0  # wall: when it is told again that a setpoint falls short

    def take(
        self, port: GroundPort, link: Link, message: SetpointMessage | AttitudeSetpointMessage,
        t_us: int, now: float,
    ) -> None:  # fmt: skip
        """Fly a setpoint from `t_us` on, or say why not. `now`: wall, s."""
        vehicle, script = self._vehicle, self._vehicle.script
        if vehicle.state is None:
            return
        who = message.source, link.address
        why = script.heard(who, t_us, now, vehicle.lost_us) or message.refusal
        setpoint = None
        if why is None:
            request = self._request(message)
            setpoint, why = vehicle.resolve(request, t_us)
        if setpoint is None:
            script.refused += 1
            self.complain(Told(Code.SETPOINT_REFUSED, (why,)), now)
            return
        if self._falls_short(setpoint, now):
            script.refused += 1
            if script.owner in (None, who):
                self._say(vehicle.keep_script(t_us, now))
            return
        script.take(setpoint, t_us, now, who)
        self.message = message
        self._say(vehicle.fly_script(t_us))
        port.send(link, echo(t_us * 1e-6, message))
        # flown at a limit: told once of each, not again while it is repeated
        limited = None if why is None else (who, request, why.code)
        if why is None or limited == self._limited or self.complain(why, now):
            self._limited = limited

    def _request(
        self, message: SetpointMessage | AttitudeSetpointMessage
    ) -> PositionRequest | AttitudeRequest:
        request = message.request
        if isinstance(message, AttitudeSetpointMessage) or isinstance(request, AttitudeRequest):
            return request
        place = message.geodetic
        if place is None or message.type_mask & IGNORE_POSITION == IGNORE_POSITION:
            return request
        alt, here = place.alt_m, (self.origin.lat_deg, self.origin.lon_deg)
        lat, lon = (
            here if message.type_mask & IGNORE_POSITION & 3 else (place.lat_deg, place.lon_deg)
        )
        if message.frame in RELATIVE_FRAMES:
            home = self._vehicle.home or self._vehicle.pose().r_E
            alt += self.origin.alt_m + home.z
        return placed(request, message.type_mask, to_local(self.origin, lat, lon, alt))

    def _falls_short(self, setpoint: Setpoint, now: float) -> bool:
        """Whether the guard refuses a setpoint; says so, or warns of it, once."""
        vehicle = self._vehicle
        if vehicle.is_flown(setpoint):
            return False
        check, short = vehicle.feasibility, vehicle.short_of(setpoint)
        if short == 0.0:
            return False
        if now >= self._short_due:  # to find what to say takes longer than to look
            told = check.complaint(setpoint, short, vehicle.reference)
            if told is not None:
                self._short_due = now + COMPLAIN_S
                if self.complain(told, now):
                    check.told(setpoint, short)
        return check.refuses

    def _say(self, told: Told | None) -> None:
        if told is not None:
            self._tell(told, Severity.INFO)

    def complain(self, told: Told, now: float) -> bool:
        """Tell what is wrong with a stream: once, not at the stream's rate. Whether it was told."""
        kind = told.kind
        self._complained = {k: at for k, at in self._complained.items() if now - at < COMPLAIN_S}
        if kind not in self._complained and len(self._complained) < COMPLAINTS:
            self._complained[kind] = now
            self._tell(told, Severity.WARNING)
            return True
        return False
