"""What a mission expects of its flight, held against what was measured.

`[expect]` in a mission file maps a metric to a limit, in one of these forms:

    reference_error_rms_settled_m = 0.03                            # at most
    reference_error_rms_m = { limit = 0.03, from = 12.0, to = 20.0 }  # in a window of time, s
    reference_error_max_m = { at_least = 50.0 }
    margin_min_n = 0.0                                       # at least: a minimum has a floor
    margin_min_n = { at_least = 0.0, laws_with = "guard" }   # does not apply to laws without one
    ended = "diverged"                                       # how the flight must end
    reached = 0.1                                            # m, of setpoints that stand; false: no
    limited = true                                           # the vehicle limits a setpoint
    mode = "Return"                                          # at the end (judging.failsafes)

Nobody has to write that a flight ends well, that its setpoints are reached within REACHED_M, and that
the vehicle limits and refuses none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gcs_tools.judging.metrics import (
    FLOOR,
    FLOORS,
    METRICS,
    OF_ITEMS,
    OF_THE_TRUTH,
    PARTS,
    REACHED_M,
    SETTLE_S,
)
from gcs_tools.judging.setpoint_checks import Changed, Standing

MetricFunction = Callable[[str, float | None, float | None], float | None]
Reason = Callable[[str, float | None, float | None], str]
Has = Callable[[str], bool]  # whether the law has one of PARTS

GOOD_ENDINGS = ("time", "arrived")
LOST_ENDINGS = ("diverged", "crashed", "fell")
BAD_ENDINGS = (*LOST_ENDINGS, "refused")  # after which nothing is asked for any more
NOT_FINITE = "nonfinite_samples"
LAWS_WITH = "laws_with"
NOT_APPLICABLE = "not applicable"
ENDED, REACHED, LIMITED, ITEMS = "ended", "reached", "limited", "items"
MODE, FAILSAFE, FENCE_BREACHED = OF_VEHICLE = "mode", "failsafe", "fence_breached"
LAW_FAILED = "law_failed"  # a failsafe
FAULTS = "faults"  # of the mission's [plant]: nobody writes it
OTHERS = ENDED, REACHED, LIMITED, ITEMS, *OF_VEHICLE  # entries that are no metric
_KEYS = ("limit", "at_least", "from", "to", LAWS_WITH)


class ExpectError(ValueError):
    """An [expect] entry that cannot be judged: names the key and what was expected."""


@dataclass(frozen=True)
class Expectation:
    """One line of [expect], judged."""

    name: str
    limit: float | str  # at most, or at least, as `text` says; for `ended`, the ending(s)
    value: float | str | None  # measured; None: the metric has no value, which fails
    passed: bool | None  # None: it does not apply to the law that flew
    text: str  # the expectation as a person reads it, without the value
    why: str | None = None  # why there is no value, or what was missed and how

    def __str__(self) -> str:
        """The expectation and what was measured, in one line."""
        why = "" if self.why is None else f": {self.why}"
        return f"{self.text}: {self.shown}{why}"

    @property
    def is_missed(self) -> bool:
        """True unless it is met, or does not apply."""
        return self.passed is False

    @property
    def shown(self) -> str:
        """What was measured, as a person reads it."""
        if self.passed is None:
            return NOT_APPLICABLE
        if self.value is None:
            return "no value"
        if self.name == REACHED:
            value = max(float(self.value), 0.001)  # nobody asks for more
            return f"{value:.{4 if value >= 1.0 else 3}g} m at most"
        if self.name == LIMITED:
            return f"{self.value:.0f} setpoint{'s' * (self.value != 1.0)}"
        return _number(self.value)


class _Bound(NamedTuple):
    """A limit of one metric."""

    limit: float
    at_least: bool
    t_from: float | None
    t_to: float | None
    part: str | None  # of PARTS: it is expected of laws that have it


def untold(expect: Mapping[str, Any]) -> list[str]:
    """Its entries that need what a controller tells of itself."""
    inside = METRICS.keys() - OF_THE_TRUTH | {LIMITED, *OF_VEHICLE}
    return [
        name for name, entry in expect.items()
        if name in inside and not (isinstance(entry, Mapping) and LAWS_WITH in entry)
    ]  # fmt: skip


def _number(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


def _bound(name: str, entry: Any) -> _Bound:
    bare = "at_least" if name in FLOORS else "limit"
    table = dict(entry) if isinstance(entry, Mapping) else {bare: entry}
    unknown = [key for key in table if key not in _KEYS]
    if unknown:
        raise ExpectError(f"[expect] {name}.{unknown[0]}: expected one of {', '.join(_KEYS)}")
    if name in FLOORS and "limit" in table:
        raise ExpectError(f"[expect] {name}.limit: expected at_least ({FLOOR})")
    if ("limit" in table) == ("at_least" in table):
        raise ExpectError(f"[expect] {name}: expected either limit or at_least")
    part = table.pop(LAWS_WITH, None)
    if part is not None and part not in PARTS:
        raise ExpectError(
            f"[expect] {name}.{LAWS_WITH}: expected one of {', '.join(PARTS)}, got {part!r}"
        )
    for key, value in table.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value):
            raise ExpectError(f"[expect] {name}.{key}: expected a finite number, got {value!r}")
    at_least = "at_least" in table
    limit = float(table["at_least" if at_least else "limit"])
    return _Bound(limit, at_least, table.get("from"), table.get("to"), part)


def judge_metric(
    name: str,
    entry: Any,
    metric: MetricFunction,
    reason: Reason | None = None,
    has: Has | None = None,
) -> Expectation:
    """One metric held against its entry.

    reason : why a metric has no value.  has : which of PARTS the law has. None: all of them.
    Raises ExpectError.
    """
    bound = _bound(name, entry)
    known = name in METRICS or name in OF_ITEMS
    value = metric(name, bound.t_from, bound.t_to) if known else None
    if value is not None and not math.isfinite(value):
        value = None
    passed: bool | None = value is not None and (
        value >= bound.limit if bound.at_least else value <= bound.limit
    )
    text = f"{name} {'≥' if bound.at_least else '≤'} {_number(bound.limit)}"
    if bound.t_from is not None:
        text += f" from {bound.t_from:g} s"
    if bound.t_to is not None:
        text += f" to {bound.t_to:g} s"
    if bound.part is not None and has is not None and not has(bound.part):
        return Expectation(name, bound.limit, None, None, text)
    why = None if value is not None or reason is None else reason(name, bound.t_from, bound.t_to)
    return Expectation(name, bound.limit, value, passed, text, why)


def _judge_reached(
    entry: Any, standing: Sequence[Standing], ended: str, kept_s: float = math.inf
) -> Expectation | None:
    """Whether the vehicle came near each setpoint that stood; None where nothing is expected.

    kept_s : when a failsafe kept the vehicle from its setpoints.
    """
    if entry is False or (entry is None and not standing):
        return None
    within = REACHED_M if entry is None or entry is True else _positive(entry)
    text = f"{REACHED}: setpoints that stand for {SETTLE_S:g} s, within {_number(within)} m"
    if not standing:
        why = f"no setpoint stood for {SETTLE_S:g} s"
        return Expectation(REACHED, within, None, False, text, why)
    worst = max(standing, key=lambda each: each.away_m)
    value = worst.away_m if math.isfinite(worst.away_m) else None
    if worst.away_m <= within:
        return Expectation(REACHED, within, value, True, text)
    missed = sum(each.away_m > within for each in standing)
    others = f" ({missed} of {len(standing)} setpoints were not)" if len(standing) > 1 else ""
    if worst.until_s > kept_s:
        why = f"{worst}{others}. The lines below say why"
        return Expectation(REACHED, within, value, False, text, why)
    on_its_way = ended in GOOD_ENDINGS and not worst.grounded
    late = "If it was still on its way, give it more time; else ask" if on_its_way else "Ask"
    why = (
        f"{worst}{others}. The lines below may explain it. {late} for a setpoint that it can reach,"
        " or set [expect] reached to a greater distance (m) or to false"
    )
    return Expectation(REACHED, within, value, False, text, why)


def _positive(entry: Any) -> float:
    number = isinstance(entry, int | float) and not isinstance(entry, bool)
    if not number or not math.isfinite(entry) or entry <= 0.0:
        raise ExpectError(
            f"[expect] reached: expected true, false or a distance > 0 in m, got {entry!r}"
        )
    return float(entry)


def _judge_limited(entry: Any, changed: Sequence[Changed]) -> Expectation | None:
    """Whether setpoints were flown as asked for; None where they were and nobody asked."""
    n = float(len(changed))
    if entry is True:
        text = f"{LIMITED}: the vehicle limits or refuses a setpoint"
        why = None if changed else "each was flown as asked for; take [expect] limited out"
        return Expectation(LIMITED, 1.0, n, bool(changed), text, why)
    if entry is not None and entry is not False:
        raise ExpectError(f"[expect] limited: expected true or false, got {entry!r}")
    if entry is None and not changed:
        return None
    text = f"{LIMITED}: the vehicle limits or refuses no setpoint"
    if not changed:
        return Expectation(LIMITED, 0.0, n, True, text)
    more = f" ({len(changed)} setpoints were flown otherwise)" if len(changed) > 1 else ""
    why = f"{changed[0]}{more}. Ask for less, or expect it: [expect] limited = true"
    return Expectation(LIMITED, 0.0, n, False, text, why)


def judge_each(
    expect: Mapping[str, Any],
    metric: MetricFunction,
    ended: str,
    reason: Reason | None = None,
    standing: Sequence[Standing] = (),
    changed: Sequence[Changed] = (),
    good: Sequence[str] = GOOD_ENDINGS,
    has: Has | None = None,
    kept_s: float = math.inf,
) -> list[Expectation]:
    """Each entry of `expect` judged: how the flight ended first, then its setpoints.

    metric : value of a metric from and to a time (s); None where there is none.
    ended : how the flight ended. Where nothing else is expected: in time or by arriving. One that
    ended like that, with samples that are not finite, misses an expectation that nobody has to name.
    good : how a flight ends well, of which any will do where nothing else is expected.
    reason : why a metric has no value, from and to a time, in words.
    has : which of PARTS the law has. None: all of them.
    standing, changed : setpoints that stood, and that were not flown as asked for. A mission that
    expects a flight to end badly expects nothing of them that it does not name.
    Raises ExpectError for an entry that is none of the forms above.
    """
    wanted = expect.get("ended")
    if wanted is not None and not isinstance(wanted, str):
        raise ExpectError(f"[expect] ended: expected a word, got {wanted!r}")
    endings = tuple(good) if wanted is None else (wanted,)
    limit = " or ".join(endings)
    first = Expectation("ended", limit, ended, ended in endings, f"ended = {limit}")
    ends_well = set(endings).isdisjoint(BAD_ENDINGS)
    checks = []
    if ends_well or REACHED in expect:
        checks.append(_judge_reached(expect.get(REACHED), standing, ended, kept_s))
    if ends_well or LIMITED in expect:
        checks.append(_judge_limited(expect.get(LIMITED), changed))
    rest = [check for check in checks if check is not None]
    rest += [
        judge_metric(n, entry, metric, reason, has)
        for n, entry in expect.items()
        if n not in OTHERS
    ]
    fails = (expect.get(FAILSAFE) or {}).get("name") == LAW_FAILED  # the law, as is expected
    if (
        NOT_FINITE not in expect and ended in good and not fails
    ):  # nothing follows from such a flight
        finite = judge_metric(NOT_FINITE, 0.0, metric)
        rest += [] if finite.passed or finite.value is None else [finite]
    return [first, *rest]
