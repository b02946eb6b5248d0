"""Velocity and rate prediction errors: does the predictor hold?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs_tools.pictures.plot.numbers import Numbers, finite, greatest, percent, rms, said
from gcs_tools.pictures.plot.style import (
    INK,
    THREE,
    TIME,
    Y,
    flagged,
    legend,
    line,
    logarithmic,
    zoom,
)
from gcs_tools.pictures.plot.window import Window
from gcs_tools.pictures.quantities import ENU
from gcs_tools.recording.table import Rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (12.0, 7.4)  # inches
QUESTION = "Does the predictor hold?"
V, W = "internals.prediction.v_til", "internals.prediction.w_til"
MILLI = 1e3  # m/s and rad/s are shown in thousandths
LEAST = 1e-6  # of them that a log scale shows


def _size(window: Window, name: str) -> Rows:
    """Euclidean norm at each tick."""
    x, y, z = window.fcu.axes(name)
    size: Rows = np.hypot(np.hypot(x, y), z)
    return size


def numbers(window: Window) -> Numbers:
    """RMS of what is settled, and the worst. Raises Missing."""
    found: Numbers = {}
    window.t  # noqa: B018  what the figure needs
    window.need("Velocity prediction error", "Rate prediction error")
    for name, key, unit in ((V, "velocity", "m_s"), (W, "rate", "rad_s")):
        size = _size(window, name)
        found[f"{key}_rms_settled_{unit}"] = rms(size[window.settled])
        found[f"{key}_max_{unit}"] = greatest(size)
    held = window.fcu["internals.flags.projected"] > 0.5
    found["projected_fraction"] = finite(float(np.mean(held)))
    found["settled_from_s"] = window.settled_from_s
    return found


def answer(found: Numbers) -> str:
    """In one line."""
    v, w = found["velocity_rms_settled_m_s"], found["rate_rms_settled_rad_s"]
    return (
        f"settled RMS {said(v and MILLI * v, 'mm/s')} and {said(w and MILLI * w, 'mrad/s')}, "
        f"projection holds an estimate {percent(found['projected_fraction'])} of the time"
    )


def notes(_shown: Window) -> list[str]:
    """What to know when reading it."""
    return ["Errors are measured minus predicted, (36) and (41), after each tick."]


def draw(figure: Figure, window: Window, found: Numbers) -> None:
    """The errors by axis, and their size on a log scale."""
    (v, v_size), (w, w_size) = figure.subplots(2, 2, sharex=True)
    _by_axis(v, window, V, "Velocity error ṽ, mm/s", ENU)
    _by_axis(w, window, W, "Body rate error ω̃, mrad/s", ("p", "q", "r"))
    _by_size(v_size, window, V, found["velocity_rms_settled_m_s"], "mm/s")
    _by_size(w_size, window, W, found["rate_rms_settled_rad_s"], "mrad/s")
    for axes in (w, w_size):
        axes.set_xlabel(TIME)


def _by_axis(axes: Axes, window: Window, name: str, title: str, of: tuple[str, ...]) -> None:
    axes.set_title(title)
    parts = [MILLI * part for part in window.fcu.axes(name)]
    for label, colour, part in zip(of, THREE, parts, strict=True):
        line(axes, window.t, part, color=colour, linewidth=0.9, label=label)
    zoom(axes, window.t, parts, window.settled_from_s)
    legend(axes)


def _by_size(axes: Axes, window: Window, name: str, settled: float | None, unit: str) -> None:
    axes.set_title(f"Size |{'ṽ' if name == V else 'ω̃'}|, {unit}")
    t, size = window.t, MILLI * _size(window, name)
    logarithmic(axes, "y")
    seen = size[np.isfinite(size) & (size > 0.0)]
    low, high = np.quantile(seen, (0.001, 1.0)).tolist() if len(seen) else (LEAST, 1.0)
    axes.set_ylim(max(LEAST, 0.5 * low), max(10.0 * LEAST, 3.0 * high))
    line(axes, t, np.maximum(size, LEAST), color=INK, linewidth=0.8)
    if settled is not None:
        label = f"settled RMS {said(MILLI * settled, unit)}"
        start = window.settled_from_s
        axes.hlines(max(MILLI * settled, LEAST), start, t[-1], color=Y, linewidth=1.6, label=label)
    flagged(axes, t, window.fcu["internals.flags.projected"], "an estimate held by projection")
    legend(axes)
