"""The overview: where a flight went, what it asked of the vehicle, what it learned of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fcu.kernel.buffers import columns
from fcu.settings import Settings
from fcu.tick import Tick
from gcs_tools.judging.metrics import EngagedTicks
from gcs_tools.pictures.plot.numbers import Numbers, length, percent
from gcs_tools.pictures.plot.style import (
    DASHED,
    DOTTED,
    INK,
    MUTED,
    STYLE,
    THREE,
    TIME,
    WIDE,
    X,
    Y,
    legend,
    limits,
    line,
    logarithmic,
)
from gcs_tools.pictures.plot.window import ENU, Window
from gcs_tools.recording.table import Rows, Table
from sitl_plant.physics.types import PlantRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (12.0, 11.0)  # inches


def _position(axes: Axes, plant: Table, fcu: Table) -> None:
    axes.set_title("Position, m")
    t = fcu["t"]
    for colour, r_c in zip(THREE, fcu.axes("setpoint.r_c"), strict=True):
        line(axes, t, r_c, color=colour, **DOTTED)
    for colour, r_m in zip(THREE, fcu.axes("outputs.reference.r_m"), strict=True):
        line(axes, t, r_m, color=colour, **WIDE)
    for name, colour, r in zip(ENU, THREE, plant.axes("state.r_E"), strict=True):
        line(axes, t, r, color=colour, label=name)
    axes.plot([], [], color=MUTED, label="reference", **WIDE)
    axes.plot([], [], color=MUTED, label="setpoint", **DOTTED)
    legend(axes)


def distance(axes: Axes, flight: EngagedTicks) -> None:
    """On a log scale: from the metres of a start to the millimetres of a settled flight."""
    axes.set_title("Distance from the reference, m")
    t, error = flight.t, flight.position_error
    logarithmic(axes, "y")
    greatest = flight.metric("position_max_m")
    axes.set_ylim(1e-3, max(1.0, 2.0 * (greatest or 0.0)))
    line(axes, t, np.maximum(error, 1e-4), color=INK, linewidth=0.8)
    rms = flight.metric("position_rms_settled_m")
    if rms is not None:
        start = max(flight.settle_from_s, float(t[0]))
        label = f"settled RMS {rms:.3g} m"
        axes.hlines(max(rms, 1e-4), start, t[-1], color=Y, linewidth=1.6, label=label)
        legend(axes)


def _thrust(axes: Axes, fcu: Table, params: dict[str, float]) -> None:
    axes.set_title("Thrust, N")
    line(axes, fcu["t"], fcu["outputs.T_achieved"], color=MUTED, label="achieved", **WIDE)
    line(axes, fcu["t"], fcu["outputs.T_c"], color=X, label="commanded")
    axes.plot([], [], label="limit", **DASHED)
    limits(axes, params["law.limits.T_min"], params["law.limits.T_max"])
    legend(axes)


def _tilt(axes: Axes, fcu: Table, params: dict[str, float]) -> None:
    axes.set_title("Commanded tilt, degrees")
    angles = fcu.axes("outputs.angles_c", "xy")
    for name, colour, angle in zip(("roll", "pitch"), THREE, angles, strict=False):
        line(axes, fcu["t"], np.degrees(angle), color=colour, label=name)
    axes.plot([], [], label="limit", **DASHED)
    limit = float(np.degrees(params["law.limits.phi_star"]))
    limits(axes, -limit, limit)
    axes.set_yticks([-limit, -limit / 2, 0.0, limit / 2, limit])
    legend(axes)


def learned(
    axes: Axes, title: str, t: Rows, lines: list[tuple[str, Rows, Rows]], least: float = 0.0
) -> None:
    """Lines of (name, estimate, truth); at least `least` of the quantity is shown."""
    axes.set_title(title)
    for (_, _, truth), colour in zip(lines, THREE, strict=False):
        line(axes, t, truth, color=colour, **WIDE)
    for (name, estimate, _), colour in zip(lines, THREE, strict=False):
        line(axes, t, estimate, color=colour, label=name)
    axes.plot([], [], color=MUTED, label="truth", **WIDE)
    low, high = axes.get_ylim()
    middle = 0.5 * (low + high)
    axes.set_ylim(min(low, middle - least / 2), max(high, middle + least / 2))
    legend(axes)


def drag_over_mass(
    plant: Table, fcu: Table, told: dict[str, float]
) -> list[tuple[str, Rows, Rows]]:
    """(axis, s_v_hat, its truth), m/s^2, E. As printed, s_v_hat has to find gravity too."""
    down = (0.0, 0.0, told["law.g"] if told["law.achieved"] < 0.5 else 0.0)
    found = zip(ENU, fcu.axes("state.estimates.s_v_hat"), plant.axes("f_D_E"), down, strict=True)
    return [(name, s_hat, f_D / plant["m"] - g) for name, s_hat, f_D, g in found]


def inertia(plant: Table, fcu: Table) -> list[tuple[str, Rows, Rows]]:
    """(axis, J_hat, J), kg m^2, B."""
    return list(zip("xyz", fcu.axes("state.estimates.J_hat"), plant.axes("J"), strict=True))


def _overview(figure: Figure, flight: EngagedTicks, told: dict[str, float], title: str) -> None:
    true, fcu = flight.plant, flight.fcu
    grid = figure.subplot_mosaic(
        [["position", "error"], ["thrust", "tilt"], ["drag", "drag"], ["mass", "inertia"]],
        sharex=True,
    )
    figure.suptitle(title, x=0.012, ha="left", fontsize=13.0, fontweight="bold", color=INK)
    _position(grid["position"], true, fcu)
    distance(grid["error"], flight)
    _thrust(grid["thrust"], fcu, told)
    _tilt(grid["tilt"], fcu, told)
    learned(grid["drag"], "Drag force over mass, m/s²", flight.t, drag_over_mass(true, fcu, told))
    mass = [("estimate", fcu["state.estimates.m_hat"], true["m"])]
    learned(grid["mass"], "Mass, kg", flight.t, mass, 1.0)
    learned(grid["inertia"], "Inertia, kg m²", flight.t, inertia(true, fcu), 0.1)
    for name in ("mass", "inertia"):
        grid[name].set_xlabel(TIME)


def numbers(window: Window) -> Numbers:
    """How the flight went. Raises Missing."""
    names = (
        "position_rms_settled_m", "position_max_m", "thrust_saturated_fraction",
        "tilt_saturated_fraction",
    )  # fmt: skip
    window.t, window.told  # noqa: B018  what the figure needs
    return {name: window.flight.metric(name) for name in names}


def answer(found: Numbers) -> str:
    """In one line."""
    return (
        f"settled RMS {length(found['position_rms_settled_m'])}, "
        f"thrust at a limit {percent(found['thrust_saturated_fraction'])} of the time, "
        f"tilt {percent(found['tilt_saturated_fraction'])}"
    )


def draw(figure: Figure, window: Window, _found: Numbers) -> None:
    """The overview of a window."""
    _overview(figure, window.flight, window.told, window.metadata.get("title", "A flight"))


def flight_figure(
    plant: Rows, fcu: Rows, params: Rows, title: str, path: Path, settle_from_s: float | None = None
) -> None:
    """Draw a flight as a PNG at `path`.

    plant : float64 (n, size(PlantRecord)).  fcu : float64 (m, size(Tick)).
    params : float64 (size(Settings),), of which the limits are taken.
    settle_from_s : as for metrics.EngagedTicks.  Raises OSError if it cannot be written.
    """
    # here, not above: matplotlib takes longer to import than all else of a command
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    flight = EngagedTicks.of(Table.of(PlantRecord, plant), Table.of(Tick, fcu), settle_from_s)
    told = dict(zip(columns(Settings), params.tolist(), strict=True))
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE, layout=ConstrainedLayoutEngine(h_pad=0.09, w_pad=0.12))
        _overview(figure, flight, told, title)
        figure.savefig(path, format="png", dpi=110)
