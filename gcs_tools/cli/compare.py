"""`gcs compare`: several flights, or laws, side by side."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fcu.interface.options import Number
from gcs_tools.cli import arguments
from gcs_tools.cli.campaign_flying import JOBS, SCHEDULER, WAIT
from gcs_tools.cli.output import Failure, print_json
from gcs_tools.exit_codes import OK, USAGE

if TYPE_CHECKING:
    from gcs_tools.judging.comparison import ComparedFlight

LETTERS = "ABCD"  # that stand for flights above their columns
COLUMNS = len(LETTERS)  # flights with a column each; of more, least, mean and most
FORMATS = ("png", "svg", "pdf")
SEEDS = range(1, 21)
SEEDS_MOST = 10_000


def _seeds(_context: click.Context, _option: click.Parameter, value: str | None) -> range:
    """A callback: N as 1 to N, A..B as it is. Raises BadParameter."""
    if value is None:
        return SEEDS
    found = re.fullmatch(r"(\d{1,9})(?:\.\.(\d{1,9}))?", value)
    if found is None:
        raise click.BadParameter(f"{value!r}: expected a whole number, or a range as 0..20")
    first, last = (int(found[1]), int(found[2])) if found[2] else (1, int(found[1]))
    if not 0 < last + 1 - first <= SEEDS_MOST:
        raise click.BadParameter(
            f"{value!r}: expected from one to {SEEDS_MOST} seeds (the mission as written alone: 0..0)"
        )
    return range(first, last + 1)


@click.command(
    epilog="Exit codes: 0 compared, 1 worse than BASELINE (--fail, --exact), 2 something cannot be read, flown or written, 3 a law ended its process or the workers failed, 130 interrupted.\n\n"
    "LAW is a name or your own FILE.py; MISSION a name, a file, or a folder of shipped ones (benchmark)."
)
@click.argument("compared", nargs=-1, required=True, metavar="RUN RUN... | RUN BASELINE | LAW...")
@click.option("--missions", multiple=True, metavar="MISSION,...", help="Fly these with each LAW; may be repeated.")  # fmt: skip
@click.option("--seeds", callback=_seeds, metavar="N|A..B", help="Flights of each mission with seeds 1 to N, or A to B; 0 is the mission as written; default: 20.")  # fmt: skip
@click.option("--airframe", "airframes", multiple=True, metavar="NAME|FILE.toml", help="Vehicle to fly with, whatever a mission says; may be repeated; default: s1000.")  # fmt: skip
@click.option("--gains", type=click.Path(path_type=Path), metavar="FILE|FOLDER", help="Fly each LAW with its file of gains (gcs tune), if one is there.")  # fmt: skip
@click.option("--margins", is_flag=True, help="Also find the delay, rotor lag, mass and wind at which each LAW loses the vehicle.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), metavar="FOLDER", help="Write the results here, and keep the flights: an interrupted comparison goes on.")  # fmt: skip
@click.option("--procedure", "followed", type=click.Path(path_type=Path), metavar="FILE", help="Procedure to follow; default: the one that all laws are compared by.")  # fmt: skip
@arguments.SETTINGS
@click.option("--figure", type=click.Path(path_type=Path), callback=arguments.new_file, metavar="FILE", help="Draw the errors of all RUNs (needs their recordings), or LAWs.")  # fmt: skip
@click.option("--fail", is_flag=True, help="Exit with 1 when RUN is worse than BASELINE: two runs, or two folders with runs.")  # fmt: skip
@click.option("--exact", is_flag=True, help="Exit with 1 when a flight of RUN differs from that of BASELINE by a bit; tells where it differs first.")  # fmt: skip
@click.option("--tolerance", type=Number(0.0, 10.0), metavar="PART", help="With --fail, part by which a metric may be worse in flights of the same seeds; default: 0.005.")  # fmt: skip
@click.option("--junit", type=click.Path(path_type=Path), callback=arguments.new_file, metavar="FILE", help="With --fail, --exact or --missions, also write a JUnit report.")  # fmt: skip
@JOBS
@SCHEDULER
@WAIT
@arguments.as_json("Print the results as JSON.")
def compare(
    compared: tuple[str, ...], missions: tuple[str, ...], seeds: range, airframes: tuple[str, ...], gains: Path | None,
    margins: bool, out: Path | None, followed: Path | None, settings: tuple[str, ...],
    figure: Path | None, fail: bool, exact: bool, tolerance: float | None, junit: Path | None,
    jobs: int | None, scheduler: str | None, wait_s: float, as_json: bool,
) -> int:  # fmt: skip
    """Compare flights that were flown, or laws, which are flown now.

    Of two or more RUNs (the folder of a run, its result.json, or a recording): their metrics, and what
    they were flown with. Differences are from the first.

    With --fail, whether RUN is worse than BASELINE, each a run or a folder with runs.

    With --missions, fly each LAW through the same missions with the same draws of noise, wind and
    vehicle, and print errors with 95 % intervals, losses, and differences from the first LAW.
    """
    if figure is not None and figure.suffix.lower().removeprefix(".") not in FORMATS:
        raise click.UsageError(f"--figure {figure}: ends in none of {', '.join(FORMATS)}")
    is_judged = fail or exact
    if not is_judged and tolerance is not None:
        raise click.UsageError("--tolerance: goes with --fail or --exact")
    if not is_judged and junit is not None and not missions:
        raise click.UsageError("--junit: goes with --fail, --exact or --missions")
    if is_judged and (missions or figure is not None):
        raise click.UsageError("--fail and --exact compare RUN with BASELINE, and draw nothing")
    if missions:
        from gcs_tools.cli.laws import CompareOptions, compare_laws

        names = [name for each in missions for name in each.split(",") if name]
        if not names:
            raise click.UsageError("--missions: expected the name of a mission, got none")
        return compare_laws(
            CompareOptions(
                compared,
                names,
                seeds,
                airframes,
                gains,
                margins,
                out,
                followed,
                settings,
                figure,
                jobs,
                scheduler,
                wait_s,
                junit,
                as_json,
            )
        )
    of_laws = {
        "--seeds": seeds != SEEDS, "--airframe": airframes, "--gains": gains, "--margins": margins, "--out": out,
        "--procedure": followed, "--set": settings, "--jobs": jobs, "--scheduler": scheduler,
    }  # fmt: skip
    if given := [name for name, value in of_laws.items() if value]:
        raise click.UsageError(f"{given[0]}: laws are compared with --missions")
    if laws := [name for name in compared if _is_law(name)]:
        raise click.UsageError(f"{laws[0]}: a law is compared with --missions")
    if is_judged:
        from gcs_tools.campaigns.regression import TOLERANCE
        from gcs_tools.cli.regression import compare_with_baseline

        part = TOLERANCE if tolerance is None else tolerance
        return compare_with_baseline(compared, exact, part, junit, as_json)
    return _compare_runs(tuple(map(Path, compared)), figure, as_json)


def _is_law(name: str) -> bool:
    """Whether it names no run, but a law."""
    if name.endswith(".py"):
        return True
    if Path(name).exists():
        return False
    from fcu.laws import loader

    return name in loader.SHIPPED


def _compare_runs(runs: tuple[Path, ...], figure: Path | None, as_json: bool) -> int:
    from gcs_tools.judging.comparison import CompareError, all_flown

    if len(runs) < 2:
        raise click.UsageError("expected two runs or more, or laws and --missions")
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


def _json(flights: list[ComparedFlight]) -> dict[str, Any]:
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


def _print(flights: list[ComparedFlight]) -> None:
    from rich.table import Table
    from rich.text import Text

    from gcs_tools.cli.terminal import PipedConsole
    from gcs_tools.judging.comparison import difference, shown, spread, unequal

    console = PipedConsole(highlight=False)
    first, *others = flights
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("", no_wrap=True, min_width=max(map(len, shown(flights)), default=0))
    side_by_side = len(flights) <= COLUMNS
    differ = len(flights) < COLUMNS  # more does not fit 80 columns
    for i, f in enumerate(flights if side_by_side else ()):
        console.print(Text(f"{LETTERS[i]}  {f.name}"), soft_wrap=True)
        table.add_column(LETTERS[i], justify="right", no_wrap=True)
        if i and differ:
            table.add_column(f"{LETTERS[i]} - {LETTERS[0]}", justify="right", no_wrap=True)
    for heading in () if side_by_side else ("least", "mean", "most"):
        table.add_column(heading, justify="right")
    if not side_by_side:
        table.add_column("most of", overflow="fold")
    for name in shown(flights):
        row = [name]
        if side_by_side:
            row.append(_number(first.metrics.get(name)))
            for other in others:
                row.append(_number(other.metrics.get(name)))
                if differ:
                    row.append(_number(difference(name, first, other), "+", 2))
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


def _number(value: float | None, sign: str = "-", digits: int = 4) -> str:
    return "" if value is None else f"{value:{sign}.{digits}g}"
