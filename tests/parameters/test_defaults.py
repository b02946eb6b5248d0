"""Ranges and defaults are those of defaults.txt: who changes a gain changes that text with it."""

from __future__ import annotations

import pytest

from fcu.laws import loader
from fcu.parameters import VEHICLE
from tests.parameters.defaults import AIRFRAMES, KEPT, _row, defaults, ranges

KNOWN = KEPT.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", loader.SHIPPED)
def test_every_range_of_a_law_is_as_written_down(name):
    assert f"\n\n{ranges(name)}\n\n" in KNOWN


@pytest.mark.parametrize("airframe", AIRFRAMES, ids=lambda path: path.stem)
@pytest.mark.parametrize("name", loader.SHIPPED)
def test_every_default_of_a_law_is_as_written_down(name, airframe):
    assert f"\n\n{defaults(name, airframe)}\n" in KNOWN


def test_every_default_of_the_vehicle_is_as_written_down():
    lines = KNOWN.splitlines()
    assert all(f"{_row(row)}; {row.default!r}" in lines for row in VEHICLE)
