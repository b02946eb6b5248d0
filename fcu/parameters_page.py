"""docs/parameters.md: every parameter of missions and of MAVLink, in groups.

python -m fcu.parameters_page docs/parameters.md
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from fcu.interface.parameter import Parameter, default
from fcu.laws import loader
from fcu.parameters import VEHICLE, entries
from fcu.process.configuration import read_airframe
from fcu.process.settings import PARAMETERS

HEAD = """# Parameters

A parameter of the law has a key in a mission's `[law]`, and most have a name that ground stations
set them by. Over MAVLink a number is a REAL32 unless INT32 is said; the law's are in force from the
next tick; names that do not begin with MR_ or REF_ are PX4's. What is refused, and why: [mavlink.md](mavlink.md).
Written by `make schemas`.
"""
TITLES = "\n## {}\n\n| `[law]` | MAVLink | default | may be | |\n|---|---|---|---|---|\n"


def page(law: Iterable[Parameter] = PARAMETERS) -> str:
    """The text of the page, for the default airframe; `law`: the table of a law."""
    airframe = read_airframe(loader.load()).tables
    text, of = HEAD, ""
    for row in (*law, *VEHICLE):
        text += TITLES.format(row.group) if row.group != of else ""
        of = row.group
        text += "".join(_rows(row, airframe))
    return text


def _rows(row: Parameter, airframe: Mapping[str, Any]) -> Iterator[str]:
    """A row for the key, and one for each name that is not the whole of it."""
    known = entries([row], airframe).values()
    one = len(known) == 1
    if row.key and not one:
        low, high = (_number(v) for v in (row.low, row.high))
        allowed = f"at least {low}" if row.high == math.inf else f"{low} to {high}"
        numbers = row.numbers(default(row, airframe))
        shown = ", ".join(_number(v) for v in dict.fromkeys(numbers))
        yield _row(row.key, "", shown, f"{allowed} {row.unit}", row.sentence)
    for p in known:
        when = " (while disarmed)" if row.disarmed_only else ""
        when = " (at the start)" if row.at_start else when
        allowed = "read only" if row.read_only else f"{p.expected()}{when}"
        allowed += ", INT32" if row.integer else ""
        key = row.key if one else ""
        key += f", {row.unit}" if key and row.degrees else ""
        given = _number(p.default) + (f", {row.default}" if row.words else "")
        yield _row(key, p.name, given, allowed, p.sentence)


def _row(*cells: str) -> str:
    return f"| {' | '.join(cell.rstrip() for cell in cells)} |\n"


def _number(value: float) -> str:
    return f"{value:.6g}"


@click.command()
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path))
def main(out: Path) -> None:
    """Write the page to OUT."""
    out.write_text(page())


if __name__ == "__main__":
    main()
