"""The law fails in flight: how far from its way is the vehicle taken until the baseline has it?

    python -m gcs_tools.studies.law_failures           300 moments (--moments N)
    python -m gcs_tools.studies.law_failures --page    writes the table of docs/failsafes.md

A whole vehicle flies a shipped mission in process, with MR_LAW_ACT 1. At a drawn tick all that the law
remembers is made NaN, so that its next tick computes nothing else. Each flight is held against the same
flight in which the law does not fail: the excursion is the greatest distance between the two, from the
failure to the end.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import click
import numpy as np

from fcu.interface.status_texts import Code
from fcu.kernel.rows import slice_of
from fcu.laws.face import SharedTick
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.missions.mission import load, override
from gcs_tools.recording.table import Rows
from gcs_tools.studies.failsafes import PAGE, written
from sitl_plant.physics.types import PlantRecord

MISSIONS = ("urban_step", "gust_step", "paper_nominal")
MOMENTS, LATEST = 300, 0.75  # of the flight's ticks: until there the law fails
_R = slice_of(PlantRecord, "state.r_E")
_COMMAND = slice_of(SharedTick, "command")


class Poisoned(MemoryFlight):
    """A flight whose law remembers nothing but NaN from a tick on. Negative: never."""

    def __init__(self, scene: Scenario, at_tick: int) -> None:
        super().__init__(scene, None, (_drop, _drop))
        self._at_tick = at_tick

    def _fly_to(self, tick: int) -> bool:
        if 0 <= self._at_tick <= tick:
            goes_on = super()._fly_to(self._at_tick)
            self._autopilot.flight.remembered[:] = math.nan
            self._at_tick = -1
            if not goes_on:
                return False
        return super()._fly_to(tick)


class Outcome(NamedTuple):
    """One flight whose law failed."""

    tick: int
    excursion_m: float
    final_m: float  # distance from the other flight at the end
    jump: float  # of the rotors' commands (0 to 1) from the tick before to the baseline's first, at most
    tells: bool  # the failure, at the tick at which the law failed
    whole: bool  # it flew to the end of its time


def reference(scene: Scenario) -> Rows:
    """Rows of the plant of the flight in which the law does not fail."""
    return Poisoned(scene, -1).fly().plant


def fly(scene: Scenario, tick: int, undisturbed: Rows) -> Outcome:
    """Fly one moment."""
    flown = Poisoned(scene, tick).fly()
    n = min(len(flown.plant), len(undisturbed))
    apart = np.linalg.norm(flown.plant[:n, _R] - undisturbed[:n, _R], axis=1)[tick:]
    command = flown.fcu[:, _COMMAND]
    told = [each.t for each in flown.told if each.code == Code.LAW_FAILED.name]
    return Outcome(
        tick, float(apart.max()), float(apart[-1]), float(np.abs(command[tick] - command[tick - 1]).max()),
        len(told) == 1 and abs(told[0] * scene.rate_hz - tick) < 0.5,
        len(flown.fcu) == scene.ticks and bool(np.isfinite(command).all()),
    )  # fmt: skip


def outcomes(name: str, moments: int) -> Iterator[Outcome]:
    """Fly a mission's moments, drawn by their number."""
    mission = override(load(name), "vehicle.params.MR_LAW_ACT=1")
    scene = scenario(mission)
    undisturbed = reference(scene)
    random = np.random.default_rng([37, len(name)])
    for tick in sorted(random.integers(1, round(LATEST * scene.ticks), moments).tolist()):
        yield fly(scene, tick, undisturbed)


HEAD = (
    "| mission | flew on | excursion: median, 95 %, greatest, m | at the end, greatest, m | jump of a rotor's command, greatest |",
    "|---|---|---|---|---|",
)


def line(name: str, found: list[Outcome]) -> str:
    """A line of the table."""
    away = np.array([each.excursion_m for each in found])
    flew_on = sum(each.whole and each.tells for each in found)
    return (
        f"| {name} | {flew_on} of {len(found)} | {np.median(away):.2f}, {np.quantile(away, 0.95):.2f},"
        f" {away.max():.2f} | {max(each.final_m for each in found):.2f} |"
        f" {max(each.jump for each in found):.3f} |"
    )


@click.command()
@click.option("--moments", default=MOMENTS, show_default=True, help="flights of each mission")
@click.option("--mission", "only", multiple=True, help="instead of the three")
@click.option("--page", is_flag=True, help="write the table into docs/failsafes.md")
def main(moments: int, only: tuple[str, ...], page: bool) -> None:
    """Fly every moment, and print the table. Exit code 1: a flight did not go on."""
    lines, kept = [*HEAD], True
    for name in only or MISSIONS:
        found = list(outcomes(name, moments))
        lines.append(line(name, found))
        worst = max(found, key=lambda each: each.excursion_m)
        print(
            lines[-1],
            worst,
            *[each for each in found if not (each.whole and each.tells)][:3],
            sep="\n",
            flush=True,
        )
        kept = kept and all(each.whole and each.tells for each in found)
    if page:
        PAGE.write_text(written(PAGE.read_text(), "law", lines))
    raise SystemExit(int(not kept))


def _drop(_rows: object) -> None:
    """Keep no row."""


if __name__ == "__main__":
    main()
