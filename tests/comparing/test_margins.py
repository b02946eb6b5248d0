"""Margins: that what is told of one is what was flown."""

from __future__ import annotations

import pytest

from gcs_tools.campaigns import margins, procedure
from gcs_tools.campaigns.entrant import entrant
from gcs_tools.missions.mission import load


@pytest.mark.parametrize(("quantity", "key"), [("mass", "mass_kg"), ("lag", "rotor_lag_s")])
def test_every_seed_flies_the_mass_and_the_lag_that_are_told(monkeypatch, quantity, key):
    flown = []

    def is_lost(mission, _):
        flown.append(getattr(mission.plant, key))
        return False

    monkeypatch.setattr(margins, "_is_lost", is_lost)
    how = procedure.read()
    found = margins.margin(entrant("px4"), quantity, how)
    assert flown[-1 - how.margins.seeds :] == pytest.approx([found.held] * (1 + how.margins.seeds))
    assert found.held == pytest.approx(
        getattr(how.margins, quantity)[1] * margins._size(load(how.margins.mission), quantity)
    )
