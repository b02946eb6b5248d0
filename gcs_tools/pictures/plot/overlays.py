"""Several flights in one figure: their errors, or any of the OVERLAYS, a colour for each flight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gcs_tools.judging.metrics import EngagedTicks
from gcs_tools.pictures.plot.style import GREY, INK, STYLE, TIME, line, logarithmic
from gcs_tools.recording.table import Rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, HEAD, PANEL = 12.0, 1.2, 2.6  # inches: of the figure, above the panels, of each panel
LEAST_M = 1e-3  # what is less is drawn there
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", INK)
NAMED = len(COLOURS)  # flights with a colour of their own; of more all are drawn alike
DEGREES = 180.0 / math.pi
METRICS = (
    "setpoint_error_rms_settled_m", "setpoint_error_final_m", "reference_error_rms_settled_m",
    "reference_error_max_m",
)  # fmt: skip

Numbers = dict[str, dict[str, float | None]]


class Panel(NamedTuple):
    """One quantity over time."""

    title: str
    column: str  # of the truth, or of what the controller tells; of an error its name
    times: float = 1.0  # to the unit of the title
    limit: float | None = None  # drawn dashed
    is_error: bool = False  # on a logarithmic axis


OVERLAYS: dict[str, tuple[Panel, ...]] = {
    "errors": (
        Panel("Distance from the setpoint that the mission asks for, m", "setpoint_error", is_error=True),
        Panel("Distance from the reference model, m", "reference_error", is_error=True),
    ),
    "position": tuple(
        Panel(f"Position {way}, m", f"state.r_E.{axis}")
        for way, axis in zip(("east", "north", "up"), "xyz", strict=True)
    ),
    "velocity": tuple(
        Panel(f"Velocity {way}, m/s", f"state.v_E.{axis}")
        for way, axis in zip(("east", "north", "up"), "xyz", strict=True)
    ),
    "attitude": tuple(
        Panel(f"{name}, °", f"outputs.angles.{axis}", DEGREES)
        for name, axis in zip(("Roll", "Pitch", "Yaw"), "xyz", strict=True)
    ),
    "margin": (
        Panel("Force left before a limit, N", "guard.margin.force", limit=0.0),
        Panel("Margin of the condition, N", "guard.margin.condition", limit=0.0),
    ),
    "thrust": (Panel("Thrust commanded, N", "outputs.T_c"),),
    "mass": (Panel("Mass estimate, kg", "state.estimates.m_hat"),),
    "wind": tuple(
        Panel(f"Velocity of the air {way}, m/s", f"v_air_E.{axis}")
        for way, axis in zip(("east", "north", "up"), "xyz", strict=True)
    ),
}  # fmt: skip


def save(
    flights: Mapping[str, EngagedTicks], path: Path, kind: str, remarks: Sequence[str] = (),
    what: Sequence[str] = ("errors",),
) -> Numbers:  # fmt: skip
    """Draw flights, by name, over each other to `path` as `kind`; the metrics of each.

    remarks : on single flights, in the figure too.  what : keys of OVERLAYS.
    Raises OSError if it cannot be written.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    panels = [panel for name in what for panel in OVERLAYS[name]]
    with rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, HEAD + PANEL * len(panels)), layout="constrained")
        grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)
        for axes, panel in zip(grid[:, 0], panels, strict=True):
            _draw(axes, panel, flights)
        grid[-1, 0].set_xlabel(TIME)
        if len(flights) <= NAMED:
            from matplotlib.lines import Line2D

            marks = [Line2D([], [], color=COLOURS[i], label=name) for i, name in enumerate(flights)]
            columns = 1 if max(map(len, flights)) > 40 else min(len(flights), 4)
            figure.legend(handles=marks, loc="outside upper left", ncols=columns)
        if remarks:
            figure.supxlabel("\n".join(remarks), x=0.012, ha="left", fontsize=8.0, color=GREY)
        figure.savefig(path, format=kind, dpi=110)
    return {name: {m: flight.metric(m) for m in METRICS} for name, flight in flights.items()}


def _draw(axes: Axes, panel: Panel, flights: Mapping[str, EngagedTicks]) -> None:
    axes.set_title(panel.title)
    if panel.is_error:
        logarithmic(axes, "y")
    if panel.limit is not None:
        axes.axhline(panel.limit, color="#b22222", linewidth=0.9, linestyle=(0, (5, 3)), zorder=1)
    few = len(flights) <= NAMED
    for i, flight in enumerate(flights.values()):
        values = _values(panel, flight)
        if values is None or not np.isfinite(values).any():
            continue
        style: dict[str, Any] = {"color": COLOURS[i] if few else INK, "alpha": 1.0 if few else 0.35}
        if few:  # the first stay seen below those that are the same
            style["linewidth"] = max(1.0, 2.6 - 0.6 * i)
        line(axes, flight.t, values, **style)
    if not axes.get_lines():
        axes.annotate(
            "no flight tells this", (0.5, 0.5), xycoords="axes fraction", ha="center", color=GREY
        )


def _values(panel: Panel, flight: EngagedTicks) -> Rows | None:
    """The quantity at each tick, float64 (n,). None if the flight does not tell it."""
    if panel.is_error:
        error: Rows = np.maximum(getattr(flight, panel.column), LEAST_M)
        return error
    for table in (flight.plant, flight.fcu):
        if panel.column in table:
            return panel.times * table[panel.column]
    return None
