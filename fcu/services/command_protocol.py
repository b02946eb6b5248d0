"""The command protocol: what each command takes and does, and how its sender learns of it.

Every command is answered, to its sender: it may be a repetition, or wait. A first acknowledgement
is the last, but for what takes its time (IN_PROGRESS): many clients read no second one. What is
wrong with a command is told, and changes nothing. The table says which parameters mean something; of
another that is not 0 or NaN it is told that it has no effect.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.mavlink import failures, replies
from fcu.mavlink.definitions import (
    GLOBAL_FRAMES,
    RELATIVE_FRAMES,
    CommandId,
    Frame,
    ModeFlag,
    Result,
    Severity,
    command_name,
)
from fcu.mavlink.geodesy import Origin, to_local
from fcu.mavlink.requests import Command
from fcu.services import status
from fcu.services.ground_port import Acknowledged, GroundPort, Link
from fcu.services.text_budget import TextBudget
from fcu.vehicle import plans
from fcu.vehicle.modes import Mode
from fcu.vehicle.state_machine import Answer, StateMachine

ORBIT_SPEED = 1.0  # m/s, as PX4's
ORBIT_YAW = {float(each.value): each for each in plans.OrbitYaw}
FORCE = 21196.0  # COMPONENT_ARM_DISARM, parameter 2: do it whatever the checks say
FORCE_REBOOT = 20190226.0  # PREFLIGHT_REBOOT_SHUTDOWN, parameter 6: in flight too
_SCALES = 1e7, 1e4  # of parameter 6 in COMMAND_INT, by its frame
FARTHEST, LOWEST = 20_000.0, 100.0  # m from here, and below home: nobody flies there
TAKEOFF_ASIDE = 10.0  # m: a take-off that names a place farther away is not a take-off
REMEMBERED, REPEAT_S = 8, 5.0  # acknowledgements of a link, for so long (wall), for repetitions
PENDING_S = 0.5  # wall: how long a command waits for the second setpoint of a stream
SOON = (CommandId.INJECT_FAILURE,)  # answered within ticks: nobody is told that they have begun
WAIT_FOR_A_STREAM = (CommandId.SET_MODE, CommandId.SET_STANDARD_MODE, CommandId.ARM_DISARM)


class Verdict(NamedTuple):
    """What became of a command, and what is told of it; None: nothing."""

    result: Result
    told: Told | None = None
    unused: Told | None = None  # what of it has no effect

    @property
    def good(self) -> bool:
        """Whether it was done."""
        return self.result is Result.ACCEPTED


def denied(what: str, why: Told | Code, result: Result = Result.DENIED) -> Verdict:
    """It was not, and nothing has changed. `what`: was asked for."""
    reason = Told(why) if isinstance(why, Code) else why
    return Verdict(result, Told(Code.DENIED, (what, reason)))


def _verdict(what: str, answer: Answer) -> Verdict:
    """What the vehicle answered; `what`: was asked for, if it is refused."""
    if answer.granted:
        return Verdict(Result.ACCEPTED, answer.told)
    assert answer.told is not None
    what = "Speed" if answer.told.code is Code.SPEED_RANGE else what
    return denied(what, answer.told, Result.TEMPORARILY_REJECTED if answer.later else Result.DENIED)


class Request(NamedTuple):
    """One command at its moment."""

    command: Command
    t_us: int  # simulation time at which it takes effect
    wall_s: float

    def parameter(self, n: int) -> float:
        """Parameter n, from 1; NaN where it is left to the vehicle."""
        return self.command.params[n - 1]

    def given(self, n: int, default: float) -> float:
        """Parameter n, or the default if it is NaN."""
        value = self.parameter(n)
        return default if math.isnan(value) else value


class Spec(NamedTuple):
    """One command: what runs it, and what its parameters may be."""

    run: Callable[[Request], Verdict]
    used: tuple[int, ...] = ()  # parameters that mean something; NaN: default
    required: tuple[int, ...] = ()  # of these, those that must be numbers
    to_all: bool = True  # also when it is sent to every system
    place: bool = False  # parameters 5 to 7 are a place on Earth: to a metre in COMMAND_LONG
    what: str = ""


@dataclass
class Failure:
    """A failure that the plant is asked for, until it has answered."""

    order: failures.Order
    number: int
    result: Result | None = None  # the plant's; FAILED: it does not answer


def _injected(asked: Failure) -> Verdict | None:
    """The outcome of a failure. None: the plant has not answered yet."""
    order, result = asked.order, asked.result
    if result is None:
        return None
    if result is not Result.ACCEPTED:
        return denied("Failure", _NOT_INJECTED.get(result, Code.FAILURE_UNANSWERED), result)
    code = Code.FAILURE_CLEARED if order.type == failures.Type.OK else Code.FAILURE_INJECTED
    return Verdict(result, Told(code, (failures.words(order),)))


_NOT_INJECTED = {
    Result.UNSUPPORTED: Code.FAILURE_NOT_DONE,
    Result.DENIED: Code.FAILURE_RANGE,
    Result.TEMPORARILY_REJECTED: Code.FAILURE_FULL,
}


class Commands:
    """The flight commands of one vehicle; the ground services add theirs to `table`."""

    def __init__(self, vehicle: StateMachine, origin: Origin, resets: bool = False) -> None:
        """`resets`: whoever asks about `reset_asked` then resets vehicle and plant."""
        self._vehicle = vehicle
        self.origin = origin  # of local positions: may be set anew
        self._resets = resets
        self.reset_asked = False  # and granted
        # of a command that is being done: asked until it tells what became of it
        self.in_progress: Callable[[], Verdict | None] | None = None
        self.failure: Failure | None = None  # that the plant is asked for
        self._failures = 0  # how often it was
        self._deaf: dict[int, float] = {}  # signal that is not heard: until when, us
        arm = Spec(self._arm, (1, 2), (1,), to_all=False, what="Arming")
        self.table: dict[int, Spec] = {
            CommandId.ARM_DISARM: arm,
            CommandId.SET_MODE: Spec(self._set_mode, (1, 2, 3), (1, 2), what="Mode"),
            CommandId.SET_STANDARD_MODE: Spec(self._standard_mode, (1,), (1,), what="Mode"),
            CommandId.TAKEOFF: Spec(self._take_off, (1, 4, 5, 6, 7), what="Takeoff"),
            CommandId.LAND: Spec(self._land, (1, 2, 4, 5, 6, 7), what="Landing"),
            CommandId.RETURN: Spec(self._return, what="Return"),
            CommandId.LOITER: Spec(self._loiter, (3, 4, 5, 6, 7), place=True, what="Hold"),
            CommandId.REPOSITION: Spec(
                self._reposition, (1, 2, 3, 4, 5, 6, 7), place=True, what="Reposition"
            ),
            CommandId.ORBIT: Spec(self._orbit, (1, 2, 3, 5, 6, 7), place=True, what="Orbit"),
            CommandId.PAUSE_CONTINUE: Spec(self._pause, (1,), (1,), what="Pause"),
            CommandId.MISSION_START: Spec(self._start_plan, (1, 2), to_all=False, what="Mission"),
            CommandId.SET_MISSION_CURRENT: Spec(self._set_current, (1, 2), (1,), what="Item"),
            CommandId.LAND_START: Spec(self._land_start, (4, 5, 6, 7), what="Landing"),
            CommandId.CHANGE_SPEED: Spec(self._speed, (1, 2, 3), (2,), what="Speed"),
            CommandId.SET_HOME: Spec(self._set_home, (1, 2, 3, 4, 5, 6, 7), (1,), what="Home"),
            CommandId.FLIGHT_TERMINATION: Spec(
                self._terminate, (1,), (1,), to_all=False, what="Termination"
            ),
            CommandId.INJECT_FAILURE: Spec(
                self._inject, (1, 2, 3, 4, 5), (1, 2, 3), to_all=False, what="Failure"
            ),
            CommandId.RUN_PREARM_CHECKS: Spec(self._checks, what="Checks"),
            CommandId.REBOOT: Spec(self._reset, (1, 6), (1,), to_all=False, what="Reset"),
        }

    def answer(self, request: Request) -> Verdict:
        """Check a command against the table, and run it."""
        command = request.command
        spec = self.table.get(command.command)
        if spec is None:
            return Verdict(
                Result.UNSUPPORTED, Told(Code.UNSUPPORTED, (command_name(command.command),))
            )
        if command.target_system == 0 and not spec.to_all:
            return denied(spec.what, Code.TO_NO_SYSTEM)
        if command.frame is not None and spec.place and command.frame not in GLOBAL_FRAMES:
            return _wrong_frame(spec.what, command.frame)
        for n, value in enumerate(command.params, start=1):
            if math.isinf(value) or (n in spec.required and math.isnan(value)):
                return denied(spec.what, Told(Code.PARAMETER_NAN, (n,)))
        verdict = spec.run(request)
        unused = [
            n
            for n, value in enumerate(command.params, start=1)
            if n not in spec.used and not math.isnan(value) and value != 0.0
        ]
        if not unused or not verdict.good or not spec.what:
            return verdict
        return verdict._replace(unused=Told(Code.PARAMETER_UNUSED, (spec.what, unused[0])))

    # --- each

    def _arm(self, request: Request) -> Verdict:
        want, forced = request.parameter(1), request.given(2, 0.0) == FORCE
        if want not in (0.0, 1.0):
            return denied("Arming", Code.NEITHER_0_NOR_1)
        if want == 0.0:
            return _verdict("Disarming", self._vehicle.disarm(request.t_us, forced))
        return _verdict("Arming", self._vehicle.arm(request.t_us, request.wall_s))

    def _set_mode(self, request: Request) -> Verdict:
        base, main, sub = request.parameter(1), request.parameter(2), request.given(3, 0.0)
        if not int(base) & ModeFlag.CUSTOM:
            return denied("Mode", Code.CUSTOM_MODES_ONLY)
        numbers = int(main), int(sub)
        return self.select(status.of_numbers(*numbers), request, status.shown(*numbers))

    def _standard_mode(self, request: Request) -> Verdict:
        number = int(request.parameter(1))
        name = status.OTHER_STANDARD.get(number, f"{number} (standard)")
        return self.select(status.of_standard(number), request, name)

    def select(self, mode: Mode | None, request: Request, asked: str) -> Verdict:
        """Another mode. None: one that this vehicle does not have. `asked`: what it is called."""
        if mode is None:
            return Verdict(Result.DENIED, Told(Code.MODE_UNKNOWN, (asked,)))
        return self._select(mode, request)

    def _select(self, mode: Mode, request: Request) -> Verdict:
        return _verdict(mode.value, self._vehicle.select(mode, request.t_us, request.wall_s))

    def _place(self, request: Request) -> Vec3 | Code:
        """Parameters 5 to 7 as a position, or what is wrong with them.

        What is left out is where the vehicle comes to rest.
        """
        vehicle = self._vehicle
        here = vehicle.stopping_place(request.t_us)
        lat, lon, alt = (request.parameter(n) for n in (5, 6, 7))
        if abs(lat) > 90.0 or abs(lon) > 180.0 or math.isnan(lat) != math.isnan(lon):
            return Code.NO_PLACE_NEAR
        r = here
        if not (math.isnan(lat) or math.isnan(lon)):
            r = to_local(self.origin, lat, lon, self.origin.alt_m)
            if not math.dist(r[:2], here[:2]) <= FARTHEST:  # 0, 0: mostly one that was left out
                return Code.NO_PLACE_NEAR
        if math.isnan(alt):
            return Vec3(r.x, r.y, here.z)
        z = alt - self.origin.alt_m
        if request.command.frame in RELATIVE_FRAMES and vehicle.home is not None:
            z = alt + vehicle.home.z
        ground = here.z if vehicle.home is None else vehicle.home.z
        if not ground - LOWEST <= z <= ground + FARTHEST:  # as above: a height of 0
            return Code.NO_HEIGHT_NEAR
        return Vec3(r.x, r.y, z)

    def _take_off(self, request: Request) -> Verdict:
        vehicle = self._vehicle
        if vehicle.state is None or vehicle.home is None:
            return denied("Takeoff", Code.NO_STATE)
        lat, lon, alt = (request.parameter(n) for n in (5, 6, 7))
        named = not (math.isnan(lat) or math.isnan(lon) or lat == lon == 0.0)
        place = self._place(_level(request)) if named else Code.NO_PLACE
        here = vehicle.pose().r_E
        if named and (isinstance(place, Code) or math.dist(place[:2], here[:2]) > TAKEOFF_ASIDE):
            return denied("Takeoff", Code.PLACE_NOT_HERE)
        if math.isnan(alt) or (alt == 0.0 and not named):
            return self._climb(None, request)
        z = alt - self.origin.alt_m
        # Above the sea, as PX4 reads it; what would be below ground is a height above home.
        above_home = request.command.frame in RELATIVE_FRAMES or z <= vehicle.home.z
        z = alt + vehicle.home.z if above_home else z
        if not abs(alt) <= 1e5:
            return denied("Takeoff", Code.HEIGHT_IMPOSSIBLE)
        return self._climb(z, request)

    def _climb(self, z: float | None, request: Request) -> Verdict:
        return _verdict("Takeoff", self._vehicle.take_off(z, request.t_us, request.wall_s))

    def _land(self, request: Request) -> Verdict:
        """Land here, whatever the height that is asked for, as PX4 does."""
        lat, lon = request.parameter(5), request.parameter(6)
        if not (math.isnan(lat) or math.isnan(lon) or lat == lon == 0.0):
            if self._vehicle.state is None:
                return denied("Landing", Code.NO_STATE)
            place = self._place(_level(request))
            if isinstance(place, Code):
                return denied("Landing", place)
            if math.dist(place[:2], self._vehicle.pose().r_E[:2]) > TAKEOFF_ASIDE:
                return denied("Landing", Code.LANDS_HERE)
        return self._select(Mode.LAND, request)

    def _return(self, request: Request) -> Verdict:
        return self._select(Mode.RETURN, request)

    def _loiter(self, request: Request) -> Verdict:
        """Hold here, or fly to a place and hold there. Radius and yaw are those of other vehicles."""
        lat, lon, alt = (request.parameter(n) for n in (5, 6, 7))
        if lat == lon == 0.0 or all(map(math.isnan, (lat, lon, alt))):
            return self._select(Mode.HOLD, request)
        if self._vehicle.state is None or self._vehicle.home is None:
            return denied("Hold", Code.NO_STATE)
        to = self._place(request)
        if isinstance(to, Code):
            return denied("Hold", to)
        return _verdict("Hold", self._vehicle.reposition(to, None, request.t_us, None))

    def _reposition(self, request: Request) -> Verdict:
        vehicle = self._vehicle
        speed = request.given(1, -1.0)  # m/s; -1: as it is
        if vehicle.state is None or vehicle.home is None:
            return denied("Reposition", Code.NO_STATE)
        yaw = request.parameter(4)
        psi = None if math.isnan(yaw) else 0.5 * math.pi - yaw
        if all(math.isnan(request.parameter(n)) for n in (5, 6, 7)):  # pause, or turn here
            if psi is None:
                return self._select(Mode.HOLD, request)
            return _verdict("Reposition", vehicle.turn(psi, request.t_us))
        to = self._place(request)
        if isinstance(to, Code):
            return denied("Reposition", to)
        told = None if speed == -1.0 else speed
        return _verdict("Reposition", vehicle.reposition(to, psi, request.t_us, told))

    def _orbit(self, request: Request) -> Verdict:
        """A circle about a place, or about here. What is left to the vehicle is as PX4 has it.

        So is the height: above the sea whatever the frame, which MAVSDK says is above home.
        """
        vehicle = self._vehicle
        if vehicle.state is None or vehicle.home is None:
            return denied("Orbit", Code.NO_STATE)
        radius, speed = request.given(1, plans.RADIUS_LEAST), request.given(2, ORBIT_SPEED)
        faces = ORBIT_YAW.get(request.given(3, 0.0))
        if faces is None:
            return denied("Orbit", Code.ORBIT_YAW)
        command = request.command._replace(frame=Frame.GLOBAL_INT)
        center = self._place(request._replace(command=command))
        if isinstance(center, Code):
            return denied("Orbit", center)
        clockwise = math.copysign(1.0, radius) * math.copysign(1.0, speed) > 0.0
        circle = plans.Circle(center, abs(radius), abs(speed), clockwise, faces)
        return _verdict("Orbit", vehicle.orbit(circle, request.t_us))

    def _pause(self, request: Request) -> Verdict:
        if request.parameter(1) not in (0.0, 1.0):
            return denied("Pause", Code.NEITHER_0_NOR_1)
        if request.parameter(1) == 1.0:
            return self._select(Mode.MISSION, request)
        return self._select(Mode.HOLD, request)

    def _start_plan(self, request: Request) -> Verdict:
        """Fly the plan from item parameter 1 on, and arm. The last item is always the plan's."""
        answer = self._vehicle.start_plan(int(request.given(1, -1.0)), request.t_us, request.wall_s)
        return _verdict("Mission", answer)

    def _set_current(self, request: Request) -> Verdict:
        item = request.parameter(1)
        if item == -1.0:
            item = float(self._vehicle.mission.current)
        if request.given(2, 0.0) == 1.0:
            self._vehicle.mission.restart()
        return _verdict("Item", self._vehicle.set_current(int(item), request.t_us))

    def _land_start(self, request: Request) -> Verdict:
        """Fly the landing of the plan, from its DO_LAND_START on."""
        begin = self._vehicle.mission.landing
        if begin is None:
            return denied("Landing", Code.NO_LAND_START)
        if not self._vehicle.armed:
            return denied("Landing", Code.NOT_ARMED)
        answer = self._vehicle.start_plan(begin, request.t_us, request.wall_s)
        return _verdict("Landing", answer)

    def _speed(self, request: Request) -> Verdict:
        if request.given(1, 1.0) not in (0.0, 1.0):
            return denied("Speed", Code.GROUND_SPEED_ONLY)
        return _verdict("Speed", self._vehicle.change_speed(request.parameter(2)))

    def _set_home(self, request: Request) -> Verdict:
        if request.parameter(1) == 1.0:
            return _verdict("Home", self._vehicle.set_home(None))
        if self._vehicle.state is None:
            return denied("Home", Code.NO_STATE)
        if any(math.isnan(request.parameter(n)) for n in (5, 6, 7)):
            return denied("Home", Code.NO_PLACE)
        frame = request.command.frame
        if frame is not None and frame not in GLOBAL_FRAMES:
            return _wrong_frame("Home", frame)
        place = self._place(request)
        if isinstance(place, Code):
            return denied("Home", place)
        return _verdict("Home", self._vehicle.set_home(place))

    def _terminate(self, request: Request) -> Verdict:
        if request.parameter(1) <= 0.5:
            return Verdict(Result.ACCEPTED)
        return _verdict("Termination", self._vehicle.terminate(request.t_us))

    def _reset(self, request: Request) -> Verdict:
        if request.parameter(1) == 0.0:  # do nothing, as PX4 accepts it
            return Verdict(Result.ACCEPTED)
        if request.parameter(1) != 1.0:
            return denied("Reset", Code.RESETS_ONLY)
        if not self._resets:
            return denied("Reset", Code.ONE_FLIGHT)
        if self._vehicle.armed and not _forces_reset(request):
            return denied("Reset", Code.ARMED_NOT_RESET)
        self.reset_asked = True
        return Verdict(Result.ACCEPTED)

    def _inject(self, request: Request) -> Verdict:
        """Ask the plant to break something, or to mend it: answered once the plant has done it."""
        if not self._vehicle.takes_failures:
            return denied("Failure", Code.FAILURES_OFF)
        order = failures.order(request.command.params)
        if order is None:
            return denied("Failure", Code.FAILURE_RANGE)
        if order.unit in set(failures.Signal):
            return self._deafen(order, request.t_us)
        if not failures.kinds(order):
            return denied("Failure", Code.FAILURE_UNKNOWN, Result.UNSUPPORTED)
        self._failures += 1
        self.failure = asked = Failure(order, self._failures)
        self.in_progress = lambda: _injected(asked)
        return Verdict(Result.IN_PROGRESS)

    def failure_is_over(self) -> list[Told]:
        """Tell the vehicle of rotors that the plant has stopped, or mended. Returns what it says of them.

        Of one that turns again by itself nothing is told: it is lost if its speed says so.
        """
        asked, self.failure = self.failure, None
        if asked is None or asked.result is not Result.ACCEPTED:
            return []
        order = asked.order
        if order.unit != failures.Unit.MOTOR or order.type not in (
            failures.Type.OK, failures.Type.OFF,
        ):  # fmt: skip
            return []
        rotors = [order.instance] if order.instance else range(1, self._vehicle.rotor_count + 1)
        lost = order.type == failures.Type.OFF
        if lost and order.for_s > 0.0:
            return []
        return [told for rotor in rotors for told in self._vehicle.tell_rotor(rotor, lost)]

    def _deafen(self, order: failures.Order, t_us: int) -> Verdict:
        """Stop hearing sticks or ground stations, or hear them again. Who hears no station needs an end."""
        if order.type not in (failures.Type.OK, failures.Type.OFF):
            return denied("Failure", Code.FAILURE_UNKNOWN, Result.UNSUPPORTED)
        off = order.type == failures.Type.OFF
        for_ever = off and order.for_s == 0.0
        if for_ever and order.unit == failures.Signal.MAVLINK_SIGNAL:
            return denied("Failure", Code.FAILURE_ENDLESS)
        too_long = (
            order.unit == failures.Signal.MAVLINK_SIGNAL and order.for_s > failures.DEAF_MOST_S
        )
        if too_long or not failures.is_in_range(order, 0):
            return denied("Failure", Code.FAILURE_RANGE)
        until = math.inf if for_ever else t_us + 1e6 * order.for_s
        self._deaf[order.unit] = until if off else -math.inf
        code = Code.FAILURE_INJECTED if off else Code.FAILURE_CLEARED
        return Verdict(Result.ACCEPTED, Told(code, (failures.words(order),)))

    def hear_again(self) -> None:
        """Hear every signal: simulation time stands for good, and would end no failure."""
        self._deaf.clear()

    def is_deaf(self, signal: failures.Signal, t_us: int) -> bool:
        """Return true if a failure was injected by which a signal is not heard.

        Once the flight has ended everything is heard: simulation time stands, and would end no failure.
        """
        return self._vehicle.ended is None and t_us < self._deaf.get(signal, -math.inf)

    def _checks(self, request: Request) -> Verdict:
        why = self._vehicle.why_not_arm(request.t_us, request.wall_s)
        told = Told(Code.READY_TO_ARM) if why is None else Told(Code.NOT_READY_TO_ARM, (why,))
        return Verdict(Result.ACCEPTED, told)


def _level(request: Request) -> Request:
    """A request without its height, parameter 7."""
    params = (*request.command.params[:6], math.nan)
    return request._replace(command=request.command._replace(params=params))


def _forces_reset(request: Request) -> bool:
    force = request.given(6, 0.0)
    if request.command.frame is None:
        return force == FORCE_REBOOT
    return any(round(force * scale) == FORCE_REBOOT for scale in _SCALES)


def _wrong_frame(what: str, frame: int) -> Verdict:
    return denied(what, Told(Code.COMMAND_FRAME, (frame,)), Result.UNSUPPORTED_MAV_FRAME)


# --- acknowledged


@dataclass
class Pending:
    """A command that is answered later."""

    command: Command
    port: GroundPort
    link: Link
    outcome: Callable[[int, float], Verdict | None]
    in_progress: bool  # it has begun, and its sender was told so


class CommandProtocol:
    """Commands from their arrival to their acknowledgement. One for all links."""

    def __init__(
        self, commands: Commands, questions: frozenset[int], vehicle: StateMachine,
        tell: Callable[[Told, Severity], None], tell_change: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        """`questions`: commands that ask, and change nothing. `tell`: to everyone.

        `tell_change`: sends a heartbeat if mode or arming has changed.
        """
        self._tell_change = tell_change
        self._commands = commands
        self._questions = questions
        self._vehicle = vehicle
        self._tell = tell
        self._pending: dict[int, Pending] = {}  # by command
        self.texts = TextBudget()

    @property
    def is_pending(self) -> bool:
        """Whether there is a command that is answered later."""
        return bool(self._pending)

    def take(
        self, port: GroundPort, link: Link, command: Command, t_us: int, now: float
    ) -> None:  # fmt: skip
        """Carry a command out, or begin to, or acknowledge once more. `now`: wall, s."""
        if self._is_pending(port, link, command, now) or self._is_repeated(
            port, link, command, now
        ):
            return
        verdict = self._commands.answer(Request(command, t_us, now))
        later = self._later(command, verdict, now)
        if later is not None:
            begun = verdict.result is Result.IN_PROGRESS and command.command not in SOON
            self._pending[command.command] = Pending(command, port, link, later, begun)
            if begun:
                _acknowledge(port, link, command, Result.IN_PROGRESS)
            return
        self._conclude(port, link, command, verdict, now)

    def settle(self, t_us: int, now: float) -> None:
        """Acknowledge what has come to its end."""
        for number, pending in list(self._pending.items()):
            verdict = pending.outcome(t_us, now)
            if verdict is None:
                continue
            del self._pending[number]
            self._conclude(pending.port, pending.link, pending.command, verdict, now)

    def explain(self, verdict: Verdict, now: float) -> None:
        """What a verdict tells, to everyone; as much as there is room for."""
        if verdict.told is not None and self.texts.may_say(verdict.told, verdict.good, now):
            self._tell(verdict.told, Severity.INFO if verdict.good else Severity.WARNING)
        if verdict.unused is not None and self.texts.may_say(verdict.unused, verdict.good, now):
            self._tell(verdict.unused, Severity.INFO)

    def _is_pending(self, port: GroundPort, link: Link, command: Command, now: float) -> bool:
        pending = self._pending.get(command.command)
        if pending is None:
            return False
        if _asked(pending.command) == _asked(command):  # counted as a repetition or not
            if pending.in_progress:  # else its answer is to come, within PENDING_S
                _acknowledge(port, link, command, Result.IN_PROGRESS)
        else:
            _acknowledge(port, link, command, Result.TEMPORARILY_REJECTED)
            told = Told(Code.BUSY, (command_name(command.command),))
            self.explain(Verdict(Result.TEMPORARILY_REJECTED, told), now)
        return True

    def _is_repeated(self, port: GroundPort, link: Link, command: Command, now: float) -> bool:
        """True if its answer was lost: the same was asked before, with a lower confirmation.

        Some clients (MAVROS) send each command with confirmation 1. What only asks is not
        remembered: it is answered anew.
        """
        known = [
            known for known in link.acknowledged
            if known.command == command.command and now - known.at < REPEAT_S
        ]  # fmt: skip
        same = next(
            (
                each
                for each in known
                if each.asked == _asked(command) and each.confirmation < command.confirmation
            ),
            None,
        )
        if same is None:
            return False
        if same is known[0]:
            _acknowledge(port, link, command, same.result)
        else:  # to do it now would undo what was asked for later
            _acknowledge(port, link, command, Result.DENIED)
            told = Told(Code.LATE_REPETITION, (command_name(command.command),))
            self.explain(Verdict(Result.DENIED, told), now)
        return True

    def _later(
        self, command: Command, verdict: Verdict, now: float
    ) -> Callable[[int, float], Verdict | None] | None:
        """How to go on asking about a command that is not done yet; None if it is."""
        done = self._commands.in_progress
        if verdict.result is Result.IN_PROGRESS and done is not None:
            return lambda _t_us, _now: done()
        rejected = verdict.result is Result.TEMPORARILY_REJECTED
        if (
            rejected
            and command.command in WAIT_FOR_A_STREAM
            and self._vehicle.script.setpoint is not None
        ):
            # the first setpoint of a stream came just before: the second is on its way
            until = now + PENDING_S

            def entered(t_us: int, at: float) -> Verdict | None:
                verdict = self._commands.answer(Request(command, t_us, at))
                return verdict if verdict.good or at >= until else None

            return entered
        return None

    def _conclude(
        self, port: GroundPort, link: Link, command: Command, verdict: Verdict, now: float
    ) -> None:
        if command.command not in self._questions:
            done = Acknowledged(
                command.command, _asked(command), command.confirmation, verdict.result, now
            )
            link.acknowledged = [done, *link.acknowledged][:REMEMBERED]
        if verdict.good and command.command not in self._questions:
            self._tell_change()  # before: clients take the mode from a heartbeat once answered
        _acknowledge(port, link, command, verdict.result)
        self.explain(verdict, now)  # after: who waits for the answer then hears the reason


def _acknowledge(port: GroundPort, link: Link, command: Command, result: Result) -> None:
    port.send(link, replies.command_ack(command.command, result, command.source))


def _asked(command: Command) -> bytes:
    """What makes two commands the same: who asks, and the bits of what is asked (NaN is NaN)."""
    return struct.pack("<HH7d", *command.source, *command.params)
