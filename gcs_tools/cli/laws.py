"""`gcs compare LAW... --missions`: fly laws through the same draws, and show what came out."""

from __future__ import annotations

import errno
import json
import math
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from gcs_tools.cli.campaign_flying import (
    NEEDED,
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
    from rich.console import Console

    from gcs_tools.campaigns.comparing import Cell, Difference, Part, Row
    from gcs_tools.campaigns.entrant import Entrant
    from gcs_tools.campaigns.gains_file import Gains
    from gcs_tools.campaigns.margins import Margin
    from gcs_tools.campaigns.procedure import Procedure
    from gcs_tools.campaigns.results import Comparison
    from gcs_tools.campaigns.running import CampaignProgress
    from gcs_tools.campaigns.statistics import Interval
    from gcs_tools.judging.junit_report import Case
    from gcs_tools.missions.mission import Mission
    from gcs_tools.pictures.plot.laws import Mark

PICTURE = "results.png"
FLIGHTS = (
    "flights"  # in the folder of a comparison: its campaigns, one of each mission on each airframe
)


@dataclass(frozen=True)
class CompareOptions:
    """The command line."""

    laws: tuple[str, ...]
    missions: list[str]
    seeds: range
    airframes: tuple[str, ...]
    gains: Path | None
    margins: bool
    out: Path | None
    procedure: Path | None
    settings: tuple[str, ...]
    figure: Path | None
    jobs: int | None
    scheduler: str | None
    wait_s: float
    junit: Path | None
    as_json: bool


class _Comparison(NamedTuple):
    """A comparison read and checked, before anything is written."""

    how: Procedure
    entrants: list[Entrant]
    tuned: dict[tuple[str, str], Gains]
    missions: list[Mission]
    parts: list[Part]


def compare_laws(asked: CompareOptions) -> int:
    """Fly, write and show a comparison. Return the exit code."""
    with ExitStack() as held:
        return _compare_laws(asked, held)


def _compare_laws(asked: CompareOptions, held: ExitStack) -> int:
    """The same.  held : holds the folder until all is written."""
    from fcu.interface.files import whole_file
    from fcu.laws.loader import LawError
    from gcs_tools.campaigns import results
    from gcs_tools.campaigns.campaign_file import CampaignError
    from gcs_tools.campaigns.entrant import EntrantError
    from gcs_tools.campaigns.gains_file import GainsError
    from gcs_tools.campaigns.procedure import ProcedureError
    from gcs_tools.campaigns.running import RunningError
    from gcs_tools.campaigns.score import ENDED, RAISED
    from gcs_tools.cli.terminal import PipedConsole
    from gcs_tools.judging import junit_report
    from gcs_tools.missions.mission import MissionError

    need(*NEEDED)
    check_address(asked.scheduler)
    log = PipedConsole(stderr=True, highlight=False)
    began = time.monotonic()
    try:
        read = _read(asked, log)
        folder = held.enter_context(_folder(asked, read))
        found, cases = _compared(asked, read, folder, log)
    except (
        CampaignError,
        EntrantError,
        GainsError,
        LawError,
        MissionError,
        ProcedureError,
    ) as error:
        raise Failure(error, USAGE) from error
    except RunningError as error:
        raise Failure(error, INFRASTRUCTURE) from error
    except OSError as error:
        where = f"{error.filename}: {error.strerror}"
        if error.errno not in (errno.ENOSPC, errno.EFBIG, errno.EDQUOT):
            raise Failure(where, USAGE) from error
        kept = "" if asked.out is None else "; flights are kept: the same command goes on"
        raise Failure(where + kept, INFRASTRUCTURE) from error
    if asked.as_json:
        print_json(results.content(found))
    else:
        _print(found, PipedConsole(highlight=False))
    try:  # it is shown already: a full disk does not lose it
        _write(found, asked)
        if asked.junit is not None:
            text = junit_report.document("gcs compare", cases, time.monotonic() - began)
            whole_file.write(asked.junit, text.encode())
    except OSError as error:
        raise Failure(f"{error.filename or asked.out}: {error.strerror}", USAGE) from error
    for path in (asked.out, asked.figure):
        if path is not None and not asked.as_json:
            print_line(f"{path}")
    raised = [row for row in found.rows if row.score.lost.startswith((RAISED, ENDED))]
    if raised:
        law, first = raised[0].law, raised[0]
        of = sum(row.law == law for row in found.rows)
        raise Failure(
            f"{law} in {first.mission} with seed {first.seed}: {first.score.lost}; in"
            f" {sum(row.law == law for row in raised)} of its {of} flights, which count as lost",
            USAGE if first.score.lost.startswith(RAISED) else INFRASTRUCTURE,
        )
    return OK


def _write(found: Comparison, asked: CompareOptions) -> None:
    """The files that were asked for. Raises OSError."""
    from fcu.interface.files import whole_file
    from gcs_tools.campaigns import results

    if asked.out is not None:
        text, table = results.as_json(found).encode(), results.as_parquet(found)
        whole_file.write(asked.out / results.JSON, text, follow=False)
        whole_file.write(asked.out / results.PARQUET, table, follow=False)
        _draw(found, asked.out / PICTURE, follow=False)
    if asked.figure is not None:
        _draw(found, asked.figure)


def _read(asked: CompareOptions, log: Console) -> _Comparison:
    """Read what is compared. Raises the errors that `_compare_laws` tells."""
    from gcs_tools.campaigns import comparing, procedure
    from gcs_tools.campaigns.entrant import EntrantError, refusal
    from gcs_tools.missions.mission import load, shipped

    how = procedure.read(asked.procedure or procedure.SHIPPED)
    entrants, used = _entrants(asked, log)
    names = [each for name in asked.missions for each in shipped(name) or [name]]
    missions = [load(name) for name in _once(names, log)]
    several = [m.name for m in missions if sum(o.name == m.name for o in missions) > 1]
    if several:
        raise EntrantError(f"two missions are called {several[0]}")
    for each in entrants:
        if why := refusal(each, missions[0]):
            log.print(
                f"{each.label} on {each.airframe}: {why}; its flights count as lost", markup=False
            )
    parts = comparing.campaigns(entrants, missions, asked.seeds, how)
    for part in parts:
        check_laws(part.campaign)
    return _Comparison(how, entrants, used, missions, parts)


def _compared(
    asked: CompareOptions, read: _Comparison, folder: Path, log: Console
) -> tuple[Comparison, list[Case]]:
    """Fly it.  folder : of its campaigns."""
    from gcs_tools.campaigns import comparing, margins
    from gcs_tools.campaigns.results import Comparison

    how, entrants, used, missions, parts = read
    rows, cases = _flown(parts, asked, folder, log)
    lost_at = margins.margins(entrants, how, log) if asked.margins else []
    found = comparing.summary(rows, how.objective)
    compared = Comparison(
        entrants, used, missions, list(asked.seeds), asked.settings, how, rows, found, lost_at
    )
    return compared, cases


def _once(names: Sequence[str], log: Console) -> list[str]:
    """Names without those that come again, which are told."""
    found = list(dict.fromkeys(names))
    for name in found:
        if names.count(name) > 1:
            log.print(f"{name}: given more than once, flown once", markup=False)
    return found


@contextmanager
def _folder(asked: CompareOptions, read: _Comparison) -> Iterator[Path]:
    """Yield the folder of the campaigns, in which no other process flies. Without --out it is removed afterwards.

    Raises CampaignError for a folder that holds something else, OSError now for one that cannot be written.
    """
    from gcs_tools.campaigns import results, store

    if asked.out is None:
        with tempfile.TemporaryDirectory(prefix="gcs-compare-") as folder:
            yield Path(folder)
        return
    _check_parts(asked.out, read.parts)  # a folder of something else gets no lock
    with store.locked(asked.out, "comparison"):
        _check_parts(asked.out, read.parts)
        _check_same(asked.out / results.JSON, read.entrants, read.missions, asked.seeds)
        yield asked.out / FLIGHTS


def _check_parts(out: Path, parts: list[Part]) -> None:
    """Raise CampaignError for a folder that is neither empty nor this comparison's."""
    from gcs_tools.campaigns import results, store

    if out.exists() and not out.is_dir():
        raise store.Refused(f"--out {out}: expected a folder")
    flights, ours = out / FLIGHTS, {part.folder for part in parts}
    there = {each.name for each in out.iterdir()} if out.exists() else set()
    begun = {FLIGHTS, results.JSON} & there
    if there - {store.LOCK} and (not begun or store.JSON in there):
        raise store.not_empty(out)
    for each in (flights, *(flights / name for name in ours)):
        if each.is_symlink():
            raise store.Refused(f"{each}: expected a folder, not a link: remove it")
    if FLIGHTS in there and (other := sorted({each.name for each in flights.iterdir()} - ours)):
        raise store.Refused(
            f"{flights}: {other[0]} is of another comparison; name a new folder with --out"
        )


def _check_same(
    results: Path, entrants: list[Entrant], missions: list[Mission], seeds: range
) -> None:
    """Raise CampaignError where the folder has the results of another comparison, which these would replace."""
    from gcs_tools.campaigns.campaign_file import CampaignError

    try:
        there = json.loads(results.read_text(encoding="utf-8"))
        was = {
            "laws": {(each["law"], each["airframe"]) for each in there["laws"]},
            "missions": {each["mission"] for each in there["missions"]},
            "seeds": set(there["seeds"]),
        }
    except FileNotFoundError:
        return
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise CampaignError(f"{results}: not the results of a comparison ({error})") from error
    now = {
        "laws": {(each.label, each.airframe) for each in entrants},
        "missions": {mission.name for mission in missions},
        "seeds": set(seeds),
    }
    if other := [name for name in now if now[name] != was[name]]:
        raise CampaignError(
            f"{results}: of other {' and '.join(other)}; name a new folder with --out"
        )


def _flown(
    parts: list[Part], asked: CompareOptions, folder: Path, log: Console
) -> tuple[list[Row], list[Case]]:
    """Fly the campaigns of a comparison, one after the other. Return the rows, and the cases for JUnit.

    folder : theirs. Raises CampaignError, RunningError, OSError.
    """
    from gcs_tools.campaigns import analysis, comparing, store
    from gcs_tools.campaigns.fingerprint import fingerprint, of_the_draws
    from gcs_tools.campaigns.running import Ending, run
    from gcs_tools.campaigns.verdict import cases

    for part in {part.airframe: part for part in parts}.values():
        first_flight(part.campaign, asked.scheduler is None, log)
    rows: list[Row] = []
    told_of: list[Case] = []
    ours, before = fingerprint(), 0
    total = sum(len(part.campaign.variants) * part.campaign.n for part in parts)
    with (
        workers(asked.scheduler, asked.jobs, asked.wait_s, ours, log) as flying,
        bar(log, total) as told,
    ):
        for part in parts:
            out, began = folder / part.folder, time.monotonic()
            with store.locked(out):
                kept = store.Store(out, part.campaign, {**ours, **of_the_draws()})
                ending = Ending.of(part.campaign, kept)

                def at(progress: CampaignProgress, before: int = before) -> None:
                    told(replace(progress, flown=before + progress.flown, shares=()))

                try:
                    run(part.campaign, kept, flying, ending, at)
                except KeyboardInterrupt:
                    if asked.out is not None:
                        log.print(
                            f"{before + kept.flown} flights are kept; the same command goes on"
                        )
                    raise
                path = kept.finish(ending.n or part.campaign.n)
                before += kept.flown
                rows += comparing.rows(part, analysis.read(path))
                found = None
                if asked.out is not None:
                    found, _, _ = write_results(part.campaign, kept, path, out, page=False)
                seconds = time.monotonic() - began
                told_of += cases(part.campaign, found, kept.errors, seconds)
    return rows, told_of


def _entrants(
    asked: CompareOptions, log: Console
) -> tuple[list[Entrant], dict[tuple[str, str], Gains]]:
    """Every law on every airframe, and the files of gains that they fly with, by law and airframe."""
    from gcs_tools.campaigns import gains_file
    from gcs_tools.campaigns.entrant import DEFAULT_AIRFRAME, EntrantError, entrant

    files = gains_file.folder(asked.gains) if asked.gains is not None else []
    entrants, used = [], {}
    laws = _once(asked.laws, log)
    for airframe in _once(asked.airframes or (DEFAULT_AIRFRAME,), log):
        for law in laws:
            made = entrant(law, airframe, settings=asked.settings)
            gains = gains_file.of(files, law, made.airframe)
            if gains is not None:
                made, used[law, made.airframe] = replace(made, gains=gains.values), gains
                for change in gains_file.changes(gains, made):
                    log.print(f"{gains.path}: {change}", soft_wrap=True)
            elif asked.gains is not None:
                log.print(f"{law} on {made.airframe}: no gains in {asked.gains}, flown with its defaults")  # fmt: skip
            entrants.append(made)
    named = [(each.label, each.airframe) for each in entrants]
    if several := [name for name in named if named.count(name) > 1]:
        label, airframe = several[0]
        one_name = len(set(asked.airframes)) > len({each.airframe for each in entrants})
        what = f"airframes are called {airframe}" if one_name else f"laws are called {label}"
        raise EntrantError(f"two {what}: give one of the files another name")
    return entrants, used


# --- what is shown


def _print(found: Comparison, console: Console) -> None:
    from rich.text import Text

    airframes = dict.fromkeys(each.airframe for each in found.entrants)
    n = len(found.seeds)
    flights = f"{len(found.rows)} flight{'s' if len(found.rows) > 1 else ''}"
    seeds = f"{n} seeds" if n > 1 else "one seed, so no intervals"
    console.print(Text(f"{flights}: {seeds} of each mission", style="dim"))
    means = "error, mm RMS after the transient" + ("; ± half of the 95 % interval" if n > 1 else "")
    for airframe in airframes:
        console.print()
        console.print(Text(airframe, style="bold"), Text(means, style="dim"))
        console.print(_errors(found, airframe))
        console.print()
        console.print(_overall(found, airframe))
        if any(each.airframe == airframe for each in found.summary.differences):
            console.print()
            console.print(_differences(found, airframe))
        if margins := [each for each in found.margins if each.airframe == airframe]:
            console.print()
            console.print(_margins(margins))


def _table(first: str, columns: list[str]):  # type: ignore[no-untyped-def]
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column(first, no_wrap=True)
    for name in columns:
        table.add_column(name, justify="right", overflow="fold")
    return table


def _errors(found: Comparison, airframe: str):  # type: ignore[no-untyped-def]
    """Missions by laws; the least error of a mission is bold."""
    laws = [each.label for each in found.entrants if each.airframe == airframe]
    table = _table("", laws)
    for mission in found.missions:
        cells = [
            cell
            for law in laws
            for cell in found.summary.cells
            if (cell.airframe, cell.mission, cell.law) == (airframe, mission.name, law)
        ]
        least = min((c.means["error_m"].value for c in cells if not c.lost), default=math.nan)
        table.add_row(mission.name, *(_cell(cell, least) for cell in cells))
    return table


def _cell(cell: Cell, least: float):  # type: ignore[no-untyped-def]
    from rich.text import Text

    error = cell.means["error_m"]
    text = Text("" if cell.lost == cell.flights else _millimetres(error))
    if cell.lost:
        text.append(
            f" {cell.lost} lost".lstrip() if not text else f" {cell.lost} lost", style="red"
        )
    elif error.value == least:
        text.stylize("bold")
    return text


def _overall(found: Comparison, airframe: str):  # type: ignore[no-untyped-def]
    of = [each for each in found.summary.overall if each.airframe == airframe]
    table = _table("all missions", [each.law for each in of])
    table.add_row("cost", *(_interval(each.cost, 1.0, ".2f") for each in of))
    table.add_row("lost, %", *(_share(each.lost) for each in of))
    for name, said, factor, form in (
        ("error_all_m", "whole flight, m", 1.0, ".2f"),
        ("thrust", "most thrust, %", 100.0, ".1f"),
        ("tilt", "most tilt, %", 100.0, ".1f"),
        ("saturated", "saturated, %", 100.0, ".2f"),
        ("energy_j", "energy, kJ", 1e-3, ".1f"),
        ("noise", "rotor noise, %", 100.0, ".2f"),
    ):
        table.add_row(said, *(_interval(each.means[name], factor, form) for each in of))
    return table


def _differences(found: Comparison, airframe: str):  # type: ignore[no-untyped-def]
    """Error less that of the first law, over common seeds; certain ones are bold."""
    of = [each for each in found.summary.differences if each.airframe == airframe]
    laws = list(dict.fromkeys(each.law for each in of))
    table = _table(f"error minus {of[0].first}'s, mm", laws)
    for mission in dict.fromkeys(each.mission for each in of):
        row = [each for law in laws for each in of if (each.mission, each.law) == (mission, law)]
        table.add_row(mission, *(_difference(each, len(found.seeds)) for each in row))
    overall = {each.law: each for each in found.summary.overall if each.airframe == airframe}
    table.add_section()
    table.add_row("cost, all missions", *(_cost(overall[law].cost_less_first) for law in laws))
    return table


def _cost(interval: Interval):  # type: ignore[no-untyped-def]
    from rich.text import Text

    return Text(_interval(interval, 1.0, "+.2f"), style="bold" if interval.excludes_zero else "")


def _difference(each: Difference, seeds: int):  # type: ignore[no-untyped-def]
    from rich.text import Text

    if not each.pairs:
        return Text("none in common", style="dim")
    told = Text(_millimetres(each.error_m, "+"), style="bold" if each.error_m.excludes_zero else "")
    if each.pairs < seeds:
        told.append(f" of {each.pairs}", style="red")
    return told


def _margins(margins: list[Margin]):  # type: ignore[no-untyped-def]
    laws = list(dict.fromkeys(each.law for each in margins))
    table = _table("not lost up to", laws)
    for quantity in dict.fromkeys(each.quantity for each in margins):
        of = [each for law in laws for each in margins if (each.quantity, each.law) == (quantity, law)]  # fmt: skip
        table.add_row(f"{quantity}, {of[0].unit}", *map(_held, of))
    return table


def _held(margin: Margin) -> str:
    if margin.held is None:
        return "always lost"
    return f"{margin.held:.3g}" + ("" if margin.lost is not None else " or more")


def _millimetres(interval: Interval, sign: str = "") -> str:
    size = abs(interval.value)
    form = f"{sign}.{1 if size < 0.1 else 0}f" if size >= 1e-3 else f"{sign}.2f"
    return _interval(interval, 1e3, form)


def _interval(interval: Interval, factor: float, form: str) -> str:
    """A value, and half of its interval: a column has room for no more."""
    value, low, high = (factor * number for number in interval)
    if not math.isfinite(value):
        return "-"
    if not math.isfinite(low):
        return f"{value:{form}}"
    return f"{value:{form}} ±{0.5 * (high - low):{form.lstrip('+')}}"


def _share(interval: Interval) -> str:
    """A share is far from the middle of its interval."""
    value, low, high = (
        f"{100.0 * number:.2g}" if number < 0.095 else f"{100.0 * number:.0f}"
        for number in interval
    )
    return f"{value} ({low}-{high})"


def _draw(found: Comparison, path: Path, follow: bool = True) -> None:
    from fcu.interface.files import whole_file
    from gcs_tools.pictures.plot.laws import draw

    kind = path.suffix.lower().removeprefix(".")
    picture = draw([_mark(cell) for cell in found.summary.cells], kind)
    whole_file.write(path, picture, follow)


def _mark(cell: Cell) -> Mark:
    from gcs_tools.pictures.plot.laws import Mark

    error = cell.means["error_m"]
    return Mark(cell.airframe, cell.mission, cell.law, *error, cell.lost, cell.flights)
