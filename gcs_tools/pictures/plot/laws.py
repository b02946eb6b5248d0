"""How far off were several laws? Their errors in each mission, with intervals, in one figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from io import BytesIO
from typing import TYPE_CHECKING, NamedTuple

from gcs_tools.pictures.plot.overlays import COLOURS
from gcs_tools.pictures.plot.style import GREY, STYLE, legend, logarithmic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABOVE = 24.0  # points from the axes to their title, with the legend between


class Mark(NamedTuple):
    """A law on an airframe in a mission."""

    airframe: str
    mission: str
    law: str
    error_m: float  # not a number if no flight was left
    low_m: float
    high_m: float
    lost: int
    flights: int


def draw(marks: Sequence[Mark], kind: str = "png") -> bytes:
    """The picture: a panel an airframe, a column a mission, a colour a law."""
    from matplotlib import rc_context

    with rc_context(STYLE):
        picture = BytesIO()
        metadata = (
            {"Software": None} if kind == "png" else {"Date": None} if kind == "svg" else None
        )
        figure(marks).savefig(picture, format=kind, dpi=110, metadata=metadata)
    return picture.getvalue()


def figure(marks: Sequence[Mark]) -> Figure:
    """The same, as matplotlib has it; to be drawn in STYLE."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    airframes, missions, laws = (
        list(dict.fromkeys(getattr(mark, of) for mark in marks))
        for of in ("airframe", "mission", "law")
    )
    with rc_context(STYLE):
        width = max(6.5, 2.5 + 0.95 * len(missions), 0.5 + 0.9 * len(laws))
        drawn = Figure(figsize=(width, 0.6 + 3.7 * len(airframes)), layout="constrained")
        panels = drawn.subplots(len(airframes), 1, squeeze=False)[:, 0]
        for axes, airframe in zip(panels, airframes, strict=True):
            title = f"{airframe}: distance from the setpoint, RMS after the transient"
            axes.set_title(title, pad=ABOVE)
            axes.set_ylabel("m")
            logarithmic(axes, "y")
            for i, law in enumerate(laws):
                colour = COLOURS[i % len(COLOURS)]
                shift = 0.7 * ((i + 0.5) / len(laws) - 0.5)
                found = [m for m in marks if (m.airframe, m.law) == (airframe, law)]
                shown = [m for m in found if m.error_m > 0.0]
                x = [missions.index(m.mission) + shift for m in shown]
                y = [m.error_m for m in shown]
                ends = [[_reach(m, m.low_m) for m in shown], [_reach(m, m.high_m) for m in shown]]
                axes.errorbar(
                    x, y, yerr=ends, fmt="o", markersize=4, capsize=2, color=colour, label=law
                )
                for m in (m for m in found if m.lost):
                    at = missions.index(m.mission) + shift
                    axes.annotate(
                        f"{100.0 * m.lost / m.flights:.2g} %", (at, 0.99), color=colour, fontsize=7.0,
                        xycoords=("data", "axes fraction"), ha="center", va="top", rotation=90.0,
                    )  # fmt: skip
            names = [mission.replace("_", "\n") for mission in missions]
            axes.set_xticks(range(len(missions)), names)
            axes.set_xlim(-0.6, len(missions) - 0.4)
            axes.grid(False, axis="x")
            legend(axes)
        said = "Bars: 95 % intervals of the mean. Percentages at the top: flights that were lost."
        drawn.supxlabel(said, x=0.012, ha="left", fontsize=8.0, color=GREY)
    return drawn


def _reach(mark: Mark, end: float) -> float:
    return abs(end - mark.error_m) if math.isfinite(end) else 0.0
