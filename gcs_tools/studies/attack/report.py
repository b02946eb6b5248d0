"""What a campaign found: counts with their confidence limits, as a table and as JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table
from scipy.stats import binomtest

from gcs_tools.studies.attack.verdict import Verdict

CONFIDENCE = 0.95  # two-sided
SHOWN = 10  # of the worst flights

Campaign = Mapping[int, Verdict]  # by number of the flight


class Tally(NamedTuple):
    """What came of a group of flights."""

    flights: int
    force: int
    torque: int
    yaw: int
    lost: int
    not_arrived: int
    margin_n: float  # least
    room_n: float  # least
    rotors_median: float  # part of the ticks of a flight with torque or yaw given up
    rotors_90: float
    difference: float  # greatest, over what is allowed for
    admitted: float  # part of the setpoints, mean over flights
    took: float  # greatest part of the time that is stated
    told: int  # something seems not as believed


COLUMNS = {
    "flights": "flights",
    "force": "thrust, tilt",
    "torque": "torque",
    "yaw": "yaw",
    "lost": "lost",
    "not_arrived": "not arrived",
    "margin_n": "margin, N",
    "room_n": "room, N",
    "rotors_median": "rotors 50 %",
    "rotors_90": "90 %",
    "difference": "m z",
    "admitted": "admitted",
    "took": "took",
    "told": "told",
}
COUNTED: dict[str, Callable[[Verdict], bool]] = {
    "saturated": lambda v: v.saturated,
    "lost": lambda v: v.lost,
    "not_arrived": lambda v: not v.arrived,
    "late": lambda v: v.late,
    "contradicts": lambda v: v.contradicts,
}


def tally(verdicts: Sequence[Verdict]) -> Tally:
    """Of one flight or more."""
    rotors = np.array([v.rotors for v in verdicts])
    return Tally(
        flights=len(verdicts),
        force=sum(v.force for v in verdicts),
        torque=sum(v.torque for v in verdicts),
        yaw=sum(v.yaw for v in verdicts),
        lost=sum(v.lost for v in verdicts),
        not_arrived=sum(not v.arrived for v in verdicts),
        margin_n=min(v.margin_n for v in verdicts),
        room_n=min(v.room_n for v in verdicts),
        rotors_median=float(np.median(rotors)),
        rotors_90=float(np.quantile(rotors, 0.9)),
        difference=max(v.difference for v in verdicts),
        admitted=float(np.mean([v.admitted for v in verdicts])),
        took=max(v.took for v in verdicts),
        told=sum(v.told for v in verdicts),
    )


def groups(campaign: Campaign) -> dict[str, Tally]:
    """All flights, then those of each class of setpoints and of each kind of wind."""
    every = list(campaign.values())
    found = {"all": tally(every)}
    for of in ("setpoints", "wind"):
        for name in sorted({getattr(v, of) for v in every}):
            found[f"{of}: {name}"] = tally([v for v in every if getattr(v, of) == name])
    return found


def upper(count: int, flights: int) -> float:
    """Clopper-Pearson upper limit of a probability, of CONFIDENCE, two-sided."""
    found = binomtest(count, flights).proportion_ci(CONFIDENCE, method="exact")
    return float(found.high)


def counted(campaign: Campaign) -> dict[str, tuple[int, float]]:
    """What contradicts the guard: how many flights, and the upper limit of their part."""
    found = {name: sum(map(test, campaign.values())) for name, test in COUNTED.items()}
    return {name: (count, upper(count, len(campaign))) for name, count in found.items()}


def worst(campaign: Campaign, count: int = SHOWN) -> dict[int, Verdict]:
    """The flights to look at first: what contradicts, then what came nearest to it."""

    def order(item: tuple[int, Verdict]) -> tuple[bool, bool, float]:
        v = item[1]
        return not v.lost, not v.contradicts, v.least_n

    return dict(sorted(campaign.items(), key=order)[:count])


def contradicts(campaign: Campaign) -> bool:
    """Whether any flight does."""
    return any(v.contradicts for v in campaign.values())


def table(policy: str, campaign: Campaign) -> Table:
    """For people: groups of flights."""
    shown = Table(title=policy, box=None, title_justify="left")
    shown.add_column("", no_wrap=True)
    for words in COLUMNS.values():
        shown.add_column(words, justify="right")
    for name, of in groups(campaign).items():
        shown.add_row(name, *(_shown(value) for value in of))
    return shown


def worst_table(flights: Mapping[Any, Verdict]) -> Table:
    """For people: flights by number."""
    shown = Table(box=None)
    for words in ("flight", "setpoints", "wind", "saturated at, s", "margin, N", "room, N", "end, m", ""):  # fmt: skip
        shown.add_column(words, justify="left" if words in ("setpoints", "wind", "") else "right")
    for number, v in flights.items():
        said = [
            word
            for word, of in (
                ("thrust or tilt", v.force), ("torque", v.torque), ("lost", v.lost), ("not arrived", not v.arrived),
            )
            if of
        ]  # fmt: skip
        shown.add_row(
            str(number), v.setpoints, v.wind, "" if v.first_s is None else f"{v.first_s:.2f}",
            _shown(v.margin_n), _shown(v.room_n), f"{v.end_m:.3g}", ", ".join(said),
        )  # fmt: skip
    return shown


def limits_in_words(campaign: Campaign) -> str:
    """Each count with its upper limit."""
    return "; ".join(
        f"{name.replace('_', ' ')} {count} of {len(campaign)} (below {100.0 * limit:.3g} %)"
        for name, (count, limit) in counted(campaign).items()
    )


def noise_in_words(campaign: Campaign) -> str:
    """In how many flights there is room for the noise that is believed, and what came of those."""
    held = [v for v in campaign.values() if v.held]
    if not held:
        return "room for the noise that is believed: in no flight"
    saturated = sum(v.saturated for v in held)
    told = sum(v.chance for v in held) / len(held)
    return (
        f"room for the noise that is believed: in {len(held)} of {len(campaign)}; of these saturated"
        f" {saturated} (below {100.0 * upper(saturated, len(held)):.3g} %; foretold, of white noise:"
        f" {100.0 * told:.3g} % at most)"
    )


def content(campaign: Campaign) -> dict[str, Any]:
    """For programs."""
    return {
        "groups": {name: plain(of._asdict()) for name, of in groups(campaign).items()},
        "counted": {
            name: {"flights": count, "upper": limit}
            for name, (count, limit) in counted(campaign).items()
        },
        "held": sum(v.held for v in campaign.values()),
        "held_saturated": sum(v.held and v.saturated for v in campaign.values()),
        "worst": {str(k): plain(v._asdict()) for k, v in worst(campaign).items()},
        "contradicting": [k for k, v in campaign.items() if v.contradicts],
        "contradicts": contradicts(campaign),
    }


def plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values that JSON has; of what is not finite, none."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in values.items()
    }


def _shown(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.3g}"
