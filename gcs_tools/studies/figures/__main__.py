"""The paper's Figures 1–11 and their counterparts, flown and drawn; the numbers beside them.

python -m gcs_tools.studies.figures                              draws docs/figures/*.png
python -m gcs_tools.studies.figures --numbers                    prints what docs/paper.md quotes
python -m gcs_tools.studies.figures --numbers --write docs/paper.md
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from fcu.interface.files.spelling import suggestion
from gcs_tools.cli.output import silence
from gcs_tools.studies.figures.page import PageError, check, written

SCHEMA = 1
NAMES = (*(f"figure-{number}" for number in range(1, 12)), "gamma")


def _names(
    _context: click.Context, _option: click.Parameter, value: tuple[str, ...]
) -> tuple[str, ...]:
    for name in value:
        if name not in NAMES:
            meant = suggestion(name, NAMES)
            raise click.BadParameter(f"no figure {name!r}{meant}; there are {', '.join(NAMES)}")
    return tuple(dict.fromkeys(value)) or NAMES


@click.command()
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("docs/figures"), show_default=True, metavar="FOLDER", help="Where the figures go.")  # fmt: skip
@click.option("--only", "names", multiple=True, callback=_names, metavar="NAME", help="This figure, and no other that is not named; may be given again.")  # fmt: skip
@click.option("--numbers", is_flag=True, help="Instead: the numbers that docs/paper.md quotes.")
@click.option("--json", "as_json", is_flag=True, help="With --numbers: as JSON, unrounded.")
@click.option("--write", "page", type=click.Path(path_type=Path, dir_okay=False, exists=True), metavar="PAGE.md", help="With --numbers: into the page's tables.")  # fmt: skip
def main(
    out: Path, names: tuple[str, ...], numbers: bool, as_json: bool, page: Path | None
) -> None:
    """Fly and draw the paper's figures and their counterparts."""
    if (as_json or page) and not numbers:
        raise click.UsageError("--json and --write go with --numbers")
    try:
        if numbers:
            _numbers(as_json, page)
        else:
            _draw(out, names)
    except BrokenPipeError:
        silence(sys.stdout)
    except PageError as error:
        raise click.UsageError(f"{page}: {error}") from error
    except OSError as error:
        where = error.filename or "standard output"
        raise click.UsageError(f"{where}: {error.strerror}") from error


def _numbers(as_json: bool, page: Path | None) -> None:
    from rich.console import Console
    from rich.table import Table

    from gcs_tools.campaigns.flights import each
    from gcs_tools.studies.figures import gamma
    from gcs_tools.studies.figures.cases import CASES, fly
    from gcs_tools.studies.figures.numbers import measured, table

    if page:
        check(page.read_text(encoding="utf-8"), (*CASES, gamma.NAME))
    flights = {group: list(each(fly, cases)) for group, cases in CASES.items()}
    points = list(each(gamma.flown, gamma.cases(gamma.QUOTED)))
    hovers = [gamma.hover(value) for value in gamma.QUOTED]
    tables = {group: table(group, flights[group]) for group in CASES}
    tables[gamma.NAME] = gamma.table(points, hovers)
    if page:
        page.write_text(written(page.read_text(encoding="utf-8"), tables), encoding="utf-8")
    if as_json:
        found = {
            "schema": SCHEMA,
            "numbers": measured(flights),
            gamma.NAME: gamma.measured(points, hovers),
        }
        print(json.dumps(found, allow_nan=False, ensure_ascii=False, indent=2))
        return
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 120)
    for group, (head, *rows) in tables.items():
        shown = Table(title=group, title_justify="left", box=None)
        for i, column in enumerate(head):
            shown.add_column(column, justify="right" if i > 1 else "left")
        for row in rows:
            shown.add_row(*row)
        out.print(shown)
        for flown in flights.get(group, ()):
            out.print(f"{flown.case.title}: {flown.command}", soft_wrap=True)
        out.print()


def _draw(out: Path, names: tuple[str, ...]) -> None:
    from rich.console import Console

    from gcs_tools.campaigns.flights import each
    from gcs_tools.studies.figures import gamma
    from gcs_tools.studies.figures.cases import CASES, fly
    from gcs_tools.studies.figures.drawing import FIGURES, save

    out.mkdir(parents=True, exist_ok=True)
    log = Console(stderr=True, highlight=False)
    groups = dict.fromkeys(FIGURES[name].group for name in names if name in FIGURES)
    cases = [case for group in groups for case in CASES[group]]
    flown = iter(list(each(fly, cases, console=log)))
    flights = {group: [next(flown) for _ in CASES[group]] for group in groups}
    for name in names:
        path = out / f"{name}.png"
        if name in FIGURES:
            save(name, flights[FIGURES[name].group], path)
        else:
            points = list(each(gamma.flown, gamma.cases(), f"flying {name}", log))
            hovers = list(each(gamma.hover, gamma.IN_THEORY, "hovering in theory", log))
            gamma.save(points, hovers, path)
        click.echo(path)


if __name__ == "__main__":
    main()
