"""The parts of commands that fly campaigns: workers, the first flight, progress, and the files of results."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fcu.interface.options import Number, WholeNumber
from gcs_tools.cli.output import Failure
from gcs_tools.exit_codes import MISSED, OK, USAGE

if TYPE_CHECKING:
    from rich.console import Console

    from gcs_tools.campaigns.analysis import Analysis
    from gcs_tools.campaigns.campaign_file import Campaign
    from gcs_tools.campaigns.running import CampaignProgress, Workers
    from gcs_tools.campaigns.statistics import Share
    from gcs_tools.campaigns.store import Store
    from gcs_tools.campaigns.verdict import Shown

NEEDED = ("pyarrow", "scipy")
LINE_S = 10.0  # wall: between two lines off a terminal about how far a campaign is
RESULT, REPORT = "result.json", "report.html"
ADDRESS = re.compile(r"(tcp|tls)://[^\s/]+:[0-9]{1,5}")  # of a scheduler

JOBS = click.option("-j", "--jobs", type=WholeNumber(1), metavar="N", help="Worker processes; default: as many as cores.")  # fmt: skip
SCHEDULER = click.option("--scheduler", metavar="ADDRESS", help="Fly on the workers of a Dask scheduler: tcp://HOST:8786.")  # fmt: skip
WAIT = click.option("--wait", "wait_s", type=Number(min=0.0), default=300.0, show_default=True, metavar="S", help="Seconds to wait for a worker of the scheduler; then exit with 3.")  # fmt: skip


def check_address(scheduler: str | None) -> None:
    """Raise Failure for an address that no scheduler has."""
    if scheduler is not None and not ADDRESS.fullmatch(scheduler):
        raise Failure(
            f"--scheduler {scheduler}: expected tcp://HOST:PORT or tls://HOST:PORT", USAGE
        )


def need(*modules: str) -> None:
    """Raise Failure for a package that is not installed."""
    from importlib.util import find_spec

    if lacking := [each for each in modules if find_spec(each) is None]:
        raise Failure(
            f"{', '.join(lacking)} is not installed (pip install {' '.join(lacking)})", USAGE
        )


def check_laws(asked_for: Campaign) -> None:
    """Compile users' own laws. Raises CampaignError for one that does not compile, before a folder is made."""
    from fcu.laws.loader import LawError
    from gcs_tools.campaigns.campaign_file import CampaignError

    for variant in asked_for.variants:
        try:
            variant.mission.flown.check_compiles()
        except LawError as error:
            raise CampaignError(f"{asked_for.source}: {variant.label}: {error}") from error


def first_flight(asked_for: Campaign, in_lanes: bool, log: Console) -> None:
    """Fly a tick of each law here first: compile it once, and name what cannot be flown at all.

    in_lanes : whether lanes are compiled here too.
    """
    from fcu.laws.loader import LawError
    from gcs_tools.campaigns.batch import VEHICLE
    from gcs_tools.campaigns.campaign_file import CampaignError
    from gcs_tools.flight import law_alone, law_flights
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
            law_alone.warm_up(replace(scene, faults=(), parameters={}) if whole else scene)
        except LawError as error:
            raise CampaignError(f"{asked_for.source}: {variant.label}: {error}") from error
        lanes = in_lanes and not whole
        if lanes and law_flights.repays(scene, asked_for.in_all or asked_for.n):
            if not law_flights.is_compiled(scene.flown.package, told=True):
                log.print(
                    f"compiling {variant.label} for lanes, once for this version (a minute or two)"
                )
            law_flights.warm_up([scene, scene])


def workers(
    scheduler: str | None, jobs: int | None, wait_s: float, ours: dict[str, str], log: Console
) -> AbstractContextManager[Workers]:
    """Worker processes here, or those of a scheduler.  ours : the fingerprint here."""
    from gcs_tools.campaigns.running import processes
    from gcs_tools.flight.side_by_side import cores

    if scheduler is None:
        return processes(jobs or cores())
    need("distributed")
    from gcs_tools.campaigns.cluster import cluster

    return cluster(scheduler, ours, wait_s, lambda text: log.print(text, soft_wrap=True))


@contextmanager
def bar(
    log: Console, total: int, labels: Sequence[str] = ()
) -> Iterator[Callable[[CampaignProgress], None]]:
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
    shown = Progress(*columns, console=log, transient=True, disable=not log.is_terminal)
    with shown:
        task = shown.add_task("flying", total=total)
        said_s = time.monotonic()

        def told(at: Any) -> None:
            nonlocal said_s
            named = zip(labels, at.shares or (), strict=False)
            shares = "  ".join(f"{law} {_percent(share)}" for law, share in named)
            shown.update(task, completed=at.flown, description=shares or "flying")
            if not log.is_terminal and (now := time.monotonic()) - said_s >= LINE_S:
                said_s = now
                text = f"{at.flown} of {total} flights" + (f": {shares}" if shares else "")
                log.print(text, soft_wrap=True)

        yield told


def write_results(
    of: Campaign, kept: Store, path: Path, out: Path, page: bool = True
) -> tuple[Analysis, list[Shown], dict[str, Any]]:
    """Write result.json, the page and a map that is asked for. Return what the flights say. Raises OSError.

    path : the file of the flights.  out : the folder.
    """
    from fcu.interface.files import whole_file
    from gcs_tools.campaigns import analysis as analyse
    from gcs_tools.campaigns import maps
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
    if page:
        from gcs_tools.campaigns.report import report

        pictures = maps.save(of, table, out)
        html = report(of, found, shown, table, out, pictures).encode()
        whole_file.write(out / REPORT, html, follow=False)
    return found, shown, content


def _percent(share: Share) -> str:
    if not share.of:
        return "-"
    return f"{100.0 * share.value:.2f} % ({100.0 * share.low:.2f}-{100.0 * share.high:.2f})"
