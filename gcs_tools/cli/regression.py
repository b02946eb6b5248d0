"""`gcs compare RUN BASELINE --fail`: whether flights are worse than those of a baseline."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_tools.cli.output import Failure, print_json
from gcs_tools.exit_codes import MISSED, OK, USAGE

if TYPE_CHECKING:
    from gcs_tools.campaigns.regression import Held

BY = {
    "seeds": "the same seeds",
    "interval": "other seeds, by the baseline's interval",
    "exact": "to the bit",
}


def compare_with_baseline(
    compared: tuple[str, ...], exact: bool, tolerance: float, junit: Path | None, as_json: bool
) -> int:
    """Judge the flights below RUN by those below BASELINE. Raises Failure."""
    from fcu.interface.files import whole_file
    from gcs_tools.campaigns.regression import RegressionError, held_against
    from gcs_tools.judging import junit_report
    from gcs_tools.judging.comparison import CompareError, all_flown, below

    if len(compared) != 2:
        raise click.UsageError("expected RUN and BASELINE: two runs, or two folders with runs")
    run, baseline = map(Path, compared)
    try:
        held = held_against(all_flown(below(run)), all_flown(below(baseline)), exact, tolerance)
    except (CompareError, RegressionError) as error:
        raise Failure(error, USAGE) from error
    if junit is not None:
        text = junit_report.document("gcs compare", [each.case() for each in held])
        try:
            whole_file.write(junit, text.encode())
        except OSError as error:
            raise Failure(f"{junit}: {error.strerror}", USAGE) from error
    if as_json:
        print_json(_json(held))
    else:
        _print(held)
    return OK if all(each.passed for each in held) else MISSED


def _json(held: list[Held]) -> dict[str, Any]:
    return {
        "passed": all(each.passed for each in held),
        "missions": [{"passed": each.passed, **dataclasses.asdict(each)} for each in held],
    }


def _print(held: list[Held]) -> None:
    from rich.text import Text

    from gcs_tools.cli.terminal import PipedConsole

    console = PipedConsole(highlight=False)
    for each in held:
        verdict = "as before" if each.passed else "worse"
        if each.by == "exact":
            verdict = "equal" if each.passed else "differs"
        flights = f"{each.flights} of {each.baseline_flights} flights"
        console.print(Text(f"{each.mission}: {verdict} ({flights}, {BY[each.by]})"), soft_wrap=True)
        for line in each.lines():
            console.print(Text(f"  {line}"), soft_wrap=True)
    failed = sum(not each.passed for each in held)
    word = "missions are" if len(held) > 1 else "mission is"
    console.print(Text(f"{len(held) - failed} of {len(held)} {word} as the baseline"))
