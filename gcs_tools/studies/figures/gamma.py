"""The velocity prediction error against the adaptation gain: flown, in theory, and its bounds.

Flown is the nominal flight, rotors and all. The theory's is a hover in the same wind, of the
general M-MRAC, with the mass estimate held close to the truth: what its bounds assume.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fcu.theory.sweep import GammaSweep, prediction_against_gamma
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load
from gcs_tools.pictures.plot.style import DASHED, GREY, INK, LIMIT, X, Y
from gcs_tools.studies.figures.cases import ACHIEVED, PRINTED, Case, fly
from gcs_tools.studies.figures.drawing import write
from gcs_tools.studies.figures.numbers import MILLI, SETTLED_S, late, norm

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "gamma"
GAMMAS = tuple(float(f"{gamma:.4g}") for gamma in np.geomspace(10.0, 1e5, 17))
MISSIONS = {PRINTED: "paper_printed", ACHIEVED: "paper_nominal"}
IN_THEORY = tuple(float(f"{gamma:.4g}") for gamma in np.geomspace(10.0, 1e5, 9))
QUOTED = (10.0, 100.0, 1e3, 1e4)
SIZE = (7.4, 4.8)  # inches


@dataclass(frozen=True)
class Point:
    """One flight: its greatest velocity prediction error from SETTLED_S on."""

    title: str
    gamma: float  # 1/s^2; the predictor's gain is its root
    error: float | None  # m/s; None: the flight did not last


def cases(gammas: tuple[float, ...] = GAMMAS) -> list[tuple[float, Case]]:
    """What is flown, as printed and with Delta u, at each gamma."""
    return [
        (gamma, Case(title, mission, (f"law.gamma={gamma!r}",)))
        for title, mission in MISSIONS.items()
        for gamma in gammas
    ]


def flown(one: tuple[float, Case]) -> Point:
    """One flight of `cases`."""
    gamma, case = one
    flight = fly(case)
    size = norm(flight.fcu.axes("internals.prediction.v_til"))[late(flight, SETTLED_S)]
    return Point(case.title, gamma, None if flight.ended else float(size.max()))


@cache
def hover(gamma: float) -> GammaSweep:
    """The theory's hover at one gamma, with the nominal flight's law: arrays of one number."""
    law = scenario(load(MISSIONS[ACHIEVED])).law
    return prediction_against_gamma([gamma], law)


def table(points: list[Point], hovers: list[GammaSweep]) -> list[list[str]]:
    """A head and rows: gamma, the error with Delta u, what it tends to times gamma, and bounds."""
    head = ["γ, 1/s²", "flown, with Δu", "times γ", "hover in theory", "bound, 1/γ", "bound (20)"]
    rows = [head]
    errors = {p.gamma: p.error for p in points if p.title == ACHIEVED}
    for sweep in hovers:
        gamma = float(sweep.gamma[0])
        error = errors[gamma]
        tends = "–" if error is None else f"{gamma * error:.2f} m/s³"
        theory = [float(values[0]) for values in (sweep.measured, sweep.inverse, sweep.lyapunov)]
        rows.append([f"{gamma:.0f}", _said(error), tends, *map(_said, theory)])
    return rows


def _said(error: float | None) -> str:
    """In mm/s, three digits."""
    if error is None or not math.isfinite(error):
        return "–"
    value = MILLI * error
    return (f"{value:.0f}" if value >= 100.0 else f"{value:#.3g}") + " mm/s"


def measured(points: list[Point], hovers: list[GammaSweep]) -> dict[str, Any]:
    """Title, gamma: the errors, m/s; None for a flight that did not last, a bound there is not."""
    found: dict[str, Any] = {
        title: {f"{p.gamma:g}": p.error for p in points if p.title == title} for title in MISSIONS
    }
    for name in ("measured", "inverse", "lyapunov"):
        values = {f"{s.gamma[0]:g}": float(getattr(s, name)[0]) for s in hovers}
        found[f"hover_{name}"] = {g: v if math.isfinite(v) else None for g, v in values.items()}
    return found


def draw(picture: Figure, points: list[Point], hovers: list[GammaSweep]) -> None:
    """Errors and bounds on two log scales."""
    axes = picture.subplots()
    axes.set_title("Velocity prediction error against the adaptation gain, f_m = 1", weight="bold")
    axes.set(xscale="log", yscale="log", xlabel="γ, 1/s²")
    axes.set_ylabel("greatest from 5 s on, mm/s")
    for coordinate in (axes.xaxis, axes.yaxis):
        coordinate.set_major_formatter(lambda value, _: f"{value:g}")
    for title, colour, marker in ((PRINTED, Y, "s"), (ACHIEVED, X, "o")):
        of = [point for point in points if point.title == title]
        lasted = [(p.gamma, MILLI * p.error) for p in of if p.error is not None]
        axes.plot(*zip(*lasted, strict=True), color=colour, marker=marker, ms=4.0, label=title)
        lost = [p.gamma for p in of if p.error is None]
        if lost:
            top = axes.get_xaxis_transform()
            axes.plot(
                lost, [0.97] * len(lost), "x", color=colour, transform=top, label=f"{title}: lost"
            )
    gammas = [float(sweep.gamma[0]) for sweep in hovers]
    for name, style, label in (
        ("measured", {"linewidth": 1.0, "color": GREY}, "a hover in theory"),
        ("inverse", {**DASHED, "color": INK}, "its bound of order 1/γ"),
        ("lyapunov", {**DASHED, "color": LIMIT}, "its bound (20), of order 1/√γ"),
    ):
        errors = [MILLI * float(getattr(sweep, name)[0]) for sweep in hovers]
        axes.plot(gammas, errors, label=label, **style)
    axes.legend(loc="lower left")


def save(points: list[Point], hovers: list[GammaSweep], path: Path) -> None:
    """Draw them to a file. Raises OSError."""
    write(path, SIZE, lambda picture: draw(picture, points, hovers))
