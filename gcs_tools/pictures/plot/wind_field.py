"""The figure of `gcs wind show`: a plan and a section of a field of wind, with its buildings and a flight."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gcs_tools.pictures.plot import style

if TYPE_CHECKING:
    from gcs_tools.wind_fields.cut import Cut

ARROWS = 30  # across a picture


def save(title: str, planes: tuple[Cut, Cut], path: Path) -> None:
    """Draw both cuts, one below the other, in one colour scale of speed. Raises OSError."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    fastest = max(float(np.nanmax(of.speed, initial=0.1)) for of in planes)
    spans = [(np.ptp(of.b) + 0.1 * np.ptp(of.a)) / np.ptp(of.a) for of in planes]
    with mpl.rc_context(style.STYLE):
        height = min(max(8.6 * sum(spans) + 0.8, 4.0), 14.0)
        figure = Figure(figsize=(9.6, height), layout="constrained")
        subplots = figure.subplots(2, 1, height_ratios=spans)
        for axes, of in zip(subplots, planes, strict=True):
            axes.set_facecolor("#c9c9c9")  # of buildings, where there is no speed
            shown = axes.pcolormesh(
                of.a, of.b, of.speed, cmap="YlGnBu", vmin=0.0, vmax=fastest, shading="nearest",
                rasterized=True,
            )  # fmt: skip
            n = max(1, len(of.a) // ARROWS)
            m = max(1, round(n * np.ptp(of.a) / len(of.a) * len(of.b) / np.ptp(of.b)))
            axes.quiver(
                of.a[::n], of.b[::m], of.v_a[::m, ::n], of.v_b[::m, ::n], color=style.INK, alpha=0.7,
                angles="xy", scale=fastest * ARROWS / 1.2, scale_units="width", width=0.0014, headwidth=4.0,
            )  # fmt: skip
            if of.roofs is not None and np.ptp(of.roofs) > 0.0:
                axes.contour(
                    of.a,
                    of.b,
                    of.roofs,
                    levels=[of.roofs.min() + 0.5],
                    colors="white",
                    linewidths=0.9,
                )
            if len(of.path):
                axes.plot(*of.path.T, color=style.LIMIT, linewidth=1.8, label="flight")
                axes.plot(*of.path[0], "o", color=style.LIMIT, markersize=4)
                axes.legend(
                    loc="upper left", frameon=True, facecolor="white", framealpha=0.9, borderpad=0.4
                )
            axes.set(title=of.title, xlabel=of.axes[0], ylabel=of.axes[1], aspect="equal")
            axes.set(xlim=(of.a[0], of.a[-1]), ylim=(of.b[0], of.b[-1]))
            axes.grid(visible=False)
        figure.colorbar(
            shown,
            ax=subplots,
            label="speed of the air, m/s; grey: buildings in the plane, white lines: houses below it",
            shrink=0.6,
        )
        figure.suptitle(title)
        style.save(figure, path)
