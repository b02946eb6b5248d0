"""What all figures are drawn with: one style, lines with their peaks, limits, legends.

Colour tells axes and quantities apart, width tells an estimate (thin) from what it is held
against (wide and pale), and dashed red is a limit, in every figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fcu.interface.files import whole_file
from gcs_tools.recording.table import Rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = 2000  # drawn of each line
GAP = 1.5  # of the usual step between samples: above it a line is broken
X, Y, Z = "#0072b2", "#d55e00", "#009e73"  # told apart by colour-blind eyes too
THREE = (X, Y, Z)
MUTED, LIMIT, INK, GREY = "#a3a3a3", "#b22222", "#222222", "#666666"
GOVERNED = "#cc9a00"  # where the guard steps in
WIDE: dict[str, Any] = {"linewidth": 3.2, "alpha": 0.3}  # what a line is held against
DOTTED: dict[str, Any] = {"linewidth": 1.0, "linestyle": (0, (1, 2))}
DASHED: dict[str, Any] = {"color": LIMIT, "linewidth": 0.9, "linestyle": (0, (5, 3))}
STYLE: Any = {
    "font.size": 9.0,
    "text.parse_math": False,  # a title may hold a $
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
    "svg.fonttype": "none",  # text stays text
    "pdf.fonttype": 42,
}
TIME = "simulation time, s"


def save(figure: Figure, path: Path, follow: bool = True) -> None:
    """Write a figure to a .png, .svg or .pdf, the same bytes each time, whole or not at all. Raises OSError.

    follow : as for whole_file.part.
    """
    kind, picture = path.suffix.lower().removeprefix("."), BytesIO()
    metadata = {"Software": None} if kind == "png" else None
    figure.savefig(picture, format=kind, dpi=110, metadata=metadata)
    whole_file.write(path, picture.getvalue(), follow)


def logarithmic(axes: Axes, *which: Literal["x", "y"]) -> None:
    """A log scale with plain numbers: powers of ten would be mathematical text, which is off.

    Ticks at 1, 2 and 5, so that an axis of less than a power of ten has some.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    for name in which:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(NullFormatter())


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


def broken(t: Rows, y: Rows) -> tuple[Rows, Rows]:
    """The same line with a NaN wherever samples are missing: nothing is drawn across a gap."""
    steps = np.diff(t)
    if len(steps) < 2:
        return t, y
    after = 1 + np.flatnonzero(steps > GAP * float(np.median(steps)))
    if not len(after):
        return t, y
    return np.insert(t, after, t[after - 1]), np.insert(y, after, np.nan)


def line(axes: Axes, t: Rows, y: Rows, **style: Any) -> None:
    """A line over time, thinned, and broken where samples are missing."""
    axes.plot(*thin(*broken(t, y)), **style)


def legend(axes: Axes) -> None:
    """One row above the axes, beside their title; none without anything to name."""
    if names := axes.get_legend_handles_labels()[1]:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(names))


def limits(axes: Axes, low: float, high: float) -> None:
    """Two limits as dashed lines, and room around them."""
    for level in (low, high):
        axes.axhline(level, zorder=1, **DASHED)
    margin = 0.08 * (high - low)
    axes.set_ylim(low - margin, high + margin)


def flagged(axes: Axes, t: Rows, flag: Rows, label: str, color: str = LIMIT) -> None:
    """A mark over the whole height wherever `flag` is up; in the legend only if it ever is."""
    up = flag > 0.5
    if up.any():
        axes.fill_between(
            t, 0.0, 1.0, where=up.tolist(), transform=axes.get_xaxis_transform(), color=color,
            alpha=0.15, linewidth=0.8, zorder=0, label=label,
        )  # fmt: skip


def note(axes: Axes, text: str) -> None:
    """A remark inside the axes, at the bottom right."""
    axes.annotate(
        text, (1.0, 0.0), (-4.0, 3.0), "axes fraction", "offset points", ha="right", va="bottom",
        fontsize=8.0, color=GREY, zorder=5,
        bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.0},
    )  # fmt: skip


def empty(axes: Axes, text: str) -> None:
    """Axes without data, and why."""
    axes.set_yticks([])
    axes.grid(False)
    axes.annotate(
        text, (0.5, 0.5), xycoords="axes fraction", ha="center", va="center", color=GREY
    )  # fmt: skip


def zoom(
    axes: Axes, t: Rows, lines: Sequence[Rows], from_s: float, least: float = 0.0, remark: str = ""
) -> None:
    """Show what `lines` do from `from_s` on; what went before is cut, and the cut is said.

    At least `least` of the quantity is shown; below it stays room for that and for the `remark`.
    """
    values = np.stack(lines)
    late = values[:, t >= from_s]
    late, whole = late[np.isfinite(late)], values[np.isfinite(values)]
    said = [remark] if remark else []
    if len(late):
        low, high = float(late.min()), float(late.max())
        middle = 0.5 * (low + high)
        half = max(0.6 * (high - low), 0.5 * least, 1e-6 * max(1.0, abs(middle)))
        bottom, top = middle - 1.25 * half, middle + half
        ends = [float(end) for end in (whole.min(), whole.max()) if not bottom <= end <= top]
        if ends:
            reached = " and ".join(f"{0.0 if abs(end) < 1e-3 * half else end:.3g}" for end in ends)
            said.append(f"before {from_s:.3g} s: to {reached}".replace("-", "−"))
        axes.set_ylim(bottom if said else middle - half, top)
    if said:
        note(axes, "; ".join(said))
