"""The map of a campaign: a panel for all flights, and one for each value of a quantity."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gcs_tools.pictures.plot import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
Numbers = np.ndarray[Any, np.dtype[np.float64]]
Flags = np.ndarray[Any, np.dtype[np.bool_]]

ACROSS = 4  # small panels in a row
WIDTH = 9.6  # inches
MOST_SHADES = 12
NONE = "#d9d9d9"  # nothing succeeds there


class Axis(NamedTuple):
    """One of the two quantities."""

    label: str
    edges: Numbers  # of the cells; of words 0, 1, ...
    words: tuple[str, ...]  # of each cell; empty: numbers


class Panel(NamedTuple):
    """The cells of some flights."""

    title: str
    cells: Numbers  # (up, across): share, or greatest value; not a number: no flight
    none: (
        Flags  # (up, across): not a flight of the cell succeeds; with up_to: the least value fails
    )


class Drawn(NamedTuple):
    """A map as numbers."""

    across: Axis
    up: Axis
    label: str  # of the cells' values
    levels: tuple[float, ...]  # values that cells can have; empty: any of the span
    span: tuple[float, float]  # least and greatest
    panels: tuple[Panel, ...]


class Roofs(NamedTuple):
    """Buildings below a map of places."""

    x: Numbers  # (n,): edges of cells, in the units of the map
    y: Numbers  # (m,)
    top: Numbers  # (m - 1, n - 1): height, m


def save(title: str, of: Drawn, roofs: Roofs | None, path: Path) -> None:
    """Draw a map, in place of what is at `path`, be it a link. Raises OSError."""
    import matplotlib as mpl
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
    from matplotlib.figure import Figure

    shades = of.levels if 0 < len(of.levels) <= MOST_SHADES else ()
    norm: Any
    if shades:
        steps = np.array([*shades, shades[-1] + 1.0])
        edges = np.concatenate(([shades[0] - 1.0], 0.5 * (steps[1:-1] + steps[:-2]), [steps[-1]]))
        colours: Any = ListedColormap(mpl.colormaps["viridis"](np.linspace(0.12, 1.0, len(shades))))
        norm = BoundaryNorm(edges, len(shades))
    else:
        colours, norm = mpl.colormaps["viridis"], Normalize(*of.span)
    same = of.across.words == () and of.up.words == () and roofs is not None
    ratio = float(np.ptp(of.up.edges) / np.ptp(of.across.edges)) if same else 0.55
    few = of.panels[1:]
    rows = -(-len(few) // ACROSS)
    big, small = WIDTH * 0.86 * ratio, WIDTH / ACROSS * ratio
    with mpl.rc_context(style.STYLE):
        height = big + rows * (small + 0.34) + 1.0
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        grid = figure.add_gridspec(
            1 + rows, ACROSS, height_ratios=[big + 0.3, *[small + 0.34] * rows]
        )
        main = figure.add_subplot(grid[0, :])
        _draw(main, of, of.panels[0], roofs, colours, norm, same)
        main.set(xlabel=of.across.label, ylabel=of.up.label)
        if few:
            main.set_title(of.panels[0].title)
        for i, panel in enumerate(few):
            axes = figure.add_subplot(grid[1 + i // ACROSS, i % ACROSS])
            _draw(axes, of, panel, roofs, colours, norm, same)
            axes.set_title(panel.title, fontsize=8.5)
            axes.set(xticks=[], yticks=[])
        bar = figure.colorbar(
            ScalarMappable(norm, colours), ax=main, shrink=0.8, pad=0.01,
            ticks=list(shades) if shades else None,
        )  # fmt: skip
        if shades:
            middles = 0.5 * (norm.boundaries[1:] + norm.boundaries[:-1])
            bar.set_ticks(middles.tolist(), labels=[f"{value:g}" for value in shades])
            bar.ax.tick_params(length=0)
        bar.set_label(textwrap.fill(f"{of.label}; grey: none", 46), fontsize=8.5)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10.5)
        style.save(figure, path, follow=False)


def _draw(
    axes: Axes, of: Drawn, panel: Panel, roofs: Roofs | None, colours: Any, norm: Any, same: bool
) -> None:
    x, y = of.across.edges, of.up.edges
    axes.pcolormesh(x, y, np.where(panel.none, 1.0, np.nan), cmap=_one(NONE), shading="flat")
    cells = np.ma.masked_invalid(np.where(panel.none, np.nan, panel.cells))
    axes.pcolormesh(x, y, cells, cmap=colours, norm=norm, shading="flat", rasterized=True)
    if roofs is not None:
        _outlines(axes, roofs)
    for axis, words in ((axes.xaxis, of.across.words), (axes.yaxis, of.up.words)):
        if words:
            axis.set_ticks(np.arange(len(words)) + 0.5, labels=list(words))
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    if same:
        axes.set_aspect("equal")
    axes.grid(False)


def _one(colour: str) -> Any:
    from matplotlib.colors import ListedColormap

    return ListedColormap([colour])


def _outlines(axes: Axes, roofs: Roofs) -> None:
    """Walls: the edges between cells of different heights."""
    top = roofs.top
    for j, i in np.argwhere(np.abs(np.diff(top, axis=1)) > 0.5).tolist():
        axes.plot([roofs.x[i + 1]] * 2, roofs.y[j : j + 2], color=style.INK, linewidth=0.9)
    for j, i in np.argwhere(np.abs(np.diff(top, axis=0)) > 0.5).tolist():
        axes.plot(roofs.x[i : i + 2], [roofs.y[j + 1]] * 2, color=style.INK, linewidth=0.9)
