"""One flight of a law, and the numbers that a comparison keeps of it; its rows are dropped.

The ticks are those of a law alone (`gcs_tools.flight.law_alone`): of a whole vehicle, as long as its
autopilot only passes setpoints on, and it flies to the end of its time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from fcu.laws.loader import LawError
from gcs_tools.campaigns import flights
from gcs_tools.campaigns.flights import LawFlight, LawFlightOrder
from gcs_tools.campaigns.procedure import Objective
from gcs_tools.exit_codes import OK, USAGE
from gcs_tools.flight import law_flights
from gcs_tools.flight.law_flights import Keep
from gcs_tools.flight.scenario import Scenario
from gcs_tools.judging.metrics import SETTLE_S, EngagedTicks
from gcs_tools.missions.mission import Mission
from gcs_tools.missions.timeline import timeline
from gcs_tools.recording.table import Rows
from sitl_plant.physics import dynamics

ERROR = "setpoint_error_rms_m"
ENDINGS = dynamics.ENDED
KEPT = Keep(  # what is looked at
    plant=("t", "state.r_E", "on_ground", "battery.energy_J"),
    law=("t", "engaged", "command", "outputs"),
)
REFUSED = "refused"  # a vehicle would not arm with these gains
RAISED = "raised: "  # and then what its law raised
ENDED = "ended: "  # and then how its law ended the process that flew it
_SATURATED = tuple(f"outputs.saturation.{of}" for of in ("thrust", "tilt", "torque", "yaw"))


class Score(NamedTuple):
    """What is kept of a flight. Of one that was lost only why: the rest is not a number."""

    # crashed, diverged, not finite, far, refused, or what its law raised; empty if it was not
    lost: str
    error_m: float  # RMS distance to the setpoint, after the transient
    error_all_m: float  # the same of the whole flight
    error_max_m: float  # the greatest, after the transient
    thrust: float  # greatest commanded thrust over the greatest allowed
    tilt: float  # greatest commanded roll or pitch over the greatest allowed
    saturated: float  # part of the ticks at which thrust, tilt, torque or yaw was cut
    energy_j: float  # taken from the battery
    noise: (
        float  # RMS change of a rotor's command in a tick, part of full speed, after the transient
    )


NAMES = Score._fields[1:]  # those that are numbers
SCORED = "score."  # before their names in a table of flights
COLUMNS = tuple(f"{SCORED}{name}" for name in NAMES)


def columns(score: Score) -> dict[str, float | None]:
    """The numbers as a table of flights has them. None: not a number."""
    values = {name: getattr(score, name) for name in NAMES}
    return {f"{SCORED}{k}": v if math.isfinite(v) else None for k, v in values.items()}


def of_columns(row: Mapping[str, Any]) -> Score:
    """The score of a row of a table of flights."""
    if row["success"]:
        return Score("", *(row[name] for name in COLUMNS))
    if row["error"]:
        if row["exit_code"] == OK:
            return lost(REFUSED)
        return lost(f"{RAISED if row['exit_code'] == USAGE else ENDED}{row['error']}")
    return lost(row["missed"] or row["ended"])


def lost(why: str) -> Score:
    """The score of a lost flight."""
    return Score(why, *[math.nan] * len(NAMES))


def _raised(error: LawError) -> Score:
    """A flight whose law raised is lost, and no other is."""
    return lost(f"{RAISED}{error}".partition("\n")[0])


def window(mission: Mission) -> tuple[float, float | None]:
    """From when to when (s; None: to the end) the error counts."""
    own = mission.expectations().get(ERROR)
    if isinstance(own, dict) and "from" in own:
        return float(own["from"]), own.get("to")
    return timeline(mission.flight).last_change_s + SETTLE_S, None


def fly(scene: Scenario, mission: Mission, far_m: float) -> Score:
    """Fly a scene and score it.

    far_m : from the setpoint at the end, at which it counts as lost.
    """
    return fly_several([(scene, mission)], far_m)[0]


def fly_several(
    of: Sequence[tuple[Scenario, Mission]], far_m: float, in_all: float | None = None
) -> list[Score]:
    """The same of several flights, side by side where that can be (`flights.fly`).

    in_all : how many flights these are some of; default: there are no others.
    """
    allowed = [
        LawFlightOrder(scene, partial(_score, mission=mission, far_m=far_m))
        for scene, mission in of
        if not scene.unstable
    ]
    found = iter(flights.fly(allowed, KEPT, in_all, _raised))
    known = {id(each.scene) for each in allowed}
    return [next(found) if id(scene) in known else lost(REFUSED) for scene, _ in of]


def of_rows(scene: Scenario, mission: Mission, plant: Rows, law: Rows, far_m: float) -> Score:
    """Score a flight by its rows (as of `law_alone.fly`)."""
    flown = law_flights.of_rows(scene, plant, law, KEPT)
    tables = law_flights.tables(scene, flown, KEPT)
    return _score(LawFlight(scene, *tables, flown.ticks, flown.ended), mission, far_m)


def _score(flown: LawFlight, mission: Mission, far_m: float) -> Score:
    if not flown.lasted:
        return lost(ENDINGS[flown.ended])
    scene = flown.scene
    wanted = timeline(mission.flight)
    flight = EngagedTicks.of(
        flown.plant, flown.law,
        wanted.last_change_s + SETTLE_S, wanted.positions_at,
    )  # fmt: skip
    if flight.metric("nonfinite_samples"):
        return lost("not finite")
    if (flight.metric("setpoint_error_final_m") or math.inf) > far_m:
        return lost("far")
    limits = scene.law.limits
    settled = flight.window(*window(mission))
    cut = np.maximum.reduce([flight.told(name) for name in _SATURATED])
    energy = flight.plant["battery.energy_J"]
    found = Score(
        lost="",
        error_m=_number(settled, ERROR),
        error_all_m=_number(flight, ERROR),
        error_max_m=_number(settled, "setpoint_error_max_m"),
        thrust=_number(flight, "thrust_max_n") / limits.T_max,
        tilt=math.radians(_number(flight, "tilt_max_deg")) / limits.phi_star,
        saturated=float(np.mean(cut > 0.5)),
        energy_j=float(energy[-1] - energy[0]),
        noise=_noise(settled),
    )
    return found if all(map(math.isfinite, found[1:])) else lost("not finite")


def cost(score: Score, objective: Objective) -> float:
    """What the flight adds to the objective."""
    if score.lost:
        return objective.lost
    error = math.log1p(score.error_m / objective.error_scale_m)
    whole = math.log1p(score.error_all_m / objective.error_scale_m)
    noise = math.log1p(score.noise / objective.noise_scale)
    return min(
        objective.lost, error + objective.whole_weight * whole + objective.noise_weight * noise
    )


def _number(flight: EngagedTicks, name: str) -> float:
    value = flight.metric(name)
    return math.nan if value is None else value


def _noise(flight: EngagedTicks) -> float:
    """Of the rotors that are there: one that is absent is never told to turn."""
    command = flight.fcu["command.u"]
    present = command[:, (command != 0.0).any(axis=0)]
    return float(np.sqrt(np.mean(np.diff(present, axis=0) ** 2))) if present.size else math.nan
