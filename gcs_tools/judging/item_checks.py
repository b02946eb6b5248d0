"""How each item of a mission went: when it began and ended, and what was expected of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fcu.kernel.algebra import Vec3
from gcs_tools.judging.causes import LITTLE
from gcs_tools.judging.expectations import (
    GOOD_ENDINGS,
    ITEMS,
    Expectation,
    MetricFunction,
    Reason,
    judge_metric,
)
from gcs_tools.judging.metrics import REACHED_M, SETTLE_S, EngagedTicks, on_ground
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.items import lands
from gcs_tools.missions.timeline import LANDS, Begun, legs
from gcs_tools.recording.plans import PlanHistory
from gcs_tools.recording.table import Table

STEPS_COUNT = ("setpoint_error_max_m", "setpoint_error_rms_m")
STEP_S = 0.05  # after its begin: so early an error is the step to its place


@dataclass(frozen=True)
class ItemFlown:
    """One item of a flight."""

    item: int  # from 1, as a person counts
    kind: str
    began_s: float | None  # None: it never began
    ended_s: float | None  # None: it had not ended when the flight had

    @property
    def name(self) -> str:
        """As a person calls it."""
        return f"item {self.item} ({self.kind})"


def items_flown(
    flight: Flight, begun: tuple[Begun, ...], over_s: float, done: bool
) -> list[ItemFlown]:  # fmt: skip
    """Each item of a mission.

    begun : its legs, as they were begun.  over_s : when the flight was over.  done : all items are.
    """
    since: dict[int, float] = {}
    for each in begun:
        since.setdefault(legs(flight)[each.leg].item, each.tick / flight.rate_hz)
    return [
        ItemFlown(i + 1, item.kind, since.get(i), since.get(i + 1, over_s if done else None))
        for i, item in enumerate(flight.items)
    ]


def good_endings(flight: Flight) -> tuple[str, ...]:
    """How a flight ends well, if its mission does not say."""
    if flight.script is not None:
        return ("landed",) if flight.start.on_ground else ("landed", "script")
    if not flight.items:
        return GOOD_ENDINGS
    return ("landed",) if lands(flight.items[-1]) else ("done",)


def unfinished(flight: Flight, begun: tuple[Begun, ...], plant: Table) -> str:
    """Which item had not ended when the flight was over, and where the vehicle was."""
    if not begun:
        return ""
    leg = legs(flight)[begun[-1].leg]
    kind, place = flight.items[leg.item].kind, begun[-1].place
    text = f"Item {leg.item + 1} of {len(flight.items)} ({kind}) had not ended"
    if (plan := begun[-1].plan) is not None:
        return f"{text}: the vehicle was at item {plan.item} of the plan, whose last is {plan.total - 1}."
    r, v = plant["state.r_E"][-1], plant["state.v_E"][-1]
    if place is None or leg.kind in LANDS or not np.isfinite(r).all():
        return f"{text}."
    away, speed = math.dist(r, place), float(np.linalg.norm(v))
    return f"{text}: the vehicle was {away:.3g} m away at {speed:.2g} m/s (within_m is {leg.within:g})."


def judge_items(
    flight: Flight, expected: Iterable[Mapping[str, Any]], flown: Iterable[ItemFlown],
    ticks: EngagedTicks, plant: Table, begun: tuple[Begun, ...], followed: bool,
    plans: PlanHistory,
) -> list[Expectation]:  # fmt: skip
    """What was expected of each item, judged in its own time.

    expected : an item's [expect] as plain values, each.  ticks, plant : of the flight.  followed :
    whether paths are to be, of which nothing is written.  plans : which item of a plan was flown when.
    """
    found = []
    for entries, item in zip(expected, flown, strict=True):
        own = _own(flight, item, ticks)
        landing = _landing(flight, item, begun, plant) if item.kind in LANDS else {}
        metrics = _metrics_of(item, own, landing)
        for name, entry in entries.items():
            if name == ITEMS:
                continue
            judged = judge_metric(name, entry, *metrics, ticks.law_has)
            said = judged.why
            if own is not None and judged.is_missed and judged.value is not None:
                said = _why_missed(name, entry, own, item, flight, begun)
            why = None if said is None else f"of {item.name}: {said}"
            found.append(replace(judged, text=f"{item.name}: {judged.text}", why=why))
        written = any(name.startswith("setpoint_error_") for name in entries)
        if followed and item.kind == "follow" and not written:
            found += _followed(flight, item, ticks, begun)
        if entries.get(ITEMS):
            found += _of_plan(flight, entries[ITEMS], item, ticks, plans)
    return found


def _own(flight: Flight, item: ItemFlown, ticks: EngagedTicks) -> EngagedTicks | None:
    """The ticks of an item. None: it never began."""
    if item.began_s is None:
        return None
    own = ticks.window(item.began_s, _last(flight, item))
    return replace(own, settle_from_s=item.began_s + SETTLE_S)


def _metrics_of(
    item: ItemFlown, own: EngagedTicks | None, others: Mapping[str, float | None],
    lacks: str = "the vehicle has not touched the ground",
) -> tuple[MetricFunction, Reason]:  # fmt: skip
    """The value of a metric in an item's own time, and the reason why it has none.

    own : its ticks.  others : metrics of this item alone, and `lacks` the reason why one has no value.
    """

    def metric(name: str, t_from: float | None, t_to: float | None) -> float | None:
        if item.began_s is None or own is None:
            return None
        if name == "took_s":
            return None if item.ended_s is None else item.ended_s - item.began_s
        if name in others:
            return others[name]
        return own.metric(name, *_shifted(item.began_s, t_from, t_to))

    def reason(name: str, t_from: float | None, t_to: float | None) -> str:
        if item.began_s is None or own is None:
            return "it never began"
        if name == "took_s":
            return "it had not ended"
        if name in others:
            return lacks
        return own.why_no_value(name, *_shifted(item.began_s, t_from, t_to))

    return metric, reason


def _of_plan(
    flight: Flight, expected: Mapping[str, Mapping[str, Any]], item: ItemFlown,
    ticks: EngagedTicks, plans: PlanHistory,
) -> list[Expectation]:  # fmt: skip
    """Judge items of a plan, each in the time in which it was flown first."""
    found = []
    until = math.inf if item.ended_s is None else item.ended_s
    spans = {} if item.began_s is None else plans.spans(item.began_s, until)
    for number, entries in expected.items():
        k = int(number)
        began_s, ended_s = spans.get(k, (None, None))
        plan = plans.at(math.inf if began_s is None else began_s)
        command = plan.mission[k].command if k < len(plan.mission) else "item"
        part = ItemFlown(k, command, began_s, ended_s)
        own = _own(flight, part, ticks)
        place = plan.mission[k].at(plan.home) if k < len(plan.mission) else None
        nearest = None
        if own is not None and place is not None and len(own.t):
            away = np.linalg.norm(own.plant["state.r_E"] - np.array(place), axis=1)
            nearest = float(away.min())
        metrics = _metrics_of(part, own, {"passed_m": nearest}, "it has no place, or took no time")
        before = "" if len(flight.items) == 1 else f"{item.name}: "
        for name, entry in entries.items():
            judged = judge_metric(name, entry, *metrics, ticks.law_has)
            why = None if judged.why is None else f"of plan item {k}: {judged.why}"
            text = f"{before}plan item {k} ({command}): {judged.text}"
            found.append(replace(judged, text=text, why=why))
    return found


def _why_missed(
    name: str, entry: Any, own: EngagedTicks, item: ItemFlown, flight: Flight,
    begun: tuple[Begun, ...],
) -> str | None:  # fmt: skip
    """What came of an item that missed a limit: where its time went, when its error was greatest.

    own : its ticks.  None: there is nothing to add.
    """
    if name == "took_s":
        return _where_time_went(own, item, flight, begun)
    if not name.startswith("setpoint_error_"):
        return None
    assert item.began_s is not None
    window = entry if isinstance(entry, Mapping) else {}
    ticks = own.window(*_shifted(item.began_s, window.get("from"), window.get("to")))
    error = np.where(ticks.is_asked & np.isfinite(ticks.setpoint_error), ticks.setpoint_error, -1.0)
    worst, after_s = int(error.argmax()), ticks.t - item.began_s
    said = f"greatest {after_s[worst]:.3g} s after its begin, {error[worst]:.3g} m"
    counts = name in STEPS_COUNT and window.get("from") is None
    if counts and after_s[worst] <= STEP_S and item.kind == "go_to":
        said += ", which is the step of the setpoint (leave it out with from)"
    return f"{said}; {error[error >= 0.0][-1]:.3g} m in the end"


def _where_time_went(
    own: EngagedTicks, item: ItemFlown, flight: Flight, begun: tuple[Begun, ...]
) -> str | None:
    """When an item that took too long was where it should end; None: there is nothing to add."""
    last = [each for each in begun if legs(flight)[each.leg].item == item.item - 1][-1]
    leg = legs(flight)[last.leg]
    if item.began_s is None or item.ended_s is None or not len(own.t):
        return None
    if leg.kind in LANDS:
        down = own.t[own.is_grounded]
        return f"it was on the ground after {down[0] - item.began_s:.3g} s" if len(down) else None
    if last.place is None or leg.kind == "hold":
        return f"a hold of {leg.for_s:g} s" if leg.kind == "hold" else None
    parts = []
    if leg.path is not None:
        parts.append(f"its path takes {leg.path.duration_s:.3g} s from its first point")
    since = last.tick / flight.rate_hz + (0.0 if leg.path is None else leg.path.duration_s)
    away = np.linalg.norm(own.plant["state.r_E"] - np.array(last.place), axis=1)
    near = np.flatnonzero((away <= leg.within) & (own.t >= since - STEP_S))
    if len(near):
        at_s = own.t[near[0]] - item.began_s
        parts.append(f"it was within {leg.within:g} m of its end after {at_s:.3g} s")
    parts.append(f"slow enough there after {item.ended_s - item.began_s:.3g} s")
    return ", ".join(parts)


def _followed(
    flight: Flight, item: ItemFlown, ticks: EngagedTicks, begun: tuple[Begun, ...]
) -> list[Expectation]:
    """Check how closely each path was followed. Paths that were not reached are left out."""
    all_legs = legs(flight)
    along = [
        each for each in begun
        if all_legs[each.leg].item == item.item - 1 and all_legs[each.leg].path is not None
    ]  # fmt: skip
    if not along:
        return []
    window = ticks.window(along[0].tick / flight.rate_hz, _last(flight, item))
    name = "setpoint_error_max_m"
    judged = judge_metric(name, REACHED_M, window.metric, window.why_no_value)
    why = judged.why
    if judged.is_missed and judged.value is not None:
        why = f"of {item.name}: {_why_missed(name, REACHED_M, window, item, flight, begun)}"
    return [replace(judged, text=f"{item.name}: {judged.text} along its path", why=why)]


def _last(flight: Flight, item: ItemFlown) -> float | None:
    """The last tick of an item, s: at its end the next one begins."""
    return None if item.ended_s is None else item.ended_s - 1.0 / flight.rate_hz


def slowed(
    flown: Iterable[ItemFlown], judged: Iterable[Expectation], ticks: EngagedTicks
) -> list[str]:
    """The items that the guard slowed, among those that missed an expectation."""
    missed = [line.text for line in judged if line.is_missed]
    found = []
    for item in flown:
        if item.began_s is None or not any(text.startswith(f"{item.name}: ") for text in missed):
            continue
        part = ticks.metric("governed_fraction", item.began_s, item.ended_s)
        if part is not None and part >= LITTLE:
            found.append(f"The guard slowed {item.name} for {100.0 * part:.0f} % of its time.")
    return found


def _shifted(
    began_s: float, t_from: float | None, t_to: float | None
) -> tuple[float | None, float | None]:
    """A window of an item as one of the flight."""
    return (
        None if t_from is None else began_s + t_from, None if t_to is None else began_s + t_to,
    )  # fmt: skip


def _landing(
    flight: Flight, item: ItemFlown, begun: tuple[Begun, ...], plant: Table
) -> dict[str, float | None]:
    """How fast it touched the ground first, m/s, and how far across from where it should, m."""
    nothing: dict[str, float | None] = {"touchdown_m_s": None, "touchdown_m": None}
    if item.began_s is None:
        return nothing
    since = int(np.searchsorted(plant["t"], item.began_s - 0.5e-6))
    after = np.flatnonzero(on_ground(plant)[since:])
    if not len(after):
        return nothing
    first = since + int(after[0])
    r, v = plant["state.r_E"], plant["state.v_E"]
    where = Vec3(*r[since].tolist()) if item.kind == "land" else _home(flight, begun, plant)
    across = math.dist(r[first][:2], (where.x, where.y))
    speed = float(np.linalg.norm(v[max(first - 1, 0)]))  # of the last tick in the air
    return {"touchdown_m_s": speed, "touchdown_m": across}


def _home(flight: Flight, begun: tuple[Begun, ...], plant: Table) -> Vec3:
    """Where it armed last: at the last take-off, or where the flight began."""
    at = [each for each in begun if legs(flight)[each.leg].kind == "take_off"]
    k = int(np.searchsorted(plant["t"], at[-1].tick / flight.rate_hz)) if at else 0
    return Vec3(*plant["state.r_E"][min(k, len(plant) - 1)].tolist())
