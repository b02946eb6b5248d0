"""The verdict on a flight: what was flown, held against what its mission expects."""

from __future__ import annotations

from fcu.kernel.rows import column
from gcs_tools.flight.scenario import Scenario
from gcs_tools.flight.wire_flight import Flown
from gcs_tools.judging import expectations, metrics, result
from gcs_tools.judging.result import Result
from gcs_tools.missions.mission import Mission
from gcs_tools.missions.trajectory import last_change_s
from sitl_plant.physics import dynamics
from sitl_plant.physics.types import PlantRecord

OK, MISSED = 0, 1


def judge(
    mission: Mission,
    scene: Scenario,
    flown: Flown,
    exit_code: int,
    error: str | None,
    versions: dict[str, str],
) -> Result:
    """The result of a flight. Of one that was cut short (an `exit_code` not OK) it judges nothing.

    `error`: what cut it short, in words.
    """
    judged: list[expectations.Expectation] = []
    measured: dict[str, float | None] = {}
    ended = "aborted"
    if len(flown.plant) and len(flown.fcu):
        settle = last_change_s(mission.flight) + metrics.SETTLE_S
        flight = metrics.EngagedTicks.of(flown.plant, flown.fcu, settle)
        measured = flight.metrics()
        if exit_code == OK:
            ended = _ended(flown)
            judged = expectations.judge(mission.expectations(), flight.metric, ended)
    passed = exit_code == OK and all(e.passed for e in judged)
    if exit_code == OK and not passed:
        exit_code = MISSED
    sim_time = float(flown.plant[-1, 0]) if len(flown.plant) else 0.0
    said = flown.said.get("plant", {})
    return Result(
        mission=mission.name,
        title=mission.title,
        passed=passed,
        exit_code=exit_code,
        ended=ended,
        seed=mission.flight.seed,
        rate_hz=float(scene.rate_hz),
        sim_time_s=sim_time,
        wall_time_s=flown.wall_time_s,
        real_time_factor=sim_time / flown.wall_time_s if flown.wall_time_s else 0.0,
        startup_s=flown.startup_s,
        ticks=len(flown.fcu),
        slips=int(said.get("slips", 0)),
        trajectory_sha256=result.trajectory_sha256(flown.plant) if len(flown.plant) else "",
        versions=versions,
        values={k: result.InForce(v.value, v.origin) for k, v in mission.values_in_force().items()},
        expectations=judged,
        metrics=measured,
        error=error,
    )


def _ended(flown: Flown) -> str:
    if flown.arrived:
        return "arrived"
    return {
        dynamics.FLYING: "time", dynamics.DIVERGED: "diverged", dynamics.CRASHED: "crashed"
    }[float(column(PlantRecord, flown.plant, "ended")[-1])]  # fmt: skip
