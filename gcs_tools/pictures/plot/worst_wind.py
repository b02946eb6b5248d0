"""The figure of `gcs envelope --worst-wind`: the room before each limit along the flight that brings it nearest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gcs_tools.pictures.plot import style

Rows = np.ndarray[Any, np.dtype[np.float64]]


class History(Protocol):
    """One limit along a flight, as `gcs_tools.gusts.survey.histories` makes it."""

    @property
    def limit(self) -> str: ...  # noqa: D102
    @property
    def t(self) -> Rows: ...  # noqa: D102
    @property
    def still(self) -> Rows: ...  # noqa: D102
    @property
    def room(self) -> Rows: ...  # noqa: D102
    @property
    def air(self) -> Rows: ...  # noqa: D102
    @property
    def at_s(self) -> float: ...  # noqa: D102
    @property
    def words(self) -> str: ...  # noqa: D102


def save(title: str, from_s: float, histories: Sequence[History], path: Path) -> None:
    """Draw a column for each limit: its room above, the wind below.  from_s : judged from then on. Raises OSError."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(style.STYLE):
        figure = Figure(figsize=(3.1 * len(histories), 5.2), layout="constrained")
        axes = figure.subplots(2, len(histories), sharex=True, sharey="row", squeeze=False)
        for (above, below), of in zip(axes.T, histories, strict=True):
            above.axvspan(0.0, from_s, color="0.93", lw=0)
            above.plot(of.t, of.still, color=style.MUTED, label="still air")
            above.plot(of.t, of.room, color=style.INK, label="worst wind")
            above.axhline(0.0, **style.DASHED)
            k = int(np.argmin(np.where(of.t >= from_s, of.room, np.inf)))
            above.plot(of.t[k], of.room[k], "o", color=style.LIMIT, markersize=4)
            above.annotate(
                f"{math.floor(10.0 * of.room[k]) / 10.0:.1f} N", (of.t[k], of.room[k]), (6, -3), textcoords="offset points",
                color=style.LIMIT, va="top", bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 1.0},
            )  # fmt: skip
            above.set(title=f"{of.limit.replace('_', ' ')}\n{of.words}")
            for axis, colour, name in zip(
                of.air.T, style.THREE, ("east", "north", "up"), strict=True
            ):
                below.plot(of.t, axis, color=colour, label=name)
            below.set(xlabel="time, s", xlim=(0.0, float(of.t[-1])))
        low = min(float(of.room[of.t >= from_s].min(initial=0.0)) for of in histories)
        high = max(float(of.still[of.t >= from_s].max(initial=1.0)) for of in histories)
        axes[0, 0].set(ylabel="room before the limit, N", ylim=(1.2 * low - 8.0, 1.1 * high))
        axes[1, 0].set(ylabel="velocity of the air, m/s")
        axes[0, 0].legend(loc="lower right")
        axes[1, 0].legend(loc="upper right", ncols=3)
        figure.suptitle(title)
        style.save(figure, path)
