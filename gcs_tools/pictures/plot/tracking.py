"""Did it go where the reference went?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs_tools.pictures.plot.numbers import Numbers, length
from gcs_tools.pictures.plot.overview import distance
from gcs_tools.pictures.plot.style import (
    DOTTED,
    INK,
    MUTED,
    THREE,
    TIME,
    WIDE,
    X,
    broken,
    legend,
    line,
)
from gcs_tools.pictures.plot.window import ENU, Window

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = (12.0, 9.0)  # inches
RESTS = 30  # setpoints that are drawn from above; more are a path, and the reference shows it
QUESTION = "Did it go where the reference went?"


def numbers(window: Window) -> Numbers:
    """Distances from the reference model (34). Raises Missing."""
    t, error = window.t, window.flight.position_error
    finite = np.isfinite(error)
    worst_at = float(t[np.argmax(np.where(finite, error, -1.0))]) if finite.any() else None
    names = ("position_rms_settled_m", "position_max_m", "position_final_m", "position_rms_m")
    return {
        **{name: window.flight.metric(name) for name in names},
        "position_max_at_s": worst_at,
        "settled_from_s": window.flight.settle_from_s,
    }


def answer(found: Numbers) -> str:
    """In one line."""
    settled, at = found["position_rms_settled_m"], found["position_max_at_s"]
    first = "never settled" if settled is None else f"settled RMS {length(settled)}"
    worst = "" if at is None else f", worst {length(found['position_max_m'])} at {at:.3g} s"
    return first + worst


def draw(figure: Figure, window: Window, _found: Numbers) -> None:
    """Position over time, from above, and the distance from the reference."""
    grid = figure.subplot_mosaic(
        [["east", "above"], ["north", "above"], ["up", "above"], ["error", "error"]],
        width_ratios=[1.4, 1.0],
        height_ratios=[1.0, 1.0, 1.0, 1.25],
    )
    t, fcu = window.t, window.fcu
    flown = window.plant.axes("state.r_E")
    reference, told = fcu.axes("outputs.reference.r_m"), fcu.axes("setpoint.r_c")
    for i, (name, colour) in enumerate(zip(ENU, THREE, strict=True)):
        axes = grid[name]
        axes.sharex(grid["error"])
        axes.tick_params(labelbottom=name == "up")
        axes.set_title(f"{name.capitalize()}, m")
        line(axes, t, told[i], color=INK, label="setpoint", **DOTTED)
        line(axes, t, reference[i], color=colour, label="reference", **WIDE)
        line(axes, t, flown[i], color=colour, label="flown")
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, 0.5 * (low + high) - 0.5), max(high, 0.5 * (low + high) + 0.5))
        legend(axes)

    above = grid["above"]
    above.set_title("From above, m")
    above.set_xlabel("east")
    above.set_ylabel("north")
    (_, east), (_, north) = (broken(t, r) for r in reference[:2])
    above.plot(east, north, color=MUTED, label="reference", **WIDE)
    (_, east), (_, north) = (broken(t, r) for r in flown[:2])
    above.plot(east, north, color=INK, linewidth=0.9, label="flown")
    above.plot(flown[0][:1], flown[1][:1], color=INK, marker="o", linestyle="none", label="start")
    rests = np.unique(np.stack(told[:2]), axis=1)
    if rests.shape[1] <= RESTS:
        above.plot(*rests, color=X, marker="x", linestyle="none", label="setpoint")
    above.set_aspect("equal", adjustable="datalim")
    above.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, columnspacing=0.8,
                 handlelength=1.2)  # fmt: skip
    distance(grid["error"], window.flight)
    grid["error"].set_xlabel(TIME)
