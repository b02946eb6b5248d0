"""The report of a campaign: one HTML page that needs no network, no script and no other file."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.files.input_file import written
from gcs_tools.campaigns.analysis import LIKELY, Analysis, Difference, Flights, OfLaw, Quantile
from gcs_tools.campaigns.batch import VEHICLE
from gcs_tools.campaigns.campaign_file import Campaign
from gcs_tools.campaigns.distributions import Distribution
from gcs_tools.campaigns.rare_flying import RareFound
from gcs_tools.campaigns.refly import command
from gcs_tools.campaigns.statistics import interval
from gcs_tools.campaigns.store import DRAWN
from gcs_tools.campaigns.verdict import Shown
from gcs_tools.judging.metrics import SETTLE_S
from gcs_tools.pictures.plot import campaign as plot
from gcs_tools.pictures.plot.campaign import Panel

NAMED = 3  # of them, whose values stand beside the worst flights
PANELS = 6  # quantities that are drawn, the clearest first
MOST_METRICS = 12  # that are drawn
STYLE = """
:root { --ink: #222; --grey: #666; --line: #e3e3e3; --good: #1b7a3d; --bad: #b22222; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2.2rem 1.6rem 4rem; max-width: 68rem; color: var(--ink); background: #fff;
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.55rem; line-height: 1.25; margin: 0 0 .3rem; }
h2 { font-size: 1.12rem; margin: 2.6rem 0 .6rem; padding-top: .9rem; border-top: 1px solid var(--line); }
h3 { font-size: 1rem; margin: 1.4rem 0 .3rem; }
p { margin: .4rem 0 .8rem; max-width: 52rem; }
.dim, small { color: var(--grey); }
.cards { display: flex; flex-wrap: wrap; gap: .9rem; margin: 1.3rem 0 .6rem; }
.card { flex: 1 1 15rem; border: 1px solid var(--line); border-radius: 8px; padding: .9rem 1.1rem; }
.card b { display: block; font-size: 2rem; line-height: 1.2; font-weight: 650; }
.met { color: var(--good); } .missed { color: var(--bad); }
.verdict { border-left: 4px solid; padding: .25rem 0 .25rem .8rem; margin: .5rem 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; width: 100%; font-size: .9rem; }
th { text-align: right; font-weight: 600; color: var(--grey); border-bottom: 1px solid var(--line); }
th, td { padding: .3rem .7rem .3rem 0; vertical-align: top; }
td { text-align: right; border-bottom: 1px solid #f1f1f1; }
th:first-child, td:first-child, .left { text-align: left !important; }
td small { display: block; font-size: .78rem; white-space: nowrap; }
code { font: .86em ui-monospace, "DejaVu Sans Mono", monospace; background: #f5f5f5; padding: .1em .35em;
  border-radius: 4px; user-select: all; white-space: nowrap; }
th { white-space: nowrap; }
svg, img { width: 100%; height: auto; }
@media print { body { max-width: none; padding: 0; } h2 { break-after: avoid; } svg { break-inside: avoid; } }
"""


def report(
    campaign: Campaign, found: Analysis, shown: Sequence[Shown], table: Any, folder: Path,
    maps: Sequence[Path] = (),
) -> str:  # fmt: skip
    """The page.  folder : the campaign's, as commands on the page name it.  maps : pictures, which the page then holds."""
    flights = {law: Flights(table, law) for law in campaign.labels}
    body = "\n".join(_body(campaign, found, shown, flights, folder, maps))
    return _page(campaign, body)


def rare_report(campaign: Campaign, found: RareFound, folder: Path) -> str:
    """The page of a campaign that looked for rare failures."""
    return _page(campaign, "\n".join(_rare_body(campaign, found, folder)))


def _page(campaign: Campaign, body: str) -> str:
    title = escape(campaign.document.title)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n<title>{title}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def _rare_body(campaign: Campaign, found: RareFound, folder: Path) -> Iterator[str]:
    rare, at = campaign.document.rare, found.estimate
    assert rare is not None
    beyond = f"> {rare.limit:g}" if rare.limit is not None else f"< {rare.at_least:g}"
    yield f"<h1>{escape(campaign.document.title)}</h1>"
    mission = campaign.variants[0].mission
    yield (
        f'<p class="dim">{found.flown:,} flights of {escape(mission.name)} with'
        f" {escape(mission.airframe.name)} and {escape(campaign.labels[0])}.</p>"
        '<div class="cards"><div class="card"><span class="dim">probability of failure:'
        f" {escape(rare.metric)} {escape(beyond)}, or lost</span><b>{at.probability:.3g}</b>"
        f'{at.low:.3g} to {at.high:.3g} <span class="dim">with {100 * found.confidence:g} %'
        f" confidence</span><br><small>{at.failures:,} of the {at.flights:,} flights that count"
        f" failed, which say as much as {at.effective:,.1f} of equal weight</small></div></div>"
    )
    if at.doubt:
        yield f"<p><b>{escape(at.doubt)}</b></p>"
    if math.isfinite(found.plain_flights):
        yield f"<p>Without importance sampling, an interval as narrow takes some {found.plain_flights:,.0f} flights.</p>"  # fmt: skip
    if found.levels and found.levels[-1] < 0.0:
        yield "<p>The stages ended before a tenth of the flights failed: give more stages, or larger ones.</p>"  # fmt: skip
    yield "<h2>Where failures are</h2>"
    rows = [
        (escape(each.name), _value(each.median), _value(each.of_failures)) for each in found.typical
    ]
    yield _table(("quantity", "median", "median of failures"), rows)
    yield "<h2>Stages</h2>"
    rows = [
        (f"{i + 1}", f"{level:.4g}" if math.isfinite(level) else "all lost", f"<code>{escape(command(folder, i * rare.stage))}</code>")
        for i, level in enumerate(found.levels)
    ]  # fmt: skip
    yield _table(("stage", "worst tenth beyond the limit", "its first flight"), rows)
    yield (
        "<p><small>Each stage is drawn from where the worst tenth of the flights before it were; 0: a tenth"
        " failed. The interval is Student's, of the weighted flights. It cannot count a region of failures"
        " that no flight has met.</small></p><h2>What was drawn</h2>"
    )
    yield _drawn(campaign)


def _body(
    campaign: Campaign, found: Analysis, shown: Sequence[Shown], flights: Mapping[str, Flights],
    folder: Path, maps: Sequence[Path],
) -> Iterator[str]:  # fmt: skip
    several = len(found.laws) > 1
    yield f"<h1>{escape(campaign.document.title)}</h1>"
    yield f'<p class="dim">{_about(campaign, found)}</p>'
    yield '<div class="cards">' + "".join(_card(of, found) for of in found.laws) + "</div>"
    for each in shown:
        state, word = ("met", "Met") if each.passed else ("missed", "Missed")
        yield f'<div class="verdict {state}"><b>{word}.</b> {escape(str(each))}.</div>'
    at_each_look = partial(interval, confidence=found.looks.confidence(found.confidence))
    for path in maps:
        picture = base64.b64encode(path.read_bytes()).decode()
        yield f'<p><img alt="map" src="data:image/png;base64,{picture}"></p>'
    yield plot.shrinking({law: of.success for law, of in flights.items()}, at_each_look)
    yield f"<p><small>{_of_the_interval(campaign, found)}</small></p>"
    if found.differences:
        yield "<h2>Differences between laws, flight by flight</h2>"
        yield from _differences(found.differences)
    yield from _failures(campaign, found, flights, several)
    yield "<h2>Worst flights</h2>"
    yield (
        "<p>Failed flights first, lost ones before others, then by"
        f" {escape(campaign.ranked_by)}. The command flies a flight again, records it in full, and says"
        " whether it is the same to the bit.</p>"
    )
    for of in found.laws:
        if several:
            yield f"<h3>{escape(of.law)}</h3>"
        yield _worst(campaign, of, flights[of.law], folder, several)
    yield "<h2>Metrics</h2>"
    names = list(dict.fromkeys(metric.name for of in found.laws for metric in of.metrics))
    values = {name: {law: of.numbers(name) for law, of in flights.items()} for name in names}
    if names:
        yield plot.histograms(dict(list(values.items())[:MOST_METRICS]))
    for of in found.laws:
        if several:
            yield f"<h3>{escape(of.law)}</h3>"
        yield _metrics(of)
    yield (
        f"<p><small>Quantiles over flights; below each its {100 * found.confidence:g} % interval, of order"
        " statistics, which holds for any distribution (–: too few flights for that end). Settled metrics"
        f" count from {SETTLE_S:g} s after the last step. At the edges of a histogram stand the flights"
        " beyond it.</small></p>"
    )
    yield "<h2>What was drawn</h2>"
    yield _drawn(campaign)


def _about(campaign: Campaign, found: Analysis) -> str:
    mission, document = campaign.variants[0].mission, campaign.document
    how = {
        "random": "drawn at random", "latin_hypercube": "drawn by Latin hypercube",
        "sobol": "drawn by a scrambled Sobol sequence", "grid": "on a grid", "list": "as listed",
    }[document.method]  # fmt: skip
    seeds = document.seeds is not None
    n = f"{found.flights:,} flights" + (" of each law" if len(found.laws) > 1 else "")
    if found.flights < found.of:
        n += f" (of {found.of:,}: it ended early)"
    whole = "the whole vehicle" if document.fly == VEHICLE else "the law without an autopilot"
    return escape(
        f"{n} of {mission.name} with {mission.airframe.name}, {how},"
        f" {'first seed' if seeds else 'seed'} {document.seed}; {whole}."
    )


def _card(of: OfLaw, found: Analysis) -> str:
    ends = ", ".join(f"{n:,} {word}" for word, n in of.endings.items())
    missed = ", ".join(f"{name} by {n:,}" for name, n in of.missed.items())
    missed = f"; missed: {escape(missed)}" if missed else ""
    low, high = (_percent(end) for end in (of.success.low, of.success.high))
    return (
        f'<div class="card"><span class="dim">{escape(of.law)}: success</span>'
        f"<b>{_percent(of.success.value)}</b>{low} to {high}"
        f' <span class="dim">with {100 * found.confidence:g} % confidence</span><br>'
        f"<small>{of.success.successes:,} of {of.success.of:,}; ended by: {escape(ends)}{missed}</small></div>"
    )


def _of_the_interval(campaign: Campaign, found: Analysis) -> str:
    text = "Intervals of shares are exact (Clopper and Pearson)."
    if found.looks.width is not None:
        looks = ", ".join(f"{n:,}" for n in found.looks.at)
        text += (
            f" The campaign was to end when they are no wider than {100 * found.looks.width:g} %, and was"
            f" looked at after {looks} flights. Each look has an equal part of the error, so the interval"
            " holds wherever it ended."
        )
    if campaign.document.method in ("latin_hypercube", "sobol"):
        text += (
            " They are those of independent flights. Flights that are laid out together scatter less as a"
            " rule, so the intervals are wider than need be."
        )
    if campaign.document.method in ("grid", "list"):
        text += " Points of a grid or a list are chosen: the share is that of these points."
    return escape(text)


def _differences(differences: Iterable[Difference]) -> Iterator[str]:
    rows = [
        (
            f"{each.law} minus {each.first}",
            f"{100 * each.success:+.2f} %<small>{100 * each.low:+.2f} to {100 * each.high:+.2f}</small>",
            f"{each.better:,}", f"{each.worse:,}", _p(each.p), escape(each.metric),
            _quantile(each.median),
        )
        for each in differences
    ]  # fmt: skip
    heads = ("", "success", "succeeds alone", "fails alone", "p", "metric", "median difference")
    yield _table(heads, rows, left=(0, 5))
    yield (
        "<p><small>The same draws for all laws. p: of no difference in success (McNemar, exact). The"
        " interval of the difference holds for few flights too, and is wider than need be.</small></p>"
    )


def _failures(
    campaign: Campaign, found: Analysis, flights: Mapping[str, Flights], several: bool
) -> Iterator[str]:
    if not campaign.draws.names:
        return
    yield "<h2>What explains the failures</h2>"
    for of in found.laws:
        if several:
            yield f"<h3>{escape(of.law)}</h3>"
        if not of.causes:
            yield (
                "<p>Every flight succeeds.</p>"
                if of.success.successes
                else "<p>Every flight fails.</p>"
            )
            continue
        clear = [cause for cause in of.causes if cause.p < LIKELY]
        if clear:
            said = "; ".join(f"{c.name} ({_direction(c.direction)}, p {_p(c.p)})" for c in clear)
            yield f"<p>Failures go with {escape(said)}.</p>"
        else:
            yield f"<p>No drawn quantity tells failed flights from others (p &lt; {LIKELY:g}).</p>"
        yield plot.effects(
            [cause.name for cause in of.causes], [cause.effect for cause in of.causes],
            [cause.p < LIKELY for cause in of.causes],
        )  # fmt: skip
        law = flights[of.law]
        yield "<h3>Failed flights, %</h3>"
        yield plot.failures(
            [_panel(law, cause.name) for cause in of.causes[:PANELS]],
            partial(interval, confidence=found.confidence),
        )
    yield (
        "<p><small>How much they differ: the greatest distance between the distributions of a quantity in"
        " failed and in successful flights (Kolmogorov and Smirnov; of words, total variation), from 0 to"
        f" 1. Red: p &lt; {LIKELY:g}, corrected for the number of quantities (Holm). High or low: whether"
        " failed flights have the greater values (Mann and Whitney). Below, flights are cut into parts of"
        f" equal number, each with its {100 * found.confidence:g} % interval; the grey line is the share of"
        " all flights.</small></p>"
    )


def _panel(law: Flights, name: str) -> Panel:
    words = law.words(f"{DRAWN}{name}")
    values = law.numbers(f"{DRAWN}{name}").tolist() if words is None else words
    known = [value is not None and value == value for value in values]
    kept = [value for value, is_known in zip(values, known, strict=True) if is_known]
    return Panel(name, kept, law.success[np.array(known, dtype=bool)])


def _worst(campaign: Campaign, of: OfLaw, law: Flights, folder: Path, several: bool) -> str:
    places = {number: i for i, number in enumerate(law.number.tolist())}
    names = [cause.name for cause in of.causes[:NAMED]] or list(campaign.draws.names[:NAMED])
    columns = {name: law.words(f"{DRAWN}{name}") or law.numbers(f"{DRAWN}{name}") for name in names} if names else {}  # fmt: skip
    rows = []
    for each in of.worst:
        i = places[each.number]
        state = '<span class="met">success</span>' if each.success else '<span class="missed">failure</span>'  # fmt: skip
        rows.append(
            (
                f"<code>{escape(command(folder, each.number, of.law if several else ''))}</code>",
                state,
                escape(each.error or each.ended),
                "–" if each.value is None else f"{each.value:.4g}",
                *(_value(columns[name][i]) for name in names),
            )
        )
    heads = ("fly it again", "", "ended by", campaign.ranked_by, *names)
    return _table(heads, rows, left=(0, 1, 2))


def _metrics(of: OfLaw) -> str:
    rows = [
        (escape(metric.name), f"{metric.n:,}", *map(_quantile, metric.quantiles))
        for metric in of.metrics
    ]
    ends = [f"{100 * at.at:g} %" for at in of.metrics[0].quantiles] if of.metrics else []
    return _table(("", "flights", *ends), rows)


def _drawn(campaign: Campaign) -> str:
    drawn = campaign.draws.drawn
    if campaign.document.seeds is not None:
        return "<p>Noise, wind, and a vehicle within what the airframe's file believes, as for all comparisons.</p>"
    if not drawn:
        return f"<p>{len(campaign.draws.points)} listed points.</p>" if campaign.draws.points else "<p>Nothing but the noise.</p>"  # fmt: skip
    rows = [(escape(each.name), escape(_said(distribution))) for each, distribution in drawn]
    return _table(("quantity", "distribution"), rows, left=(0, 1))


def _said(of: Distribution) -> str:
    given = of.model_dump(exclude_none=True, exclude_defaults=True)
    kind = of.kind
    text = f"{kind.replace('_', ' ')} {written(given.pop(kind))}"
    relative = given.pop("relative", False)
    text += "".join(f", {name} {written(value)}" for name, value in given.items())
    return f"{text}, times the mission's value" if relative else text


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], left: Sequence[int] = (0,)) -> str:
    def cells(tag: str, values: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{' class=left' if i in left else ''}>{value}</{tag}>"
            for i, value in enumerate(values)
        )

    head = cells("th", [escape(each) for each in heads])
    lines = "\n".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f'<div class="wide"><table><tr>{head}</tr>\n{lines}</table></div>'


def _percent(part: float) -> str:
    return f"{100 * part:.2f} %" if math.isfinite(part) else "–"


def _quantile(of: Quantile) -> str:
    if not math.isfinite(of.value):
        return "–"
    low, high = (f"{end:.4g}" if math.isfinite(end) else "–" for end in (of.low, of.high))
    return f"{of.value:.4g}<small>{low} to {high}</small>"


def _value(value: Any) -> str:
    if value is None:
        return "–"
    return escape(value) if isinstance(value, str) else f"{value:.4g}"


def _p(p: float) -> str:
    return "< 1e-12" if p < 1e-12 else f"{p:.2g}"


def _direction(part: float) -> str:
    if not 0.0 <= part <= 1.0:
        return "by kind"
    return "high" if part > 0.55 else "low" if part < 0.45 else "neither high nor low alone"
