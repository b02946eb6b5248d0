"""The rows of the paper's figures: one quantity each, drawn for one flight."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_tools.pictures.plot.style import (
    DASHED,
    DOTTED,
    GREY,
    INK,
    LIMIT,
    MUTED,
    THREE,
    WIDE,
    X,
    flagged,
    limits,
    line,
    note,
)
from gcs_tools.pictures.quantities import ENU
from gcs_tools.recording.table import Rows
from gcs_tools.studies.figures.cases import FigureFlight
from gcs_tools.studies.figures.numbers import FIRST_S, MILLI, SETTLED_S, norm

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EVENT: dict[str, Any] = {"color": GREY, "linewidth": 0.8, "linestyle": (0, (2, 2)), "zorder": 1}


@dataclass(frozen=True)
class Row:
    """One row of a figure."""

    label: str  # with its unit
    draw: Callable[[Axes, FigureFlight], None]
    height: float = 1.0  # against other rows
    span: tuple[float, float] | None = None  # shown, if it is not to follow from the data
    log: bool = False
    until: float | None = None  # s, a row that shows the beginning alone


def mark(axes: Axes, t: float) -> None:
    """A time that the text speaks of."""
    axes.axvline(t, **EVENT)


def _position(axis: int) -> Row:
    def draw(axes: Axes, flown: FigureFlight) -> None:
        colour, of = THREE[axis], "xyz"[axis]
        line(axes, flown.t, flown.fcu[f"setpoint.r_c.{of}"], color=colour, **DOTTED)
        line(axes, flown.t, flown.fcu[f"outputs.reference.r_m.{of}"], color=colour, **WIDE)
        line(axes, flown.t, flown.plant[f"state.r_E.{of}"], color=colour)

    return Row(f"{ENU[axis]}, m", draw)


def _distance(axes: Axes, flown: FigureFlight) -> None:
    line(axes, flown.t, np.maximum(flown.flight.reference_error, 1e-4), color=INK, linewidth=0.9)


def _known(axes: Axes, flown: FigureFlight) -> None:
    """With it, what it would be were the vehicle known: e(t) = exp(At) e(0) (23), of (34)."""
    mark(axes, SETTLED_S)
    f, zeta, t = flown.law.f_m, flown.law.zeta_m, flown.t
    root = math.sqrt(1.0 - zeta * zeta)
    swing = np.cos(root * f * t) + zeta / root * np.sin(root * f * t)
    ideal = float(flown.flight.reference_error[0]) * np.exp(-zeta * f * t) * np.abs(swing)
    line(axes, t, np.maximum(ideal, 1e-4), color=MUTED, **WIDE)
    _distance(axes, flown)


def _thrust(axes: Axes, flown: FigureFlight) -> None:
    mark(axes, FIRST_S)
    line(axes, flown.t, flown.fcu["outputs.T_achieved"], color=MUTED, **WIDE)
    line(axes, flown.t, flown.fcu["outputs.T_c"], color=X)
    limits(axes, flown.law.limits.T_min, flown.law.limits.T_max)
    flagged(axes, flown.t, flown.fcu["outputs.saturation.thrust"], "")


def _delta_u(axes: Axes, flown: FigureFlight) -> None:
    mark(axes, FIRST_S)
    size = norm(flown.fcu.axes("internals.achieved.delta_u"))
    line(axes, flown.t, np.maximum(size, 1e-2), color=INK, linewidth=0.9)
    flagged(axes, flown.t, flown.fcu["outputs.saturation.thrust"], "")


def _mass(axes: Axes, flown: FigureFlight) -> None:
    bounds = flown.law.bounds
    line(axes, flown.t, flown.plant["m"], color=MUTED, **WIDE)
    line(axes, flown.t, flown.fcu["state.estimates.m_hat"], color=X)
    for level in (bounds.m_min, bounds.m_max):
        axes.axhline(level, color=LIMIT, linewidth=0.9, linestyle=":")


def _angle(axis: int) -> Row:
    name = ("roll", "pitch", "yaw")[axis]

    def draw(axes: Axes, flown: FigureFlight) -> None:
        mark(axes, FIRST_S)
        angle, asked = (
            np.degrees(flown.fcu[f"outputs.{of}.{'xyz'[axis]}"]) for of in ("angles", "angles_c")
        )
        line(axes, flown.t, asked, color=THREE[axis], **WIDE)
        line(axes, flown.t, angle, color=THREE[axis])
        if axis < 2:
            limit = float(np.degrees(flown.law.limits.phi_star))
            limits(axes, -limit, limit)
            axes.set_yticks([-limit, 0.0, limit])
            flagged(axes, flown.t, flown.fcu["outputs.saturation.tilt"], "")

    return Row(f"{name}, °", draw)


def _velocity(axis: int) -> Row:
    def draw(axes: Axes, flown: FigureFlight) -> None:
        colour, of = THREE[axis], "xyz"[axis]
        line(axes, flown.t, flown.fcu[f"outputs.reference.v_m.{of}"], color=INK, **DOTTED)
        line(axes, flown.t, flown.fcu[f"measured.v_E.{of}"], color=colour, **WIDE)
        line(axes, flown.t, flown.fcu[f"state.predictor.v_hat.{of}"], color=colour)

    return Row(f"{ENU[axis]}, m/s", draw)


def _rate(axis: int) -> Row:
    span = ((-4.0, 4.0), (-3.0, 3.0), (-1.0, 1.5))[axis]

    def draw(axes: Axes, flown: FigureFlight) -> None:
        colour, of = THREE[axis], "xyz"[axis]
        asked = flown.fcu[f"outputs.w_c.{of}"]
        line(axes, flown.t, asked, color=INK, **DOTTED)
        line(axes, flown.t, flown.fcu[f"measured.w_B.{of}"], color=colour, **WIDE)
        line(axes, flown.t, flown.fcu[f"state.predictor.w_hat.{of}"], color=colour)
        ends = [end for end in (asked.min(), asked.max()) if not span[0] <= end <= span[1]]
        if ends:
            note(
                axes,
                f"commanded at first: to {' and '.join(f'{end:.2g}' for end in ends)}".replace(
                    "-", "−"
                ),
            )

    return Row(f"{'pqr'[axis]}, rad/s", draw, span=span)


def _error(name: str) -> Callable[[Axes, FigureFlight], None]:
    def draw(axes: Axes, flown: FigureFlight) -> None:
        size: Rows = MILLI * norm(flown.fcu.axes(f"internals.prediction.{name}"))
        line(axes, flown.t, np.maximum(size, 1e-3), color=INK, linewidth=0.9)

    return draw


POSITION = (*(_position(axis) for axis in range(3)), Row("distance from\nreference, m", _distance, 1.0, (1e-3, 2e1), True))  # fmt: skip
WRONG = (*POSITION[:3], Row("distance from\nreference, m", _known, 1.0, (1e-3, 2e1), True))  # fmt: skip
LOST = (*POSITION[:3], Row("distance from\nreference, m", _distance, 1.0, (1e-3, 2e2), True))
THRUST = (
    Row("thrust, N", _thrust, 1.3),
    Row("thrust at\nfirst, N", _thrust, 1.3, until=2.5),
    Row("|Δu|, N", _delta_u, 1.0, (1e-1, 2e4), True),
    Row("mass, kg", _mass, 1.0, (0.0, 13.0)),
)
ANGLES = tuple(_angle(axis) for axis in range(3))
VELOCITY = (*(_velocity(axis) for axis in range(3)), Row("prediction\nerror, mm/s", _error("v_til"), 1.0, (1e-1, 1e3), True))  # fmt: skip
RATES = (*(_rate(axis) for axis in range(3)), Row("prediction\nerror, mrad/s", _error("w_til"), 1.0, (1e-2, 1e3), True))  # fmt: skip

# what the legend says of the lines of each kind of figure: label, style
Legend = tuple[tuple[str, dict[str, Any]], ...]
THIN: dict[str, Any] = {"color": GREY, "linewidth": 1.2}
PALE: dict[str, Any] = {"color": GREY, **WIDE}
POINTS: dict[str, Any] = {"color": GREY, **DOTTED}
SETPOINT: Legend = (("setpoint", POINTS), ("reference model", PALE), ("flown", THIN))
FROM_WRONG: Legend = (
    *SETPOINT[:1],
    ("reference model; its distance, were the vehicle known, (23)", PALE),
    SETPOINT[2],
)
FORCES: Legend = (
    ("achieved (thrust), true (mass)", PALE), ("commanded, estimated", {**THIN, "color": X}),
    ("limit", DASHED), ("set of the estimate", {"color": LIMIT, "linewidth": 0.9, "linestyle": ":"}),
)  # fmt: skip
TILTS: Legend = (("commanded", PALE), ("flown", THIN), ("limit", DASHED))
PREDICTED: Legend = (("flown", PALE), ("predicted", THIN), ("reference model", {**POINTS, "color": INK}))  # fmt: skip
TURNING: Legend = (("flown", PALE), ("predicted", THIN), ("commanded", {**POINTS, "color": INK}))
