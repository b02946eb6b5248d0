"""Thrust and tilt against their limits: how close to saturation?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs_tools.pictures.plot.numbers import Numbers, finite, least, percent
from gcs_tools.pictures.plot.style import (
    DASHED,
    GOVERNED,
    MUTED,
    THREE,
    TIME,
    WIDE,
    X,
    Y,
    empty,
    flagged,
    legend,
    limits,
    line,
    note,
)
from gcs_tools.pictures.plot.window import Window
from gcs_tools.recording.table import Rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (12.0, 11.5)  # inches
QUESTION = "How close to saturation?"
MARGINS = ("margin_min_n", "margin_tilt_min_deg", "margin_condition_min_n", "governed_fraction")
ROTORS = [f"outputs.thrusts.r{i}" for i in range(1, 9)]


def _rotors(window: Window) -> Rows:
    """Allocated thrusts, N, (8, n)."""
    return np.stack([window.fcu[name] for name in ROTORS])


def _room(values: Rows, low: float, high: float) -> float | None:
    """The least distance from a limit, over the range between both; None without a number."""
    return least(np.minimum(values - low, high - values) / (high - low))


def numbers(window: Window) -> Numbers:
    """Least room left before each limit, over its range; and how often at it. Raises Missing."""
    told = window.told
    limit = told["law.limits.phi_star"]
    tilt = np.abs(np.stack(window.fcu.axes("outputs.angles_c", "xy"))).max(axis=0)
    thrust = window.fcu["outputs.T_c"]
    n = len(window.t)
    fractions = {
        f"{which}_saturated_fraction": float(
            np.sum(window.fcu[f"outputs.saturation.{which}"] > 0.5)
        )
        / n
        for which in ("thrust", "tilt", "rotor")
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


def answer(found: Numbers) -> str:
    """In one line."""
    parts = []
    for which, word in (("thrust", "thrust"), ("tilt", "tilt"), ("rotor", "rotors")):
        share = found[f"{which}_saturated_fraction"]
        at = f"at a limit {percent(share)} of the time" if share else "never at a limit"
        room = found[f"{which}_room_fraction"]
        left = "" if share or room is None else f" ({percent(room)} of its range left)"
        parts.append(f"{word} {at}{left}")
    return ", ".join(parts)


def draw(figure: Figure, window: Window, found: Numbers) -> None:
    """Total thrust, tilt and rotors over time, each between its limits; what the demand leaves."""
    thrust, tilt, rotors, margin = figure.subplots(4, 1, sharex=True)
    t, fcu, told = window.t, window.fcu, window.told

    thrust.set_title("Total thrust, N")
    line(thrust, t, fcu["outputs.T_achieved"], color=MUTED, label="achieved", **WIDE)
    line(thrust, t, fcu["outputs.T_c"], color=X, label="commanded")
    limits(thrust, told["law.limits.T_min"], told["law.limits.T_max"])
    _finish(thrust, window, "thrust", "at the limit")

    tilt.set_title("Roll and pitch, degrees")
    angles, commands = (fcu.axes(f"outputs.{name}", "xy") for name in ("angles", "angles_c"))
    for colour, angle in zip(THREE, angles, strict=False):
        line(tilt, t, np.degrees(angle), color=colour, **WIDE)
    for name, colour, angle in zip(("roll", "pitch"), THREE, commands, strict=False):
        line(tilt, t, np.degrees(angle), color=colour, label=f"{name} commanded")
    tilt.plot([], [], color=MUTED, label="flown", **WIDE)
    limit = float(np.degrees(told["law.limits.phi_star"]))
    limits(tilt, -limit, limit)
    tilt.set_yticks([-limit, -limit / 2, 0.0, limit / 2, limit])
    _finish(tilt, window, "tilt", "at the limit")

    rotors.set_title("Thrust of the eight rotors as allocated, N")
    each = _rotors(window)
    line(rotors, t, each.max(axis=0), color=THREE[1], linewidth=0.9, label="greatest of eight")
    line(rotors, t, each.mean(axis=0), color=MUTED, label="mean", **WIDE)
    line(rotors, t, each.min(axis=0), color=THREE[0], linewidth=0.9, label="least of eight")
    limits(rotors, told["law.rotors.f_min"], told["law.rotors.f_max"])
    _finish(rotors, window, "rotor", "gives up torque or thrust")
    _margin(margin, window, found)
    margin.set_xlabel(TIME)


def _margin(axes: Axes, window: Window, found: Numbers) -> None:
    axes.set_title("From the demanded force to the nearest limit, N")
    demand, condition = (window.fcu[f"guard.margin.{name}"] for name in ("force", "condition"))
    if not np.isfinite(demand).any():
        empty(axes, "not recorded")
        return
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


def _finish(axes: Axes, window: Window, which: str, flag: str) -> None:
    axes.plot([], [], label="limit", **DASHED)
    flagged(axes, window.t, window.fcu[f"outputs.saturation.{which}"], flag)
    legend(axes)
