"""One picture of a flight: where it went, what it asked of the vehicle, what it learned of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fcu.kernel.buffers import columns
from fcu.law.types import LawParams, Tick
from gcs_tools.metrics import Flight, Rows
from sitl_plant.physics.types import PlantRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS = 2000  # drawn of each line
X, Y, Z = "#0072b2", "#d55e00", "#009e73"  # told apart by colour-blind eyes too
THREE = (X, Y, Z)
MUTED, LIMIT, INK = "#a3a3a3", "#b22222", "#222222"
WIDE: dict[str, Any] = {"linewidth": 3.2, "alpha": 0.3}  # what a line is held against
DOTTED: dict[str, Any] = {"linewidth": 1.0, "linestyle": (0, (1, 2))}
DASHED: dict[str, Any] = {"color": LIMIT, "linewidth": 0.9, "linestyle": (0, (5, 3))}
_STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.titlepad": 7.0,
    "axes.edgecolor": "#c4c4c4",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.01,
    "grid.color": "#ececec",
    "grid.linewidth": 0.7,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.3,
    "legend.borderpad": 0.0,
}


class _Columns:
    """Rows whose columns are asked for by name."""

    def __init__(self, rows: Rows, cls: Any) -> None:
        self._rows = rows
        self._at = {name: i for i, name in enumerate(columns(cls))}

    def __getitem__(self, name: str) -> Rows:
        return self._rows[:, self._at[name]]

    def axes(self, name: str, of: str = "xyz") -> list[Rows]:
        """The components of a Vec3."""
        return [self[f"{name}.{axis}"] for axis in of]


def thin(t: Rows, y: Rows) -> tuple[Rows, Rows]:
    """At most about POINTS points of a line, the least and the greatest of every stretch."""
    stretch = 2 * -(-len(y) // POINTS)
    if stretch <= 2:
        return t, y
    whole = len(y) // stretch * stretch
    part = np.nan_to_num(y[:whole], nan=np.inf).reshape(-1, stretch)
    first = np.arange(0, whole, stretch)
    ends = np.stack([first + part.argmin(axis=1), first + part.argmax(axis=1)], axis=1)
    keep = np.concatenate([np.sort(ends, axis=1).ravel(), np.arange(whole, len(y))])
    return t[keep], y[keep]


def _line(axes: Axes, t: Rows, y: Rows, **style: Any) -> None:
    axes.plot(*thin(t, y), **style)


def _legend(axes: Axes) -> None:
    """One row above the axes, beside their title."""
    handles, _ = axes.get_legend_handles_labels()
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=max(1, len(handles)))


def _limits(axes: Axes, low: float, high: float) -> None:
    """Two limits as dashed lines, and room around them."""
    for level in (low, high):
        axes.axhline(level, zorder=1, **DASHED)
    margin = 0.08 * (high - low)
    axes.set_ylim(low - margin, high + margin)


def _position(axes: Axes, plant: _Columns, fcu: _Columns) -> None:
    axes.set_title("Position, m")
    t = fcu["t"]
    for colour, r_c in zip(THREE, fcu.axes("setpoint.r_c"), strict=True):
        _line(axes, t, r_c, color=colour, **DOTTED)
    for colour, r_m in zip(THREE, fcu.axes("internals.r_m"), strict=True):
        _line(axes, t, r_m, color=colour, **WIDE)
    for name, colour, r in zip(
        ("east", "north", "up"), THREE, plant.axes("state.r_E"), strict=True
    ):
        _line(axes, t, r, color=colour, label=name)
    axes.plot([], [], color=MUTED, label="reference", **WIDE)
    axes.plot([], [], color=MUTED, label="setpoint", **DOTTED)
    _legend(axes)


def _error(axes: Axes, flight: Flight) -> None:
    """On a log scale: from the metres of a start to the millimetres of a settled flight."""
    axes.set_title("Distance from the reference, m")
    t, error = flight.t, flight.position_error
    axes.set_yscale("log")
    _line(axes, t, np.maximum(error, 1e-4), color=INK, linewidth=0.8)
    rms = flight.metric("position_rms_settled_m")
    if rms is not None:
        start = max(flight.settle_from_s, float(t[0]))
        label = f"settled RMS {rms:.3g} m"
        axes.hlines(max(rms, 1e-4), start, t[-1], color=Y, linewidth=1.6, label=label)
        _legend(axes)
    greatest = flight.metric("position_max_m")
    axes.set_ylim(1e-3, max(1.0, 2.0 * (greatest or 0.0)))


def _thrust(axes: Axes, fcu: _Columns, params: dict[str, float]) -> None:
    axes.set_title("Thrust, N")
    _line(axes, fcu["t"], fcu["internals.T_achieved"], color=MUTED, label="achieved", **WIDE)
    _line(axes, fcu["t"], fcu["internals.T_c"], color=X, label="commanded")
    axes.plot([], [], label="limit", **DASHED)
    _limits(axes, params["T_min"], params["T_max"])
    _legend(axes)


def _tilt(axes: Axes, fcu: _Columns, params: dict[str, float]) -> None:
    axes.set_title("Commanded tilt, degrees")
    angles = fcu.axes("internals.angles_c", "xy")
    for name, colour, angle in zip(("roll", "pitch"), THREE, angles, strict=False):
        _line(axes, fcu["t"], np.degrees(angle), color=colour, label=name)
    axes.plot([], [], label="limit", **DASHED)
    limit = float(np.degrees(params["phi_star"]))
    _limits(axes, -limit, limit)
    axes.set_yticks([-limit, -limit / 2, 0.0, limit / 2, limit])
    _legend(axes)


def _learned(
    axes: Axes, title: str, t: Rows, lines: list[tuple[str, Rows, Rows]], least: float = 0.0
) -> None:
    """Lines of (name, estimate, truth); at least `least` of the quantity is shown."""
    axes.set_title(title)
    for (_, _, truth), colour in zip(lines, THREE, strict=False):
        _line(axes, t, truth, color=colour, **WIDE)
    for (name, estimate, _), colour in zip(lines, THREE, strict=False):
        _line(axes, t, estimate, color=colour, label=name)
    axes.plot([], [], color=MUTED, label="truth", **WIDE)
    low, high = axes.get_ylim()
    middle = 0.5 * (low + high)
    axes.set_ylim(min(low, middle - least / 2), max(high, middle + least / 2))
    _legend(axes)


def flight_figure(
    plant: Rows, fcu: Rows, params: Rows, title: str, path: Path, settle_from_s: float | None = None
) -> None:
    """Draw a flight as a PNG at `path`.

    plant : float64 (n, size(PlantRecord)).  fcu : float64 (m, size(Tick)).
    params : float64 (size(LawParams),), of which the limits are taken.
    settle_from_s : as for metrics.Flight.  Raises OSError if it cannot be written.
    """
    # here, not above: matplotlib takes longer to import than all else of a command
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    flight = Flight.of(plant, fcu, settle_from_s)
    told = dict(zip(columns(LawParams), params.tolist(), strict=True))
    true, shown = _Columns(flight.plant, PlantRecord), _Columns(flight.fcu, Tick)
    m = true["m"]
    drag = [
        (name, s_hat, f_D / m)
        for name, s_hat, f_D in zip(
            ("east", "north", "up"), shown.axes("state.s_v_hat"), true.axes("f_D_E"), strict=True
        )
    ]
    inertia = list(zip("xyz", shown.axes("state.J_hat"), true.axes("J"), strict=True))

    with rc_context(_STYLE):
        spacing = ConstrainedLayoutEngine(h_pad=0.09, w_pad=0.12)
        figure = Figure(figsize=(12.0, 11.0), layout=spacing)
        grid = figure.subplot_mosaic(
            [["position", "error"], ["thrust", "tilt"], ["drag", "drag"], ["mass", "inertia"]],
            sharex=True,
        )
        figure.suptitle(title, x=0.012, ha="left", fontsize=13.0, fontweight="bold", color=INK)
        _position(grid["position"], true, shown)
        _error(grid["error"], flight)
        _thrust(grid["thrust"], shown, told)
        _tilt(grid["tilt"], shown, told)
        _learned(grid["drag"], "Drag force over mass, m/s²", flight.t, drag)
        _learned(grid["mass"], "Mass, kg", flight.t, [("estimate", shown["state.m_hat"], m)], 1.0)
        _learned(grid["inertia"], "Inertia, kg m²", flight.t, inertia, 0.1)
        for name in ("mass", "inertia"):
            grid[name].set_xlabel("simulation time, s")
        figure.savefig(path, format="png", dpi=110)
