"""`gcs campaign`: one mission flown many times with its uncertain values sampled."""

from __future__ import annotations

import errno
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fcu.interface.files.spelling import suggestion
from fcu.interface.options import WholeNumber
from gcs_tools.cli import arguments
from gcs_tools.cli.campaign_flying import (
    JOBS,
    NEEDED,
    REPORT,
    RESULT,
    SCHEDULER,
    WAIT,
    bar,
    check_address,
    check_laws,
    first_flight,
    need,
    workers,
    write_results,
)
from gcs_tools.cli.output import Failure, print_json, print_line
from gcs_tools.exit_codes import INFRASTRUCTURE, OK, USAGE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from gcs_tools.campaigns.analysis import Analysis
    from gcs_tools.campaigns.campaign_file import Campaign
    from gcs_tools.campaigns.rare_flying import RareFound
    from gcs_tools.campaigns.store import Store


@dataclass(frozen=True)
class CampaignOptions:
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
            meant = suggestion(name, METRICS) or " (docs/missions.md lists them)"
            raise click.BadParameter(f"{name}: no such metric{meant}")
        if found.count(name) > 1:
            raise click.BadParameter(f"{name}: given twice")
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
@click.option("--flights", type=WholeNumber(1), metavar="N", help="Flights of each law, in place of the file's.")  # fmt: skip
@click.option("--seed", type=WholeNumber(0, 2**53 - 1), metavar="N", help="Seed of the draws, in place of the file's.")  # fmt: skip
@arguments.SETTINGS
@click.option("--metrics", callback=_metrics, metavar="NAME,...", help="Metrics to show; flights are ranked by the first. Default: the file's, or all that differ.")  # fmt: skip
@JOBS
@SCHEDULER
@WAIT
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

    need(*NEEDED)
    asked = CampaignOptions(
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


def _flown(asked: CampaignOptions, log: Console) -> int:
    """Fly, keep, analyse, tell; the exit code. Raises CampaignError, UsageError, OSError, Failure."""
    from fcu.kernel.compile import is_cached
    from gcs_tools.campaigns import campaign_file, rare_flying, refly, store
    from gcs_tools.campaigns.fingerprint import fingerprint, of_the_draws
    from gcs_tools.campaigns.running import Ending, RunningError, run
    from gcs_tools.flight.run import COMPILING
    from gcs_tools.flight.run_folder import new_folder

    began = time.monotonic()
    check_address(asked.scheduler)
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
        again = store.reopened(folder, allow_commands=asked.allow_commands, metrics=asked.metrics)
        asked_for, out = again, folder
    else:
        changes = campaign_file.Changes(
            asked.flights, asked.seed, campaign_file.settings(asked.settings), asked.metrics
        )
        asked_for = campaign_file.read(asked.name, changes, asked.allow_commands)
        check_laws(asked_for)
        out = asked.out or new_folder(None, asked_for.name)
    if out.exists() and not out.is_dir():
        raise campaign_file.CampaignError(f"--out {out}: expected a folder")
    with store.locked(out):
        if not is_cached("together"):
            log.print(COMPILING)
        ours = fingerprint()
        kept = store.Store(out, asked_for, {**ours, **of_the_draws()})
        first_flight(asked_for, asked.scheduler is None, log)
        if kept.flown:
            log.print(f"{out}: {kept.flown} flights are there already")
        error, exit_code, rare = "", OK, None
        try:
            total = len(asked_for.variants) * asked_for.n
            with (
                workers(asked.scheduler, asked.jobs, asked.wait_s, ours, log) as flying,
                bar(log, total, asked_for.labels) as told,
            ):
                if asked_for.document.rare is not None:
                    rare = rare_flying.fly(asked_for, kept, flying, told)
                    n = asked_for.n
                else:
                    ending = Ending.of(asked_for, kept)
                    run(asked_for, kept, flying, ending, told)
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


def _tell(
    asked: CampaignOptions, of: Campaign, kept: Store, out: Path, path: Path, began: float
) -> int:
    found, shown, content = write_results(of, kept, path, out, asked.report)
    _junit(asked, of, found, kept.errors, began)
    if asked.as_json:
        print_json(content)
    else:
        from gcs_tools.cli.campaign_summary import summary

        page = out / (REPORT if asked.report else RESULT)
        print_line("\n".join(summary(of, found, shown, out, page)))
    if kept.worst_exit:
        raise Failure(kept.first_error, kept.worst_exit)
    return int(content["exit_code"])


def _tell_rare(
    asked: CampaignOptions, of: Campaign, kept: Store, found: RareFound, out: Path
) -> int:
    from fcu.interface.files import whole_file
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


def _junit(
    asked: CampaignOptions,
    of: Campaign,
    found: Analysis | None,
    error: str | Mapping[str, str],
    began: float,
) -> None:
    if asked.junit is not None:
        from gcs_tools.campaigns.verdict import junit

        junit(of, found, error, time.monotonic() - began, asked.junit)
