"""What a campaign found: counts, and how tight each bound is, as a distribution."""

from __future__ import annotations

from collections import Counter
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from gcs_tools.studies.theory_check.check import Excluded, Held

QUANTILES = {"min": 0.0, "5 %": 0.05, "median": 0.5, "95 %": 0.95}


class Line(NamedTuple):
    """One bound over all systems: how many, how many exceeded it, bound over measured."""

    part: str
    name: str
    held: int
    exceeded: int
    projected: int  # of those held: where the projection of Theta_hat acted
    excluded: dict[str, int]  # by reason
    tightness: dict[str, float]  # by name of quantile; of those aimed at it


class Findings:
    """Collects what is held and what is excluded, by part of the campaign."""

    def __init__(self) -> None:
        self._held: dict[tuple[str, str], list[Held]] = {}
        self._excluded: dict[tuple[str, str], Counter[str]] = {}

    def add(self, part: str, found: list[Held | Excluded]) -> None:
        """A batch."""
        for one in found:
            key = part, one.name
            if isinstance(one, Held):
                self._held.setdefault(key, []).append(one)
            else:
                self._excluded.setdefault(key, Counter())[one.why] += 1

    def lines(self) -> list[Line]:
        """One for each bound, in the order in which they came."""
        return [
            Line(
                *key, len(all_of), sum(one.exceeded for one in all_of),
                sum(one.projected for one in all_of), dict(self._excluded.get(key, {})), _tightness(all_of),
            )
            for key, all_of in self._held.items()
        ]  # fmt: skip

    @property
    def exceeded(self) -> int:
        """How often a bound did not hold."""
        return sum(line.exceeded for line in self.lines())


def _tightness(all_of: list[Held]) -> dict[str, float]:
    ratios = [one.bound / one.measured for one in all_of if one.aimed and one.measured > 0.0]
    return {name: float(np.quantile(ratios, at)) for name, at in QUANTILES.items() if ratios}


def table(lines: list[Line]) -> Table:
    """For people."""
    shown = Table(title="Bounds against simulation; bound over measured", caption=_outside(lines))
    for column in ("bound", "held", "exceeded", "projected", *QUANTILES):
        shown.add_column(column, justify="left" if column == "bound" else "right")
    for line in lines:
        shown.add_row(
            f"{line.part}: {line.name}", f"{line.held}", f"{line.exceeded}", f"{line.projected}",
            *(f"{line.tightness[name]:.3g}" for name in line.tightness),
        )  # fmt: skip
    return shown


def _outside(lines: list[Line]) -> str:
    """What was not counted, since it is outside of what a bound assumes."""
    return "\n".join(
        f"not counted, {line.part}: {line.name}: {count} where {why}"
        for line in lines
        for why, count in line.excluded.items()
    )


def content(lines: list[Line]) -> list[dict[str, Any]]:
    """For programs."""
    return [line._asdict() for line in lines]
