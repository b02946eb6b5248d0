"""docs/failsafes.md has the rows of the table of conditions, and every case of the study."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from fcu.vehicle.conditions import ROWS
from gcs_tools.studies import failsafes, law_failures


def test_the_table_of_conditions_is_that_of_the_rows():
    """If not: python -m gcs_tools.studies.failsafes --conditions."""
    page = failsafes.PAGE.read_text()
    assert set(failsafes.WORDS) == set(ROWS)
    assert failsafes.written(page, "conditions", failsafes.table()) == page


def test_every_case_was_measured_and_kept():
    lines = failsafes.PAGE.read_text().partition("## Measured")[2].splitlines()
    for case in failsafes.CASES:
        [row] = [line for line in lines if line.startswith(f"| {case.name} |")]
        assert row.endswith(f"| {failsafes.SEEDS} of {failsafes.SEEDS} |"), row


@pytest.mark.parametrize(
    ("study", "words", "said"),
    [
        (failsafes, ("--case", "rotr lost"), "(did you mean rotor lost?); there are offboard; "),
        (law_failures, ("--mission", "gust_stp"), "no such mission (did you mean gust_step?)"),
    ],
)
def test_a_study_says_what_it_has_in_place_of_what_it_has_not(study, words, said):
    done = CliRunner().invoke(study.main, words)
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.split())
