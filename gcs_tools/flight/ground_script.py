"""A ground script's view of the vehicle: commands and setpoints over MAVLink, with their answers.

What a user's own script would do, no more: everything here crosses the UDP link. One such
script is `fly_to`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from fcu.interface.link import Link, UdpLink
from fcu.interface.messages import Setpoint
from fcu.interface.ports import owner, ports
from fcu.interface.status_texts import Code, says
from fcu.kernel.algebra import Vec3
from fcu.mavlink import plan_messages, requests, setpoints
from fcu.mavlink.definitions import (
    IGNORE_ACCELERATION,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    IGNORE_YAW_RATE,
    CommandId,
    LandedState,
    MissionResult,
    MissionState,
    MissionType,
    Result,
    SystemStatus,
    definition,
)
from fcu.mavlink.framing import Source
from fcu.mavlink.geodesy import Origin
from fcu.mavlink.ground_link import GroundCodec, GroundMessage
from fcu.mavlink.plan_messages import MissionCurrent, MissionMessage, PlanItem
from fcu.mavlink.px4_modes import AutoMode, MainMode
from fcu.mavlink.replies import CommandAck, ParamValue, StatusText
from fcu.mavlink.setpoints import PositionTarget
from fcu.mavlink.telemetry import (
    ExtendedState,
    Heartbeat,
    LocalPosition,
    OriginTold,
    ground_heartbeat,
)
from gcs_tools.flight.interrupts import interrupts_wait
from gcs_tools.missions.plan_file import PlanFile
from gcs_tools.missions.timeline import PlanProgress

FORCE_REBOOT = 20190226.0  # MAVLink's REBOOT_SHUTDOWN_CONDITIONS_FORCE
ME = Source(255, 190)  # a ground station, as MAVLink numbers them
TOGETHER = 256  # messages of one datagram: others' vehicles may send all they have in one
ANSWER_S, TRIES = 0.5, 10  # wall: how long an answer may take, how often to ask
REASON_S = 0.2  # wall: how long after a refusal its reason may come
ACCEPTED = (
    Code.ITEMS_TAKEN,
    Code.ITEMS_PASSED_OVER,
    Code.ITEMS_CLEARED,
)  # of an upload: may come late
CHUNK = 50  # characters of a STATUSTEXT; one that is full is followed by another

TAKEOFF_M = 2.5
CLOSE_M, SLOW_M_S = 0.3, 0.3
WITHIN_S = 60.0  # simulation time: how long a flight to a place may take
HOLD_TRIES = 2  # half a second each, for somebody who waits for the prompt
NOTHING = Vec3(0.0, 0.0, 0.0)

T = TypeVar("T")


class VehicleError(RuntimeError):
    """The vehicle did not answer, or refused: what was asked, and its reason in words."""


class Refused(VehicleError):
    """The vehicle refuses what it was asked for, and flies on: its reason in words."""


class SetpointRefused(Refused):
    """It refuses a setpoint."""


class Vehicle:
    """One vehicle, met on its script link."""

    def __init__(self, instance: int, link: Link | None = None, me: Source = ME) -> None:
        """`link`: to it; None: the script's, by UDP. `me`: who we are.

        Raises PortBusy when another script has that link.
        """
        at = ports(instance)
        self._link = link or UdpLink(at.script, at.fcu_script, owner("script"))
        self._codec = GroundCodec(*me, at_once=TOGETHER)
        self._target = Source(at.system_id, 1)
        self._texts: list[str] = []
        self._goes_on = False  # the last of them: another chunk of it is to come
        self.on_text: Callable[[str], None] = lambda _text: None  # what the vehicle says
        self.on_message: Callable[[GroundMessage], None] = lambda _message: None  # all it sends
        self.on_wait: Callable[[], None] = lambda: None  # called while waiting; may raise

    def close(self) -> None:
        """Give the port back."""
        self._link.close()

    def greet(self) -> None:
        """Send a heartbeat: who sends them hears telemetry."""
        self._link.send(self._codec.framed(ground_heartbeat()))

    def wait_ready(self, timeout_s: float = 60.0) -> None:
        """Until the vehicle says that it could arm, or where it is. Raises VehicleError.

        Both follow on the plant being heard, and the next heartbeat may be a second away.
        """
        until = time.monotonic() + timeout_s
        self.greet()
        while time.monotonic() < until:
            for message in self.messages(0.2):
                if isinstance(message, LocalPosition):
                    return
                if isinstance(message, Heartbeat) and message.status >= SystemStatus.STANDBY:
                    return
        raise VehicleError(f"no vehicle ready within {timeout_s:.0f} s")

    def messages(self, timeout_s: float) -> list[GroundMessage]:
        """What arrives within the time: as soon as there is anything, all that is there."""
        self.on_wait()
        self._link.wait(timeout_s)
        return self._hear()

    def _hear(self) -> list[GroundMessage]:
        heard: list[GroundMessage] = []
        while (datagram := self._link.receive()) is not None:
            heard += self._codec.parse(datagram)
        for message in heard:
            self.on_message(message)
            if isinstance(message, StatusText):
                if message.chunk and self._texts:  # a long text comes in pieces
                    self._texts[-1] += message.text
                else:
                    self._texts.append(message.text)
                self._goes_on = message.id != 0 and len(message.text) == CHUNK
                self.on_text(message.text)
        return heard

    def _forget(self) -> None:
        """What was said so far is no answer to what is asked next."""
        self._hear()
        self._texts.clear()

    def _reason(self, is_one: Callable[[str], bool]) -> str:
        """The reason of a refusal, heard to its end: it follows the refusal. Empty: not said.

        is_one : whether a text may be the reason.
        """
        until = time.monotonic() + REASON_S
        while (self._goes_on or not any(map(is_one, self._texts))) and time.monotonic() < until:
            self.messages(until - time.monotonic())
        return "; ".join(filter(is_one, self._texts))

    def _ask(
        self, datagram: bytes, answer: Callable[[GroundMessage], T | None], what: str,
        tries: int = TRIES,
    ) -> T:  # fmt: skip
        for sent in range(tries):
            self._link.send(datagram)
            found = self._await(answer, ANSWER_S)
            if found is not None:
                for _ in range(sent):  # what was asked twice must not take effect again, later
                    self._await(answer, ANSWER_S)
                return found
        silent = ANSWER_S * tries
        raise VehicleError(
            f"the flight controller has been silent for {silent:.0f} s, asked for {what}"
        )

    def _await(self, answer: Callable[[GroundMessage], T | None], timeout_s: float) -> T | None:
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            for message in self.messages(until - time.monotonic()):
                found = answer(message)
                if found is not None:
                    return found
        return None

    def command(self, command: CommandId, *params: float, tries: int = TRIES) -> None:
        """Send a command and await its acknowledgement. Raises VehicleError with the reason."""
        self._forget()

        def answer(message: GroundMessage) -> int | None:
            mine = isinstance(message, CommandAck) and message.command == command
            return message.result if mine else None  # type: ignore[union-attr]

        def outcome(message: GroundMessage) -> int | None:
            result = answer(message)
            return None if result == Result.IN_PROGRESS else result

        packed = self._codec.framed(requests.command_long(self._target, command, params))
        result = self._ask(packed, answer, command.name, tries)
        if result == Result.IN_PROGRESS:
            ended = self._await(outcome, ANSWER_S * tries)
            if ended is None:
                raise VehicleError(f"{command.name} was begun, and has not ended")
            result = ended
        if result != Result.ACCEPTED:
            why = self._reason(_is_no_acceptance) or Result(result).name
            raise Refused(f"{command.name} refused: {why}")

    def offer(self, setpoint: Setpoint) -> None:
        """Send a setpoint, and await nothing: the vehicle may be in another mode."""
        self._link.send(self._codec.framed(setpoints.setpoint(self._target, 0.0, setpoint, 0)))

    def set_setpoint(self, setpoint: Setpoint, time_s: float = 0.0, type_mask: int = 0) -> None:
        """Send a setpoint and await its echo: from then on it is what the vehicle flies.

        Raises SetpointRefused, or VehicleError where no answer comes.
        """
        sent = setpoints.setpoint(self._target, time_s, setpoint, type_mask)

        def answer(message: GroundMessage) -> bool | None:
            if isinstance(message, StatusText) and says(message.text, Code.SETPOINT_REFUSED):
                return False
            mine = isinstance(message, PositionTarget) and message.echoes(sent)
            return True if mine else None

        packed = self._codec.framed(sent)
        self._forget()
        try:
            accepted = self._ask(packed, answer, "the echo of a setpoint")
        except VehicleError as error:
            why = "; ".join(self._texts)
            raise VehicleError(f"{error}{': ' + why if why else ''}") from None
        if not accepted:
            raise SetpointRefused(self._reason(_is_no_acceptance))

    def set_parameter(self, name: str, value: float, tries: int = TRIES) -> None:
        """Set a parameter and await that it is told. Raises VehicleError, also if it is another."""

        def answer(message: GroundMessage) -> float | None:
            mine = isinstance(message, ParamValue) and message.name == name
            return message.value if mine else None  # type: ignore[union-attr]

        packed = self._codec.framed(requests.param_set(self._target, name, value))
        told = self._ask(packed, answer, f"parameter {name}", tries)
        if not math.isclose(told, value, rel_tol=1e-6):  # it is told as a float32
            raise VehicleError(f"parameter {name} is {told:g}, asked for {value:g}")

    def arm(self) -> None:
        """Arm. Raises VehicleError."""
        self.command(CommandId.ARM_DISARM, 1.0)

    def offboard(self) -> None:
        """Fly the setpoints sent. Raises VehicleError."""
        self.command(CommandId.SET_MODE, 1.0, MainMode.OFFBOARD, AutoMode.NONE)

    def reset(self, force: bool = False, tries: int = TRIES) -> None:
        """Put vehicle and simulator back to the start; forced: in flight too. Raises VehicleError."""
        unused = (0.0,) * 4
        self.command(CommandId.REBOOT, 1.0, *unused, FORCE_REBOOT if force else 0.0, tries=tries)

    def hold(self, tries: int = TRIES) -> None:
        """Stay where it is; asked so often, half a second apart. Raises VehicleError."""
        self.command(CommandId.SET_MODE, 1.0, MainMode.AUTO, AutoMode.LOITER, tries=tries)

    def take_off(self, height_m: float) -> None:
        """Climb by so much from here. Raises VehicleError."""
        nan = math.nan
        self.command(CommandId.TAKEOFF, nan, nan, nan, nan, nan, nan, height_m)

    def land(self) -> None:
        """Land here. Raises VehicleError."""
        self.command(CommandId.SET_MODE, 1.0, MainMode.AUTO, AutoMode.LAND)

    def return_home(self) -> None:
        """Fly home and land there. Raises VehicleError."""
        self.command(CommandId.SET_MODE, 1.0, MainMode.AUTO, AutoMode.RETURN)

    # --- plans

    def set_origin(self, origin: Origin) -> None:
        """Have local (0, 0, 0) at this place on Earth. Raises VehicleError."""

        def answer(message: GroundMessage) -> bool | None:
            return True if isinstance(message, OriginTold) and message.is_close(origin) else None

        packed = requests.set_gps_global_origin(self._target, origin)
        self._ask(self._codec.framed(packed), answer, "its origin")

    def upload(self, kind: MissionType, items: Sequence[PlanItem]) -> None:
        """Upload a plan, a fence or rally points. Raises Refused with the reason, or VehicleError."""
        self._forget()
        to = self._target

        def answer(message: GroundMessage) -> MissionMessage | None:
            if not isinstance(message, MissionMessage) or message.mission_type != kind:
                return None
            return message if message.kind in ("REQUEST", "REQUEST_INT", "ACK") else None

        packed = plan_messages.count(len(items), kind, to)
        while True:
            found = self._ask(self._codec.framed(packed), answer, f"a {kind.name.lower()}")
            if found.kind == "ACK":
                break
            if found.sequence >= len(items):
                raise VehicleError(f"asked for item {found.sequence} of {len(items)}")
            each = items[found.sequence]
            packed = plan_messages.item(each, found.sequence, kind, to, True, found.sequence == 0)
        if found.result != MissionResult.ACCEPTED:
            why = self._reason(_is_denial) or MissionResult(found.result).name
            raise Refused(f"{kind.name} refused: {why}")

    def fly_plan(self, plan: PlanFile, origin: Origin) -> None:
        """Upload a plan, its fence and its rally points, and fly it. Raises VehicleError."""
        self.set_origin(origin)
        self.upload(MissionType.MISSION, ())  # or the one there is may not fit the fence
        self.upload(MissionType.FENCE, plan.fence)
        self.upload(MissionType.RALLY, plan.rally)
        self.upload(MissionType.MISSION, plan.mission)
        self.start_mission()

    def plan_progress(self) -> PlanProgress:
        """How far the plan is flown. Raises VehicleError."""
        told = self.mission_state()
        return PlanProgress(told.sequence, told.total, told.state == MissionState.COMPLETE)

    def start_mission(self) -> None:
        """Arm, and fly the plan from its first item on. Raises VehicleError."""
        self.command(CommandId.MISSION_START, 0.0)

    def mission_state(self) -> MissionCurrent:
        """The state of the plan. Raises VehicleError."""

        def answer(message: GroundMessage) -> MissionCurrent | None:
            return message if isinstance(message, MissionCurrent) else None

        asked = requests.command_long(
            self._target, CommandId.REQUEST_MESSAGE, (definition("MISSION_CURRENT").id,)
        )
        return self._ask(self._codec.framed(asked), answer, "the state of its mission")

    def position(self, timeout_s: float = 5.0) -> LocalPosition:
        """The next position it reports. Raises VehicleError."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            for message in self.messages(0.2):
                if isinstance(message, LocalPosition):
                    return message
        raise VehicleError(f"no position within {timeout_s:.0f} s")

    def heartbeat(self, timeout_s: float = 5.0) -> Heartbeat:
        """The next heartbeat. Raises VehicleError."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            for message in self.messages(0.2):
                if isinstance(message, Heartbeat):
                    return message
        raise VehicleError(f"no heartbeat within {timeout_s:.0f} s")


def _is_denial(text: str) -> bool:
    return says(text, Code.DENIED)


def _is_no_acceptance(text: str) -> bool:
    return not any(says(text, code) for code in ACCEPTED)


def distance(a: Vec3, b: Vec3) -> float:
    """Between two points, m."""
    return math.dist(a, b)


class MissionProgress:
    """Why a vehicle that was sent somewhere does not go there any more."""

    def __init__(self) -> None:
        self.why = ""  # what it has done instead; empty: it goes on
        self.offboard = False  # whether it was told to fly setpoints
        self.into_ground = False  # whether it says that its setpoint is below the ground
        self._has_flown = False

    def see(self, message: GroundMessage) -> None:
        """Whatever the vehicle sends, once it is armed."""
        if isinstance(message, ExtendedState):
            on_ground = message.landed_state == LandedState.ON_GROUND
            self._has_flown |= not on_ground
            if on_ground and self._has_flown:
                self.why = self.why or "has landed"
        elif isinstance(message, Heartbeat):
            if not message.armed:
                self.why = self.why or "has disarmed"
            elif self.offboard and message.main_mode != MainMode.OFFBOARD:
                self.why = self.why or "is in another mode by now"
        elif isinstance(message, StatusText):
            self.into_ground |= says(message.text, Code.SETPOINT_INTO_GROUND)


def fly_to(
    vehicle: Vehicle, target: Vec3, yaw_deg: float | None, tell: Callable[[str], None],
    within_s: float = WITHIN_S,
) -> LocalPosition:  # fmt: skip
    """Arm and take off if need be, fly to `target` (m, ENU) and return where it arrived.

    Raises VehicleError when the vehicle refuses, falls silent, lands, or is not there `within_s` of
    simulation time. Also for a target below the ground that it stands on, before it is armed.
    Interrupted, it has the vehicle hold, and goes on with that.
    """
    vehicle.wait_ready()
    told: set[str] = set()

    def hear(text: str) -> None:
        if text not in told:  # what is wrong with a stream is said again and again
            told.add(text)
            tell(f"  vehicle: {text}")

    vehicle.on_text = hear
    try:
        with interrupts_wait() as interrupts:
            vehicle.on_wait = interrupts.look
            return _fly_to(vehicle, target, yaw_deg, tell, within_s)
    except KeyboardInterrupt:
        vehicle.on_wait = lambda: None
        try:
            vehicle.hold(HOLD_TRIES)
        except VehicleError as error:
            tell(f"interrupted, and the vehicle may not hold: {error}")
        else:
            tell("interrupted: the vehicle holds where it is")
        raise


def _fly_to(
    vehicle: Vehicle, target: Vec3, yaw_deg: float | None, tell: Callable[[str], None],
    within_s: float,
) -> LocalPosition:  # fmt: skip
    watch = MissionProgress()
    start = vehicle.position()
    armed = vehicle.heartbeat().armed
    if not armed:
        if target.z < (ground := start.r_E.z) - CLOSE_M:
            raise VehicleError(
                f"not flown: {_place(target)} is below the ground, on which the vehicle stands at a"
                f" height of {ground:.1f} m (give Z above that)"
            )
        vehicle.arm()
    vehicle.on_message = watch.see
    if not armed:
        vehicle.take_off(TAKEOFF_M)
        _wait_until_at(vehicle, start.r_E + Vec3(0.0, 0.0, TAKEOFF_M), watch, within_s)
    psi = 0.0 if yaw_deg is None else math.radians(yaw_deg)
    mask = IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW_RATE
    if yaw_deg is None:
        mask |= IGNORE_YAW

    def stream() -> None:  # a vehicle that hears no setpoint for a second takes it for lost
        vehicle.set_setpoint(Setpoint(target, NOTHING, NOTHING, psi, 0.0), 0.0, mask)

    stream()
    stream()
    vehicle.offboard()
    watch.offboard = True
    tell(f"flying to {_place(target)}")
    there = _wait_until_at(vehicle, target, watch, within_s, stream)
    watch.offboard = False
    vehicle.hold()
    return there


def _place(r: Vec3) -> str:
    return f"({r.x:g}, {r.y:g}, {r.z:g}) m"


def _wait_until_at(
    vehicle: Vehicle, goal: Vec3, watch: MissionProgress, within_s: float,
    stream: Callable[[], None] = lambda: None,
) -> LocalPosition:  # fmt: skip
    began = vehicle.position()
    while True:
        stream()
        here = vehicle.position()
        away = distance(here.r_E, goal)
        if away < CLOSE_M and distance(here.v_E, NOTHING) < SLOW_M_S:
            return here
        if watch.why:
            because = f": {_place(goal)} is below the ground" if watch.into_ground else ""
            raise VehicleError(f"not there: the vehicle {watch.why}, {away:.1f} m away{because}")
        if here.time_boot_ms - began.time_boot_ms > within_s * 1000:
            raise VehicleError(
                f"not there after {within_s:g} s: still {away:.1f} m away (longer: --within S)"
            )


def put_back(vehicle: Vehicle, force: bool, timeout_s: float) -> None:
    """Reset a vehicle, and wait until time runs at its start. Raises VehicleError.

    `force`: in flight too. `timeout_s`: wall, for all of it.
    """
    until, due = time.monotonic() + timeout_s, 0.0
    watch = _Beginning()
    vehicle.on_message = watch.see
    vehicle.greet()  # to hear its telemetry
    vehicle.reset(force, max(1, math.ceil(timeout_s / ANSWER_S)))
    while not watch.time_runs:
        now = time.monotonic()
        if watch.refusal or now >= until:
            late = f"not at its start within {timeout_s:g} s (longer: --timeout S)"
            raise VehicleError(watch.refusal or late)
        if now >= due:
            due = now + ANSWER_S
            vehicle.greet()
        vehicle.messages(min(ANSWER_S, until - now))


class _Beginning:
    """Whether a vehicle that was to be reset is at its start, and time runs."""

    def __init__(self) -> None:
        self.time_runs = False
        self.refusal = ""  # why it is not reset after all
        self._is_reset = False

    def see(self, message: GroundMessage) -> None:
        """Whatever the vehicle sends."""
        if isinstance(message, StatusText):
            self._is_reset |= says(message.text, Code.RESET)
            if says(message.text, Code.NOT_RESET):
                self.refusal = message.text
        elif self._is_reset and isinstance(message, LocalPosition):
            self.time_runs |= message.time_boot_ms > 0
