"""The monitor's panels, laid out for a terminal."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.layout import Layout
from rich.text import Text

from gcs_tools.pictures.monitor import panels
from gcs_tools.pictures.monitor.readings import Readings
from gcs_tools.pictures.monitor.widgets import DIM

WIDE, HIGH = 120, 38  # columns and lines from which the panels stand side by side
_FRAME = 6  # columns that a frame and its padding take
_HEIGHTS = {"header": 3, "top": 12, "middle": 15}


def screen(r: Readings, width: int, height: int) -> RenderableType:
    """The whole picture, for a terminal of so many columns and lines."""
    with np.errstate(all="ignore"):  # what diverges is shown, not complained about
        return _screen(r, width, height)


def _screen(r: Readings, width: int, height: int) -> RenderableType:
    if width < WIDE or height < HIGH:
        return _narrow(r, width, height)
    inside = width // 2 - _FRAME
    layout = Layout()
    layout.split_column(
        Layout(panels.header(r), size=_HEIGHTS["header"]),
        Layout(name="top", size=_HEIGHTS["top"]),
        Layout(name="middle", size=_HEIGHTS["middle"]),
        Layout(name="bottom"),
    )
    layout["top"].split_row(panels.tracking(r, inside), panels.limits(r, inside))
    middle = (panels.estimates(r, inside), panels.wind(r, inside))
    layout["middle"].split_row(*(panel for panel in middle if panel is not None))
    left = height - sum(_HEIGHTS.values()) - 2
    layout["bottom"].split_row(panels.bus(r, inside), panels.events(r, left))
    return layout


def _narrow(r: Readings, width: int, height: int) -> RenderableType:
    """One below the other, as many as there is room for."""
    inside = max(width - _FRAME, 60)
    rows: list[RenderableType] = [panels.header(r)]
    room = height - _HEIGHTS["header"] - 1
    for make, lines in (
        (panels.tracking, 11), (panels.limits, 11), (panels.estimates, 11), (panels.wind, 14),
        (panels.bus, 10),
    ):  # fmt: skip
        if room >= lines and (made := make(r, inside)) is not None:
            rows.append(made)
            room -= lines
    if room > 2:
        rows.append(panels.events(r, room - 2))
    hint = f"more in a terminal of {WIDE} columns and {HIGH} lines; this has {width} and {height}"
    return Group(*rows, Text(hint, style=DIM, overflow="ellipsis", no_wrap=True))
