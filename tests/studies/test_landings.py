"""The study of landings: what it draws, and what it takes for a fault."""

from __future__ import annotations

import math

import pytest

from gcs_tools.studies import landings
from gcs_tools.studies.landings import LAWS, Landing

FINE = Landing(0, "quad", "mmrac", True, "landed", 2.6, 0.7, 0.0, 0.1)


def test_a_number_is_one_flight_and_all_kinds_are_drawn():
    made = [landings.sampled_landing(number) for number in range(50)]
    assert repr(made) == repr([landings.sampled_landing(number) for number in range(50)])
    assert {name for name, _ in made} == {"s1000", "hexa", "quad", "x8", "racer"}
    assert {tables["law"]["module"] for _, tables in made} == set(LAWS)
    starts = ["on_ground" in tables["flight"]["start"] for _, tables in made]
    assert sum(starts) == 25


@pytest.mark.parametrize(
    ("changed", "faults"),
    [
        ({}, []),
        ({"ended": "time"}, ["not landed"]),
        ({"disarmed_s": 3.1}, ["late"]),
        ({"disarmed_s": math.nan}, ["late"]),
        ({"cut_m": 0.06}, ["cut in the air"]),
        ({"tilt_deg": 46.0}, ["tipped"]),
    ],
)
def test_a_fault_has_its_name(changed, faults):
    assert FINE._replace(**changed).faults == faults


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 5])
def test_a_landing_is_flown(number):
    found = landings.fly(number)
    assert found.took_off is (number == 0)
    assert found.faults == []
    assert 0.3 < found.touchdown_m_s < 1.5
