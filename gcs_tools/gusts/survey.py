"""The worst winds of a mission, and files with which each of them is flown again."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fcu.interface.files import whole_file
from fcu.interface.parameter import ParameterError
from fcu.interface.samples_file import wind_text
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.gusts.air import Bounds
from gcs_tools.gusts.ends import ends
from gcs_tools.gusts.limits import LIMITS
from gcs_tools.gusts.worst_wind import Vehicle, Worst, bounds_of, transient_s, worst_winds
from gcs_tools.judging.preflight_check import refusal, unflyable
from gcs_tools.missions.mission import Mission, MissionError, as_toml, is_foreseen, refuse_script

if TYPE_CHECKING:
    from rich.console import Console

Rows = np.ndarray[Any, np.dtype[np.float64]]

WHAT = "gcs envelope --worst-wind"
LONGEST_S = 600.0  # of a flight: each is flown a thousand times
EXPECTED = ("thrust", "tilt", "torque")


@dataclass(frozen=True)
class Survey:
    """The worst winds of one mission."""

    mission: str
    guard: str
    scene: Scenario  # as it was flown
    bounds: Bounds
    vehicles: int  # that were flown
    transient_s: float  # after take-over, in which nothing is judged
    worst: tuple[Worst, ...]  # by limit, then by time
    remarks: tuple[str, ...]

    @property
    def saturates(self) -> bool:
        """True if a computed wind brings something to its limit."""
        return any(each.saturated for each in self.worst)

    def as_json(self) -> dict[str, Any]:
        """Plain values, of each wind all but its samples."""
        return {
            "mission": self.mission,
            "guard": self.guard,
            "wind_m_s": float(self.scene.guard.w_max),
            "wind_rate_m_s2": float(self.scene.guard.w_dot_max),
            "vehicles": self.vehicles,
            "transient_s": self.transient_s,
            "saturates": self.saturates,
            "worst": [
                {
                    "limit": each.limit, "from_s": each.from_s, "to_s": each.to_s, "at_s": each.at_s,
                    "room_still_n": finite(each.still_n), "room_sines_n": finite(each.drawn_n),
                    "begun": each.begun, "room_begun_n": finite(each.begun_n),
                    "room_n": finite(each.computed_n), "saturated": each.saturated,
                    "rounds": each.rounds, **each.end.plant,
                }
                for each in self.worst
            ],
            "remarks": list(self.remarks),
        }  # fmt: skip


class History(NamedTuple):
    """One limit along a flight, in still air and in the worst wind."""

    limit: str
    t: Rows  # s
    still: Rows  # float64[n], N: the room in still air
    room: Rows  # in the wind
    air: Rows  # float64[n, 3], m/s, E
    at_s: float  # when the room is least
    words: str  # which vehicle


def finite(value: float) -> float | None:
    """The value, or None where a flight ended and none is known."""
    return value if np.isfinite(value) else None


def survey(mission: Mission, parts: int, console: Console | None = None) -> Survey:
    """Compute the worst wind for each limit in each of so many parts of a mission's flight.

    Raises MissionError for a mission that a law alone cannot fly, ParameterError, AirframeError, LawError,
    ProgramError.
    """
    refuse_script(mission, WHAT)
    if not is_foreseen(mission):
        raise MissionError(
            f"{mission.source}: [flight] plan: {WHAT} does not look at plans, whose way the vehicle chooses as it flies"
        )
    scene = scenario(mission)
    if (
        scene.settings is None
        or not hasattr(scene.settings, "guard")
        or mission.flown.name != "mmrac"
    ):
        raise ParameterError(
            f"[law] module: {mission.flown.name}: expected mmrac, whose guard says what wind is believed"
        )
    if scene.unstable:
        raise MissionError(f"{mission.source}: {scene.unstable} is unstable with these gains")
    for why in (refusal(scene), *(f"{each.text}" for each in unflyable(mission, scene))):
        if why:
            raise MissionError(
                f"{mission.source}: [flight] the vehicle would not fly this as written: {why}"
            )
    remarks = []
    if scene.legs:
        scene = law_alone.hovering(scene)
        remarks.append(
            "the items are flown from hover where they begin, at times that are foreseen: take-off, landing"
            " and the way home, which the vehicle leads itself, are not"
        )
    if scene.ticks > LONGEST_S * scene.rate_hz:
        raise MissionError(
            f"{mission.source}: [flight] duration_s: expected at most {LONGEST_S:g} s for {WHAT}, which"
            " flies the mission a thousand times"
        )
    plant = mission.plant
    if plant.mass_change is not None or plant.rotor_loss:
        remarks.append("a mass that changes is left out, and a rotor that is lost is in no belief")
    if plant.faults:
        remarks.append("faults to order ([[plant.faults]]) are left out")
    if scene.world.noise_scale.any():
        remarks.append("the noise of the mission is flown, the same in each flight")
    bounds, begins_s = bounds_of(scene), transient_s(scene)
    if bounds.speed <= 0.0:
        raise ParameterError("[law] guard_wind_m_s: expected a wind that is believed, got 0")
    law_alone.warm_up(scene)
    found = worst_winds(scene, parts, console=console)
    if not found:
        raise MissionError(
            f"{mission.source}: [flight] duration_s: too short: {WHAT} looks at what comes after the first"
            f" {begins_s:.2f} s"
        )
    return Survey(
        mission=mission.name,
        guard=("warn", "govern", "refuse")[int(scene.guard.policy)],
        scene=scene,
        bounds=bounds,
        vehicles=len(ends(scene)),
        transient_s=begins_s,
        worst=tuple(found),
        remarks=tuple(remarks),
    )


def tightest(found: Survey) -> dict[str, Worst]:
    """Of each limit the part of the flight that leaves least."""
    return {
        limit: min((w for w in found.worst if w.limit == limit), key=lambda w: w.computed_n)
        for limit in LIMITS
    }


def histories(found: Survey) -> list[History]:
    """Each limit along the flight that brings it nearest. Raises LawError."""
    made = []
    for limit, worst in tightest(found).items():
        vehicle, h = Vehicle(found.scene, worst.end), 1.0 / found.scene.rate_hz
        t: Rows = np.asarray(np.arange(found.scene.ticks) * h, dtype=np.float64)
        air = np.stack([np.interp(t, worst.samples[:, 0], v) for v in worst.samples.T[1:]], axis=1)
        column = LIMITS.index(limit)
        still = vehicle.fly(np.zeros_like(air), found.scene.ticks)[:, column]
        room = vehicle.fly(air, found.scene.ticks)[:, column]
        n = min(len(still), len(room))
        made.append(
            History(limit, t[:n], still[:n], room[:n], air[:n], worst.at_s, worst.end.words)
        )
    return made


def name_of(worst: Worst) -> str:
    """The name of a wind's files without their ending: its limit, and which part of the flight."""
    return f"{worst.limit}-{worst.part}"


def save(mission: Mission, found: Survey, folder: Path) -> list[Path]:
    """Write each wind as a CSV file, and a mission that flies it, into a folder. Raises OSError.

    Of a mission of items the winds alone: a vehicle takes off in its own time.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for worst in found.worst:
        name = name_of(worst)
        whole_file.write(folder / f"{name}.csv", wind_text(worst.samples).encode())
        written.append(folder / f"{name}.csv")
        if mission.flight.items:
            continue
        text = as_toml(
            _tables(mission, worst, found.transient_s, folder, f"{name}.csv"),
            f"{WHAT} {mission.name}: {worst.limit} at {worst.at_s:.2f} s, {math.floor(10.0 * worst.computed_n) / 10.0:.1f} N left",
        )
        whole_file.write(folder / f"{name}.toml", text.encode())
        written.append(folder / f"{name}.toml")
    return written


def _tables(
    mission: Mission, worst: Worst, from_s: float, folder: Path, wind: str
) -> dict[str, Any]:
    """The tables of a mission that flies a worst wind again, and expects that nothing saturates."""
    given: dict[str, Any] = {k: v for k, v in mission.given.items() if k not in ("wind", "expect")}
    named = given.get("airframe")
    if isinstance(named, str) and (mission.folder / named).is_file():
        given["airframe"] = os.path.relpath(mission.folder / named, folder)
    plant = {k: v for k, v in dict(given.get("plant", {})).items() if k != "mass_change"}
    limit = {"limit": 0.0, "from": float(from_s)}
    return {
        **given,
        "title": f"The worst wind of {mission.name} for its {worst.limit.replace('_', ' ')}.",
        "plant": {**plant, **worst.end.plant},
        "wind": {"file": wind},
        "expect": {
            "reached": False,
            **{f"{of}_saturated_fraction": dict(limit) for of in EXPECTED},
        },
    }
