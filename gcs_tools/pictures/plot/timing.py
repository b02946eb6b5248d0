"""Did both processes keep time?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_tools.pictures.plot.numbers import Numbers
from gcs_tools.pictures.plot.style import (
    DASHED,
    INK,
    THREE,
    TIME,
    X,
    Y,
    empty,
    legend,
    line,
    logarithmic,
    note,
)
from gcs_tools.pictures.plot.window import Missing, Window
from gcs_tools.recording.schema import PLANT_TIMING, TIMING
from gcs_tools.recording.table import Rows, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (12.0, 8.8)  # inches
QUESTION = "Did both processes keep time?"
MICRO = 1e6
BINS = 60
LEAST_US = 1.0  # shown
COUNTED = {  # what is counted so far: name in the figure -> (topic, column)
    "slips": ((PLANT_TIMING, "slips"),),
    "resent": ((PLANT_TIMING, "resent"), (TIMING, "resent")),
    "refused": ((TIMING, "refused"),),
    "rows_dropped": tuple(
        (topic, column)
        for topic in (PLANT_TIMING, TIMING)
        for column in ("unrecorded", "unpublished")
    ),
}


def _rows(window: Window, topic: str) -> Table | None:
    rows = window.reports.get(topic)
    return rows if rows is not None and len(rows) else None


def _count(window: Window, topic: str, column: str) -> tuple[Rows, Rows] | None:
    """Times, and how many came within the window up to each; None if not recorded."""
    rows = _rows(window, topic)
    if rows is None:
        return None
    before = window.before.get(topic)
    base = before[f"timing.{column}"][0] if before is not None and len(before) else 0.0
    return rows["t"], rows[f"timing.{column}"] - base


def _quantiles(values: Rows, name: str) -> Numbers:
    seen = values[np.isfinite(values)]
    if not len(seen):
        return {f"{name}_{key}_us": None for key in ("median", "p99", "max")}
    median, high = np.quantile(seen, (0.5, 0.99))
    return {
        f"{name}_median_us": MICRO * float(median),
        f"{name}_p99_us": MICRO * float(high),
        f"{name}_max_us": MICRO * float(seen.max()),
    }


def numbers(window: Window) -> Numbers:
    """Wall times in microseconds, and what was counted in the window. Raises Missing."""
    fcu, plant = _rows(window, TIMING), _rows(window, PLANT_TIMING)
    if fcu is None and plant is None:
        raise Missing(
            f"neither {TIMING} nor {PLANT_TIMING} is in the recording"
            " (a flight in one process has no timing)"
        )
    none = np.empty(0)
    found = {
        **_quantiles(none if fcu is None else fcu["timing.cycle"], "cycle"),
        **_quantiles(none if plant is None else plant["timing.late"], "late"),
        "period_us": _period(window),
    }
    for name, parts in COUNTED.items():
        counts = [c for part in parts if (c := _count(window, *part)) is not None]
        found[name] = sum(float(count[-1]) for _, count in counts) if counts else None
    return found


def _period(window: Window) -> float | None:
    """Wall time from one tick to the next, us: as paced, or of real time for a flight that is not."""
    plant = _rows(window, PLANT_TIMING)
    if plant is not None and np.isfinite(plant["timing.late"]).sum() > 1:
        between, ticks = (
            np.median(np.diff(plant[f"timing.{name}"])) for name in ("published", "sequence")
        )
        return MICRO * float(between / max(1.0, ticks))  # a light recording leaves ticks out
    return None if window.params is None else MICRO * window.told["law.h"]


def answer(found: Numbers) -> str:
    """In one line."""
    parts = []
    if found["cycle_median_us"] is not None:
        of = "" if found["period_us"] is None else f" of {found['period_us']:.0f}"
        parts.append(
            f"cycle median {found['cycle_median_us']:.0f} µs, 99 % within "
            f"{found['cycle_p99_us']:.0f}, longest {found['cycle_max_us']:.0f}{of}"
        )
    if found["late_max_us"] is not None:
        parts.append(f"late at most {found['late_max_us']:.0f} µs")
    elif found["slips"] is not None:
        parts.append("at full speed, without deadlines")
    for name, words in (("slips", "slips"), ("rows_dropped", "rows dropped")):
        if found[name] is not None:
            parts.append(f"{words} {found[name]:.0f}")
    return ", ".join(parts)


def notes(window: Window) -> list[str]:
    """What to know when reading it."""
    said = ["Wall times of the machine that flew: they differ from flight to flight."]
    for topic in (TIMING, PLANT_TIMING):
        if _rows(window, topic) is None:
            said.append(f"{topic} is not in the recording.")
    plant = _rows(window, PLANT_TIMING)
    if plant is not None and not np.isfinite(plant["timing.late"]).any():
        said.append(
            "Flown at full speed: there are no deadlines to be late for; time from tick to tick is "
            "that of real time."
        )
    return said


def draw(figure: Figure, window: Window, found: Numbers) -> None:
    """Series and histogram of cycle and lateness, and what was counted."""
    measured = []
    for topic, column, title, colour in (
        (TIMING, "cycle", "Flight controller: from state to answer, µs", X),
        (PLANT_TIMING, "late", "Plant: start of a tick after its deadline, µs", Y),
    ):
        rows = _rows(window, topic)
        if rows is not None and np.isfinite(values := rows[f"timing.{column}"]).any():
            measured.append((column, title, colour, rows["t"], MICRO * values))
    layout: list[Any] = [[column, f"{column} spread"] for column, *_ in measured]
    grid = figure.subplot_mosaic(
        [*layout, ["counts", "counts"]],
        width_ratios=[1.9, 1.0],
        height_ratios=[
            *(1.0 for _ in measured),
            0.6 if any(found[name] for name in COUNTED) else 0.2,
        ],
    )
    for column, title, colour, t, values in measured:
        series, histogram = grid[column], grid[f"{column} spread"]
        series.set_title(title)
        series.set_xlim(*_span(t))
        histogram.set_title("Ticks by time, µs")
        _spread(series, histogram, t, values, colour, found["period_us"])
    _counts(grid["counts"], window)
    grid["counts"].set_xlabel(TIME)


def _spread(
    series: Axes, histogram: Axes, t: Rows, values: Rows, colour: str, period: float | None
) -> None:
    """One wall time, as it went and as it is spread, on log scales."""
    if (values < LEAST_US).any():
        values = np.maximum(values, LEAST_US)
        note(series, f"below {LEAST_US:g} µs is shown as {LEAST_US:g} µs")
    logarithmic(series, "y")
    line(series, t, values, color=colour, linewidth=0.7)
    seen = values[np.isfinite(values)]
    low, high = float(seen.min()), max(float(seen.max()), 2.0)
    bins = np.geomspace(0.9 * low, 1.1 * high, BINS).tolist()
    histogram.hist(seen, bins=bins, color=colour, alpha=0.6)
    logarithmic(histogram, "x", "y")
    for share, words, style in ((0.5, "median", "-"), (0.99, "99 %:", (0, (1, 1)))):
        at = float(np.quantile(seen, share))
        histogram.axvline(at, color=INK, linewidth=1.2, linestyle=style, label=f"{words} {at:.0f}")
    legend(histogram)
    if period is not None:
        series.axhline(period, label="time from tick to tick", **DASHED)
        histogram.axvline(period, **DASHED)
        legend(series)


def _span(t: Rows) -> tuple[float, float]:
    """What a time axis shows: a little more than there is, so that ends are seen."""
    room = 0.01 * max(float(t[-1] - t[0]), 0.1)
    return float(t[0]) - room, float(t[-1]) + room


def _counts(axes: Axes, window: Window) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.set_title("Counted so far")
    found = {}
    for name, parts in COUNTED.items():
        counts = [c for part in parts if (c := _count(window, *part)) is not None]
        if counts:
            t = np.unique(np.concatenate([at for at, _ in counts]))
            found[name] = t, sum((_held(t, *count) for count in counts), np.zeros(len(t)))
    if not any(total.any() for _, total in found.values()):
        words = ", ".join(name.replace("_", " ") for name in found)
        empty(axes, f"none of: {words}")
    for (name, (t, total)), colour in zip(found.items(), (*THREE, INK), strict=False):
        label = f"{name.replace('_', ' ')} {total[-1]:.0f}"
        if total.any():
            line(axes, t, total, color=colour, drawstyle="steps-post", label=label)
        axes.set_xlim(*_span(t))
    if axes.get_legend_handles_labels()[0]:
        axes.set_ylim(0.0, None)
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        legend(axes)


def _held(t: Rows, at: Rows, values: Rows) -> Rows:
    """`values` at the last of `at` up to each t; nought before."""
    i = np.searchsorted(at, t, side="right") - 1
    return np.where(i >= 0, values[np.maximum(i, 0)], 0.0)
