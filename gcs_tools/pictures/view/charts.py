"""Charts in the page: thinned lines in uPlot, and above each a caption with the values in force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_tools.pictures.history import FlightHistory, Series, value
from gcs_tools.pictures.plot.style import INK, LIMIT
from gcs_tools.pictures.quantities import Line, Quantity
from gcs_tools.recording.table import HALF_US, Rows

if TYPE_CHECKING:
    import viser

STRETCHES = 300  # of time in a chart; the least and the greatest of each are drawn
HEIGHT = 91  # px, of a chart
SYNC: Any = {"sync": {"key": "flight"}, "drag": {"x": True, "y": False}, "points": {"size": 4}}


def pale(colour: str) -> str:
    """A #rrggbb colour for what stands behind a line."""
    return f"{colour}55"


def stretches(span: tuple[float, float], rows: int) -> Rows:
    """The ends (s) of equal stretches of time; fewer when there are few rows to show.

    They are of a power of two and begin at a multiple of it: so what is drawn of the past stays
    what it is while time goes on.
    """
    least = (span[1] - span[0]) / max(1, min(STRETCHES, rows // 4))
    width = 2.0 ** math.ceil(math.log2(max(least, HALF_US)))
    first = math.floor(span[0] / width)
    n = max(1, math.ceil(span[1] / width) - first)
    ends: Rows = width * np.arange(first, first + n + 1, dtype=np.float64)
    ends[-1] = max(ends[-1], span[1] + HALF_US)
    return ends


def thinned(t: Rows, y: Rows, ends: Rows) -> Rows:
    """Two values of each stretch, (2 n,): its least and its greatest, in the order of its trend.

    What is not finite does not count; a stretch of nothing else, or of no row, is not a number.
    """
    out = np.full((len(ends) - 1, 2), np.nan)
    at = np.searchsorted(t, ends)
    full = np.flatnonzero(np.diff(at))
    if not len(full):
        return out.ravel()
    y = np.where(np.isfinite(y), y, np.nan)[: at[-1]]
    first, last = at[full], at[full + 1] - 1
    least, greatest = np.fmin.reduceat(y, first), np.fmax.reduceat(y, first)
    falls = y[last] < y[first]
    out[full, 0] = np.where(falls, greatest, least)
    out[full, 1] = np.where(falls, least, greatest)
    return out.ravel()


def places(ends: Rows) -> Rows:
    """Where the two values of each stretch are drawn, s: close to its ends, or a slope has steps."""
    inside = 0.02 * np.diff(ends)
    return np.stack([ends[:-1] + inside, ends[1:] - inside], axis=1).ravel()


def seeded(lines: Sequence[Rows]) -> list[Rows]:
    """The same lines, none of which begins with what is not a number: uPlot finds no scale then.

    It begins with the next value, or alone, and so unseen, with one that another line has.
    """
    known = np.concatenate(lines)
    known = known[np.isfinite(known)]
    spare = float(known[0]) if len(known) else 0.0
    begun = []
    for y in lines:
        if not np.isfinite(y[0]):
            y = y.copy()
            y[0] = y[1] if np.isfinite(y[1]) else spare
        begun.append(y)
    return begun


def _bounds(chart: Quantity, lines: Sequence[Rows], limits: Sequence[float]) -> tuple[float, float]:
    """What a chart shows of its quantity, with room around it."""
    known = np.concatenate([*lines, np.asarray(limits, float)])
    known = known[np.isfinite(known)]
    if chart.logarithmic:
        return chart.logarithmic, max(chart.least, 1.5 * float(known.max(initial=0.0)))
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    low, high = min(low, (low + high - chart.least) / 2), max(high, (low + high + chart.least) / 2)
    room = 0.08 * (high - low)
    return low - room, high + room


class Plot:
    """One chart in a panel of the page."""

    def __init__(
        self, gui: viser.GuiApi, chart: Quantity, flight: FlightHistory, *, whole: bool, last: bool
    ) -> None:
        """whole : the flight is over, and a mark shows the time.  last : with numbers of time."""
        self._chart, self._flight, self._whole = chart, flight, whole
        self._drawn = (*chart.truth, *chart.columns)  # the later over the earlier
        self._series: dict[str | None, Series] = {}
        self._x, self._ys = np.zeros(2), [np.full(2, np.nan) for _ in self._drawn]
        self._limits = chart.limits(flight.limits)
        if whole:
            assert flight.span is not None
            self._thin(flight.span)
        self._bounds = _bounds(chart, self._ys, self._limits)
        self._caption = gui.add_html(self._words(math.nan))
        self._plot = gui.add_uplot(
            data=self._data(None),
            series=({"label": "t, s"}, *self._styles()),
            scales=self._scales(),
            axes=_axes(last),
            legend={"show": False},
            cursor=SYNC,
            height=HEIGHT + (18 if last else 0),
            padding=(6, 12, 4 if last else 6, 0),
        )

    def _styles(self) -> list[Any]:
        quiet, truth_is = {"points": {"show": False}}, self._chart.truth_is
        lines: list[dict[str, Any]] = [
            {"label": f"{line.label}, {truth_is}", "stroke": pale(line.colour), "width": 4}
            for line in self._chart.lines
            if line.truth is not None
        ]
        lines += [
            {"label": line.label, "stroke": line.colour, "width": 1.4} for line in self._chart.lines
        ]
        dashed = {"label": "limit", "stroke": LIMIT, "width": 1.2, "dash": (6, 4)}
        mark = {"label": "now", "stroke": INK, "width": 1.0}
        lines += [dashed] * len(self._limits) + [mark] * self._whole
        return [{**quiet, **line} for line in lines]

    def _scales(self) -> dict[str, Any]:
        """Of a whole flight what it fills; a live one's lines fit, and leave noise its size.

        uPlot fits them by itself: given other scales together with other data, the page of a
        slow browser loses the newest part of its time axis.
        """
        y: dict[str, Any] = {}
        if self._whole:
            y["range"] = self._bounds
        elif not self._chart.logarithmic and self._chart.fine is None:
            known = bool(self._limits) or self._chart.about_zero
            ends = zip(("min", "max"), _bounds(self._chart, [], self._limits), strict=True)
            y["range"] = {
                end: {"pad": 0.08, "soft": soft, "mode": int(known)} for end, soft in ends
            }
        if self._chart.logarithmic:
            y["distr"] = 3
        elif self._chart.fine is not None:
            y |= {"distr": 4, "asinh": self._chart.fine}
        return {"x": {"time": False}, "y": y}

    def _thin(self, span: tuple[float, float]) -> None:
        self._series = {name: self._flight.flown(name) for name in self._drawn}
        fewest = min((len(t) for t, _ in self._series.values() if len(t)), default=0)
        ends = stretches(span, fewest)
        self._x = places(ends)
        self._ys = [thinned(t, y, ends) for t, y in self._series.values()]
        if self._chart.logarithmic:
            self._ys = [np.maximum(y, self._chart.logarithmic) for y in self._ys]

    def _data(self, now: float | None) -> tuple[Rows, ...]:
        """Times, lines, limits and, of a whole flight, the mark at `now`: two points on one time."""
        limits = self._chart.limits(self._flight.limits)  # a live flight may tell others
        x, lines = self._x, [*self._ys, *(np.full(len(self._x), level) for level in limits)]
        if not self._whole:
            return (x, *seeded(lines))
        now = float(x[0]) if now is None else now
        at = int(np.searchsorted(x, now))
        mark = np.full(len(x) + 2, np.nan)
        mark[at : at + 2] = self._bounds
        lines = [np.insert(y, at, [y[min(at, len(y) - 1)]] * 2) for y in lines]
        return (np.insert(x, at, [now, now]), *lines, mark)

    def show(self, now: float) -> None:
        """Show the values at `now` (s), and of a live flight its lines up to it."""
        if not self._whole:
            assert self._flight.span is not None
            self._thin(self._flight.span)
            self._hide_if_empty(now)
        self._plot.data = self._data(now)
        self._caption.content = self._words(now)

    def _hide_if_empty(self, now: float) -> None:
        """While a law flies that tells only what is not a number: that has no reference model."""
        told = (self._series[name][1] for name in self._chart.columns)
        seen = self._flight.value("engaged", now) < 0.5 or any(np.isfinite(y).any() for y in told)
        if self._plot.visible != seen:
            self._plot.visible = self._caption.visible = seen

    def _words(self, now: float) -> str:
        """Title, unit, and each line's value at `now` (s), with that of what stands behind it."""
        chart = self._chart
        words = "".join(self._told(line, now) for line in chart.lines)
        return (
            f'<div class="caption" data-chart="{escape(chart.title)}"><b>{escape(chart.title)}</b>'
            f"<i>{escape(chart.unit)}</i>{words}</div>"
        )

    def _told(self, line: Line, now: float) -> str:
        series, behind = self._series.get(line.column), self._series.get(line.truth)
        truth_is = escape(self._chart.truth_is)
        words = f'<span style="--c:{line.colour}">{escape(line.label)} '
        if behind is not None and (series is None or not len(series[0])):
            words = f'<span style="--c:{pale(line.colour)}">{escape(line.label)} '
        else:
            words += f"<code>{self._number(value(series, now) if series else math.nan)}</code>"
        if behind is not None:
            if len(self._chart.lines) == 1:
                words += f" {truth_is}"
            words += f' <em title="{truth_is}">{self._number(value(behind, now))}</em>'
        return words + "</span>"

    def _number(self, x: float) -> str:
        """As wide whatever its sign, so that a caption stands still."""
        return f"{x: z.{self._chart.digits}f}" if math.isfinite(x) else " –"


def _axes(last: bool) -> tuple[Any, ...]:
    """Time below, with numbers under the last chart alone; the quantity on the left."""
    font = "10px -apple-system, 'Segoe UI', 'Helvetica Neue', sans-serif"
    ticks, grid = {"show": False}, {"stroke": "#ececec", "width": 1}
    x = {"size": 22, "font": font, "ticks": ticks, "grid": grid, "gap": 2, "stroke": "#555555"}
    y = {**x, "size": 44, "space": 22, "gap": 4}
    return ({**x} if last else {**x, "size": 0, "values": None, "stroke": "#00000000"}, y)
