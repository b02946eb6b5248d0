"""Did both processes keep time?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs_tools.metrics import Rows
from gcs_tools.plot.drawing import DASHED, INK, THREE, TIME, X, Y, empty, legend, line
from gcs_tools.plot.numbers import Numbers
from gcs_tools.plot.shown import Columns, Missing, Shown
from gcs_tools.schema import PLANT_TIMING, TIMING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (12.0, 8.8)  # inches
QUESTION = "Did both processes keep time?"
MICRO = 1e6
BINS = 60
COUNTED = {  # what is counted so far: name in the figure -> (topic, column)
    "slips": ((PLANT_TIMING.name, "slips"),),
    "resent": ((PLANT_TIMING.name, "resent"), (TIMING.name, "resent")),
    "refused": ((TIMING.name, "refused"),),
    "rows_dropped": tuple(
        (topic, column)
        for topic in (PLANT_TIMING.name, TIMING.name)
        for column in ("unrecorded", "unpublished")
    ),
}


def _rows(shown: Shown, topic: str) -> Columns | None:
    rows = shown.reports.get(topic)
    return rows if rows is not None and len(rows) else None


def _count(shown: Shown, topic: str, column: str) -> tuple[Rows, Rows] | None:
    """Times, and how many came within the window up to each; None if not recorded."""
    rows = _rows(shown, topic)
    if rows is None:
        return None
    before = shown.before.get(topic)
    base = before[column][0] if before is not None and len(before) else 0.0
    return rows["t"], rows[column] - base


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


def numbers(shown: Shown) -> Numbers:
    """Wall times in microseconds, and what was counted in the window. Raises Missing."""
    fcu, plant = _rows(shown, TIMING.name), _rows(shown, PLANT_TIMING.name)
    if fcu is None and plant is None:
        raise Missing(
            f"neither {TIMING.name} nor {PLANT_TIMING.name} is in the recording"
            " (a flight in one process has no timing)"
        )
    none = np.empty(0)
    found = {
        **_quantiles(none if fcu is None else fcu["cycle"], "cycle"),
        **_quantiles(none if plant is None else plant["late"], "late"),
        "period_us": _period(shown),
    }
    for name, parts in COUNTED.items():
        counts = [c for part in parts if (c := _count(shown, *part)) is not None]
        found[name] = sum(float(count[-1]) for _, count in counts) if counts else None
    return found


def _period(shown: Shown) -> float | None:
    return None if shown.params is None else MICRO * shown.told["h"]


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


def notes(_shown: Shown) -> list[str]:
    """What to know when reading it."""
    return ["Wall times of the machine that flew: they differ from flight to flight."]


def draw(figure: Figure, shown: Shown, found: Numbers) -> None:
    """Series and histogram of cycle and lateness, and what was counted."""
    grid = figure.subplot_mosaic(
        [["cycle", "cycles"], ["late", "lates"], ["counts", "counts"]],
        width_ratios=[1.9, 1.0], height_ratios=[1.0, 1.0, 0.75],
    )  # fmt: skip
    for name in ("cycle", "late"):
        grid[name].sharex(grid["counts"])
        grid[name].tick_params(labelbottom=False)
    fcu, plant = _rows(shown, TIMING.name), _rows(shown, PLANT_TIMING.name)
    period = found["period_us"]
    grid["cycle"].set_title("Flight controller: state to answer, µs")
    grid["cycles"].set_title("Ticks by cycle time, µs")
    if fcu is None:
        _absent(grid["cycle"], grid["cycles"], f"{TIMING.name} is not in the recording")
    else:
        _spread(grid["cycle"], grid["cycles"], fcu["t"], MICRO * fcu["cycle"], X, period)
    grid["late"].set_title("Plant: start of a tick after its deadline, µs")
    grid["lates"].set_title("Ticks by lateness, µs")
    if plant is None:
        _absent(grid["late"], grid["lates"], f"{PLANT_TIMING.name} is not in the recording")
    elif np.isfinite(plant["late"]).any():
        _spread(grid["late"], grid["lates"], plant["t"], MICRO * plant["late"], Y, period)
    else:
        _absent(grid["late"], grid["lates"], "flown at full speed: there are no deadlines")
    _counts(grid["counts"], shown)
    grid["counts"].set_xlabel(TIME)


def _absent(series: Axes, histogram: Axes, why: str) -> None:
    empty(series, why)
    histogram.set_visible(False)


def _spread(
    series: Axes, histogram: Axes, t: Rows, values: Rows, colour: str, period: float | None
) -> None:
    """One wall time, as it went and as it is spread, on log scales."""
    values = np.maximum(values, 1.0)
    series.set_yscale("log")
    line(series, t, values, color=colour, linewidth=0.7)
    seen = values[np.isfinite(values)]
    low, high = float(seen.min()), max(float(seen.max()), 2.0)
    bins = np.geomspace(0.9 * low, 1.1 * high, BINS).tolist()
    histogram.hist(seen, bins=bins, color=colour, alpha=0.85)
    histogram.set_xscale("log")
    histogram.set_yscale("log")
    for share, style in ((0.5, "-"), (0.99, (0, (1, 1)))):
        at = float(np.quantile(seen, share))
        label = "median" if share == 0.5 else "99 %"
        histogram.axvline(at, color=INK, linewidth=1.2, linestyle=style, label=f"{label} {at:.0f}")
    if period is not None:
        series.axhline(period, label="control period", **DASHED)
        histogram.axvline(period, label="period", **DASHED)
        legend(series)
    legend(histogram)


def _counts(axes: Axes, shown: Shown) -> None:
    axes.set_title("Counted so far")
    words = {"rows_dropped": "rows dropped"}
    colours = (*THREE, INK)
    for (name, parts), colour in zip(COUNTED.items(), colours, strict=True):
        counts = [c for part in parts if (c := _count(shown, *part)) is not None]
        if not counts:
            continue
        t = np.unique(np.concatenate([at for at, _ in counts]))
        total = sum((_held(t, *count) for count in counts), np.zeros(len(t)))
        label = f"{words.get(name, name)} {total[-1]:.0f}"
        line(axes, t, total, color=colour, drawstyle="steps-post", label=label)
    low, high = axes.get_ylim()
    axes.set_ylim(min(0.0, low), max(high, 1.0))
    axes.yaxis.get_major_locator().set_params(integer=True)
    legend(axes)


def _held(t: Rows, at: Rows, values: Rows) -> Rows:
    """`values` at the last of `at` up to each t; nought before."""
    i = np.searchsorted(at, t, side="right") - 1
    return np.where(i >= 0, values[np.maximum(i, 0)], 0.0)
