"""The velocity prediction error of the nominal flight against the adaptation gain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_tools.figures.cases import ACHIEVED, PRINTED, Case, fly
from gcs_tools.figures.drawing import write
from gcs_tools.figures.numbers import MILLI, SETTLED_S, late, norm
from gcs_tools.plot.drawing import DOTTED, GREY, X, Y

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "gamma"
GAMMAS = tuple(float(f"{gamma:.4g}") for gamma in np.geomspace(10.0, 1e5, 17))
MISSIONS = {PRINTED: "paper_printed", ACHIEVED: "paper_nominal"}
QUOTED = (10.0, 100.0, 1e3, 1e4, 1e5)
SIZE = (7.4, 4.8)  # inches
ANCHOR = 500.0  # mm/s, where the slopes begin
DASHES: dict[str, Any] = {"linewidth": 0.9, "linestyle": (0, (5, 3))}


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


def flown(gammas: tuple[float, ...] = GAMMAS) -> Iterator[Point]:
    """Each flight, as soon as it has been flown."""
    for gamma, case in cases(gammas):
        flight = fly(case)
        size = norm(flight.fcu.axes("internals.v_til"))[late(flight, SETTLED_S)]
        yield Point(case.title, gamma, None if flight.ended else float(size.max()))


def table(points: list[Point]) -> list[list[str]]:
    """A head and rows: gamma, the error with Delta u, and their product, which tends to a constant."""
    rows = [["γ, 1/s²", "greatest error from 5 s on, with Δu", "times γ"]]
    for point in points:
        if point.title == ACHIEVED and point.gamma in QUOTED and point.error is not None:
            error = f"{MILLI * point.error:#.3g}".rstrip(".") + " mm/s"
            rows.append([f"{point.gamma:.0f}", error, f"{point.gamma * point.error:.2f} m/s³"])
    return rows


def measured(points: list[Point]) -> dict[str, dict[str, float | None]]:
    """Title, gamma: the error, m/s; None for a flight that did not last."""
    return {
        title: {f"{p.gamma:g}": p.error for p in points if p.title == title} for title in MISSIONS
    }


def draw(picture: Figure, points: list[Point]) -> None:
    """Measured errors on two log scales, and the slopes to hold them against."""
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
    gammas = np.array(GAMMAS)
    for power, style, label in ((-0.5, DOTTED, "as 1/√γ"), (-1.0, DASHES, "as 1/γ")):
        axes.plot(gammas, ANCHOR * (gammas / gammas[0]) ** power, color=GREY, label=label, **style)
    axes.legend(loc="lower left")


def save(points: list[Point], path: Path) -> None:
    """Draw them to a file. Raises OSError."""
    write(path, SIZE, lambda picture: draw(picture, points))
