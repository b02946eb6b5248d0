"""Failsafes with faults to order: is the action right, and how long after its cause does it come?

    python -m gcs_tools.studies.failsafes               20 seeds of each case (--seeds N)
    python -m gcs_tools.studies.failsafes --page        writes both tables of docs/failsafes.md
    python -m gcs_tools.studies.failsafes --conditions  writes the table of conditions, and flies nothing

Each flight is a whole vehicle with its simulator, in process and in lockstep, with noise on the state. The
seed draws when the fault begins, so that it meets looks and reports of the battery at any phase. A latency
is simulation time from the cause (the fault, the last message, the first state that is beyond a limit) to
the tick at which the vehicle tells the condition. What is promised is the least and the greatest of it. The
case fails if a flight is outside, or if the action is another one.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from fcu.interface.event_log import Event
from fcu.interface.files.spelling import suggestion
from fcu.interface.messages import Setpoint
from fcu.interface.status_texts import Code
from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import column_of
from fcu.parameters import VEHICLE
from fcu.vehicle.conditions import LOOK_US, ROWS, Always, By, Clears, Condition, Row
from gcs_tools.flight.ground_script import Vehicle
from gcs_tools.flight.item_script import SEND_AGAIN_S
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import from_tables
from sitl_plant.physics.types import PlantRecord

RATE_HZ, TICK_S, LOOK_S = 250, 0.004, LOOK_US * 1e-6
BEGINS_S, ENDS_S = 6.0, 30.0
SEEDS = 20
HIGH, STILL = Vec3(0.0, 0.0, 30.0), Vec3(0.0, 0.0, 0.0)
DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = DOCS / "failsafes.md"
BEGIN, END = "<!-- written by gcs_tools/studies/failsafes.py: {} -->", "<!-- end -->"

_Q = [column_of(PlantRecord, f"state.q_EB.{each}") for each in "wxyz"]
_R = [column_of(PlantRecord, f"state.r_E.{each}") for each in "xyz"]

# cause and detector of each condition that a table of actions has, in words
WORDS: dict[Condition, tuple[str, str]] = {
    Condition.BATTERY_LOW: ("charge below BAT_LOW_THR", "at every look for 1 s"),
    Condition.BATTERY_CRITICAL: ("charge below BAT_CRIT_THR", "at every look for 1 s"),
    Condition.BATTERY_EMERGENCY: ("charge below BAT_EMERGEN_THR", "at every look for 1 s"),
    Condition.OFFBOARD_LOST: (
        "a script's setpoints stop", "the last is older than COM_OF_LOSS_T, at the tick",
    ),
    Condition.STICKS_LOST: (
        "sticks stop", "the last are older than COM_RC_LOSS_T; in Mission, Hold and Offboard only where COM_RCL_EXCEPT leaves the mode out",
    ),
    Condition.STATION_LOST: (
        "a ground station's heartbeats stop", "the last is older than COM_DL_LOSS_T, at the next look",
    ),
    Condition.FENCE_BREACHED: (
        "outside the fence, or with GF_PREDICT bound for it", "at the next look",
    ),
    Condition.ATTITUDE_LOST: (
        "roll or pitch beyond FD_FAIL_R, FD_FAIL_P", "at every look for FD_FAIL_R_TTRI, FD_FAIL_P_TTRI; not in flight by body rates",
    ),
    Condition.BELIEFS_CONTRADICTED: (
        "the flight contradicts the guard's beliefs", "at the next look, 10 s after the ground was left",
    ),
    Condition.FLIGHT_TIME_LOW: (
        "the charge does not last for the way home, 1.1 times its time and 100 s", "at two looks a second apart; not on the way home or down",
    ),
    Condition.ROTOR_LOST: (
        "a rotor has less than half of the speed that is wanted and gains none, or an injected failure has stopped it", "at every look for FD_ACT_MOT_TOUT, where more than FD_ACT_MOT_THR of full speed is wanted; an order at the next tick, each further one a look later",
    ),
    Condition.POSITION_JUMPED: (
        "the position jumps by more than 1 m", "at the tick: the law flies by the velocity until it is back",
    ),
    Condition.STATE_STUCK: ("the state is the same to the bit", "at every look for 1 s"),
    Condition.STATE_LOST: (
        "the state says of itself that it has failed", "at every tick for 0.5 s: the law flies on the last one until then",
    ),
    Condition.PLANT_SILENT: ("no datagram of the simulator", "1 s of wall time"),
    Condition.PLANT_LOST: ("no datagram of the simulator", "5 s of wall time"),
    Condition.CRASHED: ("the simulator tells of a crash", "at once"),
    Condition.DIVERGED: ("the simulator tells that the vehicle left its arena", "at once"),
    Condition.LAW_NOT_FINITE: ("a number of the law is not finite", "after the tick"),
    Condition.LAW_FAILED: (
        "the law raises an error, or with MR_LAW_ACT 1 computes a number that is not finite", "at the tick, which the baseline flies",
    ),
    Condition.NOT_AS_BELIEVED: ("the flight contradicts a belief, named", "after the tick"),
}  # fmt: skip

CLEARS = {
    Clears.AT_ONCE: "at once",
    Clears.CHOSEN: "when a mode is chosen, or disarmed",
    Clears.DISARMED: "when disarmed",
    Clears.NEVER: "by a reset",
}
GONE = {
    Condition.ROTOR_LOST: "when an order that stopped it is taken back; found by its speed, by a reset",
    Condition.FENCE_BREACHED: "inside again",
    Condition.POSITION_JUMPED: "at the first position without the jump",
    Condition.STATE_STUCK: "at the first state that differs",
    Condition.STATE_LOST: "at the first valid state",
    Condition.PLANT_SILENT: "at the next datagram",
}


class Case(NamedTuple):
    """A cause, and what is promised of the vehicle."""

    name: str
    condition: Condition
    parameters: dict[str, float]
    faults: tuple[dict[str, Any], ...]  # `at_s` is added
    code: Code  # that is told first of the condition
    action: tuple[str, ...]  # the mode that is entered then; "stopped"; or empty: it only warns
    least_s: float
    most_s: float
    cause: Callable[[Any, float], float] = lambda plant, at_s: at_s  # its time, s
    streams: bool = True  # the script's setpoints go on
    station: bool = False  # heartbeats of a ground station come until the fault
    to: Vec3 = HIGH  # where the script leads it from BEGINS_S on
    by_mission: bool = False  # the mission sends its setpoints, as far as its faults let it


def _beyond(plant: Any, at_s: float) -> float:
    """Time of the first row with roll or pitch beyond 60 degrees, s."""
    w, x, y, z = (plant[:, each] for each in _Q)
    roll = np.abs(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
    pitch = np.abs(np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)))
    return float(plant[int((np.maximum(roll, pitch) > math.radians(60.0)).argmax()), 0])


def _outside(plant: Any, at_s: float) -> float:
    """Time of the first row more than 5 m from the start, s."""
    return float(plant[int((np.hypot(plant[:, _R[0]], plant[:, _R[1]]) > 5.0).argmax()), 0])


def _last_sent(plant: Any, at_s: float) -> float:
    """Time of the last setpoint that a mission sends before the fault, s."""
    return SEND_AGAIN_S * (math.ceil(round(at_s / SEND_AGAIN_S, 6)) - 1)


def _level(remaining: float) -> tuple[dict[str, Any], ...]:
    return ({"kind": "battery_level", "remaining": remaining},)


BATTERY_S = 1.0, 1.0 + 0.1 + 2.0 * LOOK_S
TERMINATES = {"CBRK_FLIGHTTERM": 0.0}
CASES = (
    Case(
        "offboard", Condition.OFFBOARD_LOST, {"COM_OBL_RC_ACT": 3.0}, (), Code.OFFBOARD_LOST_MODE,
        ("Return",), 1.0, 1.0 + TICK_S, streams=False,
    ),
    Case(
        "ground link of a mission", Condition.OFFBOARD_LOST, {"COM_OBL_RC_ACT": 5.0},
        ({"kind": "ground_lost"},), Code.OFFBOARD_LOST_MODE, ("Hold",), 1.0, 1.0 + TICK_S,
        cause=_last_sent, by_mission=True,
    ),
    Case(
        "ground station", Condition.STATION_LOST, {"NAV_DLL_ACT": 3.0, "COM_DL_LOSS_T": 5.0}, (),
        Code.STATION_LOST, ("Land",), 5.0, 5.0 + LOOK_S + TICK_S, station=True,
    ),
    Case(
        "battery low", Condition.BATTERY_LOW, {"COM_LOW_BAT_ACT": 3.0}, _level(0.14),
        Code.BATTERY_LOW, (), *BATTERY_S,
    ),
    Case(
        "battery critical", Condition.BATTERY_CRITICAL, {"COM_LOW_BAT_ACT": 3.0}, _level(0.06),
        Code.BATTERY_CRITICAL, ("Return",), *BATTERY_S,
    ),
    Case(
        "battery emergency", Condition.BATTERY_EMERGENCY, {"COM_LOW_BAT_ACT": 3.0}, _level(0.04),
        Code.BATTERY_EMERGENCY, ("Land",), *BATTERY_S,
    ),
    Case(
        "battery, held before", Condition.BATTERY_CRITICAL,
        {"COM_LOW_BAT_ACT": 3.0, "COM_FAIL_ACT_T": 5.0}, _level(0.06), Code.BATTERY_CRITICAL,
        ("Hold", "Return"), *BATTERY_S,
    ),
    Case(
        # two looks a second apart, of which the first is within a second
        "flight time", Condition.FLIGHT_TIME_LOW, {"COM_FLTT_LOW_ACT": 3.0}, _level(0.05),
        Code.FLIGHT_TIME_LOW, ("Return",), 1.0, 2.0 + 0.1 + 2.0 * LOOK_S,
    ),
    Case(
        "fence", Condition.FENCE_BREACHED, {"GF_ACTION": 3.0, "GF_MAX_HOR_DIST": 5.0}, (),
        Code.FENCE_BREACHED, ("Return",), 0.0, LOOK_S + TICK_S, cause=_outside,
        to=Vec3(9.0, 0.0, 30.0),
    ),
    Case(
        "motors", Condition.ATTITUDE_LOST, TERMINATES,
        tuple({"kind": "motor_off", "rotor": each} for each in (1, 2, 3)), Code.ATTITUDE_LOST,
        ("stopped",), 0.3, 0.3 + 2.0 * LOOK_S, cause=_beyond,
    ),
    Case(
        "motors, warned of", Condition.ATTITUDE_LOST, {},
        tuple({"kind": "motor_off", "rotor": each} for each in (1, 2, 3)), Code.ATTITUDE_LOST, (),
        0.3, 0.3 + 2.0 * LOOK_S, cause=_beyond,
    ),
    Case(
        # it slows down to half of what is wanted first, within a rotor's lag
        "rotor lost", Condition.ROTOR_LOST, {"CA_FAILURE_MODE": 1.0, "COM_ACT_FAIL_ACT": 2.0},
        ({"kind": "motor_off", "rotor": 1},), Code.ROTOR_LOST, ("Land",), 0.1,
        0.1 + 0.05 + 2.0 * LOOK_S,
    ),
    Case(
        "position jumps", Condition.POSITION_JUMPED, {},
        ({"kind": "state_jumps", "jump_m": [5.0, 0.0, 0.0]},), Code.POSITION_JUMPED, (), 0.0, 0.0,
    ),
    Case(
        "state stuck", Condition.STATE_STUCK, TERMINATES, ({"kind": "state_stuck"},),
        Code.STATE_STUCK, ("stopped",), 1.0 - LOOK_S, 1.0 + LOOK_S + TICK_S,
    ),
    Case(
        "state off", Condition.STATE_LOST, TERMINATES, ({"kind": "state_off"},), Code.STATE_LOST,
        ("stopped",), 0.5, 0.5,
    ),
    Case(
        "state off, for 0.3 s", Condition.STATE_LOST, TERMINATES,
        ({"kind": "state_off", "for_s": 0.3},), Code.STATE_FAILED, (), 0.0, 0.0,
    ),
)  # fmt: skip


class Outcome(NamedTuple):
    """One flight of a case."""

    latency_s: float  # NaN: the condition was not told
    action: tuple[str, ...]

    def keeps(self, case: Case) -> bool:
        """Return true if it is what was promised. Times are whole ticks."""
        half = 0.5 * TICK_S
        in_time = case.least_s - half <= self.latency_s <= case.most_s + half
        return in_time and self.action == case.action


class Watched(MemoryFlight):
    """A flight whose script streams setpoints, and beats like a ground station, until the fault."""

    def __init__(self, case: Case, seed: int) -> None:
        random = np.random.default_rng([31, seed])
        self.at_tick = round((BEGINS_S + float(random.uniform())) * RATE_HZ)
        self._case = case
        self.events: list[Event] = []
        at_s = self.at_tick / RATE_HZ
        tables = {
            "title": "A failsafe.",
            "flight": {
                "duration_s": ENDS_S, "rate_hz": RATE_HZ, "seed": seed, "ground_z_m": 0.0,
                "start": {"position_m": list(HIGH)},
                "setpoints": [{"at_s": 0.0, "position_m": list(HIGH)}],
            },
            "plant": {
                "noise": {"position_m": 0.002, "rate_rad_s": 0.01},
                "faults": [{"at_s": at_s, **each} for each in case.faults],
            },
        }  # fmt: skip
        super().__init__(scenario(from_tables("failsafe", tables)), None, (_drop, _drop))

    def _log(self, stack: ExitStack, who: str) -> Callable[[Event], None]:
        return self.events.append

    def _send_setpoints(self, vehicle: Any) -> bool:
        assert isinstance(vehicle, Vehicle)
        for name, value in self._case.parameters.items():
            if name != "NAV_DLL_ACT":
                vehicle.set_parameter(name, value)
        if self._case.station:
            vehicle.greet()
            vehicle.set_parameter("NAV_DLL_ACT", self._case.parameters["NAV_DLL_ACT"])
        if self._case.by_mission:
            return super()._send_setpoints(vehicle)
        asked = Setpoint(HIGH, STILL, STILL, 0.0, 0.0)
        for tick in range(0, self._scene.ticks, RATE_HZ // 10):
            self._fly_to(min(tick, self.at_tick))
            if tick >= self.at_tick:
                break
            self._say(vehicle, asked, True)
        self._fly_to(self.at_tick)
        self._say(vehicle, asked._replace(r_c=self._case.to), True)
        for tick in range(self.at_tick + 25, self._scene.ticks + 1, 25):
            if not self._fly_to(tick):
                break
            self._say(vehicle, asked._replace(r_c=self._case.to), False)
        return False

    def _say(self, vehicle: Vehicle, asked: Setpoint, before: bool) -> None:
        """Send what goes on: before the fault everything, after it what the case leaves."""
        if before and self._case.station:
            vehicle.greet()
        if before or self._case.streams:
            vehicle.offer(asked)
        vehicle.messages(0.0)


def fly(case: Case, seed: int) -> Outcome:
    """Fly one case."""
    flight = Watched(case, seed)
    plant = flight.fly().plant
    told = [event for event in flight.events if event.who == "fcu" and event.t >= 0.0]
    first = next((event for event in told if event.code == case.code.name), None)
    if first is None:
        return Outcome(math.nan, ())
    cause_s = case.cause(plant, flight.at_tick / RATE_HZ)
    action = tuple(
        entered for event in told if event.t >= first.t and (entered := _entered(event, case))
    )
    if "stopped" in action:
        action = ("stopped",)
    return Outcome(first.t - cause_s, action[:2])


def _entered(event: Event, case: Case) -> str:
    """The mode that an event tells as entered by the condition of a case, or that rotors stopped."""
    if event.code in (Code.FAILSAFE_STOPPED.name, Code.OFFBOARD_LOST_STOPPED.name):
        return "stopped"
    if event.code == Code.FAILSAFE_LATER.name:
        return "Hold"
    if event.code == Code.FAILSAFE_MODE.name:
        return str(event.values[0])
    if event.code == Code.OFFBOARD_LOST_MODE.name and case.condition is Condition.OFFBOARD_LOST:
        return str(event.values[1])
    return ""


def _drop(_rows: object) -> None:
    """Keep no row."""


# --- tables


def default(name: str) -> float:
    """The default of a parameter of the vehicle."""
    row = next(each for each in VEHICLE if each.parts and each.parts[0].name == name)
    assert isinstance(row.default, float)
    return row.default


def actions(row: Row) -> str:
    """The actions of a row, the default first."""
    if isinstance(row.action, Always):
        return row.action.action.name.lower()
    assert isinstance(row.action, By)
    number = int(default(row.action.parameter))
    by = ", ".join(f"{n} {act.name.lower()}" for n, act in sorted(row.action.actions.items()))
    return f"{row.action.actions[number].name.lower()}; {row.action.parameter}: {by}"


def table() -> list[str]:
    """Lines of the table of conditions, from their rows."""
    found = [
        "| condition | cause | found | default, and what it can be | severity | clears |",
        "|---|---|---|---|---|---|",
    ]
    for condition, row in ROWS.items():
        cause, detector = WORDS[condition]
        name = condition.name.lower().replace("_", " ")
        clears = GONE[condition] if row.clears is Clears.GONE else CLEARS[row.clears]
        found.append(
            f"| {name} | {cause} | {detector} | {actions(row)} | {row.severity} | {clears} |"
        )
    return found


HEAD = (
    "| case | parameters | promised, s | measured, s | action | right |",
    "|---|---|---|---|---|---|",
)


def measured_one(case: Case, outcomes: Sequence[Outcome]) -> list[str]:
    """Lines of the table of what was flown, of one case."""
    right = sum(outcome.keeps(case) for outcome in outcomes)
    times = [outcome.latency_s for outcome in outcomes]
    given = ", ".join(f"{name} {value:g}" for name, value in case.parameters.items())
    action = ", then ".join(case.action) or "warns"
    return [
        f"| {case.name} | {given} | {case.least_s:.3f} to {case.most_s:.3f} |"
        f" {min(times):.3f} to {max(times):.3f} | {action} | {right} of {len(outcomes)} |"
    ]


def written(text: str, name: str, lines: Sequence[str]) -> str:
    """The page with a table in its place."""
    begin = BEGIN.format(name)
    before, _, rest = text.partition(begin)
    _, _, after = rest.partition(END)
    return "\n".join([f"{before}{begin}", "", *lines, "", f"{END}{after}"])


@click.command()
@click.option("--seeds", default=SEEDS, show_default=True, help="flights of each case")
@click.option("--case", "only", help="one case, by its name")
@click.option("--page", is_flag=True, help="write both tables into docs/failsafes.md")
@click.option("--conditions", is_flag=True, help="write that of conditions, and fly nothing")
def main(seeds: int, only: str | None, page: bool, conditions: bool) -> None:
    """Fly every case, and print the table. Exit code 1: a flight did not keep a promise."""
    if only not in (None, *(case.name for case in CASES)):
        names = [case.name for case in CASES]
        raise click.BadParameter(
            f"{only}: no such case{suggestion(only, names)}; there are {'; '.join(names)}",
            param_hint="--case",
        )
    if page or conditions:
        PAGE.write_text(written(PAGE.read_text(), "conditions", table()))
    if conditions:
        return
    cases = [case for case in CASES if only in (None, case.name)]
    outcomes = {}
    print(*HEAD, sep="\n", flush=True)
    for i, case in enumerate(cases):
        outcomes[i] = [fly(case, seed) for seed in range(1, seeds + 1)]
        wrong = [each for each in outcomes[i] if not each.keeps(case)]
        print(*measured_one(case, outcomes[i]), *wrong[:3], sep="\n", flush=True)
    lines = [
        *HEAD,
        *(line for i, case in enumerate(cases) for line in measured_one(case, outcomes[i])),
    ]
    if page:
        PAGE.write_text(written(PAGE.read_text(), "measured", lines))
    kept = all(each.keeps(case) for i, case in enumerate(cases) for each in outcomes[i])
    sys.exit(int(not kept))


if __name__ == "__main__":
    main()
