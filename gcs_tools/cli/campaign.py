"""`gcs campaign`: one mission flown many times with its uncertain values sampled."""

from __future__ import annotations

import difflib
import errno
import json
import re
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure, print_json, print_line
from gcs_tools.exit_codes import INFRASTRUCTURE, MISSED, OK, USAGE

if TYPE_CHECKING:
    from rich.console import Console

    from gcs_tools.campaigns.analysis import Analysis
    from gcs_tools.campaigns.campaign_file import Campaign
    from gcs_tools.campaigns.rare_flying import RareFound
    from gcs_tools.campaigns.running import Progress, Workers
    from gcs_tools.campaigns.statistics import Share
    from gcs_tools.campaigns.store import Store

NEEDED = ("pyarrow", "scipy")
LINE_S = 10.0  # wall: between two lines off a terminal about how far a campaign is
RESULT, REPORT = "result.json", "report.html"
ADDRESS = re.compile(r"(tcp|tls)://[^\s/]+:[0-9]{1,5}")  # of a scheduler


@dataclass(frozen=True)
class Asked:
    """The command line."""

    name: str
    out: Path | None
    flights: int | None
    seed: int | None
    settings: tuple[str, ...]
    metrics: tuple[str, ...]
    jobs: int | None
    scheduler: str | None
    wait_s: float
    junit: Path | None
    report: bool
    allow_commands: bool
    as_json: bool


def _metrics(
    _context: click.Context, _option: click.Parameter, names: str | None
) -> tuple[str, ...]:
    """A callback: names of metrics. Raises BadParameter."""
    from gcs_tools.judging.metrics import METRICS

    found = tuple(filter(None, (name.strip() for name in (names or "").split(","))))
    for name in found:
        if name not in METRICS:
            close = difflib.get_close_matches(name, METRICS, n=1)
            meant = f"did you mean {close[0]}?" if close else "docs/missions.md lists them"
            raise click.BadParameter(f"{name}: no such metric ({meant})")
    return found


@click.command(
    epilog="""\b
A campaign file in a few lines (docs/campaigns.md has all keys):

\b
  title = "How often does a step of the paper settle?"
  mission = "noisy_state"
  flights = 1000
  [draw]
  "plant.mass_kg" = { uniform = [6.0, 10.0] }
  "wind.azimuth_deg" = { uniform = [0.0, 360.0] }

FILE is such a file, the name of a shipped campaign (paper_noise), or the folder of a campaign that was
interrupted: it goes on where it was. Exit codes: 0 flown, and what [expect] says is shown; 1 it is not
shown; 2 invalid command line, campaign or law; 3 a flight or what flies it failed, or the disk is full;
130 interrupted. Whatever ends a campaign, its flights are kept."""
)
@click.argument("name", metavar="FILE")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Results folder. If it already holds this campaign, continue it. Default: a new one in runs/.")  # fmt: skip
@click.option("--flights", type=click.IntRange(1), metavar="N", help="Flights of each law, in place of the file's.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0, 2**53 - 1), metavar="N", help="Seed of the draws, in place of the file's.")  # fmt: skip
@arguments.SETTINGS
@click.option("--metrics", callback=_metrics, metavar="NAME,...", help="Metrics to show; flights are ranked by the first. Default: the file's, or all that differ.")  # fmt: skip
@click.option("-j", "--jobs", type=click.IntRange(1), metavar="N", help="Worker processes; default: as many as cores.")  # fmt: skip
@click.option("--scheduler", metavar="ADDRESS", help="Fly on the workers of a Dask scheduler: tcp://HOST:8786.")  # fmt: skip
@click.option("--wait", "wait_s", type=click.FloatRange(min=0.0), default=300.0, show_default=True, metavar="S", help="Seconds to wait for a worker of the scheduler; then exit with 3.")  # fmt: skip
@click.option("--junit", type=click.Path(path_type=Path), callback=arguments.new_file, metavar="FILE", help="Also write a JUnit report.")  # fmt: skip
@click.option("--report/--no-report", default=True, show_default=True, help="Write report.html.")
@arguments.ALLOW_COMMANDS
@arguments.as_json("Print the results as JSON.")
def campaign(
    name: str, out: Path | None, flights: int | None, seed: int | None,
    settings: tuple[str, ...], metrics: tuple[str, ...], jobs: int | None, scheduler: str | None,
    wait_s: float, junit: Path | None, report: bool, allow_commands: bool, as_json: bool,
) -> int:  # fmt: skip
    """Fly a mission many times with its uncertain values sampled.

    Each flight has a number and is the same to the bit wherever it is flown. The folder of the
    results holds flights.parquet (a row for each flight), report.html and result.json, and
    `gcs fly 'FOLDER#1234'` flies a flight again and records it.
    """
    from gcs_tools.campaigns.campaign_file import CampaignError
    from gcs_tools.cli.terminal import PipedConsole
    from gcs_tools.flight.run_folder import UsageError

    _need(*NEEDED)
    asked = Asked(
        name, out, flights, seed, settings, metrics, jobs, scheduler, wait_s, junit, report,
        allow_commands, as_json,
    )  # fmt: skip
    log = PipedConsole(stderr=True, highlight=False)
    try:
        return _flown(asked, log)
    except (CampaignError, UsageError) as error:
        raise Failure(error, USAGE) from error
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise  # of what a person typed
        raise Failure(f"{error.filename or 'campaign'}: {error.strerror or error}") from error


def _need(*modules: str) -> None:
    from importlib.util import find_spec

    if lacking := [each for each in modules if find_spec(each) is None]:
        raise Failure(
            f"{', '.join(lacking)} is not installed (pip install {' '.join(lacking)})", USAGE
        )


def _flown(asked: Asked, log: Console) -> int:
    """Fly, keep, analyse, tell; the exit code. Raises CampaignError, UsageError, OSError, Failure."""
    from fcu.kernel.compile import is_cached
    from gcs_tools.campaigns import campaign_file, rare_flying, refly, store
    from gcs_tools.campaigns.fingerprint import fingerprint, of_the_draws
    from gcs_tools.campaigns.running import Ending, RunningError, run
    from gcs_tools.flight.run import COMPILING
    from gcs_tools.flight.run_folder import new_folder

    began = time.monotonic()
    if asked.scheduler is not None and not ADDRESS.fullmatch(asked.scheduler):
        raise Failure(
            f"--scheduler {asked.scheduler}: expected tcp://HOST:PORT or tls://HOST:PORT", USAGE
        )
    folder = Path(asked.name)
    if refly.is_campaign(asked.name):
        fixed = {
            "--out": asked.out, "--flights": asked.flights, "--seed": asked.seed,
            "--set": asked.settings or None,
        }  # fmt: skip
        if given := [option for option, value in fixed.items() if value is not None]:
            raise campaign_file.CampaignError(
                f"{folder}: a campaign that continues keeps its folder and its flights (leave out"
                f" {', '.join(given)})"
            )
        again = store.again(folder, allow_commands=asked.allow_commands, metrics=asked.metrics)
        asked_for, out = again, folder
    else:
        changes = campaign_file.Changes(
            asked.flights, asked.seed, campaign_file.settings(asked.settings), asked.metrics
        )
        asked_for = campaign_file.read(asked.name, changes, asked.allow_commands)
        _check_laws(asked_for)
        out = asked.out or new_folder(None, asked_for.name)
    if out.exists() and not out.is_dir():
        raise campaign_file.CampaignError(f"--out {out}: expected a folder")
    with store.locked(out):
        if not is_cached("together"):
            log.print(COMPILING)
        ours = fingerprint()
        kept = store.Store(out, asked_for, {**ours, **of_the_draws()})
        _first_flight(asked_for, asked.scheduler is None, log)
        if kept.flown:
            log.print(f"{out}: {kept.flown} flights are there already")
        error, exit_code, rare = "", OK, None
        try:
            with _workers(asked, ours, log) as workers, _bar(log, asked_for) as told:
                if asked_for.document.rare is not None:
                    rare = rare_flying.fly(asked_for, kept, workers, told)
                    n = asked_for.n
                else:
                    ending = Ending.of(asked_for, kept)
                    run(asked_for, kept, workers, ending, told)
                    n = ending.n or asked_for.n
            path = kept.finish(n)
        except RunningError as failed:
            error, exit_code = str(failed), INFRASTRUCTURE
        except OSError as failed:
            where = failed.filename or out
            error = (
                f"{where}: {failed.strerror}; what was written before is kept: go on with"
                f" gcs campaign {out}"
            )
            exit_code = INFRASTRUCTURE
        except KeyboardInterrupt:
            log.print(f"{kept.flown} flights are kept; go on with: gcs campaign {out}")
            raise
        if error:
            _junit(asked, asked_for, None, error, began)
            raise Failure(error, exit_code)
        if rare is not None:
            return _tell_rare(asked, asked_for, kept, rare, out)
        return _tell(asked, asked_for, kept, out, path, began)


def _check_laws(asked_for: Campaign) -> None:
    """Compile users' own laws. Raises CampaignError for one that does not compile, before a folder is made."""
    from fcu.laws.loader import LawError
    from gcs_tools.campaigns.campaign_file import CampaignError

    for variant in asked_for.variants:
        try:
            variant.mission.flown.check_compiles()
        except LawError as error:
            raise CampaignError(f"{asked_for.source}: {variant.label}: {error}") from error


def _first_flight(asked_for: Campaign, in_lanes: bool, log: Console) -> None:
    """Fly a tick of each law here first: compile it once, and name what cannot be flown at all.

    in_lanes : whether lanes are compiled here too.
    """
    from fcu.laws.loader import LawError
    from gcs_tools.campaigns.batch import VEHICLE
    from gcs_tools.campaigns.campaign_file import CampaignError
    from gcs_tools.flight import law_alone, several
    from gcs_tools.flight.forking import load
    from gcs_tools.flight.scenario import scenario

    for variant in asked_for.variants:
        scene = scenario(variant.mission)
        if scene.script:  # compiled by the first vehicle that starts, whose log says so
            load(scene.flown)
        if scene.legs or scene.script:
            continue
        whole = asked_for.document.fly == VEHICLE
        try:  # faults that a law alone cannot fly are flown by a whole vehicle
            law_alone.warm_up(replace(scene, faults=()) if whole else scene)
        except LawError as error:
            raise CampaignError(f"{asked_for.source}: {variant.label}: {error}") from error
        lanes = in_lanes and not whole
        if lanes and several.repays(scene, asked_for.n):
            if not several.is_compiled(scene.flown.package, told=True):
                log.print(
                    f"compiling {variant.label} for lanes, once for this version (a minute or two)"
                )
            several.warm_up([scene, scene])


def _workers(asked: Asked, ours: dict[str, str], log: Console) -> AbstractContextManager[Workers]:
    from gcs_tools.campaigns.running import processes
    from gcs_tools.flight.side_by_side import cores

    if asked.scheduler is None:
        return processes(asked.jobs or cores())
    _need("distributed")
    from gcs_tools.campaigns.cluster import cluster

    return cluster(
        asked.scheduler, ours, asked.wait_s, lambda text: log.print(text, soft_wrap=True)
    )


@contextmanager
def _bar(log: Console, of: Campaign) -> Iterator[Callable[[Progress], None]]:
    """Show flights, and the interval of success as it shrinks. Off a terminal print a line every LINE_S."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"), BarColumn(bar_width=30), MofNCompleteColumn(),
        TimeRemainingColumn(),
    )  # fmt: skip
    bar = Progress(*columns, console=log, transient=True, disable=not log.is_terminal)
    with bar:
        total = len(of.variants) * of.n
        task = bar.add_task("flying", total=total)
        said_s = time.monotonic()

        def told(at: Any) -> None:
            nonlocal said_s
            named = zip(of.labels, at.shares or (), strict=False)
            shares = "  ".join(f"{law} {_percent(share)}" for law, share in named)
            bar.update(task, completed=at.flown, description=shares or "flying")
            if not log.is_terminal and (now := time.monotonic()) - said_s >= LINE_S:
                said_s = now
                text = f"{at.flown} of {total} flights" + (f": {shares}" if shares else "")
                log.print(text, soft_wrap=True)

        yield told


def _tell(asked: Asked, of: Campaign, kept: Store, out: Path, path: Path, began: float) -> int:
    from fcu.interface import whole_file
    from gcs_tools.campaigns import analysis as analyse
    from gcs_tools.campaigns.verdict import verdict

    table = analyse.read(path)
    found = analyse.analysis(of, table)
    shown = verdict(of, found)
    passed = all(each.passed for each in shown)
    exit_code: int = max(kept.worst_exit, OK if passed else MISSED)
    content = {
        "campaign": of.name,
        "title": of.document.title,
        "folder": str(out),
        "passed": exit_code == OK,
        "exit_code": exit_code,
        "error": kept.first_error if kept.worst_exit else None,
        "expectations": [
            {"law": each.law, "at_least": each.expected, "shown": each.bound,
             "confidence": each.confidence, "passed": each.passed}
            for each in shown
        ],
        **found.plain(),
    }  # fmt: skip
    text = json.dumps(content, allow_nan=False, ensure_ascii=False, indent=1) + "\n"
    whole_file.write(out / RESULT, text.encode(), follow=False)
    if asked.report:
        from gcs_tools.campaigns.report import report

        html = report(of, found, shown, table, out).encode()
        whole_file.write(out / REPORT, html, follow=False)
    _junit(asked, of, found, kept.first_error if kept.worst_exit else "", began)
    if asked.as_json:
        print_json(content)
    else:
        from gcs_tools.cli.campaign_summary import summary

        page = out / (REPORT if asked.report else RESULT)
        print_line("\n".join(summary(of, found, shown, out, page)))
    if kept.worst_exit:
        raise Failure(kept.first_error, kept.worst_exit)
    return exit_code


def _tell_rare(asked: Asked, of: Campaign, kept: Store, found: RareFound, out: Path) -> int:
    from fcu.interface import whole_file
    from gcs_tools.campaigns.report import rare_report

    content = {
        "campaign": of.name, "title": of.document.title, "folder": str(out),
        "exit_code": kept.worst_exit, "error": kept.first_error or None, **found.plain(),
    }  # fmt: skip
    text = json.dumps(content, allow_nan=False, ensure_ascii=False, indent=1) + "\n"
    whole_file.write(out / RESULT, text.encode(), follow=False)
    if asked.report:
        html = rare_report(of, found, out).encode()
        whole_file.write(out / REPORT, html, follow=False)
    if asked.as_json:
        print_json(content)
    else:
        at = found.estimate
        print_line(
            f"{of.document.title}\nprobability of failure {at.probability:.3g} ({at.low:.3g} to"
            f" {at.high:.3g}, {100.0 * found.confidence:g} %), from {found.flown} flights in all;"
            f" {at.failures} of the {at.flights} that count failed, which say as much as"
            f" {at.effective:.1f} of equal weight\n{f'{at.doubt}{chr(10)}' if at.doubt else ''}"
            f"{out / REPORT if asked.report else out}"
        )
    if kept.worst_exit:
        raise Failure(kept.first_error, kept.worst_exit)
    return OK


def _junit(asked: Asked, of: Campaign, found: Analysis | None, error: str, began: float) -> None:
    if asked.junit is not None:
        from gcs_tools.campaigns.verdict import junit

        junit(of, found, error, time.monotonic() - began, asked.junit)


def _percent(share: Share) -> str:
    if not share.of:
        return "-"
    return f"{100.0 * share.value:.2f} % ({100.0 * share.low:.2f}-{100.0 * share.high:.2f})"
