"""The ground side of the vehicle: both ports, every service, one place where messages arrive.

The loop hands over what it measured and flew; everything a ground station or script can do to
the vehicle goes through `serve`. Nothing here blocks.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fcu.interface.messages import Setpoint
from fcu.interface.ports import Ports, owner
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import size
from fcu.laws.mmrac.types import Tick
from fcu.mavlink.enums import Result, Severity
from fcu.mavlink.flown import echo
from fcu.mavlink.ground_messages import (
    AttitudeSetpointMessage,
    Command,
    GroundMessage,
    ManualControl,
    NotTaken,
    SetMode,
    SetpointMessage,
)
from fcu.parameters import Parameters
from fcu.services.commands import Commands, Request
from fcu.services.desk import Desk
from fcu.services.parameters import ParameterService
from fcu.services.port import GroundPort, Link
from fcu.services.requests import Requests
from fcu.services.streams import HOME_POSITION, STREAMS
from fcu.services.telemetry import Telemetry
from fcu.services.view import Counters, Identity, Row, View
from fcu.vehicle import modes
from fcu.vehicle.modes import Mode
from fcu.vehicle.script import Frame, Refused, of_attitude, of_position, turned
from fcu.vehicle.supervisor import Supervisor
from fcu.vehicle.verdict import Verdict
from fcu.vehicle.wind import Wind

WIND_S = 0.05  # wall: between two looks at the wind
COMPLAINTS, COMPLAIN_S = 5, 1.0  # about setpoints, each another, in so long by the wall

INSTEAD = {  # of messages that ask for what this vehicle does not do
    "SET_GPS_GLOBAL_ORIGIN": " (see --origin)",
    "SET_ACTUATOR_CONTROL_TARGET": "",
}

_NUMBERS = re.compile(r"[0-9.]+")


class Station:
    """Everything on the two ground ports of one vehicle."""

    def __init__(
        self, ports: Ports, identity: Identity, params: Parameters, vehicle: Supervisor,
        file: Path | None, say: Callable[[str, str], None],
    ) -> None:  # fmt: skip
        """`file`: where parameters are saved. `say`: a line of log (level, text). Raises PortBusy."""
        system = ports.system_id
        self.script = GroundPort(ports.fcu_script, ports.script, system, owner("fcu_script"))
        try:
            self.station = GroundPort(
                ports.fcu_station, ports.station, system, owner("fcu_station")
            )
        except OSError:
            self.script.close()
            raise
        self.ports = (self.script, self.station)
        self._identity = identity
        self._params = params
        self._vehicle = vehicle
        self._say = say
        self.telemetry = Telemetry(self.station, self.script, vehicle, identity.autopilot)
        self._commands = Commands(vehicle, identity.origin)
        self._parameters = ParameterService(params, file, vehicle, self._commands.table)
        self._requests = Requests(self.telemetry, self._commands.table)
        self._wind = Wind(identity.drag)
        self._wind_due = 0.0
        self._desk = Desk(
            self._commands, self._requests, self._parameters, vehicle.script, self.tell
        )
        self._complained: dict[str, float] = {}
        self._short_due = 0.0  # wall: when it is told again that a setpoint falls short
        self._home_told = 0
        self._mode_told: Mode | None = None
        self._row: Row = np.zeros(size(Tick))
        self._flying = False
        self._counters = Counters()

    def warm_up(self, row: Row) -> None:
        """Build every message once, so that nothing is compiled or imported in flight."""
        self.see(row, True, 0.0, 0.0)
        view = self.view()
        if view is not None:
            for stream in STREAMS.values():
                stream.build(view)
        self._wind = Wind(self._identity.drag)

    # --- what the loop tells

    def see(self, row: Row, flying: bool, load: float, off: float) -> None:
        """The Tick just flown, and what SYS_STATUS says of it."""
        self._row, self._flying = row, flying
        self._counters.load, self._counters.position_off = load, off

    def view(self) -> View | None:
        """The vehicle as it is now; None before the plant was heard."""
        measured = self._vehicle.measured
        if measured is None:
            return None
        self._counters.errors = sum(sum(port.dropped.values()) for port in self.ports)
        return View(
            self._identity, self._vehicle, self._params, self._wind, self._row, measured,
            float(self._row[0]), self._flying, self._counters,
        )  # fmt: skip

    def tell(self, severity: Severity, text: str) -> None:
        """A STATUSTEXT to everyone, and a line of log."""
        self.telemetry.text(severity, text)
        self._say("info" if severity >= Severity.NOTICE else "warning", text)

    def idle(self, t_us: int, now: float) -> None:
        """What is due by the wall clock; called between ticks and at each of them."""
        if not self.telemetry.is_due(now):
            return
        self.telemetry.heartbeat(now)
        view = self.view()
        if view is not None:
            if view.flying and now >= self._wind_due:
                self._wind_due = now + WIND_S
                self._wind.see(view.t, view.measured, view.state.s_v_hat, view.state.m_hat)
            self.telemetry.send(view, now)
            if self._home_told != self._vehicle.home_changed:
                self._home_told = self._vehicle.home_changed
                self.telemetry.broadcast(*STREAMS[HOME_POSITION].build(view))
            if self._mode_told is not self._vehicle.mode:
                self._mode_told = self._vehicle.mode
                self.telemetry.broadcast(*STREAMS[436].build(view))
        for port in self.ports:
            self._parameters.pace(port, now)
        self._desk.settle(t_us, now)

    # --- what ground stations and scripts say

    def serve(self, port: GroundPort, t_us: int, now: float) -> None:
        """What is waiting on a port. `t_us`: when what is asked for takes effect."""
        for message, link in port.receive(now):
            if isinstance(message, Command):
                self._requests.about(port, link, self.view())
                self._desk.take(port, link, message, t_us, now)
            elif isinstance(message, SetpointMessage | AttitudeSetpointMessage):
                self._setpoint(port, link, message, t_us, now)
            elif isinstance(message, SetMode):
                asked = message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24
                request = Request(_as_command(message), t_us, now)
                verdict = self._commands.select(
                    modes.of_numbers(*asked), request, modes.shown(*asked)
                )
                self._desk.explain(verdict, now)
            elif isinstance(message, ManualControl):
                self._sticks(message, t_us)
            elif isinstance(message, NotTaken):
                self._complain(f"{message.name} is not taken{INSTEAD[message.name]}", now)
            else:
                self._other(port, link, message, t_us, now)

    def _other(
        self, port: GroundPort, link: Link, message: GroundMessage, t_us: int, now: float
    ) -> None:
        done = self._parameters.take(message, link, now)
        if done is not None:
            to_sender, to_all, why = done
            port.send(link, *to_sender)
            if to_all:
                port.send(link, *to_all)
                for other_port in self.ports:
                    for other in other_port.links():
                        if other is not link:
                            other_port.send(other, *to_all)
            self._desk.explain(Verdict(Result.DENIED, why), now)
            return
        self._requests.about(port, link, self.view())
        replies = self._requests.take(message, t_us)
        if replies:
            port.send(link, *replies)

    def _setpoint(
        self, port: GroundPort, link: Link, message: SetpointMessage | AttitudeSetpointMessage,
        t_us: int, now: float,
    ) -> None:  # fmt: skip
        vehicle, script = self._vehicle, self._vehicle.script
        if vehicle.state is None:
            return
        who, lost_us = (message.source, link.address), vehicle.lost_us
        try:
            other = script.heard(who, t_us, now, lost_us)
            if other:
                raise Refused(other)
            pose = vehicle.pose()
            flown = vehicle.flown(t_us, pose)
            warning = ""
            if isinstance(message, SetpointMessage):
                frame = Frame(self._identity.origin, vehicle.home or pose.r_E)
                setpoint, warning = of_position(
                    message, pose, frame, flown, vehicle.script_limits()
                )
            else:
                setpoint = of_attitude(message, flown, self._params.law.T_max)
        except Refused as refused:
            script.refused += 1
            self._complain(f"Setpoint refused: {refused}", now)
            return
        if self._falls_short(setpoint, now):
            script.refused += 1
            self._say_info(vehicle.keep_script(t_us, now))
            return
        script.take(setpoint, message, t_us, now)
        self._say_info(vehicle.fly_script(t_us))
        port.send(link, echo(t_us * 1e-6, message))
        if warning:
            self._complain(warning, now)

    def _falls_short(self, setpoint: Setpoint, now: float) -> bool:
        """Whether the guard refuses a setpoint; says so, or warns of it, once."""
        vehicle = self._vehicle
        if vehicle.is_flown(setpoint):
            return False
        foresight, reference = vehicle.foresight, vehicle.reference
        short = foresight.short(setpoint, reference)
        if short == 0.0:
            return False
        if now >= self._short_due:  # to find the words takes longer than to look
            words = foresight.words(setpoint, short, reference)
            if words:
                self._short_due = now + COMPLAIN_S
                if self._complain(words, now):
                    foresight.told(setpoint, short)
        return foresight.refuses

    def _say_info(self, text: str) -> None:
        if text:
            self.tell(Severity.INFO, text)

    def _complain(self, text: str, now: float) -> bool:
        """Tell what is wrong with a stream: once, not at the stream's rate. Whether it was told."""
        kind = _NUMBERS.sub("", text)
        self._complained = {k: at for k, at in self._complained.items() if now - at < COMPLAIN_S}
        if kind not in self._complained and len(self._complained) < COMPLAINTS:
            self._complained[kind] = now
            self.tell(Severity.WARNING, text)
            return True
        return False

    def _sticks(self, message: ManualControl, t_us: int) -> None:
        """MANUAL_CONTROL in position mode: forward, right, up (half: still) and yaw, -1 to 1."""
        vehicle, p = self._vehicle, self._params
        if vehicle.mode is not Mode.POSITION or not vehicle.armed:
            return
        ahead, right, up, yaw = (0.0 if n != n else n for n in (message.x, message.y, message.z, message.r))  # fmt: skip
        speed, climb = p["MPC_XY_CRUISE"], 2.0 * up - 1.0 if message.z == message.z else 0.0
        v = turned(Vec3(ahead * speed, -right * speed, 0.0), vehicle.pose().psi)
        vertical = p["MPC_Z_VEL_MAX_UP"] if climb > 0.0 else p["MPC_Z_VEL_MAX_DN"]
        rate = -yaw * p["MPC_MAN_Y_MAX"] * np.pi / 180.0
        vehicle.move(Vec3(v.x, v.y, climb * vertical), float(rate), t_us)

    def dropped(self) -> dict[str, int]:
        """Messages and datagrams that were not taken, by reason."""
        counted = sum((port.dropped for port in self.ports), Counter[str]())
        return {**counted, "setpoints refused": self._vehicle.script.refused}

    def close(self) -> None:
        """Give the ports back."""
        for port in self.ports:
            port.close()


def _as_command(message: SetMode) -> Command:
    """The legacy SET_MODE as the command it stands for."""
    main, sub = message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24 & 0xFF
    params = (1.0, float(main), float(sub), 0.0, 0.0, 0.0, 0.0)
    return Command(message.source, message.target_system, 0, 176, params, None, 0)
