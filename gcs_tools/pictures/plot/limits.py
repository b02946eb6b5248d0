"""Thrust and tilt against their limits: how close to saturation?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs_tools.pictures.plot.numbers import Numbers, finite, least, percent
from gcs_tools.pictures.plot.overview import chart
from gcs_tools.pictures.plot.style import (
    DASHED,
    GOVERNED,
    MUTED,
    THREE,
    TIME,
    WIDE,
    X,
    Y,
    flagged,
    legend,
    limits,
    line,
    note,
)
from gcs_tools.pictures.plot.window import Window
from gcs_tools.pictures.quantities import BY_TITLE, parts, rotors_of
from gcs_tools.recording.table import Rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (12.0, 11.5)  # inches
QUESTION = "How close to saturation?"
MARGINS = ("margin_min_n", "margin_tilt_min_deg", "margin_condition_min_n", "governed_fraction")


# what is cut, and the flags that tell it
CUT = {"thrust": ("thrust",), "tilt": ("tilt",), "torque": ("torque",), "yaw": ("yaw",), "rotor": ("torque", "yaw")}  # fmt: skip


NUMBERS = {4: "four", 5: "five", 6: "six", 7: "seven", 8: "eight"}


def _rotors(window: Window) -> Rows:
    """Allocated thrusts, N, (rotors, n), each over its weight: as the limits of all rotors are.

    NaN while a rotor stands, since it is lost: at 0 N, below the least thrust of a rotor that turns.
    """
    there = rotors_of(window.told)
    weights = [window.told.get(f"law.rotors.w.{r}", 1.0) for r in there]
    thrusts = [window.fcu[name] for name in parts("outputs.thrusts", there)]
    each = np.stack([f / w for f, w in zip(thrusts, weights, strict=True)])
    return np.where(each > 0.0, each, np.nan) if window.told["law.rotors.f_min"] > 0.0 else each


def _room(values: Rows, low: float, high: float) -> float | None:
    """The least distance from a limit, over the range between both; None without a number."""
    return least(np.minimum(values - low, high - values) / (high - low))


def numbers(window: Window) -> Numbers:
    """Least room left before each limit, over its range; and how often at it. Raises Missing."""
    told = window.told
    limit = told["law.limits.phi_star"]
    tilt = np.abs(np.stack(window.fcu.axes("outputs.angles_c", "xy"))).max(axis=0)
    thrust = window.fcu["outputs.T_c"]
    fractions = {
        f"{which}_saturated_fraction": _fraction(_cut(window, which), window.t) for which in CUT
    }
    return {
        "thrust_room_fraction": _room(thrust, told["law.limits.T_min"], told["law.limits.T_max"]),
        "tilt_room_fraction": least(1.0 - tilt / limit),
        "rotor_room_fraction": _room(
            _rotors(window), told["law.rotors.f_min"], told["law.rotors.f_max"]
        ),
        "thrust_max_n": window.flight.metric("thrust_max_n"),
        "thrust_limit_n": finite(told["law.limits.T_max"]),
        "tilt_max_deg": window.flight.metric("tilt_max_deg"),
        "tilt_limit_deg": finite(np.degrees(limit)),
        **{name: window.flight.metric(name) for name in MARGINS},
        **fractions,
    }


def _cut(window: Window, which: str) -> Rows:
    """1 at the ticks at which something was cut."""
    flags: Rows = np.fmax.reduce([window.fcu[f"outputs.saturation.{name}"] for name in CUT[which]])
    return flags


def _fraction(flags: Rows, t: Rows) -> float | None:
    """The part of the ticks (at times t) at which a flag is up; None if that is not known."""
    known = len(t) > 0 and not np.isnan(flags).any()
    return float(np.mean(flags > 0.5)) if known else None


def answer(found: Numbers) -> str:
    """In one line."""
    parts = []
    for which, word in (("thrust", "thrust"), ("tilt", "tilt"), ("rotor", "rotors")):
        share = found[f"{which}_saturated_fraction"]
        at = f"at a limit {percent(share)} of the time" if share else "never at a limit"
        at = "at a limit: not recorded" if share is None else at
        room = found[f"{which}_room_fraction"]
        left = "" if share or room is None else f" ({percent(room)} of its range left)"
        parts.append(f"{word} {at}{left}")
    return ", ".join(parts)


def draw(figure: Figure, window: Window, found: Numbers) -> None:
    """Total thrust, tilt and rotors over time, each between its limits; what the demand leaves."""
    has_margin = found["margin_min_n"] is not None
    thrust, tilt, rotors, *margin = figure.subplots(3 + has_margin, 1, sharex=True)
    t, fcu, told = window.t, window.fcu, window.told

    chart(thrust, BY_TITLE["Thrust"], window.history, window.flight.settle_from_s)
    _flag(thrust, window, "thrust", "at the limit")
    for colour, angle in zip(THREE, fcu.axes("outputs.angles", "xy"), strict=False):
        line(tilt, t, np.degrees(angle), color=colour, **WIDE)
    tilt.plot([], [], color=MUTED, label="flown", **WIDE)
    chart(tilt, BY_TITLE["Commanded tilt"], window.history, window.flight.settle_from_s)
    _flag(tilt, window, "tilt", "at the limit")

    each = _rotors(window)
    rotors.set_title(f"Thrust of the {NUMBERS[len(each)]} rotors as allocated, N")
    line(
        rotors,
        t,
        np.fmax.reduce(each),
        color=THREE[1],
        linewidth=0.9,
        label=f"greatest of {NUMBERS[len(each)]}",
    )
    turning = np.isfinite(each).sum(axis=0)
    mean = np.where(turning > 0, np.nansum(each, axis=0) / np.maximum(turning, 1), np.nan)
    line(rotors, t, mean, color=MUTED, label="mean", **WIDE)
    line(
        rotors,
        t,
        np.fmin.reduce(each),
        color=THREE[0],
        linewidth=0.9,
        label=f"least of {NUMBERS[len(each)]}",
    )
    limits(rotors, told["law.rotors.f_min"], told["law.rotors.f_max"])
    rotors.plot([], [], label="limit", **DASHED)
    _flag(rotors, window, "rotor", "gives up torque or thrust")
    for axes in margin:
        _margin(axes, window, found)
    figure.axes[-1].set_xlabel(TIME)


def _margin(axes: Axes, window: Window, found: Numbers) -> None:
    axes.set_title("From the demanded force to the nearest limit, N")
    demand, condition = (window.fcu[f"guard.margin.{name}"] for name in ("force", "condition"))
    line(axes, window.t, demand, color=X, label="demand")
    line(axes, window.t, condition, color=Y, label="whatever may come (condition)")
    axes.axhline(0.0, zorder=1, **DASHED)
    axes.plot([], [], label="limit", **DASHED)
    flagged(axes, window.t, window.fcu["guard.governed"], "governed", GOVERNED)
    legend(axes)
    left, governed = found["margin_min_n"], found["governed_fraction"]
    assert left is not None
    side = f"at least {left:.1f} N inside" if left >= 0.0 else f"up to {-left:.1f} N outside"
    note(
        axes, f"demand {side}" + (f", governed {percent(governed)} of the time" if governed else "")
    )


def _flag(axes: Axes, window: Window, which: str, flag: str) -> None:
    flagged(axes, window.t, _cut(window, which), flag)
    legend(axes)
