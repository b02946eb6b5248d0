"""Did it go where the reference went?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_tools.pictures.plot.numbers import Numbers, length
from gcs_tools.pictures.plot.overview import chart, distance
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
from gcs_tools.pictures.plot.window import Window
from gcs_tools.pictures.quantities import ENU, FROM_SETPOINT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE = (12.0, 9.0)  # inches
RESTS = 30  # setpoints that are drawn from above; more are a path, and the reference shows it
QUESTION = "Did it go where the reference went?"


def numbers(window: Window) -> Numbers:
    """Distances from the reference model (34), and from the setpoint. Raises Missing."""
    t, error = window.t, window.flight.reference_error
    finite = np.isfinite(error)
    worst_at = float(t[np.argmax(np.where(finite, error, -1.0))]) if finite.any() else None
    names = ("reference_error_rms_settled_m", "reference_error_max_m", "reference_error_final_m", "reference_error_rms_m",
             "setpoint_error_rms_settled_m", "setpoint_error_final_m")  # fmt: skip
    return {
        **{name: window.flight.metric(name) for name in names},
        "reference_error_max_at_s": worst_at,
        "settled_from_s": window.flight.settle_from_s,
    }


def answer(found: Numbers) -> str:
    """In one line."""
    settled, at = found["reference_error_rms_settled_m"], found["reference_error_max_at_s"]
    first = (
        "never settled" if settled is None else f"settled RMS {length(settled)} off the reference"
    )
    if at is None and (off := found["setpoint_error_rms_settled_m"]) is not None:
        first = f"no reference model; off the setpoint, settled RMS {length(off)}"
    worst = "" if at is None else f", worst {length(found['reference_error_max_m'])} at {at:.3g} s"
    return f"{first}{worst}; at the end {length(found['setpoint_error_final_m'])} off the setpoint"


def draw(figure: Figure, window: Window, _found: Numbers) -> None:
    """Position over time, from above, and the distance from the reference or else the setpoint."""
    error = distance(window.history)
    has_reference = error is not FROM_SETPOINT
    places: list[Any] = [*([name, "above"] for name in ENU), ["error", "error"]]
    heights = [1.0, 1.0, 1.0, 1.25]
    grid = figure.subplot_mosaic(places, width_ratios=[1.4, 1.0], height_ratios=heights)
    t, fcu = window.t, window.fcu
    flown = window.plant.axes("state.r_E")
    told = fcu.axes("setpoint.r_c")
    reference = fcu.axes("outputs.reference.r_m") if window.tells else [np.full(len(t), np.nan)] * 3
    for i, (name, colour) in enumerate(zip(ENU, THREE, strict=True)):
        axes = grid[name]
        if axes is not grid["up"]:
            axes.sharex(grid["up"])
        axes.tick_params(labelbottom=name == "up")
        axes.set_title(f"{name.capitalize()}, m")
        line(axes, t, told[i], color=INK, label="setpoint", **DOTTED)
        if has_reference:
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
    if has_reference:
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
    grid["error"].sharex(grid["up"])
    chart(grid["error"], error, window.history, window.flight.settle_from_s)
    grid["error"].set_xlabel(TIME)
