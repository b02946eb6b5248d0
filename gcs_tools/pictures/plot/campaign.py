"""Figures of a campaign: how its interval shrank, its metrics, and which draws fail.

Each is an SVG without a header, to stand in a page.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from io import StringIO
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gcs_tools.pictures.plot.overlays import COLOURS
from gcs_tools.pictures.plot.style import GREY, INK, LIMIT, MUTED, STYLE, legend, logarithmic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Numbers = np.ndarray[Any, np.dtype[np.float64]]
Flags = np.ndarray[Any, np.dtype[np.bool_]]
Interval = Callable[[int, int], tuple[float, float]]  # of so many successes of so many flights

BINS = 40
PARTS = 12  # of equal numbers of flights, into which a drawn quantity is cut at most
LEAST = 40  # flights in each of them, where there are so many
POINTS = 120  # of a curve over flights
ACROSS = 3
WIDTH = 10.4  # inches: the page's
EDGES = (0.002, 0.998)  # what is beyond these quantiles is drawn at the edge of a histogram


class Panel(NamedTuple):
    """A drawn quantity of a law's flights."""

    name: str
    values: Sequence[Any]
    success: Flags


def shrinking(success: Mapping[str, Flags], interval: Interval) -> str:
    """The share of successful flights against the number of flights, with its interval."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.set_title("Successful flights, %, as they came")
        for i, (law, flags) in enumerate(success.items()):
            n = np.unique(np.geomspace(min(5, len(flags)), len(flags), POINTS).round().astype(int))
            count = np.cumsum(flags)[n - 1]
            ends = np.array([interval(int(c), int(k)) for c, k in zip(count, n, strict=True)])
            colour = COLOURS[i % len(COLOURS)]
            axes.fill_between(n, 100 * ends[:, 0], 100 * ends[:, 1], color=colour, alpha=0.16, linewidth=0)  # fmt: skip
            axes.plot(n, 100 * count / n, color=colour, label=law)
        logarithmic(axes, "x")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
        axes.set_xlabel("flights")
        axes.set_ylim(top=min(axes.get_ylim()[1], 101.0), bottom=max(axes.get_ylim()[0], -1.0))
        if len(success) > 1:
            legend(axes)

    return _svg(draw, 2.6)


def histograms(metrics: Mapping[str, Mapping[str, Numbers]]) -> str:
    """A panel a metric, a colour a law: how many flights have which value."""

    def draw(figure: Figure) -> None:
        for axes, (name, of_law) in zip(
            _panels(figure, len(metrics)), metrics.items(), strict=True
        ):
            axes.set_title(name)
            known = {law: values[np.isfinite(values)] for law, values in of_law.items()}
            together = np.concatenate(list(known.values()))
            if not len(together):
                continue
            low, high = np.quantile(together, EDGES)
            bins = np.linspace(low, high if high > low else low + 1.0, BINS + 1).tolist()
            for i, (law, values) in enumerate(known.items()):
                colour = COLOURS[i % len(COLOURS)]
                shown = np.clip(values, low, high)
                axes.hist(shown, bins, color=colour, alpha=0.28, linewidth=0)
                axes.hist(shown, bins, color=colour, histtype="step", linewidth=1.0, label=law)
            axes.set_yticks([])
            axes.grid(False, axis="y")
            axes.spines["left"].set_visible(False)
            if len(known) > 1:
                axes.legend(loc="upper right", fontsize=7.5)

    return _svg(draw, 1.75 * -(-len(metrics) // ACROSS))


def failures(panels: Sequence[Panel], interval: Interval) -> str:
    """Failed flights, %, over each quantity: parts of equal numbers of flights, with intervals."""

    def draw(figure: Figure) -> None:
        for axes, panel in zip(_panels(figure, len(panels)), panels, strict=True):
            axes.set_title(panel.name)
            if all(isinstance(value, str) for value in panel.values):
                _of_words(axes, panel, interval)
            else:
                _of_numbers(axes, panel, interval)
            axes.axhline(100.0 * float(np.mean(~panel.success)), color=MUTED, linewidth=0.9)
            axes.set_ylim(bottom=0.0)

    return _svg(draw, 2.0 * -(-len(panels) // ACROSS))


def _of_numbers(axes: Axes, panel: Panel, interval: Interval) -> None:
    values = np.array(panel.values, dtype=np.float64)
    order = np.argsort(values, kind="stable")
    parts = [
        part for part in np.array_split(order, min(PARTS, max(3, len(order) // LEAST))) if len(part)
    ]
    for part in parts:
        failed, n = int((~panel.success[part]).sum()), len(part)
        low, high = interval(failed, n)
        ends = float(values[part[0]]), float(values[part[-1]])
        axes.fill_between(ends, 100 * low, 100 * high, color=LIMIT, alpha=0.16, linewidth=0)
        axes.plot(ends, [100 * failed / n] * 2, color=LIMIT, linewidth=1.8)


def _of_words(axes: Axes, panel: Panel, interval: Interval) -> None:
    words = sorted(set(panel.values))
    of = np.array(panel.values, dtype=object)
    for i, word in enumerate(words):
        which = of == word
        failed, n = int((~panel.success[which]).sum()), int(which.sum())
        low, high = interval(failed, n)
        ends = i - 0.3, i + 0.3
        axes.fill_between(ends, 100 * low, 100 * high, color=LIMIT, alpha=0.16, linewidth=0)
        axes.plot(ends, [100 * failed / n] * 2, color=LIMIT, linewidth=1.8)
    axes.set_xticks(range(len(words)), words)


def effects(names: Sequence[str], effect: Sequence[float], is_clear: Sequence[bool]) -> str:
    """How far the values of failed flights are from those of the others, a bar a quantity."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.set_title("How much failed flights differ from the others, by quantity")
        at = np.arange(len(names))[::-1]
        colours = [LIMIT if clear else MUTED for clear in is_clear]
        axes.barh(at, effect, color=colours, height=0.62)
        for y, value in zip(at, effect, strict=True):
            axes.annotate(f"{value:.2f}", (value, y), (4, 0), textcoords="offset points", va="center", fontsize=8.0, color=GREY)  # fmt: skip
        axes.set_yticks(at, names, color=INK)
        axes.set_xlim(0.0, 1.0)
        axes.grid(False, axis="y")
        axes.tick_params(axis="y", length=0)

    return _svg(draw, 0.75 + 0.24 * len(names))


def _panels(figure: Figure, n: int) -> list[Axes]:
    rows = -(-n // ACROSS)
    axes = figure.subplots(rows, ACROSS, squeeze=False).ravel().tolist()
    for each in axes[n:]:
        each.set_visible(False)
    return list(axes[:n])


def _svg(draw: Callable[[Figure], None], height: float) -> str:
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context({**STYLE, "svg.hashsalt": "campaign"}):
        figure, text = Figure(figsize=(WIDTH, height), layout="constrained"), StringIO()
        draw(figure)
        figure.savefig(text, format="svg", metadata={"Date": None}, transparent=True)
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
