"""Failsafes and modes of a flight, by the events that the vehicle told, and what a mission expects of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from fcu.interface.event_log import Event
from fcu.interface.status_texts import Code
from fcu.vehicle.conditions import ROWS, Action, Always, Condition
from gcs_tools.judging.expectations import FAILSAFE, FENCE_BREACHED, MODE, Expectation
from gcs_tools.recording.table import HALF_US

# These follow from how the flight went, or leave the vehicle to its setpoints.
_NO_KEEPERS = {
    Condition.ATTITUDE_LOST, Condition.CRASHED, Condition.DIVERGED, Condition.LAW_FAILED,
}  # fmt: skip
NO_FAILSAFE = "none"
STOPPED = "rotors stopped"
_VEHICLE = "fcu"  # the process that tells it


def _name(condition: Condition) -> str:
    return condition.name.lower()


_CONDITIONS = {row.code.name: _name(condition) for condition, row in ROWS.items()}
_CONDITIONS[Code.OFFBOARD_LOST_STOPPED.name] = _name(Condition.OFFBOARD_LOST)
_CONDITIONS[Code.STICKS_LOST_STOPPED.name] = _name(Condition.STICKS_LOST)
# Their own text names the mode that is flown, or that rotors stand.
_TOLD_WHOLE = {
    Code.OFFBOARD_LOST_MODE.name: 1, Code.STICKS_LOST_MODE.name: 1,
    Code.OFFBOARD_LOST_STOPPED.name: None, Code.STICKS_LOST_STOPPED.name: None,
    Code.LAW_FAILED.name: 1, Code.CRASHED.name: None, Code.DIVERGED.name: None,
}  # fmt: skip
_ACTS = {Code.FAILSAFE_MODE.name: 0, Code.FAILSAFE_LATER.name: 1, Code.FAILSAFE_STOPPED.name: None}


def _may_act(condition: Condition) -> bool:
    action = ROWS[condition].action
    found = [action.action] if isinstance(action, Always) else action.actions.values()
    return max(found) > Action.WARN


FAILSAFES = (NO_FAILSAFE, *(_name(each) for each in ROWS if _may_act(each)))


@dataclass(frozen=True)
class Failsafe:
    """A failsafe that acted."""

    name: str  # one of FAILSAFES: the condition of docs/failsafes.md
    time_s: float  # simulation time at which it was told
    action: str  # the mode that it entered, the law that flies on, or STOPPED

    def __str__(self) -> str:
        """One line."""
        return f"{self.name} at {self.time_s:.3f} s ({self.action})"


class VehicleTold(NamedTuple):
    """Modes and failsafes, as a vehicle told them."""

    mode: str  # at the end; empty: it told none
    failsafes: tuple[Failsafe, ...]
    breached_s: float | None  # when the fence was breached first

    @property
    def keeper(self) -> Failsafe | None:
        """The first failsafe that kept the vehicle from its setpoints. None: none did."""
        passed_over = set(map(_name, _NO_KEEPERS))
        return next((each for each in self.failsafes if each.name not in passed_over), None)


def vehicle_told(said: Iterable[Event], until_s: float) -> VehicleTold:
    """Read the events of a flight that was over at a simulation time (s)."""
    mode, waits, breached_s, found = "", "", None, list[Failsafe]()
    for event in sorted(said, key=lambda each: each.t):
        if event.who != _VEHICLE or event.t > until_s:
            continue
        if event.code == Code.IN_MODE.name:
            mode = str(event.values[0])
        if event.code in _CONDITIONS:
            waits = _CONDITIONS[event.code]
        if event.code == Code.FENCE_BREACHED.name and breached_s is None:
            breached_s = event.t
        acts = _TOLD_WHOLE if event.code in _TOLD_WHOLE else _ACTS
        if event.code in acts and waits:
            at = acts[event.code]
            action = STOPPED if at is None else str(event.values[at])
            found.append(Failsafe(waits, event.t, action))
            waits = ""  # another mode that is told for it is no other failsafe
    return VehicleTold(mode, tuple(found), breached_s)


def judge_vehicle(expect: Mapping[str, Any], told: VehicleTold) -> list[Expectation]:
    """Hold what the vehicle told against [expect]: its mode, failsafe and fence_breached."""
    found = []
    if (mode := expect.get(MODE)) is not None:
        value = told.mode or None
        why = None if value else "the vehicle told no mode"
        found.append(Expectation(MODE, mode, value, value == mode, f"mode = {mode}", why))
    if (wanted := expect.get(FAILSAFE)) is not None:
        found.append(_judge_failsafe(wanted, told.failsafes))
    if (breached := expect.get(FENCE_BREACHED)) is not None:
        at_s = told.breached_s
        value = "not breached" if at_s is None else f"breached at {at_s:.3f} s"
        limit = "breached" if breached else "not breached"
        met = breached is (at_s is not None)
        found.append(Expectation(FENCE_BREACHED, limit, value, met, f"fence: {limit}"))
    return found


def _judge_failsafe(wanted: Mapping[str, Any], acted: tuple[Failsafe, ...]) -> Expectation:
    """Hold the first failsafe that acted against its name and its times."""
    name, t_from, t_to = wanted["name"], wanted.get("from"), wanted.get("to")
    text = f"failsafe = {name}"
    text += "" if t_from is None else f" from {t_from:g} s"
    text += "" if t_to is None else f" to {t_to:g} s"
    if not acted:
        return Expectation(FAILSAFE, name, NO_FAILSAFE, name == NO_FAILSAFE, text)
    first, rest = acted[0], acted[1:]
    in_time = (t_from is None or first.time_s >= t_from - HALF_US) and (
        t_to is None or first.time_s <= t_to + HALF_US
    )
    met = first.name == name and in_time
    why = None if met or not rest else f"after it acted {', '.join(map(str, rest))}"
    return Expectation(FAILSAFE, name, str(first), met, text, why)
