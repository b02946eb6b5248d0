"""The wind that the disturbance estimate stands for, against the true one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_tools.pictures.plot.numbers import Numbers, greatest, rms, said
from gcs_tools.pictures.plot.style import INK, MUTED, THREE, TIME, WIDE, Y, legend, line, zoom
from gcs_tools.pictures.plot.window import Missing, Window
from gcs_tools.recording.schema import WIND
from gcs_tools.recording.table import Rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = (12.0, 8.4)  # inches
QUESTION = "Is the wind known?"
START_S = 1.0  # from take-over: what the estimates still find is not counted


def error(t: Rows, estimate: Rows, truth: Rows, from_s: float) -> Numbers:
    """RMS of an estimated wind against the true one (m/s), from `from_s` on.

    t : s, (n,).  estimate, truth : velocity of the air, m/s, E, (n, 2) or more; east and north
    are looked at. Rows whose estimate is NaN (nothing was flying) do not count.
    """
    off = estimate[:, :2] - truth[:, :2]
    off = off[(t >= from_s - 1e-6) & ~np.isnan(off).any(axis=1)]
    return {
        "from_s": from_s,
        "east_rms_m_s": rms(off[:, 0]),
        "north_rms_m_s": rms(off[:, 1]),
        "horizontal_rms_m_s": rms(np.hypot(off[:, 0], off[:, 1])),
    }


def _both(window: Window) -> tuple[Rows, Rows, Rows]:
    """Times, estimates and truths (m/s, E) at the ticks that have both. Raises Missing."""
    t, told = window.t, window.report(WIND)
    window.need("Wind")
    _, ours, theirs = np.intersect1d(
        np.rint(t * 1e6), np.rint(told["t"] * 1e6), return_indices=True
    )
    if not len(ours):
        raise Missing(f"{WIND} has no tick in common with the truth")
    return t[ours], told["wind.v_air_E"][theirs], window.plant["v_air_E"][ours]


def numbers(window: Window) -> Numbers:
    """RMS errors, and the strongest true wind. Raises Missing."""
    t, estimate, truth = _both(window)
    return {
        **error(t, estimate, truth, max(window.taken_over_s + START_S, float(t[0]))),
        "true_max_m_s": greatest(np.hypot(truth[:, 0], truth[:, 1])),
    }


def answer(found: Numbers) -> str:
    """In one line."""
    return (
        f"horizontal RMS {said(found['horizontal_rms_m_s'], 'm/s')} "
        f"(east {said(found['east_rms_m_s'], 'm/s')}, north {said(found['north_rms_m_s'], 'm/s')}), "
        f"true wind up to {said(found['true_max_m_s'], 'm/s')}"
    )


def notes(window: Window) -> list[str]:
    """What the estimate assumes."""
    true = window.truth("plant.drag")
    here = "" if true is None else f" (true here: {', '.join(f'{c:g}' for c in true)} N/(m/s)²)"
    return [
        f"Assumes the drag coefficients that the flight controller believes{here}.",
        "The vertical wind is not estimated: an error of mass looks the same.",
    ]


def draw(figure: Figure, window: Window, found: Numbers) -> None:
    """East and north over time, and the distance between the two winds."""
    east, north, distance = figure.subplots(3, 1, sharex=True)
    t, estimate, truth = _both(window)
    start = found["from_s"] or 0.0
    for i, (axes, name) in enumerate(((east, "east"), (north, "north"))):
        axes.set_title(f"Velocity of the air, {name}, m/s")
        line(axes, t, truth[:, i], color=THREE[i], label="truth", **WIDE)
        line(axes, t, estimate[:, i], color=THREE[i], label="estimate")
        zoom(axes, t, [estimate[:, i], truth[:, i]], start, 1.0)
        legend(axes)
    off = np.hypot(*(estimate - truth)[:, :2].T)
    horizontal = found["horizontal_rms_m_s"]
    distance.set_title("Horizontal error, m/s")
    line(distance, t, off, color=INK, linewidth=0.8)
    if horizontal is not None and start < t[-1]:
        label = f"RMS {horizontal:.3g} m/s, from {start:g} s on"
        distance.hlines(horizontal, start, t[-1], color=Y, linewidth=1.6, label=label)
    if start > t[0]:
        end = min(start, float(t[-1]))
        style: dict[str, Any] = {"color": MUTED, "alpha": 0.2, "linewidth": 0.0, "zorder": 0}
        distance.axvspan(float(t[0]), end, label="not counted", **style)
    legend(distance)
    late = off[t >= start]
    distance.set_ylim(0.0, 1.25 * max(greatest(late) or 0.0, 0.1))
    distance.set_xlabel(TIME)
