"""What a request of a ground station or script came to."""

from __future__ import annotations

from dataclasses import dataclass

from fcu.mavlink.enums import Result


@dataclass
class Verdict:
    """What became of a request, and why, in words for a STATUSTEXT (empty: nothing to say)."""

    result: Result
    text: str = ""

    @property
    def good(self) -> bool:
        """Whether it was done."""
        return self.result is Result.ACCEPTED


def denied(what: str, why: str) -> Verdict:
    """It was not, and nothing has changed."""
    return Verdict(Result.DENIED, f"{what} denied: {why}")
