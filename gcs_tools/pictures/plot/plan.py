"""A plan from above: its way, its items by number, its fence and its rally points."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from fcu.interface.files import whole_file
from gcs_tools.pictures.plot import style


class Outline(NamedTuple):
    """An area of a fence."""

    inclusion: bool
    corners: Sequence[tuple[float, float]]  # east and north, m


class Drawn(NamedTuple):
    """All that is drawn of a plan, about its home: east and north, m."""

    title: str
    way: Sequence[tuple[float, float]]
    items: Sequence[tuple[int, float, float]]  # number and place
    areas: Sequence[Outline]
    rally: Sequence[tuple[float, float]]
    flown: Sequence[tuple[float, float]] = ()  # the way of a flight


def draw(plan: Drawn, path: Path) -> None:
    """Draw a plan into a file: PNG, SVG or PDF. Raises OSError."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(style.STYLE):
        figure = Figure(figsize=(7.0, 7.0), layout="constrained")
        axes = figure.subplots()
        for area in plan.areas:
            round_it = [*area.corners, area.corners[0]]
            east, north = [x for x, _ in round_it], [y for _, y in round_it]
            if area.inclusion:
                axes.plot(east, north, color=style.Z, label="stay inside")
            else:
                axes.fill(east, north, color=style.LIMIT, alpha=0.25, label="stay outside")
        axes.plot([x for x, _ in plan.way], [y for _, y in plan.way], color=style.X, label="way")
        if len(plan.flown):
            axes.plot(*zip(*plan.flown, strict=True), color=style.INK, linewidth=1.0, label="flown")
        for number, x, y in plan.items:
            axes.plot([x], [y], "o", color=style.X, markersize=4.0)
            axes.annotate(str(number), (x, y), (4, 4), textcoords="offset points")
        axes.plot([0.0], [0.0], "^", color=style.INK, label="home")
        for x, y in plan.rally:
            axes.plot([x], [y], "s", color=style.Y, label="rally point")
        handles, labels = axes.get_legend_handles_labels()
        named = dict(zip(labels, handles, strict=True))
        figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=len(named))
        axes.set(aspect="equal", xlabel="east of home, m", ylabel="north of home, m")
        axes.set_title(plan.title)
        picture = io.BytesIO()
        figure.savefig(picture, format=path.suffix.removeprefix(".") or "png", dpi=150)
    whole_file.write(path, picture.getvalue())
