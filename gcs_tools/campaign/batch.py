"""The flights of a batch, wherever it is flown: the one function that a worker is sent.

A worker is given all that it needs: the plan (a campaign's missions, as JSON) and the values of each
flight. It draws nothing, writes nothing, and remembers nothing but the missions that it has loaded.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from fcu.interface.airframe import AirframeError
from fcu.interface.parameter import ParameterError
from fcu.laws.loader import LawError
from gcs_tools.exit_codes import INFRASTRUCTURE, OK, USAGE
from gcs_tools.flight import law_alone
from gcs_tools.flight.arrival import arrival
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.processes import InfrastructureError
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.flight.scripted_flight import Flown
from gcs_tools.judging.expectations import LIMITED
from gcs_tools.judging.preflight_check import refusal
from gcs_tools.judging.result import Result, judge
from gcs_tools.missions.mission import Mission, MissionError, from_tables, with_values
from gcs_tools.recording.table import Rows

REJECTED, ABORTED = "rejected", "aborted"  # ends of a flight that did not fly, or not to its end


class Asked(NamedTuple):
    """A flight that is to be flown."""

    number: int
    law: int  # which of the plan's
    values: Mapping[str, Any]  # dotted key of the mission -> value


class Row(NamedTuple):
    """What is kept of a flight."""

    number: int
    law: int
    seed: int  # of the noise
    success: bool
    ended: str  # as Result.ended
    error: str  # why it was rejected or aborted; else empty
    exit_code: int  # 2: values or a law that cannot be flown, 3: what flew it failed
    sim_time_s: float
    ticks: int
    trajectory_sha256: str
    metrics: Mapping[str, float | None]


def fly_batch(plan: str, asked: Sequence[Asked]) -> list[Row]:
    """Fly each, in order. What a flight can do is in its row; nothing of that is raised.

    plan : Campaign.plan(). Whatever flies several at a time, with equal bits, goes in here.
    """
    fly, missions = _loaded(plan)
    return [_flown(Asked(*each), missions[each[1]], fly) for each in asked]


@lru_cache(maxsize=2)
def _loaded(plan: str) -> tuple[str, tuple[Mission, ...]]:
    """How a plan's flights are flown, and the mission of each law. Raises MissionError."""
    tables = json.loads(plan)
    missions = tuple(from_tables(tables["name"], each["given"]) for each in tables["laws"])
    return tables["fly"], missions


def _flown(asked: Asked, base: Mission, fly: str) -> Row:
    try:
        mission = with_values(base, asked.values, "draw")
        scene = scenario(mission)
    except (MissionError, ParameterError, AirframeError) as error:
        seed = int(asked.values.get("flight.seed", base.flight.seed))
        return _lost(asked, seed, REJECTED, str(error), USAGE)
    seed = mission.flight.seed
    if why := refusal(scene, mission.expectations().get(LIMITED) is True):
        return _lost(asked, seed, REJECTED, why, OK)  # the vehicle's own decision
    try:
        flown = _whole(scene) if fly == "vehicle" else _alone(scene)
    except LawError as error:
        return _lost(asked, seed, ABORTED, str(error), USAGE)
    except InfrastructureError as error:
        return _lost(asked, seed, ABORTED, str(error), INFRASTRUCTURE)
    if flown is None:
        return _lost(asked, seed, REJECTED, law_alone.refusal(scene), OK)
    judged = judge(
        mission, float(scene.rate_hz), flown.plant, flown.fcu, ended=flown.ended, exit_code=OK,
        error=None, begun=flown.begun, refusal=flown.refusal, wall_time_s=0.0, startup_s=0.0, slips=0,
        versions={},
    )  # fmt: skip
    return _row(asked, judged)


def _row(asked: Asked, judged: Result) -> Row:
    return Row(
        asked.number, asked.law, judged.seed, judged.passed, judged.ended, "", OK,
        judged.sim_time_s, judged.ticks, judged.trajectory_sha256, judged.metrics,
    )  # fmt: skip


def _lost(asked: Asked, seed: int, ended: str, why: str, exit_code: int) -> Row:
    first = why.partition("\n")[0]
    return Row(asked.number, asked.law, seed, False, ended, first, exit_code, 0.0, 0, "", {})


def _whole(scene: Scenario) -> Flown:
    """The whole vehicle, in this process. Raises LawError, InfrastructureError."""
    flown = MemoryFlight(scene, None, (_drop, _drop)).fly()
    at_s = arrival(scene, flown.plant, flown.fcu)
    if at_s is None:
        return flown
    flown.plant, flown.fcu = (rows[rows[:, 0] <= at_s] for rows in (flown.plant, flown.fcu))
    flown.arrived = True
    return flown


def _alone(scene: Scenario) -> Flown | None:
    """The law without an autopilot; None of one that no vehicle would arm with. Raises LawError."""
    if law_alone.refusal(scene):
        return None
    plant, fcu = law_alone.fly(scene)
    return Flown(plant, fcu)


def _drop(_rows: Rows) -> None:
    """Nobody records a flight of a campaign."""
