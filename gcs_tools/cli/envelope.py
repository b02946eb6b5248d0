"""`gcs envelope`: what is known of a mission before it flies."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure, print_json, print_line
from gcs_tools.exit_codes import OK, USAGE

if TYPE_CHECKING:
    from rich.console import Console

    from gcs_tools.judging.envelope import Envelope, Reach

DOES_NOT_HOLD = 1  # exit code
FORMATS = (".png", ".svg", ".pdf")
NAMED = {
    "acceleration": "what the way demands",
    "speed": "drag of its own speed",
    "wind": "drag of the wind",
    "learning": "estimates that lag",
    "tracking": "closing the error that they leave",
    "doubt": "a jump, with a mass not known",
}


def _drawable(_context: click.Context, _option: click.Parameter, path: Path | None) -> Path | None:
    if path is not None and path.suffix.lower() not in FORMATS:
        raise click.BadParameter(f"{path}: ends in none of {', '.join(FORMATS)}")
    if path is not None and not path.parent.is_dir():
        raise click.BadParameter(f"{path}: there is no folder {path.parent}")
    return path


@click.command(
    epilog="\b\n"
    "Exact set   the actuators' own limits, along the way of the reference model; the guard uses it\n"
    "Ball        the largest ball of forces about hover\n"
    "(31)        the paper's condition, repaired, taken from the target\n\n"
    "Each is sufficient: that one does not hold predicts nothing.\n\n"
    "Exit codes: 0 the condition holds along the mission's way, or the guard will govern what does\n"
    "not fit; 1 it does not hold; 2 the mission cannot be flown or the figure not written; 130\n"
    "interrupted."
)
@click.argument("mission")
@arguments.SETTINGS
@click.option("--figure", type=click.Path(path_type=Path), callback=_drawable, metavar="FILE", help="Draw it, as FILE ends: .png, .svg, .pdf.")  # fmt: skip
@arguments.as_json("Print it as JSON.")
def envelope(mission: str, settings: tuple[str, ...], figure: Path | None, as_json: bool) -> int:
    """Say before flight whether MISSION keeps thrust and tilt inside their limits.

    The largest step, speed and wind for which it is certain, which term eats the margin, and what
    to change. What is believed of mass, drag and wind is the mission's [law] guard_*.
    """
    from fcu.interface.airframe import AirframeError
    from fcu.interface.parameter import ParameterError
    from fcu.theory.responses import UnstableError
    from gcs_tools.cli.terminal import PipedConsole
    from gcs_tools.judging.envelope import envelope as envelope_of
    from gcs_tools.missions.mission import MissionError, load

    try:
        chosen = load(mission, settings)
        click.echo("looking ahead (the first time compiles, for 10 s or so) ...", err=True)
        try:
            found = envelope_of(chosen)
            if figure is not None:
                from gcs_tools.pictures.plot.envelope import save

                save(chosen, found, figure)
        except (ParameterError, AirframeError, UnstableError) as error:
            raise MissionError(f"{chosen.source}: {error}") from error
        if as_json:
            print_json(found.as_json())
        else:
            _show(found, PipedConsole(highlight=False))
            if figure is not None:
                print_line(f"{figure}")
    except MissionError as error:
        raise Failure(error, USAGE) from error
    except OSError as error:
        at = error.filename or figure or "standard output"
        raise Failure(f"{at}: {error.strerror}", USAGE) from error
    return OK if found.holds or found.governed else DOES_NOT_HOLD


def _show(found: Envelope, console: Console) -> None:
    from rich.table import Table
    from rich.text import Text

    sign, colour = ("holds", "green") if found.holds else ("does not hold", "yellow")
    console.print(Text(found.mission, style="bold"), Text(f"guard {found.guard}", style="dim"))
    console.print(Text(f"The condition {sign}:", style=f"bold {colour}"), _sentence(found))
    if found.governed:
        console.print("That is as it is asked. The guard governs: flown more gently, it does hold.")
    for remark in found.remarks:
        console.print(Text(f"Beyond what is said here: {remark}.", style="yellow"))
    console.print()

    spent = Table("At its tightest", "N", box=None, pad_edge=False, header_style="dim")
    spent.columns[1].justify = "right"
    none = "" if found.terms.hover > 0.0 else "  <- the actuators do not carry what is believed"
    spent.add_row(f"room in hover, to the nearest limit{none}", f"{found.terms.hover:.1f}")
    for name, words in NAMED.items():
        eats = "  <- eats most" if name == found.terms.largest and found.terms.hover > 0.0 else ""
        spent.add_row(f"  {words}{eats}", f"{-getattr(found.terms, name):.1f}")
    spent.add_row("left", f"{found.terms.left:.1f}", style=f"bold {colour}")
    console.print(spent)
    console.print()

    reach = Table("Certain up to", "", box=None, pad_edge=False, header_style="dim")
    for column in ("exact set", "ball", "(31)"):
        reach.add_column(column, justify="right")
    for row in found.reach:
        reach.add_row(row.what, row.unit, *_columns(row))
    console.print(reach)

    if not found.holds:
        console.print()
        console.print(Text("What would do, alone:", style="dim"))
        for change in found.changes:
            would = (
                "not enough"
                if change.would_do is None
                else f"{_down(change.would_do)} {change.unit}".rstrip()
            )
            console.print(f"  {change.what} {change.now:.3g} -> {would}")
        if found.can_be_governed:
            console.print('  law.guard="govern", which flies there more gently')
    after = "thrust and tilt are certain from"
    console.print()
    console.print(Text(f"While adaptation begins nothing is certain: {after} {found.transient_s:.2f} s after take-over on.", style="dim"))  # fmt: skip


def _columns(row: Reach) -> list[str]:
    """What is certain is rounded down."""
    columns = (row.exact, row.ball, row.theorem)
    return ["-" if v is None else f"{math.floor(10.0 * v) / 10.0:.1f}" for v in columns]


def _down(value: float) -> str:
    """Three digits, rounded down: so much still holds."""
    step = 10.0 ** (math.floor(math.log10(value)) - 2) if value > 0.0 else 1.0
    return f"{math.floor(value / step) * step:.3g}"


def _sentence(found: Envelope) -> str:
    how = "left" if found.holds else "short"
    size = math.ceil(-10.0 * found.margin_n) / 10.0 if found.margin_n < 0.0 else found.margin_n
    return f"{size:.1f} N {how} at {found.at_s:.1f} s, its tightest moment."
