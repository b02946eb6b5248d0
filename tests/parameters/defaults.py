"""The parameters of every law and of the vehicle, with their values on every airframe, as a text.

python -m tests.parameters.defaults: the text is written anew, into defaults.txt (`make schemas`).
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from fcu.interface import airframe
from fcu.interface.parameter import Parameter
from fcu.kernel.buffers import columns, to_buffer
from fcu.laws import loader
from fcu.parameters import VEHICLE

HEAD = "# Written by: python -m tests.parameters.defaults"
KEPT = Path(__file__).with_name("defaults.txt")
AIRFRAMES = sorted(airframe.OCTO.parent.glob("*.toml"))
RATE_HZ = 500.0
SHARED = ("law.h", "law.limits", "law.rotors")  # the same of every law: written once


def text() -> str:
    """All rows of each law with their ranges, then every field of its settings on each airframe."""
    vehicle = (f"{_row(row)}; {row.default!r}" for row in VEHICLE)
    parts = [HEAD, "## Vehicle", "\n".join(vehicle)]
    for name in loader.SHIPPED:
        parts += [ranges(name), *(defaults(name, path) for path in AIRFRAMES)]
    return "\n\n".join(parts) + "\n"


def ranges(name: str) -> str:
    """The rows of a law."""
    rows = loader.load(name).settings.PARAMETERS
    return "\n".join([f"## {name}", "", *map(_row, rows)])


def defaults(name: str, airframe_file: Path) -> str:
    """The settings of a law for an airframe."""
    settings = loader.load(name).settings.settings(*airframe.believed(airframe_file), RATE_HZ)
    numbers = zip(columns(type(settings)), to_buffer(settings), strict=True)
    lines = [f"### {name}, {airframe_file.stem}", ""]
    for field, group in groupby(numbers, lambda each: _of(each[0])):
        if name == loader.DEFAULT or not field.startswith(SHARED):
            lines.append(f"{field} = {', '.join(_written(value) for _, value in group)}")
    return "\n".join(lines)


def _of(column: str) -> str:
    """The field of a column: of a vector or of one number a rotor, the whole."""
    field, _, last = column.rpartition(".")
    return field if last in "xyz" or last[1:].isdigit() else column


def _written(value: float) -> str:
    return "0" if abs(value) < 1e-12 else f"{value:.9g}"


def _row(row: Parameter) -> str:
    names = ", ".join(part.name for part in row.parts)
    return f"{row.key or '-'} ({names or '-'}): {row.low:g} to {row.high:g} {row.unit}".rstrip()


if __name__ == "__main__":
    KEPT.write_text(text(), encoding="utf-8")
