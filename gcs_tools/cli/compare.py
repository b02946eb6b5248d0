"""`gcs compare`: several flights side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure, print_json
from gcs_tools.exit_codes import OK, USAGE

if TYPE_CHECKING:
    from gcs_tools.judging.comparison import Flown

COLUMNS = 4  # flights with a column each; of more, least, mean and most
FORMATS = ("png", "svg", "pdf")


@click.command(
    epilog="\b\nExit codes: 0 compared, 2 a RUN cannot be read, or the figure cannot be written."
)
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN RUN...")  # fmt: skip
@click.option("--figure", type=click.Path(path_type=Path), callback=arguments.new_file, metavar="FILE", help="Also draw the errors of all of them (needs their recordings).")  # fmt: skip
@arguments.as_json("Print metrics and differences as JSON.")
def compare(runs: tuple[Path, ...], figure: Path | None, as_json: bool) -> int:
    """Compare the metrics of two or more flights, and what they were flown with.

    A RUN is the folder of a run, its result.json, or a recording. Differences are from the first.
    """
    from gcs_tools.judging.comparison import CompareError, all_flown

    if len(runs) < 2:
        raise click.UsageError("expected two runs or more")
    if figure is not None and figure.suffix.lower().removeprefix(".") not in FORMATS:
        raise click.UsageError(f"--figure {figure}: ends in none of {', '.join(FORMATS)}")
    try:
        flights = all_flown(runs)
    except CompareError as error:
        raise Failure(error, USAGE) from error
    if figure is not None:
        from gcs_tools.cli.plot import draw_several

        recorded = [run.parent if run.suffix == ".json" else run for run in runs]
        draw_several(
            [arguments.recorded(run) for run in recorded], figure, figure.suffix[1:].lower()
        )
    if as_json:
        print_json(_json(flights))
    else:
        _print(flights)
    return OK


def _json(flights: list[Flown]) -> dict[str, Any]:
    from gcs_tools.judging.comparison import difference, shown, unequal

    first, *others = flights
    return {
        "runs": [
            {
                "name": f.name, "path": str(f.path), "mission": f.mission, "passed": f.passed,
                "trajectory_sha256": f.trajectory_sha256 or None, "metrics": f.metrics,
            }
            for f in flights
        ],
        "differences": [
            {name: difference(name, first, other) for name in shown(flights)} for other in others
        ],
        "values": unequal(flights),
    }  # fmt: skip


def _print(flights: list[Flown]) -> None:
    from rich.table import Table
    from rich.text import Text

    from gcs_tools.cli.terminal import PipedConsole
    from gcs_tools.judging.comparison import difference, shown, spread, unequal

    console = PipedConsole(highlight=False)
    first, *others = flights
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("", no_wrap=True, min_width=max(map(len, shown(flights)), default=0))
    side_by_side = len(flights) <= COLUMNS
    for i, f in enumerate(flights if side_by_side else ()):
        table.add_column(Text(f.name), justify="right", overflow="fold")
        if i:
            table.add_column("difference", justify="right")
    for heading in () if side_by_side else ("least", "mean", "most"):
        table.add_column(heading, justify="right")
    if not side_by_side:
        table.add_column("most of", overflow="fold")
    for name in shown(flights):
        row = [name]
        if side_by_side:
            row.append(_number(first.metrics.get(name)))
            for other in others:
                row += [
                    _number(other.metrics.get(name)),
                    _number(difference(name, first, other), "+"),
                ]
        else:
            over = spread(name, flights)
            of = over.most_of if over.least < over.most else ""
            row += [_number(over.least), _number(over.mean), _number(over.most), of]
        table.add_row(*map(Text, row))
    console.print(table)
    for key, values in unequal(flights).items():
        few = side_by_side or len(set(values)) <= COLUMNS
        told = (value or "none" for value in (values if side_by_side else dict.fromkeys(values)))
        text = ", ".join(told) if few else f"{len(set(values))} values"
        console.print(Text(f"{key}: {text}"), soft_wrap=True)
    known = [f.passed for f in flights if f.passed is not None]
    same = {f.trajectory_sha256 for f in flights}
    equal = ", all of one trajectory, bit for bit" if len(same) == 1 and "" not in same else ""
    passed = f"; {sum(known)} of {len(known)} passed" if known else ""
    console.print(Text(f"{len(flights)} flights{passed}{equal}"), soft_wrap=True)


def _number(value: float | None, sign: str = "-") -> str:
    return "" if value is None else f"{value:{sign}.4g}"
