"""The ground side of the vehicle: its ports, every service, one place where messages arrive.

The loop hands over what it measured and flew; everything a ground station or script can do to
the vehicle goes through `serve`. Nothing here blocks.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fcu.interface.link import Datagrams
from fcu.interface.ports import Ports, owner
from fcu.interface.status_texts import Code, Told
from fcu.kernel.buffers import size
from fcu.mavlink.definitions import (
    GCS,
    CommandId,
    MissionResult,
    MissionType,
    Result,
    Severity,
    definition,
)
from fcu.mavlink.failures import Signal
from fcu.mavlink.geodesy import Geodetic, Origin, to_local
from fcu.mavlink.ground_link import GroundMessage
from fcu.mavlink.plan_messages import MissionMessage, PlanItem
from fcu.mavlink.px4_modes import main_and_sub
from fcu.mavlink.requests import (
    ChannelsOverride,
    Command,
    FollowTarget,
    GlobalOrigin,
    ManualControl,
    NotTaken,
    SetMode,
)
from fcu.mavlink.telemetry import Heartbeat, gps_global_origin
from fcu.parameters import Parameters
from fcu.services import status
from fcu.services.command_protocol import (
    CommandProtocol,
    Commands,
    Failure,
    Request,
    Verdict,
    denied,
)
from fcu.services.exchange import SERVICE_OF, Service
from fcu.services.ground_port import PEERS, GroundPort, Link
from fcu.services.information import Information
from fcu.services.messages import STREAMS
from fcu.services.offboard import OffboardProtocol
from fcu.services.parameter_protocol import ParameterProtocol
from fcu.services.plan_items import (
    NAMES,
    RefusedItem,
    areas_of,
    numbered_step,
    passed_over,
    rally_of,
    steps_of,
)
from fcu.services.plan_protocol import PlanProtocol, Taking
from fcu.services.plan_record import PlanRecord
from fcu.services.sticks import StickProtocol
from fcu.services.streams import Streams
from fcu.services.tcp_socket import TcpSocket
from fcu.services.view import Counters, Identity, Row, View
from fcu.services.wind import Wind
from fcu.vehicle.conditions import ROWS
from fcu.vehicle.feasibility_check import Shortfall
from fcu.vehicle.follow import Report
from fcu.vehicle.mission import Step
from fcu.vehicle.modes import Mode
from fcu.vehicle.state_machine import StateMachine

Bind = Callable[[int, str], Datagrams]
Listen = Callable[[int, str, int], TcpSocket]
Take = Callable[[GroundPort, Link, Any, int, float], None]  # message, tick (us), wall (s)


class Say(Protocol):
    """Takes what the log is told."""

    def __call__(self, level: str, said: Told, time_us: int | None = None, /) -> None:
        """`time_us`: its simulation time. None: that of the last tick."""


AT_A_TIME = 250  # items of a plan whose steps are found between two ticks
WIND_S = 0.05  # wall: between two looks at the wind
CURRENT_MODE, HOME_POSITION = (
    STREAMS[definition(name).id] for name in ("CURRENT_MODE", "HOME_POSITION")
)  # sent at once when they change

SEVERITIES = {  # of what happens by itself; else INFO
    **{row.code: Severity[row.severity] for row in ROWS.values()},
    Code.LED_INTO_GROUND: Severity.WARNING,
    Code.RETURN_STRAIGHT: Severity.WARNING,
    Code.FAILSAFE_MODE: Severity.CRITICAL,
    Code.FAILSAFE_STOPPED: Severity.CRITICAL,
    Code.FAILSAFE_LATER: Severity.CRITICAL,
    Code.GUARD_VOID: Severity.WARNING,
    Code.STATE_FAILED: Severity.CRITICAL,
    Code.OFFBOARD_LOST_STOPPED: Severity.CRITICAL,
    Code.STICKS_LOST_STOPPED: Severity.CRITICAL,
    Code.RESET: Severity.NOTICE,
    Code.NOT_RESET: Severity.WARNING,
}
NOT_TAKEN = {  # messages that ask for what this vehicle does not do
    "SET_ACTUATOR_CONTROL_TARGET": Code.NOT_TAKEN,
}


HIGHEST, LOWEST = 100_000.0, -12_000.0  # m above the sea: PX4's limits of an origin


def out_of_range(origin: Origin) -> Code | None:
    """The reason why a place cannot be the origin. None if it can."""
    if abs(origin.lat_deg) > 90.0 or abs(origin.lon_deg) > 180.0:
        return Code.OFF_EARTH
    return None if LOWEST < origin.alt_m < HIGHEST else Code.HEIGHT_IMPOSSIBLE


class Station:
    """Everything on the ground ports of one vehicle."""

    def __init__(
        self, ports: Ports, identity: Identity, params: Parameters, vehicle: StateMachine,
        file: Path | None, say: Say, bind: Bind, resets: bool = False,
        before: Station | None = None, listen: Listen | None = None,
    ) -> None:  # fmt: skip
        """`file`: where parameters are saved. `say`: takes what is told, with its level.

        `bind`: opens a port, given its number and name. `resets`: as for Commands. `before`: the
        one before a reset, whose ports and links this one takes over. `listen`: opens a port of TCP,
        given its number, name and places. None: there is no such port. Raises PortBusy.
        """
        self.ports: tuple[GroundPort, ...] = (
            _opened(ports, bind, listen) if before is None else before.ports
        )
        self.script, self.station = self.ports[:2]
        self._identity = identity
        self._params = params
        self._vehicle = vehicle
        self._say = say
        self.streams = Streams(
            self.ports, self.station, vehicle, int(params["MAV_TYPE"]), identity.autopilot
        )
        self._commands = Commands(vehicle, identity.origin, resets)
        self._parameters = ParameterProtocol(params, file, vehicle, self._commands)
        self._information = Information(self.streams, self._commands.table)
        self._wind = Wind(identity.drag)
        self._wind_due = 0.0
        self._protocol = CommandProtocol(
            self._commands,
            self._information.questions,
            vehicle,
            self.tell,
            self.streams.tell_change,
        )
        self._offboard = OffboardProtocol(vehicle, params, identity.origin, self.tell)
        self._sticks = StickProtocol(vehicle, self.tell)
        self._plans = PlanProtocol(vehicle, self._take_plan, self._tell_of_plan)
        self._takers: dict[Service, Take] = {
            Service.STATIONS: self._hear_station,
            Service.COMMANDS: self._take_command,
            Service.SETPOINTS: self._offboard.take,
            Service.STICKS: self._take_sticks,
            Service.TARGETS: self._follow,
            Service.ORIGIN: self._set_origin,
            Service.PLANS: self._take_items,
            Service.PARAMETERS: self._take_parameter,
            Service.INFORMATION: self._inform,
            Service.REFUSALS: self._refuse,
        }
        self._plan_told = 0
        self._record = PlanRecord(vehicle, say)
        self._now = 0.0  # wall, s: of the message that is served
        self._home_told = 0
        self._mode_told: Mode | None = None
        self._row: Row = np.zeros(size(params.flown.ticks.Tick))
        self._flying = False
        self._counters = Counters()

    def warm_up(self, row: Row) -> None:
        """Build every message once, so that nothing is compiled or imported in flight."""
        self.see(row, True, 0.0, 0.0)
        view = self.view()
        if view is not None:
            for stream in STREAMS.values():
                stream.build(view)
            if view.adapts:
                self._see_wind(view)
        self._wind = Wind(self._identity.drag)

    def parameters_set(self) -> dict[str, float]:
        """The parameters of law and guard that were set by MAVLink, with the values in force."""
        return self._parameters.set_of_law()

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
            float(self._row[0]), self._flying, self._offboard.message, self._plans, self._counters,
        )  # fmt: skip

    def tell(self, told: Told, severity: Severity | None = None) -> None:
        """A STATUSTEXT to everyone, and a line of log. `severity`: as it is of this code."""
        severity = SEVERITIES.get(told.code, Severity.INFO) if severity is None else severity
        self.streams.text(severity, told)
        self._say("info" if severity >= Severity.NOTICE else "warning", told)

    @property
    def is_pending(self) -> bool:
        """Whether a command waits for its outcome: to be settled between any two ticks."""
        return self._protocol.is_pending

    @property
    def reset_asked(self) -> bool:
        """Whether somebody has asked for a reset, and was told that it comes."""
        return self._commands.reset_asked

    @property
    def failure(self) -> Failure | None:
        """The failure that the plant is asked for. None: there is none."""
        return self._commands.failure

    def failure_is_over(self) -> None:
        """The plant has answered, or does not: its sender is told, and the vehicle of a rotor."""
        for told in self._commands.failure_is_over():
            self.tell(told)

    def forget_reset(self) -> None:
        """It does not come."""
        self._commands.reset_asked = False

    @property
    def is_waiting(self) -> bool:
        """Whether messages wait that were received, and did not fit between two ticks."""
        return any(port.is_waiting for port in self.ports)

    def idle(self, t_us: int, now: float, decides: float) -> None:
        """What is due by the wall clock; called between ticks, and often.

        now : wall, s.  decides : the clock that decides about commands, s.
        """
        if self.is_pending:
            self._protocol.settle(t_us, decides)
        self._plans.look_on(t_us, decides)
        found = self._vehicle.look_again()
        if found is not None:
            self._tell_of_plan(found, found.code is not Code.DENIED)
        self.record_plan(t_us)
        self._record.tell()
        if not self.streams.is_due(now):
            return
        self.streams.heartbeat(now)
        view = self.view()
        if view is not None:
            if view.adapts and view.flying and now >= self._wind_due:
                self._wind_due = now + WIND_S
                self._see_wind(view)
            self.streams.send(view, now)
            if self._home_told != self._vehicle.home_changed:
                self._home_told = self._vehicle.home_changed
                self.streams.broadcast(*HOME_POSITION.build(view))
            reached = self._plans.reached()
            if reached or self._plan_told != self._vehicle.mission.changed:
                self._plan_told = self._vehicle.mission.changed
                self.streams.broadcast(*reached, self._plans.current())
            if self._mode_told is not self._vehicle.mode:
                self._mode_told = self._vehicle.mode
                self.streams.broadcast(*CURRENT_MODE.build(view))
        for port in self.ports:
            self._parameters.pace(port, now)
        self._now = decides
        self._plans.pace(decides)

    def begin_streams(self) -> None:
        """Let all be due by a clock that begins now, whatever was sent by another."""
        self._wind_due = 0.0
        self.streams.begin()

    def _see_wind(self, view: View) -> None:
        estimates = view.state.estimates
        self._wind.see(view.t, view.measured, estimates.s_v_hat, estimates.m_hat)

    # --- what ground stations and scripts say

    def hear_again(self) -> None:
        """Hear stations and sticks again, whatever failure was injected: the simulator is silent."""
        self._commands.hear_again()

    def serve(self, port: GroundPort, t_us: int, now: float) -> None:
        """Hand over what is waiting on a port. `t_us`: when what is asked for takes effect."""
        for message, link in port.receive(now):
            if self._commands.is_deaf(Signal.MAVLINK_SIGNAL, t_us):
                continue
            service = SERVICE_OF.get(type(message))
            if service is not None:
                self._takers[service](port, link, message, t_us, now)
            if self.reset_asked and isinstance(message, Command):
                return  # what comes behind it is for the vehicle that is then there

    def _hear_station(
        self, port: GroundPort, link: Link, message: Heartbeat, t_us: int, now: float
    ) -> None:
        if message.type == GCS:
            back = self._vehicle.hear_station(t_us, now)
            if back is not None:
                self.tell(back)

    def _take_command(
        self, port: GroundPort, link: Link, message: Command | SetMode, t_us: int, now: float
    ) -> None:
        if isinstance(message, Command):
            self._information.about(port, link, self.view())
            self._protocol.take(port, link, message, t_us, now)
            return
        asked = main_and_sub(message.custom_mode)
        request = Request(_as_command(message), t_us, now)
        verdict = self._commands.select(status.of_numbers(*asked), request, status.shown(*asked))
        self._protocol.explain(verdict, now)

    def _take_sticks(
        self, port: GroundPort, link: Link, message: ManualControl | ChannelsOverride, t_us: int,
        now: float,
    ) -> None:  # fmt: skip
        if not self._commands.is_deaf(Signal.RC_SIGNAL, t_us):
            self._sticks.take(link, message, t_us, now)

    def _take_items(
        self, port: GroundPort, link: Link, message: MissionMessage, t_us: int, now: float
    ) -> None:
        self._now = now
        self._plans.take(port, link, message, t_us, now)

    def _refuse(
        self, port: GroundPort, link: Link, message: NotTaken, t_us: int, now: float
    ) -> None:
        told = Told(NOT_TAKEN[message.name], (message.name,))
        if message.name not in link.told and self._offboard.complain(told, now):
            link.told.add(message.name)  # once: it may be a stream

    def _follow(
        self, port: GroundPort, link: Link, message: FollowTarget, t_us: int, now: float
    ) -> None:
        """Take a target's report. One that is no place on Earth is left out."""
        place = message.lat_deg, message.lon_deg
        if out_of_range(Origin(*place, 0.0)) or place == (0.0, 0.0):
            return
        v = message.v_E
        if v is not None and not all(map(math.isfinite, v)):
            v = None
        r = to_local(self._identity.origin, *place, message.alt_m)
        self._vehicle.follow(Report(r if math.isfinite(r.z) else r._replace(z=math.nan), v), t_us)

    def _set_origin(
        self, port: GroundPort, link: Link, message: GlobalOrigin, t_us: int, now: float
    ) -> None:
        """Move the place on Earth of local (0, 0, 0). Local positions stay as they are.

        Its sender hears the origin in force, whether it has changed or not, as from PX4.
        """
        origin = Origin(message.lat_deg, message.lon_deg, message.alt_m)
        why = out_of_range(origin)
        if why is None:
            self._identity = replace(self._identity, origin=origin)
            self._commands.origin = self._offboard.origin = origin
            self._place_plan_anew(t_us)
            self._home_told = -1  # it is another place on Earth
        verdict = denied("Origin", why) if why else Verdict(Result.ACCEPTED, Told(Code.ORIGIN_SET))
        told = gps_global_origin(Geodetic(*self._identity.origin))
        if why is None:
            self.streams.broadcast(told)
        if why is not None or not link.hears_telemetry:
            port.send(link, told)
        self._protocol.explain(verdict, now)

    # --- plans

    def record_plan(self, t_us: int) -> None:
        """Tell the log where plan and home are at a time, us, if that has changed."""
        self._record.look(t_us)

    def _tell_of_plan(self, told: Told, good: bool) -> None:
        result = Result.ACCEPTED if good else Result.DENIED
        self._protocol.explain(Verdict(result, told), self._now)

    def _take_plan(self, kind: MissionType, items: tuple[PlanItem, ...]) -> Taking:
        """Take a whole plan, fence or the rally points, a part of the work at a time. Raises RefusedItem."""
        vehicle, origin = self._vehicle, self._identity.origin
        t_us = yield
        if kind is MissionType.MISSION:
            found: list[Step] = []
            for number in range(len(items)):
                if number and number % AT_A_TIME == 0:
                    t_us = yield
                found.append(numbered_step(items, number, origin))
            steps = tuple(found)
            crossed = vehicle.plan_outside(steps)
            if crossed is not None:
                number, why = crossed
                raise RefusedItem(MissionResult.DENIED, why, number)
            lack: Shortfall | None = None
            for lack in vehicle.look_along(steps):
                if lack is None:
                    t_us = yield
                elif vehicle.feasibility.refuses:
                    raise RefusedItem(MissionResult.DENIED, lack.reason, lack.item)
            vehicle.take_plan(steps, t_us)
            if lack is not None:
                self._record.take(kind, items, origin, t_us)
                return Told(Code.PLAN_SHORT, (lack.item, lack.short))
        elif kind is MissionType.FENCE:
            vehicle.take_fence(areas_of(items, origin))
        else:
            vehicle.rally = rally_of(items, origin)
        self._record.take(kind, items, origin, t_us)
        if not items:
            return Told(Code.ITEMS_CLEARED, (NAMES[kind],))
        over = passed_over(items)
        if over:
            return Told(Code.ITEMS_PASSED_OVER, (NAMES[kind], len(items), over))
        return Told(Code.ITEMS_TAKEN, (NAMES[kind], len(items)))

    def _place_plan_anew(self, t_us: int) -> None:
        """The origin has moved: places on Earth are other local places. A plan goes on as it was.

        What is too far away now is cleared.
        """
        vehicle, origin, stored = self._vehicle, self._identity.origin, self._plans.stored

        def again(kind: MissionType, place: Callable[[tuple[PlanItem, ...]], None]) -> None:
            try:
                place(stored.items[kind])
            except RefusedItem as refused:
                stored.replace(kind, ())
                place(())
                self._tell_of_plan(Told(Code.DENIED, (NAMES[kind], refused.told)), False)

        def plan(items: tuple[PlanItem, ...]) -> None:
            vehicle.mission.steps = steps_of(items, origin)

        def rally(items: tuple[PlanItem, ...]) -> None:
            vehicle.rally = rally_of(items, origin)

        again(MissionType.MISSION, plan)
        again(MissionType.FENCE, lambda items: vehicle.take_fence(areas_of(items, origin)))
        again(MissionType.RALLY, rally)
        for kind, items in stored.items.items():
            if items:
                self._record.take(kind, items, origin, t_us)

    def _take_parameter(
        self, port: GroundPort, link: Link, message: GroundMessage, t_us: int, now: float
    ) -> None:
        done = self._parameters.take(message, link, now)
        if done is None:
            return
        to_sender, to_all, why = done
        port.send(link, *to_sender)
        if to_all:
            port.send(link, *to_all)
            for other_port in self.ports:
                for other in other_port.links():
                    if other is not link:
                        other_port.send(other, *to_all)
        self._protocol.explain(Verdict(Result.DENIED, why), now)

    def _inform(
        self, port: GroundPort, link: Link, message: GroundMessage, t_us: int, now: float
    ) -> None:
        self._information.about(port, link, self.view())
        replies = self._information.take(message, t_us)
        if replies:
            port.send(link, *replies)

    def dropped(self) -> dict[str, int]:
        """Messages and datagrams that were not taken, by reason."""
        counted = sum((port.dropped for port in self.ports), Counter[str]())
        refused, unsaid = self._vehicle.script.refused, self._protocol.texts.unsaid
        return {**counted, "setpoints refused": refused, **({"texts": unsaid} if unsaid else {})}

    def close(self) -> None:
        """Tell the log what is left to tell, and give the ports back."""
        self._record.close()
        for port in self.ports:
            port.close()


def _opened(ports: Ports, bind: Bind, listen: Listen | None) -> tuple[GroundPort, ...]:
    """The ports of scripts, of ground stations, and of both by TCP. Raises PortBusy."""
    opened: list[GroundPort] = []
    try:
        for name, listener in (("fcu_script", ports.script), ("fcu_station", ports.station)):
            bound = bind(getattr(ports, name), owner(name))
            opened.append(GroundPort(bound, listener, ports.system_id))
        if listen is not None and ports.fcu_tcp:
            by_tcp = listen(ports.fcu_tcp, owner("fcu_tcp"), PEERS)
            opened.append(GroundPort(by_tcp, None, ports.system_id))
    except OSError:
        for port in opened:
            port.close()
        raise
    return tuple(opened)


def _as_command(message: SetMode) -> Command:
    """The legacy SET_MODE as the command it stands for."""
    main, sub = main_and_sub(message.custom_mode)
    params = (1.0, float(main), float(sub), 0.0, 0.0, 0.0, 0.0)
    return Command(message.source, message.target_system, 0, CommandId.SET_MODE, params, None, 0)
