"""The lines that `gcs campaign` prints of a finished campaign: the success first, 80 columns at most."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from pathlib import Path

from gcs_tools.campaigns.analysis import LIKELY, Analysis, Cause, OfLaw
from gcs_tools.campaigns.campaign_file import Campaign
from gcs_tools.campaigns.refly import command
from gcs_tools.campaigns.statistics import Share
from gcs_tools.campaigns.verdict import Shown

LINES, COLUMNS = 10, 80  # at most; of several laws, a line for each and four more
METRICS = 3  # rows at most
QUANTILES = (0.05, 0.5, 0.95)  # columns
NAMED = 3  # quantities, and expectations, that a line names


def summary(
    campaign: Campaign, found: Analysis, shown: list[Shown], out: Path, page: Path
) -> list[str]:
    """The lines to print.  out : folder of the results.  page : the file that has everything."""
    first = [_shortened(campaign.document.title)]
    last = [f"Everything else: {page}"]
    if len(found.laws) > 1:
        return [*first, *_laws(found, shown), *_worst(campaign, found.laws, out), *last]
    (law,) = found.laws
    end = f", ended early of {found.of}" if found.flights < found.of else ""
    first.append(
        f"{law.law}: {law.success.successes} of {law.success.of} flights succeed{end}:"
        f" {percent(law.success, found.confidence)}"
    )
    first += [line for each in shown for line in _wrapped(f"{mark(each)}  {each}")]
    last = [*_failures(law), *_worst(campaign, found.laws, out), *last]
    return [*first, *_metrics(campaign, law, LINES - len(first) - len(last)), *last]


def mark(shown: Shown) -> str:
    """The word for an expectation in a table."""
    return "met   " if shown.passed else "MISSED"


def percent(share: Share, confidence: float) -> str:
    """The share of successful flights with its interval. Without flights: "-"."""
    if not share.of:
        return "-"
    low, high = 100.0 * share.low, 100.0 * share.high
    return (
        f"{100.0 * share.value:.2f} % ({100.0 * confidence:g} % interval {low:.2f} to {high:.2f})"
    )


def _shortened(text: str, columns: int = COLUMNS) -> str:
    return textwrap.shorten(text, columns, placeholder=" ...")


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(
        text, COLUMNS, subsequent_indent="        ", break_long_words=False, break_on_hyphens=False
    )


def _laws(found: Analysis, shown: list[Shown]) -> Iterator[str]:
    """A table with a row for each law."""
    verdicts = {each.law: mark(each) for each in shown}
    against = {each.law: each for each in found.differences}
    width = max(len("law"), *(len(each.law) for each in found.laws))
    head = f"{'law':<{width}}  succeed   success  {100.0 * found.confidence:g} % interval"
    more = "  expected" if shown else ""
    yield f"{head:<{width + 36}}{more}  difference from {found.laws[0].law}"[:COLUMNS]
    for law in found.laws:
        share, other = law.success, against.get(law.law)
        interval = f"{100.0 * share.low:.2f} to {100.0 * share.high:.2f}"
        row = f"{law.law:<{width}}  {f'{share.successes}/{share.of}':>7}  {100.0 * share.value:>6.2f} %  {interval}"
        row = f"{row:<{width + 36}}{f'  {verdicts[law.law]:<8}' if shown else ''}"
        if other is not None:
            row += f"  {100.0 * other.success:+.2f} % (p = {other.p:.2g})"
        yield row.rstrip()
    if found.flights < found.of:
        yield f"Ended early, of {found.of} flights of each law: the intervals are narrow enough."


def _failures(law: OfLaw) -> Iterator[str]:
    """The expectations that flights missed, and the drawn quantities that go with the failures."""
    if law.missed:
        named = [f"{name} by {n}" for name, n in law.missed.items()]
        yield _shortened(f"Missed: {_few(named)}")
    if clear := [cause for cause in law.causes if cause.p < LIKELY]:
        yield _shortened(f"Failures go with {_few([_said(cause) for cause in clear])}")
    elif law.causes:
        yield "No drawn quantity explains the failures."


def _few(named: list[str]) -> str:
    more = len(named) - NAMED
    return ", ".join(named[:NAMED]) + (f" and {more} more" if more > 0 else "")


def _said(cause: Cause) -> str:
    if cause.direction > 0.55:
        return f"a high {cause.name}"
    return f"a low {cause.name}" if cause.direction < 0.45 else f"the value of {cause.name}"


def _worst(campaign: Campaign, laws: tuple[OfLaw, ...], out: Path) -> Iterator[str]:
    """The command that flies the worst flight again: of the first law that has a failure."""
    named = [law for law in laws if law.worst]
    if not named:
        return
    law = next((each for each in named if not each.worst[0].success), named[0])
    worst = law.worst[0]
    again = command(out, worst.number, law.law if len(laws) > 1 else "")
    of = f" of {law.law}" if len(laws) > 1 else ""
    what = f"largest error{of}" if worst.success else f"worst failure{of}, ended by {worst.ended}"
    allowed = "" if campaign.variants[0].mission.flight.script is None else " --allow-commands"
    yield f"Fly again ({what}): {again}{allowed}"


def _metrics(campaign: Campaign, law: OfLaw, lines: int) -> Iterator[str]:
    """Quantiles of the metrics that matter most, in so many lines with their heading."""
    rows = {metric.name: metric for metric in law.metrics}
    wanted = [] if campaign.document.metrics else [*campaign.variants[0].mission.expectations()]
    order = [name for name in dict.fromkeys([*wanted, campaign.ranked_by, *rows]) if name in rows]
    if (names := order[: max(0, min(METRICS, lines - 1))]) == []:
        return
    width = max(map(len, names))
    yield f"{'quantiles over the flights':<{width}}" + "".join(
        f"{f'{100.0 * at:g} %':>11}" for at in QUANTILES
    )
    for name in names:
        values = {each.at: each.value for each in rows[name].quantiles}
        numbers = (f"{values[at]:.4g}" if math.isfinite(values[at]) else "-" for at in QUANTILES)
        yield f"{name:<{width}}" + "".join(f"{number:>11}" for number in numbers)
