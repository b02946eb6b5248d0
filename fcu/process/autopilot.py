"""The flight controller between its sockets: a state comes in, its answer goes out.

Ticks at which nothing happens but flying are compiled (`burst`); at the others Python decides
first: what the vehicle does by itself, what was asked of it, a setting that has changed. Knows
ground stations and recorder, no plant link: a flight in one process hands it datagrams.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np

from fcu.guard.parameters import GOVERN, REFUSE
from fcu.guard.present import Beginning
from fcu.guard.types import GuardInternals, GuardState
from fcu.interface import event_log
from fcu.interface.event_log import Event, Said
from fcu.interface.link import exclusive_socket
from fcu.interface.messages import Setpoint, VehicleState
from fcu.interface.ports import Ports
from fcu.interface.status_texts import Code, Told
from fcu.kernel.buffers import fields, size, to_buffer
from fcu.kernel.pointers import Pointer
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.face import FLYING, IDLE, TAKE_OVER, Reference, SharedTick
from fcu.laws.loader import Law
from fcu.mavlink.definitions import Severity
from fcu.mavlink.plant_link import LONGEST, Ending, OtherRotors, PlantCodec, WireError
from fcu.parameters import Parameters
from fcu.process import baseline, finite
from fcu.process.baseline import Baseline
from fcu.process.belief_watch import BeliefWatch
from fcu.process.burst import (
    LAW_RAISED,
    LOAD_SMOOTHED,
    NOT_FINITE,
    NOT_QUIET_FILTERED,
    Course,
    flight,
    tick,
    what_was_raised,
)
from fcu.process.reporting import Reporter
from fcu.process.tick import State
from fcu.services.ground_port import GroundPort
from fcu.services.station import Bind, Listen, Station
from fcu.services.view import Identity
from fcu.vehicle.conditions import ROWS, Condition
from fcu.vehicle.modes import Mode
from fcu.vehicle.position_filter import PositionFilter
from fcu.vehicle.state_machine import StateMachine

MOMENT_S = 0.5  # wall: a script that flies a mission holds time for milliseconds
DROPPED = 1000  # states that a network may lose in a row; beyond, the plant's time has jumped
LATEST_US = (
    10_000_000 * 1_000_000
)  # first time of a plant: exact, and far from 2**53, as all that follow
OVERTAKEN = 10  # ticks by which a state may come late, and is ignored
JUMPS = 10  # states in a row of a wrong time, after which there is no going on

_CONTRADICTED_AT = column_of(Course, "contradicted_at")
_TIME, _H, _ARMED, _AIRBORNE, _ENGAGED, _SINCE, _LOAD, _ANSWER_BYTES, _FAILURE, _CHECKED = (
    column_of(Course, name)
    for name in (
        "time_us", "h", "armed", "airborne", "engaged", "since_us", "load", "answer_bytes", "failure",
        "checked",
    )
)  # fmt: skip
_ENGAGED_AT = column_of(SharedTick, "engaged")
LAW_ACT = "MR_LAW_ACT"
_MOVES = [column_of(Setpoint, f"{of}.{axis}") for of in ("v_c", "a_c") for axis in "xyz"]
_MOVES += [column_of(Setpoint, "psi_dot_c")]
_R_AND_V = slice(slice_of(VehicleState, "r_E").start, slice_of(VehicleState, "v_E").stop)
_COMMAND, _THRUSTS = slice_of(SharedTick, "command"), slice_of(SharedTick, "outputs.thrusts")
NAMED = 3  # numbers that are not finite are told by name, so many of them
TIMES, LOAD = 3, 2  # columns of the times of a tick: answered, cycle, load

# conditions that the filter of states finds, by what it tells
FILTERED = {ROWS[each].code: each for each in (Condition.STATE_STUCK, Condition.STATE_LOST)}

Row = np.ndarray[Any, np.dtype[np.float64]]
FlyDecided = Callable[[int, Row], bool]


class Lost(Exception):
    """There is no going on: why."""


class LawRaised(Lost):
    """The law has raised an error: which one, and where."""


@dataclass
class Figures:
    """What the loop counted, for whoever asks at the end."""

    ticks: int = 0
    resent: int = 0
    refused: int = 0  # datagrams of the plant link that were not states, or of a wrong time
    strangers: int = 0  # datagrams on the plant link that were not the plant's
    cycle_max_us: float = 0.0
    dropped: int = 0  # rows that the recorder had no room for
    unpublished: int = 0  # rows that the publisher had no room for
    ground_dropped: dict[str, int] | None = None  # messages of the ground links, by reason
    script_messages: int = 0  # readable ones that came on the script link
    parameters_set: dict[str, float] | None = None  # of law and guard, by MAVLink


def tells_beginning(law: Law) -> bool:
    """Tell if a Beginning follows from what a law and its guard remember."""
    return law.tells("state", State) and law.tells("guard_state", GuardState)


# Which time decides how old a script's stream is: simulation and wall, or simulation alone. Held: as
# simulation alone, and telemetry is due by it, too
LinkClock = Literal["both", "sim", "held"]


class Autopilot:
    """One flight controller, between its plant link and its ground stations."""

    def __init__(
        self, ports: Ports, identity: Identity, params: Parameters, reporter: Reporter,
        clock: LinkClock = "both", file: Path | None = None, bind: Bind = exclusive_socket,
        write: Callable[[Event], None] = event_log.write, resets: bool = False,
        fly_decided: FlyDecided | None = None, before: Autopilot | None = None,
        listen: Listen | None = None,
    ) -> None:  # fmt: skip
        """`clock`: which decides about ground stations. `file`: where parameters are saved.

        `bind`: opens the ports of ground stations, `listen` that of TCP. `write`: takes an event. `resets`: a request
        for a reset is obeyed. `fly_decided`: flies a tick (time in us, row) for which Python has
        decided, and returns False if the law raised an error. A process that flies bursts hands in
        a call of their kernel, which holds the law already. `before`: the autopilot before a reset.
        Its ports and figures are kept, and nothing else of it. Raises PortBusy.
        """
        self._params = params
        self._write = write
        self._fly_decided = fly_decided or self._fly_alone
        self._law = params.flown
        self.reporter = reporter
        self.codec = PlantCodec(ports.system_id, rotors=params.law.rotors.n)
        self.vehicle = StateMachine(params, sim_only=clock != "both")
        self._link_clock = clock
        self.ground: Station = Station(
            ports, identity, params, self.vehicle, file, self.say, bind, resets,
            None if before is None else before.ground, listen,
        )  # fmt: skip
        self.figures: Figures = Figures() if before is None else before.figures
        self._settings = params.settings
        self._is_looked_at = True  # what is flown, by a guard that refuses
        kind: Any = type(self._settings)
        self._policy_at = column_of(kind, "guard.policy") if params.flown.guard is not None else -1
        self._flown: Setpoint | None = None
        self._filter = PositionFilter()
        self._compiled: Pointer | None = None  # the law, once it is
        self.law_at = 0  # its address
        self._jumps = 0
        self._stood_at_us, self._stands_since_s = (
            -2,
            0.0,
        )  # where time stands, and since when (wall)
        self._stood_s = self._stands_s = 0.0  # for how long it stood, before and now
        self.heard_s = 0.0  # wall: when the plant was heard last; 0: never
        remembers, h = self._law.ticks.Remembered, params.law.h
        has_model = fields(fields(remembers)["law"]).get("reference") is Reference
        self.flight = flight(
            self.codec, to_buffer(self._settings), h, size(remembers), self._filter.buffer,
            self.vehicle.watch, slice_of(remembers, "law.reference") if has_model else None,
            size(self._law.ticks.Tick),
        )  # fmt: skip
        self._measured = self.flight.measured
        if has_model:
            self.vehicle.reference_model = self.flight.model
        if "a_m" in fields(fields(remembers)["guard"]):
            at = slice_of(remembers, "guard.a_m")
            self.vehicle.reference_acceleration = self.flight.remembered[at]
        if tells_beginning(self._law):
            self.vehicle.beginning = self._beginning
        if self._law.tells("guard", GuardInternals):
            at = slice_of(self._law.ticks.Tick, "guard.contradicted").start
            self.flight.course[_CONTRADICTED_AT] = at
        self._baseline: Baseline | None = None  # that takes over from a law that fails
        if params[LAW_ACT] > 0.0:
            self._baseline = Baseline(params.airframe, h)
            self.flight.course[_CHECKED] = 1.0
        self._is_replaced = False
        self.period_us = round(h * 1e6)
        self._course = self.flight.course
        self._datagram = np.zeros(LONGEST, dtype=np.uint8)
        self._times = np.zeros((1, TIMES))
        self._was_finite = True  # the law, since it took over
        self._mode: Mode | None = None  # that was told last
        self._beliefs = BeliefWatch(self._law)
        self._unreported: Row | None = None  # the row of a tick whose answer is to be sent first

    def _fly_alone(self, time_us: int, row: Row) -> bool:
        """Fly a tick for which Python has decided, in no burst. Returns False if the law raised an error."""
        said: int = tick(self.flight, self.law_at, self._datagram, 0, row, time_us)
        return said != LAW_RAISED

    def _beginning(self) -> Row:
        """Where a look ahead begins: a Beginning, after the last tick."""
        row, flown = np.zeros(size(Beginning)), self.flight
        self._law.ticks.beginning(flown.settings, flown.remembered, flown.measured, row)
        return row

    def raise_for_law(self, row: Row) -> NoReturn:
        """Raise LawRaised: the law has raised an error at the last tick, whose row this is."""
        assert self._compiled is not None
        raise LawRaised(what_was_raised(self._compiled, self.flight, row))

    def warm_up(self) -> None:
        """Compile what a tick needs, by flying one that goes nowhere."""
        flown, measured = self.flight, self._measured
        row = np.zeros(self.reporter.width)
        measured[column_of(VehicleState, "q_EB.w")] = 1.0
        before = [array.copy() for array in (self._course, flown.remembered, measured)]
        with self._law.compiling():
            if self.vehicle.beginning is not None:
                self.vehicle.beginning()
            self._compiled = self._law.ticks.compiled()
            self.law_at = self._compiled.address
            if self._baseline is not None:
                self._baseline.compile(flown)
            for engaged in (IDLE, TAKE_OVER, FLYING):
                self._course[_ENGAGED] = engaged
                self._fly_decided(0, row)
        for array, was in zip((self._course, flown.remembered, measured), before, strict=True):
            array[:] = was
        flown.thrusts[:] = np.nan
        self.codec.desk.sequence[0] = 0
        self.reporter.warm_up(row)
        self._filter.warm_up()
        self.vehicle.warm_up()
        self.vehicle.state = measured
        self.ground.warm_up(row)
        self.vehicle.state = None
        if self._link_clock == "both":  # the wall's clock goes on while a loss is worked out
            self._params.foresee()
            if self._baseline is not None:
                self._baseline.foresee(self._params)

    # --- time

    @property
    def time_us(self) -> int:
        """Simulation time of the last tick; negative before the first."""
        return int(self._course[_TIME])

    @property
    def time_s(self) -> float:
        """The same in seconds, and 0 before the first."""
        return max(self.time_us, 0) * 1e-6

    @property
    def next_us(self) -> int:
        """When what arrives now takes effect: at the next tick. While time stands, the one to come."""
        return 0 if self.time_us < 0 else self.time_us + self.period_us

    def clock(self, wall_s: float) -> float:
        """The time (s) that decides about ground stations: the wall's, or, if simulation time alone
        decides, that; and what time has stood beyond the moment for which a script holds it. Time that
        is held may stand for as long as it likes.
        """
        if self._link_clock == "both":
            return wall_s
        if self._link_clock == "held":
            return self.next_us * 1e-6
        if self.time_us != self._stood_at_us:
            self._stood_at_us, self._stands_since_s = self.time_us, wall_s
            self._stood_s += self._stands_s
        self._stands_s = max(0.0, wall_s - self._stands_since_s - MOMENT_S)
        return self.next_us * 1e-6 + self._stood_s + self._stands_s

    # --- ticks

    def prepare(self) -> None:
        """Lay down for the next tick, or burst of them, what Python has decided since the last."""
        vehicle, course = self.vehicle, self._course
        if self._params.settings is not self._settings:  # one is set, or a rotor is lost
            self._settings = self._params.settings
            if self._baseline is not None:
                self._baseline.share(self._params)
            if not self._is_replaced:
                self.flight.settings[:] = to_buffer(self._settings)
                course[_H] = self._settings.law.h
                self._is_looked_at = not vehicle.feasibility.refuses
        setpoint = vehicle.setpoint
        if vehicle.leads_itself and vehicle.feasibility.refuses:
            self._is_looked_at = False
            self.flight.settings[self._policy_at] = GOVERN
        elif not self._is_looked_at:
            self._look_again()
        if setpoint is None:
            course[_ENGAGED] = IDLE
            if self._flown is not None:  # what is recorded of nobody's setpoint stands still
                self.flight.setpoint[_MOVES] = 0.0
        elif course[_ENGAGED] == IDLE:
            course[_ENGAGED], self._was_finite = TAKE_OVER, True
        if setpoint is not self._flown and setpoint is not None:
            self.flight.setpoint[:] = to_buffer(setpoint)
        self._flown = setpoint
        course[_SINCE] = vehicle.since_us
        course[_ARMED] = vehicle.armed
        course[_AIRBORNE] = vehicle.armed and not vehicle.on_ground

    def _look_again(self) -> None:
        """What was accepted before a parameter was set, or what the vehicle has led itself to: governed
        until the guard accepts what is flown.

        A vehicle that refuses follows what it has accepted, and nothing else keeps that inside.
        """
        self._is_looked_at = self.vehicle.flies_what_fits(max(self.time_us, 0))
        self.flight.settings[self._policy_at] = REFUSE if self._is_looked_at else GOVERN

    def completed(self, rows: Row, times: Row) -> None:
        """Some ticks were flown: their rows, and their times as `burst.serve` writes them.

        Raises BrokenPipeError when the recorder is gone.
        """
        self.heard_s, self._jumps = float(times[-1, 0]), 0
        self.figures.ticks += len(rows)
        self.vehicle.state = self._measured
        self.vehicle.battery = self.codec.battery
        self.ground.see(rows[-1], self._flown is not None, times[-1, LOAD], self._filter.off)
        not_finite = self.reporter.report(
            rows, times, self.vehicle, self._filter.off, self.figures.resent, self.figures.refused
        )
        if self.vehicle.mode is not self._mode:
            self._mode = self.vehicle.mode
            self.say("info", Told(Code.IN_MODE, (self._mode.value,)), round(rows[0, 0] * 1e6))
        if not_finite is not None and self._was_finite:
            self._was_finite = False
            self._tell_not_finite(not_finite)
        if self._is_replaced:
            return
        for at_us, told in self._beliefs.see(rows, self._settings, bool(self._course[_AIRBORNE])):
            self._tell_of_tick(Severity.WARNING, "warning", told, at_us)

    def _tell_not_finite(self, row: Row) -> None:
        """Say of the first tick of its kind, whose row this is, that its law is not finite."""
        told = Told(Code.LAW_NOT_FINITE, (_not_finite(row, self.reporter.not_finite(row)),))
        self._tell_of_tick(Severity.CRITICAL, "error", told, round(row[0] * 1e6))

    def _tell_of_tick(self, severity: Severity, level: str, told: Told, at_us: int) -> None:
        """A STATUSTEXT, and a line of log, of a tick that was flown already."""
        self.ground.streams.text(severity, told)
        self.say(level, told, at_us)

    def take(self, datagram: bytes, wall_s: float) -> bytes | None:
        """A datagram of the plant: what is sent back; then it is to `report`. Raises Lost, BrokenPipeError."""
        started, length = time.monotonic(), min(len(datagram), LONGEST)
        self._datagram[:length] = np.frombuffer(datagram, dtype=np.uint8, count=length)
        self.prepare()
        row = self.reporter.tape.row()
        answered = tick(self.flight, self.law_at, self._datagram, length, row, -1)
        if answered > 0:
            return self._answered(row, started)
        if answered == LAW_RAISED:
            return self.law_failed(started)
        return self.decide(datagram, answered == NOT_QUIET_FILTERED, wall_s)

    def decide(self, datagram: bytes, filtered: bool, wall_s: float) -> bytes | None:
        """A datagram that has ended a burst; `filtered`: its state was let through already.

        Returns what is sent back; then it is to `report`. Raises Lost, BrokenPipeError.
        """
        started, course, received = time.monotonic(), self._course, self.flight.received
        try:
            time_us = self.codec.parse_state(datagram, received)
        except WireError as error:
            self.figures.refused += 1
            if isinstance(error, OtherRotors) and not self.heard_s:
                raise Lost(f"{error}: start both with the same --airframe") from error
            if self.figures.refused == 1:
                self.say("warning", f"plant link: {error}")
            return None
        if not self.heard_s:
            self.say("info", "the plant is there")
        self.heard_s = wall_s
        last_us = self.time_us
        if self.codec.is_hold(datagram):
            if last_us < 0:
                self._filter.take(received)
                if self.vehicle.reference_model is not None:  # it is where the vehicle is
                    self.vehicle.reference_model[:] = self._measured[_R_AND_V]
                self.vehicle.battery = self.codec.battery
                self._tell(self.vehicle.observe(self._measured, 0, self.clock(wall_s)))
            if self.codec.ending and self.vehicle.ended is None:
                self._end(self.codec.ending, received)
            self.reporter.tape.flush()  # time stands: what was flown so far is due
            return None
        if time_us == last_us:  # our answer was lost
            self.figures.resent += 1
            return self.answer
        if time_us < last_us:  # one that was overtaken on its way comes no more than once
            self.figures.refused += 1
            self._jumps += 1
            if last_us - time_us > OVERTAKEN * self.period_us or self._jumps == JUMPS:
                raise Lost(f"time ran back from {last_us * 1e-6:.6f} s")
            return None
        if last_us < 0 and time_us > LATEST_US:
            raise Lost(
                f"time begins at {time_us * 1e-6:.0f} s; expected 0 to {LATEST_US / 1e6:g} s"
            )
        if last_us >= 0 and time_us - last_us != self.period_us:
            self.figures.refused += 1
            self._jumps += 1
            if self._jumps == JUMPS:
                raise Lost(self._why_out_of_step(last_us, time_us))
            return None
        self._jumps = 0
        course[_TIME] = time_us
        if not filtered:
            self._tell(self._filtered(received, time_us))
        self.vehicle.battery = self.codec.battery
        self._tell(self.vehicle.observe(self._measured, time_us, self.clock(wall_s)))
        self.prepare()
        row = self.reporter.tape.row()
        if not self._fly_decided(time_us, row):
            return self.law_failed(started)
        return self._answered(row, started)

    def law_failed(self, started: float) -> bytes:
        """Have the baseline fly the tick at which the law has failed, and every tick after it.

        started : wall, monotonic, s.  Returns what is sent back, after which it is to `report`. Raises
        LawRaised where no baseline waits.
        """
        row, course = self.reporter.tape.row(), self._course
        if self._baseline is None or self._baseline.compiled is None or self._is_replaced:
            self.raise_for_law(row)
        assert self._compiled is not None
        if course[_FAILURE] == NOT_FINITE:
            names = finite.not_finite(self._law.ticks.Tick, row, self.flight.computed)
            why = _not_finite(row, names) if names else "thrust of a rotor below 0"
        else:
            why = what_was_raised(self._compiled, self.flight, row).removeprefix("the law ")
        age = (self.time_us - course[_SINCE]) * 1e-6
        self.flight, goes_on = self._baseline.take(self.flight, age)
        self._compiled = self._baseline.compiled
        self.law_at = self._compiled.address
        course[_ENGAGED] = FLYING if goes_on else TAKE_OVER
        course[_CHECKED], course[_CONTRADICTED_AT] = 0.0, -1.0
        self._is_replaced = self._is_looked_at = True
        self.vehicle.law_has_failed()
        self._tell(self.vehicle.find(Condition.LAW_FAILED, (why, baseline.NAME), self.time_us))
        if not self._fly_decided(self.time_us, row):
            self.raise_for_law(row)
        row[_ENGAGED_AT] = TAKE_OVER  # what reads rows learns anew which columns are numbers
        return self._answered(row, started)

    def _filtered(self, received: Row, time_us: int) -> list[Told]:
        """Pass a state on to the law, unless it has failed or cannot be. Returns what is told of it."""
        h, passes = self._settings.law.h, self._filter
        self.flight.failed[0] = self.vehicle.state_failed = self.codec.has_failed
        if self.codec.has_failed and self.vehicle.state is not None:
            found = passes.fail(h, time_us, self.vehicle.armed)
        elif passes.has_failed:
            found = passes.mend(received)
            self.vehicle.is_gone(Condition.STATE_LOST)
        elif self._course[_AIRBORNE]:
            found = passes.pass_on(received, h, time_us)
        else:
            passes.take(received)
            return []
        told: list[Told] = []
        for each in found:
            condition = FILTERED.get(each.code)
            told += (
                [each] if condition is None else self.vehicle.find(condition, each.values, time_us)
            )
        return told

    def _end(self, ending: Ending, received: Row) -> None:
        """The plant's flight has ended: the vehicle lies where it says."""
        told = Told(Code.CRASHED if ending is Ending.CRASHED else Code.DIVERGED)
        self._filter.take(received)
        self.vehicle.end(told, self._measured, self.next_us)
        self.prepare()
        self._tell([told])

    def _why_out_of_step(self, last_us: int, time_us: int) -> str:
        """What has become of time, if JUMPS states in a row have not followed the last tick's."""
        last, now, period = last_us * 1e-6, time_us * 1e-6, self.period_us
        first_us = time_us - (JUMPS - 1) * period  # if these follow each other
        lost = (first_us - last_us) // period - 1
        if (time_us - last_us) % period == 0 and 0 < lost <= DROPPED:
            states = "a state was" if lost == 1 else f"{lost} states were"
            return (
                f"{states} lost after {last:.6f} s, and the plant went on to {now:.6f} s: "
                "expected it to send a state again until it is answered"
            )
        return f"time jumped from {last:.6f} s to {now:.6f} s; a tick is {period * 1e-6:.6f} s"

    def _answered(self, row: Row, started: float) -> bytes:
        now = time.monotonic()
        load = self._course[_LOAD] + LOAD_SMOOTHED * (
            (now - started) / self._course[_H] - self._course[_LOAD]
        )
        self._course[_LOAD] = load
        self._times[0] = now, now - started, load
        self._unreported = row[None]
        return self.answer

    @property
    def answer(self) -> bytes:
        """The last one."""
        sent: bytes = self.flight.answer[: int(self._course[_ANSWER_BYTES])].tobytes()
        return sent

    def report(self) -> None:
        """The tick whose answer `take` or `decide` has returned, now that it is on its way.

        Raises BrokenPipeError when the recorder is gone.
        """
        if self._unreported is not None:
            rows, self._unreported = self._unreported, None
            self.completed(rows, self._times)

    # --- the ground

    def serve(self, port: GroundPort, wall_s: float) -> None:
        """What waits on a port of ground stations."""
        self.ground.serve(port, self.next_us, self.clock(wall_s))

    def idle(self, wall_s: float) -> None:
        """Between ticks: what is due by the wall clock, or by the time that is held."""
        decides = self.clock(wall_s)
        held = self._link_clock == "held" and self.time_us >= 0
        now = decides if held else wall_s
        self.ground.idle(self.next_us, now, decides)
        self.reporter.idle(self.time_s, self._settings, wall_s)

    @property
    def due_s(self) -> float:
        """When `idle` or `serve` has something to do: wall, monotonic, s; 0: now."""
        return 0.0 if self.ground.is_waiting else self.ground.streams.due_s

    def _tell(self, happened: Sequence[Told]) -> None:
        for told in happened:
            self.ground.tell(told)
        self.ground.record_plan(self.time_us)

    def say(self, level: str, said: Said, time_us: int | None = None) -> None:
        """An event, for the log and for whoever listens to the publisher.

        `time_us`: of what is said. None: of the last tick.
        """
        time_us = self.time_us if time_us is None else time_us
        self.reporter.feed.event(say(time_us, level, said, self._write))

    def close(self) -> None:
        """Hand over what was flown. Raises BrokenPipeError when the recorder is gone."""
        self.figures.cycle_max_us = self.reporter.cycle_max_s * 1e6
        self.figures.dropped = self.reporter.tape.dropped
        self.figures.unpublished = self.reporter.feed.dropped
        self.figures.ground_dropped = self.ground.dropped()
        self.ground.close()
        self.reporter.feed.close()


def _not_finite(row: Row, names: Sequence[str]) -> str:
    """What becomes of a law that is not finite: of the rotors, or else which numbers it is."""
    command, thrusts = row[_COMMAND], row[_THRUSTS]
    stopped = np.isnan(command) | (~np.isfinite(thrusts) & (command == 0.0))
    if stopped.any():
        return "rotors stopped" if stopped.all() else "some rotors stopped"
    shown = [name.removeprefix("outputs.") for name in names[:NAMED]]
    more = len(names) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def say(
    time_us: int, level: str, said: Said, write: Callable[[Event], None] = event_log.write
) -> Event:
    """An event of the flight controller. `time_us`: negative before time begins."""
    time_s = time_us / 1e6 if time_us >= 0 else event_log.BEFORE_S
    made = event_log.event(time_s, level, "fcu", said)
    write(made)
    return made
