"""The largest step that saturates nothing, measured in flight, against what the conditions say.

    python -m gcs_tools.studies.envelope_map     draws docs/figures/envelope_map.png, prints the coverage

A vehicle that hovers is told to be elsewhere, as asked (`warn`). A step is safe if neither thrust
nor tilt meets its limit in any of the flights: in the paper's wind at six of its phases with the
paper's 8 kg; or with every belief of the guard at its ends, the lightest and the heaviest mass
in steady wind of the greatest speed from six sides, and in the paper's wind.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from fcu.process.settings import Settings
from gcs_tools.campaigns.flights import LawFlight, LawFlightOrder, each, flown, fly
from gcs_tools.flight.law_flights import Keep
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.envelope import WAYS, largest, step, with_guard
from gcs_tools.missions.mission import from_tables
from gcs_tools.studies.guard_check import SATURATED, saturated

Array = np.ndarray[Any, np.dtype[np.float64]]

SIDES = [[s * (i == k) for i in range(3)] for k in range(3) for s in (12.0, -12.0)]
PAPER_WIND = {"amplitude_m_s": [7.2, 7.2, 5.7], "frequency_rad_s": [1.5, 1.6, 1.7]}
PHASES_S = tuple(2.0 + 0.7 * k for k in range(6))  # when the step comes
HOVER_S = 2.0  # before a step, in steady wind
MOST_M = 80.0  # of a search
KEPT = Keep(plant=(), law=SATURATED)


class MapWorld(NamedTuple):
    """One of the flights that a step has to be safe in."""

    mass: float  # kg
    wind: dict[str, Any]  # a mission's table
    at_s: float  # when the step comes


PAPER = [MapWorld(8.0, PAPER_WIND, at) for at in PHASES_S]
BELIEFS = [
    *(MapWorld(m, {"steady_m_s": side}, HOVER_S) for m, side in product((7.0, 9.0), SIDES)),
    *(MapWorld(m, PAPER_WIND, at) for m, at in product((7.0, 9.0), PHASES_S[::2])),
]


def flight_order(
    world: MapWorld, f_m: float, way: Sequence[float], far: float
) -> LawFlightOrder[bool]:
    """A hover in a world, and a step of `far` (m) along `way`: does thrust or tilt meet a limit then?"""
    to = [far * x for x in way]
    tables = {
        "title": "A step.",
        "flight": {
            "duration_s": world.at_s + min(10.0, 5.0 / f_m),
            "ground_z_m": -1e4,
            "arena_m": 1e4,
            "setpoints": [[0.0, 0.0, 0.0, 0.0], [world.at_s, *to]],
        },
        "law": {"f_m": f_m, "guard": "warn", "m_hat_0": world.mass, "J_hat_0": 0.3},
        "plant": {"mass_kg": world.mass},
        "wind": world.wind,
        "expect": {},
    }

    def look(flight: LawFlight) -> bool:
        begun = round(world.at_s * flight.scene.rate_hz)
        return not flight.lasted or bool(saturated(flight.law)[begun:].any())

    return LawFlightOrder(scenario(from_tables("step", tables)), look)


def saturates(world: MapWorld, f_m: float, way: Sequence[float], far: float) -> bool:
    """Whether thrust or tilt meets a limit from the step on."""
    return fly([flight_order(world, f_m, way, far)], KEPT)[0]


def safe_step(worlds: Sequence[MapWorld], f_m: float, way: Sequence[float]) -> float:
    """The largest step (m) that saturates in none of the worlds."""
    worst = list(worlds)  # one by one: most steps that are too far saturate in the first

    def holds(far: float) -> bool:
        for world in worst:
            if saturates(world, f_m, way, far):
                worst.remove(world)
                worst.insert(0, world)  # it will be the first to tell the next time
                return False
        return True

    return largest(holds, MOST_M) or 0.0


class Curve(NamedTuple):
    """For one direction, over f_m: the largest safe steps and what the conditions say, m."""

    way: str
    f_m: Array
    paper: Array  # safe in the paper's wind, with its 8 kg
    beliefs: Array  # safe whatever is believed
    conditions: dict[str, Array]  # by name, as believed
    known: Array  # the exact set, told the paper's mass and wind

    def coverage(self, name: str) -> float:
        """Part of the steps that are safe whatever is believed for which a condition holds."""
        return float(np.mean(self.conditions[name] / self.beliefs))

    @property
    def coverage_known(self) -> float:
        """Part of the paper's safe steps for which the exact set says so, told its mass and wind."""
        return float(np.mean(self.known / self.paper))


NAMES = {"exact": "exact set (the guard's)", "ball": "ball about hover", "theorem": "(31)"}


def with_f_m(settings: Settings, f_m: float) -> Settings:
    """The settings with another reference model."""
    return settings._replace(law=settings.law._replace(f_m=f_m))


def curve(name: str, f_m: Sequence[float]) -> Curve:
    """Fly and compute one direction."""
    way = WAYS[name]
    base = flight_order(PAPER[0], 1.0, way, 0.0).scene.settings
    told = with_guard(base, m_min=8.0, m_max=8.0, w_max=11.67, w_dot_max=18.5)
    found = [step(with_f_m(base, f), way, name) for f in f_m]
    return Curve(
        name,
        np.array(f_m),
        np.array([safe_step(PAPER, f, way) for f in f_m]),
        np.array([safe_step(BELIEFS, f, way) for f in f_m]),
        {k: np.array([getattr(reach, k) for reach in found]) for k in NAMES},
        np.array([step(with_f_m(told, f), way, name).exact for f in f_m]),
    )


def successes(names: Sequence[str], f_m: Sequence[float], steps: Sequence[float]) -> Array:
    """Part of the flights of all beliefs that saturate nothing: by direction, step and f_m."""

    def of_beliefs(of: tuple[str, float, float]) -> list[LawFlightOrder[bool]]:
        name, f, far = of
        return [flight_order(world, f, WAYS[name], far) for world in BELIEFS]

    every = list(product(names, f_m, steps))  # settings that are alike one after the other
    found = flown(of_beliefs, every, KEPT, "steps", Console(stderr=True))
    parts = np.array([np.mean([not one for one in beliefs]) for beliefs in found])
    return np.swapaxes(parts.reshape(len(names), len(f_m), len(steps)), 1, 2)


def edges(values: Sequence[float]) -> Array:
    """Between values that lie evenly on a logarithmic axis, and beyond the ends."""
    logs = np.log(values)
    half = 0.5 * (logs[1] - logs[0])
    return np.asarray(np.exp(np.append(logs - half, logs[-1] + half)))


def draw(maps: Sequence[tuple[Curve, Array, Sequence[float]]], path: Path) -> None:
    """One panel a direction: measured success, and the boundaries."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 5.2), layout="constrained")
    panels = figure.subplots(1, len(maps), sharey=True)
    for axes, (found, success, steps) in zip(panels, maps, strict=True):
        shade = axes.pcolormesh(
            edges(found.f_m.tolist()), edges(steps), success, cmap="RdYlGn", vmin=0.0, vmax=1.0,
            alpha=0.55, lw=0,
        )  # fmt: skip
        axes.loglog(found.f_m, found.beliefs, color="k", lw=1.6, label="measured: safe whatever is believed")  # fmt: skip
        axes.loglog(found.f_m, found.paper, "k:", lw=1.2, label="measured: safe in the paper's flight")  # fmt: skip
        for (key, words), colour in zip(
            NAMES.items(), ("#1f77b4", "#6a51a3", "#8c564b"), strict=True
        ):
            says = f"{words}: {100.0 * found.coverage(key):.0f} % of the safe"
            axes.loglog(found.f_m, found.conditions[key], color=colour, lw=1.8, label=says)
        axes.set(title=f"a step {found.way}", xlabel="f_m, rad/s")
        axes.set_xlim(found.f_m[0], found.f_m[-1])
        axes.set_ylim(steps[0], steps[-1])
        axes.set_xticks([0.5, 1.0, 2.0, 3.0], ["0.5", "1", "2", "3"])
        axes.minorticks_off()
        axes.legend(fontsize=7.5, loc="lower left", framealpha=0.9)
    panels[0].set_ylabel("step, m")
    panels[0].set_yticks([0.2, 0.5, 1, 2, 5, 10, 20, 40], ["0.2", "0.5", "1", "2", "5", "10", "20", "40"])  # fmt: skip
    figure.colorbar(shade, ax=panels[-1], label="flights that saturate nothing")
    figure.savefig(path, dpi=100, metadata={"Software": None})


@click.command()
@click.option(
    "--figure", type=click.Path(path_type=Path), default=Path("docs/figures/envelope_map.png")
)
@click.option("--points", default=10, show_default=True, help="values of f_m")
@click.option("--json", "as_json", is_flag=True, help="the coverage as JSON")
def main(figure: Path, points: int, as_json: bool) -> None:
    """Draw the map and print what part of the safe steps each condition covers."""
    f_m = np.geomspace(0.5, 3.0, points).tolist()
    steps = np.geomspace(0.2, 50.0, 2 * points).tolist()

    ways = list(WAYS)
    curves = each(lambda name: curve(name, f_m), ways, "largest safe steps", Console(stderr=True))
    found = zip(curves, successes(ways, f_m, steps), strict=True)
    maps = [(along, success, steps) for along, success in found]
    draw(maps, figure)
    covered = {
        found.way: {
            **{key: round(found.coverage(key), 3) for key in NAMES},
            "exact_known": round(found.coverage_known, 3),
            "unsound": int((found.conditions["exact"] > found.beliefs * 1.02).sum()),
        }
        for found, _, _ in maps
    }
    mean = {
        key: round(float(np.mean([c[key] for c in covered.values()])), 3)
        for key in (*NAMES, "exact_known")
    }
    if as_json:
        click.echo(json.dumps({"directions": covered, "mean": mean}, indent=2))
        return
    table = Table("part of the safe steps", *covered, "mean", box=None)
    for key, words in (
        *NAMES.items(),
        ("exact_known", "exact set, told the paper's mass and wind"),
    ):
        table.add_row(words, *(f"{c[key]:.2f}" for c in covered.values()), f"{mean[key]:.2f}")
    Console().print(table)
    click.echo(f"{figure}")


if __name__ == "__main__":
    main()
