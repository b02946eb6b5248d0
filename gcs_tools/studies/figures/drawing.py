"""The paper's figures by name: each flight a column, each quantity a row, one scale a row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_tools.pictures.plot.style import DASHED, GREY, INK, LIMIT, STYLE, TIME
from gcs_tools.studies.figures import rows
from gcs_tools.studies.figures.cases import FigureFlight
from gcs_tools.studies.figures.numbers import QUANTITIES, ended
from gcs_tools.studies.figures.rows import Legend, Row

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

DPI = 100
SMALLER: Any = {
    "axes.titleweight": "normal", "axes.titlesize": 9.0, "axes.labelsize": 8.5,
}  # fmt: skip
COLUMN, ROW, REST = 4.6, 1.35, 1.3  # inches: a column's width, a row's height, all else's height


@dataclass(frozen=True)
class Figure:
    """One of the paper's figures, with its counterparts."""

    title: str
    group: str  # of flights
    rows: tuple[Row, ...]
    legend: Legend
    number: Callable[[FigureFlight], str]  # the one that matters, above a flight's column


def _said(group: str, key: str, flown: FigureFlight) -> str:
    """One number of the page's tables, as it stands there."""
    quantity = next(q for q in QUANTITIES[group] if q.key == key)
    return quantity.said(quantity.of(flown))


def _of(text: str, group: str) -> Callable[[FigureFlight], str]:
    """`text` with each {key} replaced by that number; how the flight ended, if it did not last."""

    def number(flown: FigureFlight) -> str:
        if flown.ended:
            return ended(flown)
        found = {q.key: _said(group, q.key, flown) for q in QUANTITIES[group]}
        return text.format_map(found)

    return number


def _limited(group: str, which: str) -> Callable[[FigureFlight], str]:
    """How long at a limit, over the whole flight and from a time on."""
    late = "2" if group == "fast" else "1"

    def number(flown: FigureFlight) -> str:
        whole, rest = (_said(group, f"{which}_at_limit{part}_percent", flown) for part in ("", f"_from_{late}_s"))  # fmt: skip
        return f"at a limit {whole} of the flight, {rest} from {late} s on"

    return number


def _figures() -> dict[str, Figure]:
    f_m, wrong, fast = "f_m = 1", "f_m = 1, wrong start", "f_m = 1.4"
    tracked = "RMS {reference_error_rms_m}, from 5 s on {reference_error_rms_settled_m}; there from {within_0_5_m_of_setpoint_s}"
    gone = "below 5 % of the first from {reference_error_gone_s}, last second {reference_error_final_m}"
    predicted = "from 5 s on, off the prediction by {velocity_prediction_rms_settled_mm_s} RMS"
    turning = "from 5 s on, off the prediction by {rate_prediction_rms_settled_mrad_s} RMS"
    made = [
        Figure(f"Position, {f_m}", "nominal", rows.POSITION, rows.SETPOINT, _of(tracked, "nominal")),
        Figure(f"Total thrust, {f_m}", "nominal", rows.THRUST, rows.FORCES, _limited("nominal", "thrust")),
        Figure(f"Euler angles, {f_m}", "nominal", rows.ANGLES, rows.TILTS, _limited("nominal", "tilt")),
        Figure(f"Velocity, {f_m}", "nominal", rows.VELOCITY, rows.PREDICTED, _of(predicted, "nominal")),
        Figure(f"Body rates, {f_m}", "nominal", rows.RATES, rows.TURNING, _of(turning, "nominal")),
        Figure(f"Position, {wrong}", "wrong_start", rows.WRONG, rows.FROM_WRONG, _of(gone, "wrong_start")),
        Figure(f"Total thrust, {wrong}", "wrong_start", rows.THRUST, rows.FORCES, _limited("wrong_start", "thrust")),
        Figure(f"Euler angles, {wrong}", "wrong_start", rows.ANGLES, rows.TILTS, _limited("wrong_start", "tilt")),
        Figure(f"Total thrust, {fast}", "fast", rows.THRUST, rows.FORCES, _limited("fast", "thrust")),
        Figure(f"Euler angles, {fast}", "fast", rows.ANGLES, rows.TILTS, _limited("fast", "tilt")),
        Figure(f"Position, {fast}", "fast", rows.LOST, rows.SETPOINT, _of(tracked, "fast")),
    ]  # fmt: skip
    return {f"figure-{i}": figure for i, figure in enumerate(made, start=1)}


FIGURES = _figures()


def write(path: Path, size: tuple[float, float], draw: Callable[[Picture], None]) -> None:
    """What `draw` puts on a picture of `size` (inches), as a PNG. Raises OSError."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure as Picture

    with rc_context({**STYLE, **SMALLER}):
        picture = Picture(figsize=size, layout="constrained")
        draw(picture)
        drawn = BytesIO()
        picture.savefig(drawn, format="png", dpi=DPI, metadata={"Software": None})
    path.write_bytes(drawn.getvalue())


def save(name: str, flights: Sequence[FigureFlight], path: Path) -> None:
    """Draw one of FIGURES of its flights, the same bytes for the same flights. Raises OSError."""
    what = FIGURES[name]
    size = (COLUMN * len(flights), ROW * sum(row.height for row in what.rows) + REST)
    title = f"Figure {name.removeprefix('figure-')}: {what.title}"
    write(path, size, lambda picture: _lay_out(picture, title, what, flights))


def _lay_out(picture: Picture, title: str, what: Figure, flights: Sequence[FigureFlight]) -> None:
    """Each flight a column with its number above, each quantity a row."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    heights = [row.height for row in what.rows]
    picture.suptitle(title, x=0.01, ha="left", fontsize=12.0, fontweight="bold", color=INK)
    grid = picture.subplots(
        len(heights), len(flights), sharey="row", squeeze=False, height_ratios=heights
    )
    for column, flown in zip(grid.T, flights, strict=True):
        column[0].set_title(what.number(flown))
        column[0].annotate(
            flown.case.title, (0.0, 1.0), (0.0, 20.0), "axes fraction", "offset points",
            fontsize=10.0, fontweight="bold", color=INK,
        )  # fmt: skip
        column[-1].set_xlabel(TIME)
        for axes, row in zip(column, what.rows, strict=True):
            _draw(axes, row, flown)
            axes.tick_params(labelbottom=axes is column[-1] or row.until is not None)
        if flown.ended:
            column[0].annotate(
                flown.ended, (float(flown.t[-1]), 0.5), (4.0, 0.0), ("data", "axes fraction"),
                "offset points", va="center", color=GREY,
            )  # fmt: skip
    for axes, row in zip(grid[:, 0], what.rows, strict=True):
        axes.set_ylabel(row.label)
    picture.align_ylabels(grid[:, 0])
    handles: list[Artist] = [Line2D([], [], label=label, **how) for label, how in what.legend]
    if any(how is DASHED for _, how in what.legend):
        handles.append(Patch(facecolor=LIMIT, alpha=0.15, label="at the limit"))
    picture.legend(handles=handles, loc="outside lower center", ncols=len(handles))


def _draw(axes: Axes, row: Row, flown: FigureFlight) -> None:
    """One row of one flight; what comes after the end of a flight that did not last is grey."""
    until = flown.duration_s if row.until is None else row.until
    if row.log:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    row.draw(axes, flown)
    axes.set_xlim(0.0, until)
    if row.until is None:
        axes.set_xticks(np.arange(0.0, until + 0.1, 5.0))
    if row.span:
        axes.set_ylim(*row.span)
    end = float(flown.t[-1])
    if flown.ended and end < until:
        axes.axvline(end, color=INK, linewidth=0.9)
        axes.axvspan(end, until, color="#f4f4f4", zorder=0)
