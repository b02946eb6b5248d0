"""What a campaign expected of its flights: whether it is shown, for the exit code and for CI."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fcu.interface.files import whole_file
from gcs_tools.campaigns.analysis import Analysis
from gcs_tools.campaigns.campaign_file import MOST_FLIGHTS, Campaign
from gcs_tools.campaigns.statistics import at_least
from gcs_tools.judging import junit_report
from gcs_tools.judging.junit_report import Case


@dataclass(frozen=True)
class Shown:
    """One expectation of one law: `bound` is what the flights show."""

    law: str
    expected: float
    bound: float  # the probability of success is above this, with the confidence
    confidence: float
    count: int
    of: int
    bound_confidence: float  # of the bound: more than `confidence` if the campaign may end early

    @property
    def passed(self) -> bool:
        """Whether it is shown."""
        return self.bound >= self.expected

    @property
    def needed(self) -> int | None:
        """The flights that would show it without a further failure. None if it is shown, or too many fail."""
        failed = self.of - self.count
        if self.passed or not self.of or self.count < self.expected * self.of:
            return None

        def shows(n: int) -> bool:
            return at_least(n - failed, n, self.bound_confidence) >= self.expected

        most = self.of
        while not shows(most):
            most *= 2
            if most > MOST_FLIGHTS:
                return None
        return bisect_left(range(most), True, lo=failed + 1, key=shows)

    def __str__(self) -> str:
        """The expectation and what was found."""
        more = self.needed
        enough = "" if more is None else f"; {more} flights with {self._failures} would show it"
        return (
            f"{self.law}: success of at least {self.expected:g} with {100.0 * self.confidence:g} %"
            f" confidence: {self.count} of {self.of} flights show {self.bound:.4g}{enough}"
        )

    @property
    def _failures(self) -> str:
        failed = self.of - self.count
        return "no failure" if not failed else f"{failed} failure{'s' if failed > 1 else ''}"


def verdict(campaign: Campaign, found: Analysis) -> list[Shown]:
    """What was expected of each law; empty if nothing was.

    The bound is one-sided. Of a campaign that may end early it is that of each of its looks.
    """
    expect = campaign.document.expect
    if expect is None:
        return []
    wanted = expect.success
    each = found.looks.confidence(wanted.confidence)
    return [
        Shown(of.law, wanted.at_least, at_least(of.success.successes, of.success.of, each),
              wanted.confidence, of.success.successes, of.success.of, each)
        for of in found.laws
    ]  # fmt: skip


def cases(
    campaign: Campaign, found: Analysis | None, error: str | Mapping[str, str], seconds: float
) -> list[Case]:
    """A test case a law, for JUnit.  error : why the campaign, or a law, has no verdict."""
    errors = error if isinstance(error, Mapping) else dict.fromkeys(campaign.labels, error)
    shown = {each.law: each for each in verdict(campaign, found)} if found is not None else {}
    alone = len(campaign.labels) == 1
    return [
        Case(
            "campaigns",
            campaign.name if alone else f"{campaign.name} {law}",
            seconds,
            failure=""
            if errors.get(law) or law not in shown or shown[law].passed
            else str(shown[law]),
            error=errors.get(law, ""),
            text=campaign.document.title,
        )
        for law in campaign.labels
    ]


def junit(
    campaign: Campaign,
    found: Analysis | None,
    error: str | Mapping[str, str],
    seconds: float,
    path: Path,
) -> None:
    """Write JUnit XML of one campaign. Arguments as for `cases`. Raises OSError."""
    text = junit_report.document("gcs campaign", cases(campaign, found, error, seconds), seconds)
    whole_file.write(path, text.encode())
