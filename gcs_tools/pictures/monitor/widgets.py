"""What the panels of the monitor are drawn with: numbers, sparklines, gauges, tables."""

from __future__ import annotations

import math

import numpy as np
from rich.align import Align
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from gcs_tools.recording.table import Rows

SPARK_S = 30.0  # simulation time that a sparkline spans
BARS = "▁▂▃▄▅▆▇█"
NEAR = 0.05  # of the way between two limits: closer to one is shown as being at it
DIM, GOOD, WARN, BAD, TRUTH = "grey58", "green3", "yellow3", "bold red3", "sky_blue2"


def plain(value: float, digits: int) -> str:
    """A number, or a dash for one that is not known."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def number(value: float, digits: int, unit: str = "") -> Text:
    """A number with its unit."""
    text = Text(plain(value, digits), style="bold" if math.isfinite(value) else DIM)
    return text.append(f" {unit}", style=DIM) if unit else text


def true(value: float, digits: int) -> Text:
    """A number that is the plant's truth."""
    return Text(plain(value, digits), style=TRUTH)


def bar(part: float) -> str:
    """One block, of a part from 0 to 1."""
    return BARS[round(min(max(part, 0.0), 1.0) * (len(BARS) - 1))]


def spark(t: Rows, values: Rows, width: int, low: float | None = None) -> Text:
    """The greatest of each of `width` stretches of the last SPARK_S seconds, as blocks.

    low : of the scale; None: the least shown. A stretch without a value is blank.
    """
    known = np.isfinite(values)
    t, values = t[known], values[known]
    blocks = [" "] * width
    if len(t) and t[-1] > t[-1] - SPARK_S:  # of a time with a meaning
        begin = t[-1] - SPARK_S
        inside = t > begin
        at = np.minimum(((t[inside] - begin) / SPARK_S * width).astype(int), width - 1)
        tops = np.full(width, -np.inf)
        np.maximum.at(tops, at, values[inside])
        seen = np.flatnonzero(np.isfinite(tops))
        bottom = float(tops[seen].min()) if low is None else low
        span = float(tops[seen].max()) - bottom
        for i in seen:
            blocks[i] = bar((tops[i] - bottom) / span if span > 0.0 else 0.0)
    return Text("".join(blocks), style=GOOD)


def gauge(value: float, low: float, high: float, width: int) -> Text:
    """A mark between two limits, red when it is at one."""
    line = "├" + "─" * max(width - 2, 1) + "┤"
    if not (math.isfinite(value) and high > low):
        return Text(line, style=DIM)
    part = min(max((value - low) / (high - low), 0.0), 1.0)
    at = 1 + round(part * (len(line) - 3))
    style = BAD if min(part, 1.0 - part) < NEAR else GOOD
    return Text.assemble((line[:at], DIM), ("●", style), (line[at + 1 :], DIM))


def percentiles(us: Rows) -> Text:
    """Of microseconds: the median, the 99th percentile, the greatest."""
    if not len(us):
        return Text("-", style=DIM)
    p50, p99 = np.percentile(us, [50.0, 99.0])
    words = Text()
    for value, after in ((p50, " µs, 99 % within "), (p99, ", longest "), (us.max(), "")):
        words.append(f"{value:.0f}", style="bold").append(after, style=DIM)
    return words


def grid(columns: int) -> Table:
    """A table without lines: labels, then numbers to the right."""
    table = Table.grid(padding=(0, 2), pad_edge=False)
    table.add_column(no_wrap=True)
    for _ in range(columns - 1):
        table.add_column(justify="right", no_wrap=True)
    return table


def heads(*words: str) -> list[Text]:
    """The first row of a grid."""
    return [Text(word, style=DIM) for word in words]


def panel(title: str, *parts: RenderableType) -> Panel:
    """A titled frame, with a line of air before every table but the first."""
    spaced: list[RenderableType] = []
    for i, part in enumerate(parts):
        if i and isinstance(part, Table):
            spaced.append(Text())
        spaced.append(part)
    content = Align.left(Group(*spaced))
    return Panel(content, title=title, title_align="left", border_style=DIM, padding=(0, 2))
