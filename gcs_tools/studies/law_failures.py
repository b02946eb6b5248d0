"""The law fails in flight: how far from its way is the vehicle taken until the baseline has it?

    python -m gcs_tools.studies.law_failures              300 seeds of each mission (--seeds N)
    python -m gcs_tools.studies.law_failures --each-tick  every tick of the first two seconds of each mission
    ... --page                                            writes the table into docs/failsafes.md

A whole vehicle flies a shipped mission in process, with MR_LAW_ACT 1 and noise on its state. The seed draws
the noise, the phases of the paper's wind, and a tick. At that tick all that the law remembers is made NaN, so
that its next tick computes nothing else. Each flight is held against the same flight in which the law does not
fail: the excursion is the greatest distance between the two, from the failure to the end.
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
from gcs_tools.missions.mission import MissionError, load, override
from gcs_tools.recording.table import Rows
from gcs_tools.studies.failsafes import PAGE, written
from sitl_plant.physics.types import PlantRecord

MISSIONS = ("urban_step", "gust_step", "paper_nominal")
SEEDS, LATEST = 300, 0.75  # of the flight's ticks: until there the law fails
NOISE = "{position_m=0.002, velocity_m_s=0.005, attitude_deg=0.05, rate_rad_s=0.01}"
EACH_S, FLOWN_S = 2.0, 6.0  # the law fails at each tick until there, in a flight that is so long
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


def flight(name: str, seed: int, *settings: str) -> Scenario:
    """A mission's flight, with the noise and the wind of a seed."""
    mission = load(name)
    chosen = ["vehicle.params.MR_LAW_ACT=1", f"plant.noise={NOISE}", f"flight.seed={seed}"]
    if mission.given.get("wind", {}).get("base") == "paper":
        phases = np.random.default_rng([37, seed]).uniform(0.0, 2.0 * math.pi, 3)
        chosen.append(f"wind.phase_rad={phases.round(3).tolist()}")
    for setting in (*chosen, *settings):
        mission = override(mission, setting)
    return scenario(mission)


def drawn(name: str, seeds: int) -> Iterator[Outcome]:
    """Fly a mission once a seed, whose law fails at the seed's tick."""
    for seed in range(seeds):
        scene = flight(name, seed)
        tick = np.random.default_rng([38, seed]).integers(1, round(LATEST * scene.ticks))
        yield fly(scene, int(tick), reference(scene))


def at_each_tick(name: str) -> Iterator[Outcome]:
    """Fly the beginning of a mission once a tick of it, at which its law fails."""
    scene = flight(name, 0, f"flight.duration_s={FLOWN_S:g}", "expect={}")
    undisturbed = reference(scene)
    for tick in range(1, round(EACH_S * scene.rate_hz)):
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
@click.option("--seeds", default=SEEDS, show_default=True, help="flights of each mission")
@click.option("--each-tick", is_flag=True, help="fail at every tick of the first two seconds")
@click.option("--mission", "only", multiple=True, help="instead of the three")
@click.option("--page", is_flag=True, help="write the table into docs/failsafes.md")
def main(seeds: int, each_tick: bool, only: tuple[str, ...], page: bool) -> None:
    """Fly every failure, and print the table. Exit code 1: a flight did not go on."""
    try:
        for name in only:
            load(name)
    except MissionError as error:
        raise click.BadParameter(str(error), param_hint="--mission") from error
    lines, kept = [*HEAD], True
    print(*HEAD, sep="\n", flush=True)
    for name in only or MISSIONS:
        found = list(at_each_tick(name) if each_tick else drawn(name, seeds))
        lines.append(line(name, found))
        worst = max(found, key=lambda each: each.excursion_m)
        wrong = [each for each in found if not (each.whole and each.tells)]
        print(lines[-1], worst, *wrong[:3], sep="\n", flush=True)
        kept = kept and not wrong
    if page:
        where = "law at each tick" if each_tick else "law"
        PAGE.write_text(written(PAGE.read_text(), where, lines))
    raise SystemExit(int(not kept))


def _drop(_rows: object) -> None:
    """Keep no row."""


if __name__ == "__main__":
    main()
