"""The overview: where a flight went, what it asked of the vehicle, what it learned of it."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fcu.interface.files import whole_file
from gcs_tools.judging.metrics import EngagedTicks
from gcs_tools.pictures.history import FlightHistory
from gcs_tools.pictures.plot.numbers import Numbers, length, percent, rms, said
from gcs_tools.pictures.plot.style import (
    DASHED,
    DOTTED,
    INK,
    MUTED,
    STYLE,
    TIME,
    WIDE,
    Y,
    empty,
    legend,
    limits,
    line,
    logarithmic,
)
from gcs_tools.pictures.plot.window import Window
from gcs_tools.pictures.quantities import (
    BY_TITLE,
    FROM_SETPOINT,
    OF_TRUTH,
    QUANTITIES,
    WHOLE,
    Quantity,
    ShownLimits,
)
from gcs_tools.recording.schema import FCU, TRUTH
from gcs_tools.recording.table import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (12.0, 11.0)  # inches
TITLE = 96  # characters of the title that fit into a line
LEAST = 0.1  # of what a log axis shows: what is less is drawn there, below it


def chart(axes: Axes, q: Quantity, flight: FlightHistory, settled_from_s: float) -> None:
    """A quantity over time: its lines, what they are held against, its limits."""
    axes.set_title(f"{q.title}, {q.unit}")
    for columns, style in ((q.asked, DOTTED), (q.truth, WIDE)):
        for name, colour in zip(columns, q.colours, strict=False):
            line(axes, *flight.flown(name), color=colour, **style)
    for label, colour, name, _ in q.lines:
        t, values = flight.flown(name)
        if q.logarithmic:
            logarithmic(axes, "y")
            values = np.maximum(values, LEAST * q.logarithmic)
        line(axes, t, values, color=colour, label=label)
    if q.truth and flight.has_values(q.truth):
        axes.plot([], [], color=MUTED, label=q.truth_is, **WIDE)
    if q.asked:
        axes.plot([], [], color=MUTED, label="setpoint", **DOTTED)
    if ends := q.limits(flight.limits):
        axes.plot([], [], label="limit", **DASHED)
        limits(axes, *ends)
        if ends[0] == -ends[1]:
            axes.set_yticks(np.linspace(*ends, 5))
    elif q.logarithmic:
        _settled(axes, q, flight, settled_from_s)
    else:
        low, high = axes.get_ylim()
        middle = 0.5 * (low + high)
        axes.set_ylim(min(low, middle - q.least / 2), max(high, middle + q.least / 2))
    legend(axes)


def _settled(axes: Axes, q: Quantity, flight: FlightHistory, from_s: float) -> None:
    """What a log axis shows of what has a size alone, and its RMS from `from_s` (s) on."""
    assert q.logarithmic is not None
    t, values = flight.flown(q.columns[0])
    greatest = float(values[np.isfinite(values)].max(initial=0.0))
    axes.set_ylim(q.logarithmic, max(q.least, 2.0 * greatest))
    settled = rms(values[t >= from_s])
    if settled is not None:
        label = f"settled RMS {settled:.3g} {q.unit}"
        ends = max(from_s, float(t[0])), float(t[-1])
        axes.hlines(max(settled, LEAST * q.logarithmic), *ends, color=Y, linewidth=1.6, label=label)


def distance(flight: FlightHistory) -> Quantity:
    """How far off it was: from the reference, or, of a law that has none, from the setpoint."""
    reference = BY_TITLE["Distance from the reference"]
    return reference if flight.shows(reference) else FROM_SETPOINT


def _overview(figure: Figure, flight: FlightHistory, settled_from_s: float, title: str) -> None:
    words = textwrap.fill(title, TITLE)
    figure.suptitle(words, x=0.012, ha="left", fontsize=13.0, fontweight="bold", color=INK)
    rows: list[list[Quantity | None]] = []
    if flight.tells(("outputs.T_c",)):
        own, shown = BY_TITLE["Distance from the reference"], distance(flight)
        quantities = tuple(shown if q is own else q for q in QUANTITIES)
    else:
        quantities = OF_TRUTH
    for q in quantities:
        if not q.axes or not flight.shows(q):
            continue
        if rows and rows[-1][1] is None and q.axes != WHOLE:
            rows[-1][1] = q
        else:
            rows.append([q, q if q.axes == WHOLE else None])
    if not rows:
        empty(figure.subplots(), "the law never flew")
        return
    places: list[Any] = [
        [q.title if q else "" for q in (left, right or left)] for left, right in rows
    ]
    grid = figure.subplot_mosaic(places, sharex=True)
    for q in quantities:
        if q.title in grid:
            chart(grid[q.title], q, flight, settled_from_s)
    for name in places[-1]:
        grid[name].set_xlabel(TIME)


def numbers(window: Window) -> Numbers:
    """How the flight went. Raises Missing."""
    names: tuple[str, ...] = ("setpoint_error_rms_settled_m", "setpoint_error_final_m", "energy_j")
    window.t  # noqa: B018  what the figure needs
    if window.tells:
        window.told  # noqa: B018  this too
        names = (
            "reference_error_rms_settled_m", "reference_error_max_m", "setpoint_error_final_m",
            "setpoint_error_rms_settled_m", "thrust_saturated_fraction", "tilt_saturated_fraction",
        )  # fmt: skip
    return {name: window.flight.metric(name) for name in names}


def answer(found: Numbers) -> str:
    """In one line."""
    if "energy_j" in found:
        return (
            f"off the setpoint {length(found['setpoint_error_rms_settled_m'])} settled RMS, "
            f"{length(found['setpoint_error_final_m'])} at the end; "
            f"{said(found['energy_j'], 'J')} drawn from the battery"
        )
    settled = f"settled RMS {length(found['reference_error_rms_settled_m'])} off the reference"
    if found["reference_error_max_m"] is None:
        off = length(found["setpoint_error_rms_settled_m"])
        settled = f"no reference model; settled RMS {off} off the setpoint"
    return (
        f"{settled}, at the end {length(found['setpoint_error_final_m'])} off the setpoint, "
        f"thrust at a limit {percent(found['thrust_saturated_fraction'])} of the time, "
        f"tilt {percent(found['tilt_saturated_fraction'])}"
    )


def draw(figure: Figure, window: Window, _found: Numbers) -> None:
    """The overview of a window."""
    title = window.metadata.get("title", "A flight")
    _overview(figure, window.history, window.flight.settle_from_s, title)


def flight_figure(
    plant: Table, fcu: Table, params: Mapping[str, float], title: str, path: Path,
    settle_from_s: float | None = None,
) -> None:  # fmt: skip
    """Draw a flight as a PNG at `path`.

    plant : the truth.  fcu : what the controller and its law, whichever, told of each tick.
    params : the law's by name, as recorded (`law.limits.T_max`), of which the limits are taken.
    settle_from_s : as for metrics.EngagedTicks.  Raises OSError if it cannot be written.
    """
    # here, not above: matplotlib takes longer to import than all else of a command
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    flown = EngagedTicks.of(plant, fcu, settle_from_s)
    flight = FlightHistory.of(title, {TRUTH: flown.plant, FCU: flown.fcu}, ShownLimits.of(params))
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE, layout=ConstrainedLayoutEngine(h_pad=0.09, w_pad=0.12))
        _overview(figure, flight, flown.settle_from_s, title)
        picture = BytesIO()
        figure.savefig(picture, format="png", dpi=110)
    whole_file.write(path, picture.getvalue())
