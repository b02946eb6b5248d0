"""What part of what is safe is admitted: one case of each kind."""

from __future__ import annotations

import pytest

from gcs_tools.judging.envelope import WAYS
from gcs_tools.studies import coverage

CASE = coverage.Case(
    coverage.worlds(5.0)[4],
    {"f_m": 1.4, "m_hat_0": 8.0, "guard_wind_rate_m_s2": 5.0},
    WAYS["down"],
)


def test_coverage_has_as_many_cases_as_told():
    assert len(coverage.cases(20.0, {})) == 12 * 3 * 3


def test_what_is_known_now_is_what_the_last_tick_demanded():
    begins = coverage.look_of(CASE).begins
    told = begins[coverage.TOLD]
    T_z = begins[coverage.column_of(coverage.Beginning, "present.T_0.z")]
    assert told == 1.0
    assert 60.0 < T_z < 95.0  # 8 kg, and a drag of 2.7 N at most


@pytest.mark.computes
def test_the_present_admits_more_and_all_of_it_is_safe():
    of = coverage.found(CASE)
    assert of.prior < of.both <= of.safe
    assert not of.unsound


@pytest.mark.parametrize("seed", [0, 1])
def test_an_admitted_step_drawn_anywhere_is_safe(seed):
    assert not coverage.tried(seed).unsound
