"""`gcs tune`: gains of a law, by the procedure that is the same for all laws."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure, print_json, print_line
from gcs_tools.exit_codes import OK, USAGE

if TYPE_CHECKING:
    from gcs_tools.campaigns.entrant import Entrant
    from gcs_tools.campaigns.procedure import Procedure
    from gcs_tools.campaigns.tuning import Evaluation, Tuned


@click.command(
    epilog="Exit codes: 0 tuned, 2 invalid command line, law or procedure, or the file cannot be\n"
    "written, 130 interrupted: nothing is kept, and the same command finds the same gains.\n\n"
    "LAW is a name or your own FILE.py, whose table marks what may be chosen with gain=True."
)
@click.argument("law")
@click.option("--airframe", default="s1000", show_default=True, metavar="NAME|FILE.toml", help="Vehicle to tune for: a name, or your own file.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="File of the gains; default: LAW-AIRFRAME.toml.")  # fmt: skip
@click.option("--procedure", "followed", type=click.Path(path_type=Path), metavar="FILE", help="Procedure to follow; default: the one that all laws are tuned by.")  # fmt: skip
@arguments.SETTINGS
@arguments.as_json("Print what was found as JSON.")
def tune(
    law: str,
    airframe: str,
    out: Path | None,
    followed: Path | None,
    settings: tuple[str, ...],
    as_json: bool,
) -> int:
    """Choose the gains of LAW, by the same procedure for every law.

    Varies the gains that the law marks as free, within multiples of their defaults, to lower the
    tracking error over training flights. The gains that are best in validation flights are written to
    a file that `gcs compare --gains` takes, and whose [law] a mission may have.
    """
    from fcu.interface.files import whole_file
    from fcu.laws.loader import LawError
    from gcs_tools.campaigns import gains_file, procedure, tuning
    from gcs_tools.campaigns.entrant import EntrantError, entrant, warm_up
    from gcs_tools.missions.mission import MissionError, load

    try:
        how = procedure.read(followed or procedure.SHIPPED)
        asked = entrant(law, airframe, settings=settings)
        path = out or Path(f"{gains_file.name(asked)}.toml")
        _probe(path)
        warm_up([asked], load(how.training.missions[0]))
        with _Shown(how, asked) as shown:
            found = tuning.tune(asked, how, shown)
    except (procedure.ProcedureError, EntrantError, MissionError, LawError) as error:
        raise Failure(error, USAGE) from error
    except OSError as error:
        raise Failure(f"{error.filename}: {error.strerror}", USAGE) from error
    text = gains_file.text(asked, found, how)
    try:
        whole_file.write(path, text.encode())
    except OSError as error:  # what took so long is not lost
        if as_json:
            print_json(_json(found, path))
        else:
            print_line(text)
        raise Failure(f"{error.filename or path}: {error.strerror}", USAGE) from error
    if as_json:
        print_json(_json(found, path))
    else:
        _print(found, path)
    return OK


def _probe(path: Path) -> None:
    """Make its folder, and raise OSError or Failure now for a file that could not be written in minutes."""
    if path.exists() and not path.is_file():
        raise Failure(f"{path}: expected a file", USAGE)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():
        with path.open("ab"):
            pass
    else:
        try:
            with tempfile.TemporaryFile(dir=path.resolve().parent):
                pass
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from error


class _Shown:
    """Progress on standard error: a bar on a terminal, else a line for each seed of the optimiser."""

    def __init__(self, how: Procedure, asked: Entrant) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        from gcs_tools.cli.terminal import PipedConsole

        self._log = PipedConsole(stderr=True, highlight=False)
        columns = TextColumn("{task.description}"), BarColumn(bar_width=30), MofNCompleteColumn()
        self._bar = Progress(
            *columns, console=self._log, transient=True, disable=not self._log.is_terminal
        )
        self._task = self._bar.add_task("tuning")
        self._seeds = how.search.seeds
        self._flights = len(how.training.missions) * how.training.seeds
        self._what = f"{asked.label} on {asked.airframe}"
        self._default: float | None = None
        self._began = time.monotonic()

    def __enter__(self) -> _Shown:
        self._bar.start()
        return self

    def __exit__(self, *_why: object) -> None:
        self._bar.stop()

    def __call__(self, at: Evaluation) -> None:
        if self._default is None:
            self._default = at.cost
            plural = "" if self._flights == 1 else "s"
            each = f"{at.of} evaluations of {self._flights} flight{plural}"
            self._log.print(f"{self._what}: {len(self._seeds)} searches of {each}")
        nth, n = self._seeds.index(at.seed) + 1, len(self._seeds)
        said = f"seed {nth} of {n}: best {at.best:.4f}, defaults {self._default:.4f}"
        total = at.of * n
        self._bar.update(
            self._task, total=total, completed=(nth - 1) * at.of + at.done, description=said
        )
        if at.done == at.of:
            took = time.monotonic() - self._began
            self._log.print(f"{said} in training, {at.of} evaluations, {took:.0f} s")


def _rows(found: Tuned) -> list[tuple[str, float, float]]:
    """Name, default and tuned value of each factor."""
    rows = []
    for row, at, default in found.free:
        value = found.best.gains.get(row.key)
        numbers = [default] if value is None else value if isinstance(value, list) else [value]
        several = len(row.fields) > 1
        axes = "".join("xyz"[i] for i in at)
        name = f"{row.key} ({axes})" if several and axes != "xyz"[: len(row.fields)] else row.key
        rows.append((name, default, float(numbers[at[0]] if value is not None else default)))
    return rows


def _json(found: Tuned, path: Path) -> dict[str, Any]:
    return {
        "file": str(path),
        "gains": dict(found.best.gains),
        "cost_of_defaults": found.defaults.cost,
        "costs": [tried.cost for tried in found.found],
        "cost": found.best.cost,
        "lost": found.best.lost,
        "flights": found.flights,
        "evaluations": found.evaluations,
    }


def _print(found: Tuned, path: Path) -> None:
    from rich.table import Table
    from rich.text import Text

    from gcs_tools.cli.terminal import PipedConsole

    console = PipedConsole(highlight=False)
    table = Table("", box=None, pad_edge=False, header_style="dim")
    for heading in ("default", "tuned", "times"):
        table.add_column(heading, justify="right")
    for name, default, tuned in _rows(found):
        table.add_row(name, f"{default:.4g}", f"{tuned:.4g}", f"{tuned / default:.2f}")
    best, defaults = found.best, found.defaults
    table.add_section()
    table.add_row("cost in validation", f"{defaults.cost:.4f}", f"{best.cost:.4f}", "")
    table.add_row(f"lost of {found.flights}", str(defaults.lost), str(best.lost), "")
    console.print(table)
    others = ", ".join(f"{tried.cost:.4f}" for tried in found.found)
    console.print(Text(f"cost with each seed of the optimiser: {others}", style="dim"))
    if best.lost == found.flights:
        console.print("Every flight was lost, whatever was tried: these gains are the defaults.")
    elif best is defaults:
        console.print("Nothing that was found is better in validation: the defaults stay.")
    print_line(f"{path}")
