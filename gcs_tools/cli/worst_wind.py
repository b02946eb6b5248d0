"""`gcs envelope --worst-wind`: the wind that brings each limit nearest, and what it leaves."""

from __future__ import annotations

import errno
import math
import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_tools.cli.output import print_json, print_line
from gcs_tools.exit_codes import OK
from gcs_tools.missions.mission import Mission, MissionError

if TYPE_CHECKING:
    from rich.console import Console

    from gcs_tools.gusts.survey import Survey

SATURATES = 1  # exit code


def shown(
    mission: Mission, parts: int, winds: Path | None, figure: Path | None, as_json: bool
) -> int:
    """Compute the worst winds of a mission and print them. Returns the exit code. Raises MissionError, OSError."""
    from rich.console import Console

    from fcu.interface.airframe import AirframeError
    from fcu.interface.parameter import ParameterError
    from fcu.laws.loader import LawError
    from gcs_tools.cli.terminal import PipedConsole
    from gcs_tools.gusts.program import ProgramError
    from gcs_tools.gusts.survey import histories, name_of, save, survey

    if winds is not None:  # minutes of computing are not for nothing
        winds.mkdir(parents=True, exist_ok=True)
        if any(winds.iterdir()):
            raise FileExistsError(errno.EEXIST, "expected an empty folder", str(winds))
    if figure is not None and not os.access(figure.parent, os.W_OK):
        raise OSError(errno.EACCES, "no folder to write to", str(figure.parent))
    try:
        found = survey(mission, parts, Console(stderr=True))
        written = [] if winds is None else save(mission, found, winds)
        if figure is not None:
            from gcs_tools.pictures.plot import worst_wind

            title = f"{found.mission}: room in the worst wind of {_bounds(found)}"
            worst_wind.save(title, found.transient_s, histories(found), figure)
    except (ParameterError, AirframeError, LawError, ProgramError) as error:
        raise MissionError(f"{mission.source}: {error}") from error
    if as_json:
        print_json(found.as_json())
    else:
        _show(found, PipedConsole(highlight=False))
        if mission_file := next((path for path in written if path.suffix == ".toml"), None):
            worst = min(found.worst, key=lambda each: each.computed_n)
            tightest = mission_file.with_stem(name_of(worst))
            print_line(f"Fly the tightest again: gcs fly {shlex.quote(str(tightest))}")
        elif written:
            print_line(f'Fly a wind: [wind] file = "...", of {winds}')
        if figure is not None:
            print_line(f"{figure}")
    return SATURATES if found.saturates else OK


def _bounds(found: Survey) -> str:
    return f"up to {found.bounds.speed:g} m/s and {found.bounds.rate:g} m/s^2"


def _show(found: Survey, console: Console) -> None:
    from rich.table import Table
    from rich.text import Text

    console.print(Text(found.mission, style="bold"), Text(f"guard {found.guard}", style="dim"))
    console.print(
        f"Room in winds of {_bounds(found)}, from {found.transient_s:.2f} s after take-over on, of the worst of"
        f" {found.vehicles} vehicles at the ends of what is believed: in still air, in drawn sums of sines, and in the worst"
        " wind that was computed."
    )
    console.print()
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("N", "s", "at s", "still", "sines", "worst", "vehicle"):
        table.add_column(
            name, justify="left" if name in ("N", "vehicle") else "right", no_wrap=True
        )
    for each in found.worst:
        table.add_row(
            each.limit.replace("_", " "), f"{each.from_s:.0f}-{each.to_s:.0f}", f"{each.at_s:.2f}",
            _room(each.still_n), _room(each.drawn_n),
            Text(f"{_room(each.computed_n)}{'*' if each.saturated else ' '}", style="bold"), each.end.words,
            style="bold red" if each.saturated else None,
        )  # fmt: skip
    console.print(table)
    console.print()
    met = [each for each in found.worst if each.saturated]
    if met:
        console.print(
            Text(
                f"In {len(met)} of {len(found.worst)} of these winds something saturates.",
                style="bold red",
            )
        )
        if any(each.computed_n >= 0.0 for each in met):
            console.print(
                "A row that is marked and has room left saturates another limit than its own."
            )
    else:
        console.print(Text("In none of these winds anything saturates.", style="bold green"))
    for remark in found.remarks:
        console.print(Text(f"Not covered: {remark}.", style="yellow"))
    console.print(
        Text(
            "Each of these rooms was flown. That no wind leaves less is not certain: a search found them.",
            style="dim",
        )
    )


def _room(value: float) -> str:
    """One digit, rounded down. What ended early has none."""
    return f"{math.floor(10.0 * value) / 10.0:.1f}" if math.isfinite(value) else "lost"
