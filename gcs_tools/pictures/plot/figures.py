"""The standard figures of a flight, by name, and how each becomes a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from fcu.interface.files import whole_file
from gcs_tools.pictures.plot import estimates, limits, prediction, timing, tracking, wind
from gcs_tools.pictures.plot import overview as flight
from gcs_tools.pictures.plot.numbers import Numbers
from gcs_tools.pictures.plot.style import GREY, INK, STYLE
from gcs_tools.pictures.plot.window import Window

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = ("png", "svg", "pdf")
DPI = 110
_MARGIN, _LINE = 0.15, 0.17  # inches: around a figure; a small line of text


@dataclass(frozen=True)
class Standard:
    """One standard figure."""

    question: str  # that it answers; empty: it has its own heading
    size: tuple[float, float]  # inches
    numbers: Callable[[Window], Numbers]  # raises Missing
    answer: Callable[[Numbers], str]  # one line
    draw: Callable[[Figure, Window, Numbers], None]
    notes: Callable[[Window], list[str]] = lambda _: []


STANDARD = {
    "flight": Standard("", flight.SIZE, flight.numbers, flight.answer, flight.draw),
    "tracking": Standard(
        tracking.QUESTION, tracking.SIZE, tracking.numbers, tracking.answer, tracking.draw
    ),
    "limits": Standard(limits.QUESTION, limits.SIZE, limits.numbers, limits.answer, limits.draw),
    "prediction": Standard(
        prediction.QUESTION, prediction.SIZE, prediction.numbers, prediction.answer, prediction.draw,
        prediction.notes,
    ),
    "estimates": Standard(
        estimates.QUESTION, estimates.SIZE, estimates.numbers, estimates.answer, estimates.draw,
        estimates.notes,
    ),
    "wind": Standard(wind.QUESTION, wind.SIZE, wind.numbers, wind.answer, wind.draw, wind.notes),
    "timing": Standard(
        timing.QUESTION, timing.SIZE, timing.numbers, timing.answer, timing.draw, timing.notes
    ),
}  # fmt: skip


def save(
    name: str, window: Window, path: Path, kind: str, source: str, remarks: tuple[str, ...] = ()
) -> Numbers:
    """Draw one of STANDARD to `path` as `kind`, one of FORMATS; the numbers that it shows.

    source : what it is drawn of.  remarks : what is to be known of that, in the figure too.
    Raises Missing for what the recording does not have, OSError if it cannot be written.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    which = STANDARD[name]
    found = which.numbers(window)
    width, height = which.size
    below = [*which.notes(window), *remarks]
    top = 0.62 if which.question else 0.0
    bottom = _LINE * len(below) + (_MARGIN if below else 0.0)
    with rc_context(STYLE):
        rect = (0.0, bottom / height, 1.0, 1.0 - (bottom + top) / height)
        layout = ConstrainedLayoutEngine(h_pad=0.09, w_pad=0.12, rect=rect)
        figure = Figure(figsize=which.size, layout=layout)
        left, right = _MARGIN / width, 1.0 - _MARGIN / width
        if which.question:
            at = 1.0 - _MARGIN / height
            figure.text(
                left, at, which.question, va="top", fontsize=13.0, fontweight="bold", color=INK
            )
            figure.text(right, at, source, va="top", ha="right", fontsize=8.5, color=GREY)
            at -= 0.25 / height
            said = which.answer(found)
            figure.text(left, at, said[:1].upper() + said[1:], va="top", color=INK)
        for i, text in enumerate(reversed(below)):
            at = (0.5 * _MARGIN + _LINE * i) / height
            figure.text(left, at, text, va="bottom", fontsize=8.0, color=GREY)
        which.draw(figure, window, found)
        picture = BytesIO()
        figure.savefig(picture, format=kind, dpi=DPI)
    whole_file.write(path, picture.getvalue())
    return found
