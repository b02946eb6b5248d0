"""What the defaults trade: tracking, noise, arrival and lag over f_m and gamma.

    python -m gcs_tools.studies.gains     flies 16 pairs, draws docs/figures/gains.png, prints the table

Each pair flies the missions of disturbances under the guard, and the figure of eight without it, as
its speed is beyond the condition. The other values are the defaults.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from fcu.guard.stability import unstable
from gcs_tools.campaigns.flights import LawFlight, LawFlightOrder, flown
from gcs_tools.flight.law_flights import Keep
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.envelope import WAYS, step
from gcs_tools.missions.mission import load

F_M, GAMMAS = (1.0, 1.5, 2.0, 2.5), (500.0, 1000.0, 2000.0, 4000.0)
LONG = ("flight.duration_s=40.0",)
LAGS_S = (0.02, 0.05, 0.1, 0.12)  # true; 0.05 is believed
NEAR = 0.3  # m: arrived
SETTLED = 20.0  # s from which errors are settled, of a flight of 40 s
MODEL, COMMAND = "outputs.reference.r_m", "setpoint.r_c"
KEPT = Keep(plant=("state.r_E",), law=(MODEL, COMMAND))


class Pair(NamedTuple):
    """One pair of gains, and what was flown with it. RMS of the true position, m."""

    f_m: float  # rad/s
    gamma: float  # 1/s^2
    refused: str  # by the rule of stability; "" if it is not
    nominal: float  # to the reference model
    noisy: float
    drop: float  # from 2 s after it
    eight: float  # of the figure of eight, to the command
    arrival_s: float  # of the paper's step, to stay within NEAR
    lags: tuple[float, ...]  # nominal, for each of LAGS_S
    admitted: float  # m: the largest step that the condition admits from rest, mean of WAYS


class Flew(NamedTuple):
    """What is looked at in one flight."""

    rms: float  # m, of the true position about a column of Tick
    there_s: float  # when it is near the setpoint, and stays


def flight_order(
    mission: str, settings: Sequence[str], since_s: float = SETTLED, reference: str = MODEL
) -> LawFlightOrder[Flew]:
    """A mission, and the error about `reference` from `since_s` on."""

    def look(flight: LawFlight) -> Flew:
        if not flight.lasted:
            return Flew(np.inf, np.inf)
        rate, r = flight.scene.rate_hz, flight.plant["state.r_E"]
        away = np.linalg.norm(r - flight.law[reference], axis=1)
        far = np.flatnonzero(np.linalg.norm(r - flight.law[COMMAND], axis=1) > NEAR)
        settled = away[round(since_s * rate) :]
        return Flew(
            float(np.sqrt(np.mean(settled**2))), float((far[-1] + 1) / rate if len(far) else 0.0)
        )

    return LawFlightOrder(scenario(load(mission, settings)), look)


def chosen(gains: tuple[float, float]) -> tuple[str, ...]:
    """The settings of one pair."""
    f_m, gamma = gains
    return f"law.f_m={f_m}", f"law.gamma={gamma}"


def flights(gains: tuple[float, float]) -> list[LawFlightOrder[Flew]]:
    """What is flown with one pair."""
    pair = chosen(gains)
    return [
        flight_order("urban_step", (*pair, *LONG)),
        flight_order("noisy_state", (*pair, *LONG)),
        flight_order("package_drop", pair, 14.0),
        flight_order("figure_eight", pair, 10.0, COMMAND),
        *(flight_order("urban_step", (*pair, *LONG, f"plant.rotor_lag_s={lag}")) for lag in LAGS_S),
    ]


def pairs(of: Sequence[tuple[float, float]], console: Console | None = None) -> Iterator[Pair]:
    """Fly pairs of gains."""
    for gains, flew in zip(of, flown(flights, of, KEPT, console=console), strict=True):
        nominal, noisy, drop, eight, *lags = flew
        settings = scenario(load("urban_step", chosen(gains))).settings
        admitted = [step(settings, WAYS[way], way).exact or 0.0 for way in WAYS]
        yield Pair(
            *gains, unstable(settings.law, settings.guard), nominal.rms, noisy.rms, drop.rms, eight.rms,
            nominal.there_s, tuple(lag.rms for lag in lags), float(np.mean(admitted)),
        )  # fmt: skip


def draw(found: Sequence[Pair], path: Path) -> None:
    """Tracking without noise against tracking with it: a line for each gamma, a point for each f_m."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5, 4.8), layout="constrained")
    axes = figure.subplots()
    for gamma in GAMMAS:
        line = [p for p in found if p.gamma == gamma]
        axes.loglog(
            [1e3 * p.nominal for p in line], [1e3 * p.noisy for p in line], "o-",
            label=f"γ = {gamma:g} 1/s²",
        )  # fmt: skip
        for p in line:
            at = (1e3 * p.nominal, 1e3 * p.noisy)
            axes.annotate(f"{p.f_m:g}", at, (6, -4), textcoords="offset points", fontsize=8)
    axes.set(
        title="Position error with each f_m, rad/s, at the points",
        xlabel="without noise, mm RMS", ylabel="with the noise of noisy_state, mm RMS",
    )  # fmt: skip
    ticks = [7, 10, 15, 20, 30, 50]
    axes.set_xticks(ticks[:5], map(str, ticks[:5]))
    axes.set_yticks(ticks, map(str, ticks))
    axes.minorticks_off()
    axes.legend()
    figure.savefig(path, dpi=100, metadata={"Software": None})


@click.command()
@click.option("--figure", type=click.Path(path_type=Path), default=Path("docs/figures/gains.png"))
@click.option("--json", "as_json", is_flag=True, help="the table as JSON")
def main(figure: Path, as_json: bool) -> None:
    """Fly every pair, draw the front and print the table."""
    found = list(pairs(list(product(F_M, GAMMAS)), Console(stderr=True)))
    draw(found, figure)
    if as_json:
        click.echo(json.dumps([p._asdict() for p in found], indent=2))
        return
    table = Table(
        "f_m", "γ", "nominal", "noisy", "drop", "eight", "20 m in",
        f"lag {1e3 * LAGS_S[0]:.0f} to {1e3 * LAGS_S[-1]:.0f} ms", "admits", "rule", box=None,
    )  # fmt: skip
    for p in found:
        errors = (p.nominal, p.noisy, p.drop, p.eight)
        table.add_row(
            f"{p.f_m:g}", f"{p.gamma:g}", *(f"{1e3 * e:.1f} mm" for e in errors),
            f"{p.arrival_s:.1f} s", f"{1e3 * min(p.lags):.1f} to {1e3 * max(p.lags):.1f} mm",
            f"{p.admitted:.2f} m",
            "refuses" if p.refused else "accepts",
        )  # fmt: skip
    Console().print(table)
    click.echo(f"{figure}")


if __name__ == "__main__":
    main()
