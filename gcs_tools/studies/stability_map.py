"""Which gains fly: the rule of fcu.guard.stability against flights, on grids of two parameters.

    python -m gcs_tools.studies.stability_map               draws docs/stability_map.png, prints the agreement
    python -m gcs_tools.studies.stability_map --random N    flies N combinations that the rule accepts

Each point is flown twice, in still air and in the wind of `paper_nominal`: a step of
(4, 7, 18) m from rest with estimates of mass and inertia that are wrong at first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click
import numpy as np
from rich.console import Console

from fcu.guard.stability import unstable
from fcu.process.settings import Settings
from gcs_tools.campaigns.flights import LawFlight, LawFlightOrder, Random, accepted_draws, flown
from gcs_tools.flight.law_flights import Keep
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.missions.fields import RATES
from gcs_tools.missions.mission import Mission, load, override

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rows = np.ndarray[Any, np.dtype[np.float64]]

LAST_S = 5.0  # of a flight: what is judged
KEPT = Keep(plant=(), law=("measured.w_B", "setpoint.psi_dot_c", "command.u.r1", "outputs.e_r"))
STILL = (
    "wind.amplitude_m_s=[0, 0, 0]", "wind.rotation_amplitude_rad_s=[0, 0, 0]",
    "flight.yaw.amplitude_rad=0.0",
)  # fmt: skip
GENTLE = (
    "flight.setpoints=[{ at_s = 0.0, position_m = [0.2, 0.35, 0.9] }]", "law.m_hat_0=8.0",
    "law.J_hat_0=0.35",
)  # fmt: skip
LIMITS = {False: (0.02, 0.1), True: (0.5, 1.0)}  # wind -> rms body rate, rad/s; way off, m
CHATTER = 0.1  # mean change of a rotor's command from tick to tick


@dataclass(frozen=True)
class Axis:
    """One axis of a map: what it is called, what it sets in a mission, and where."""

    name: str
    keys: tuple[str, ...]
    values: tuple[float, ...]


@dataclass(frozen=True)
class Map:
    """Two parameters, the others as they come."""

    x: Axis
    y: Axis


@dataclass(frozen=True)
class Point:
    """One combination: what the rule said ("" accepts it), and what flew, still and in wind."""

    refused: str
    still: bool
    wind: bool
    gently: bool  # in still air, a step of under 1 m, with estimates that are right from the start

    @property
    def false_accept(self) -> bool:
        """Accepted, and did not fly."""
        return not self.refused and not (self.still and self.wind)

    @property
    def false_refusal(self) -> bool:
        """Refused, and flew both ways."""
        return bool(self.refused) and self.still and self.wind


def _spread(low: float, high: float, n: int) -> tuple[float, ...]:
    return tuple(float(f"{v:.4g}") for v in np.geomspace(low, high, n))


def maps(n: int) -> tuple[Map, ...]:
    """The maps, with n values along what is not the control rate."""
    rate = Axis("control rate, Hz", ("flight.rate_hz",), tuple(float(r) for r in RATES))
    lag = Axis(
        "rotor lag, true and believed, s", ("law.rotor_lag_s", "plant.rotor_lag_s"),
        _spread(0.003, 0.3, n),
    )  # fmt: skip
    c_angle = Axis("c_angle, 1/s", ("law.c_angle",), _spread(0.3, 100.0, n))
    c_rate = Axis("c_rate, 1/s", ("law.c_rate",), _spread(0.5, 2000.0, n))
    f_m = Axis("f_m, rad/s", ("law.f_m",), _spread(0.3, 10.0, n))
    gamma = Axis("gamma, 1/s²", ("law.gamma",), _spread(1.0, 1e6, n))
    response = Axis(
        "rotor_response_s, s", ("law.rotor_response_s",), _spread(0.0005, 0.1, n)
    )  # fmt: skip
    return (
        Map(gamma, rate), Map(c_rate, lag), Map(c_angle, c_rate), Map(f_m, c_angle),
        Map(response, rate),
    )  # fmt: skip


def changed(mission: Mission, axis: Axis, value: float) -> Mission:
    """The mission with an axis at a value."""
    for key in axis.keys:
        mission = override(mission, f"{key}={value!r}")
    return mission


def still(mission: Mission) -> Mission:
    """The mission without wind, and with its yaw held."""
    for setting in STILL:
        mission = override(mission, setting)
    return mission


def gentle(mission: Mission) -> Mission:
    """The mission without wind, as a small step, with estimates that are right at take-over."""
    for setting in GENTLE:
        mission = override(mission, setting)
    return still(mission)


def flies(flight: LawFlight, wind: bool) -> bool:
    """Whether a flight ends at its reference and at rest, as far as the wind lets it."""
    if not flight.lasted:
        return False
    last = flight.law.take(slice(-round(LAST_S * flight.scene.rate_hz), None))
    rate = np.array(last["measured.w_B"], order="C")
    rate[:, 2] -= last["setpoint.psi_dot_c"]
    most, far = LIMITS[wind]
    rms = np.sqrt((rate * rate).mean(axis=0)).max()
    chatter = np.abs(np.diff(last["command.u.r1"])).mean()
    way_off = np.abs(last["outputs.e_r"]).max()
    return bool(rms < most and chatter < CHATTER and way_off < far)


class Seen(NamedTuple):
    """A law, and whether it flew."""

    settings: Settings
    well: bool


def flight_order(scene: Scenario, wind: bool) -> LawFlightOrder[Seen]:
    """Whether a scene flies."""
    return LawFlightOrder(scene, lambda flight: Seen(flight.scene.settings, flies(flight, wind)))


def three(mission: Mission) -> list[LawFlightOrder[Seen]]:
    """A mission in still air, in wind, and gently."""
    calm, windy, small = (scenario(m) for m in (still(mission), mission, gentle(mission)))
    return [flight_order(calm, False), flight_order(windy, True), flight_order(small, False)]


def points(missions: Sequence[Mission]) -> list[Point]:
    """What the rule says of each mission's law, and how it flies."""
    return [
        Point(unstable(*windy.settings), calm.well, windy.well, small.well)
        for calm, windy, small in flown(three, missions, KEPT, console=Console(stderr=True))
    ]


def fly_map(chart: Map, mission: Mission) -> list[list[Point]]:
    """Rows of y, each of x."""
    rows = [changed(mission, chart.y, y) for y in chart.y.values]
    found = points([changed(row, chart.x, x) for row in rows for x in chart.x.values])
    width = len(chart.x.values)
    return [found[i : i + width] for i in range(0, len(found), width)]


class Count(NamedTuple):
    """The agreement of rule and flights on one map."""

    points: int
    false_accepts: int
    of_large_steps: int  # those that do fly gently
    false_refusals: int

    def __str__(self) -> str:
        """In words."""
        return (
            f"{self.points} points, {self.false_accepts} accepted that do not fly "
            f"({self.of_large_steps} of them fly gently), {self.false_refusals} refused that fly"
        )


def counted(points: Sequence[Sequence[Point]]) -> Count:
    """The agreement on a map."""
    flat = [p for row in points for p in row]
    accepts = [p for p in flat if p.false_accept]
    return Count(
        len(flat), len(accepts), sum(p.gently for p in accepts), sum(p.false_refusal for p in flat)
    )


SPREAD = {
    "f_m": (0.2, 10.0), "zeta_m": (0.3, 5.0), "c_angle": (0.5, 60.0), "c_rate": (1.0, 800.0),
    "gamma": (1.0, 1e6), "rotor_response_s": (0.001, 0.05), "trim_rate": (0.1, 20.0),
}  # fmt: skip


def fly_random(mission: Mission, n: int) -> tuple[int, int, list[float]]:
    """Draw until the rule has accepted n: how many it refused, and of those it accepted how many
    do not fly the gentle step, with their f_m.
    """

    def draw(random: Random) -> Scenario:
        changed = mission
        for name, (low, high) in SPREAD.items():
            value = float(f"{np.exp(random.uniform(np.log(low), np.log(high))):.6g}")
            changed = override(changed, f"law.{name}={value!r}")
        return scenario(changed)

    scenes, refused = accepted_draws(draw, lambda scene: not unstable(scene.law, scene.guard), n)
    found = flown(
        lambda scene: [flight_order(scene, False)], scenes, KEPT, console=Console(stderr=True)
    )
    bad = [seen.settings.law.f_m for (seen,) in found if not seen.well]
    return refused, len(bad), bad


def _edges(axis: Axis) -> Rows:
    logs = np.log(np.array(axis.values))
    middle = 0.5 * (logs[1:] + logs[:-1])
    ends = np.array([2 * logs[0] - middle[0], *middle, 2 * logs[-1] - middle[-1]])
    edges: Rows = np.exp(ends)
    return edges


def _draw(ax: Axes, chart: Map, points: list[list[Point]]) -> None:
    from matplotlib.colors import ListedColormap

    flown = np.array([[p.still + p.wind for p in row] for row in points], dtype=float)
    colours = ListedColormap(["#d55e00", "#f0c9a0", "#cfe3d6"])
    ax.pcolormesh(
        _edges(chart.x), _edges(chart.y), flown, cmap=colours, vmin=-0.5, vmax=2.5, rasterized=True
    )
    for marker, colour, wrong in (("x", "#222222", "refused"), ("o", "#b22222", "accepts")):
        at = [
            (x, y)
            for y, row in zip(chart.y.values, points, strict=True)
            for x, p in zip(chart.x.values, row, strict=True)
            if (p.refused if wrong == "refused" else p.false_accept)
        ]
        if at:
            xs, ys = zip(*at, strict=True)
            ax.scatter(xs, ys, s=14, c=colour, marker=marker, linewidths=0.8)
    ax.set(xscale="log", yscale="log", xlabel=chart.x.name, ylabel=chart.y.name)
    count = counted(points)
    ax.set_title(
        f"{count.points} points; false: {count.false_accepts} accepted, "
        f"{count.false_refusals} refused",
        fontsize=9,
    )


def draw(results: Sequence[tuple[Map, list[list[Point]]]], path: Path) -> None:
    """The figure."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 8.0), layout="constrained")
    axes = figure.subplots(2, 3).ravel()
    for ax, (chart, points) in zip(axes, results, strict=False):
        _draw(ax, chart, points)
    axes[-1].axis("off")
    axes[-1].text(
        0.0, 0.95,
        "green: flies in still air and in wind\nlight: one of them only\nred-brown: neither\n\n"
        "×: refused by the rule\nred dot: accepted, and does not fly both ways\n"
        "(the rule is on small motions: this is a step of 20 m\nwith estimates that begin wrong)\n\n"
        "Everything that is not on an axis is as it comes:\n500 Hz, lag 0.05 s seen as 0.01 s, "
        "γ = 1000,\nc_angle = 10, c_rate = 20, f_m = 1.",
        va="top", fontsize=10,
    )  # fmt: skip
    figure.savefig(path, dpi=110)


@click.command()
@click.option("--points", default=16, show_default=True, help="values along an axis")
@click.option("--figure", type=click.Path(path_type=Path), default=Path("docs/stability_map.png"))
@click.option("--random", type=int, help="instead: combinations of all gains at random")
def main(points: int, figure: Path, random: int | None) -> None:
    """Draw the maps and print the agreement of rule and flights."""
    mission = load("paper_nominal")
    if random is not None:
        refused, bad, f_m = fly_random(gentle(mission), random)
        fast = sum(f > 4.0 for f in f_m)
        click.echo(
            f"{random} accepted ({refused} refused): {bad} do not fly, {fast} with f_m above 4"
        )
        return
    results = []
    for chart in maps(points):
        flown = fly_map(chart, mission)
        results.append((chart, flown))
        click.echo(f"{chart.x.name} against {chart.y.name}: {counted(flown)}")
    draw(results, figure)
    click.echo(f"{figure}")


if __name__ == "__main__":
    main()
