"""The score of a flight: what is kept of its rows is enough."""

from __future__ import annotations

import pytest

from gcs_tools.campaigns import score
from gcs_tools.flight.law_flights import EVERYTHING
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load, override, with_law

SETTINGS = {
    "": "flight.seed=3",
    "crashed": "plant.mass_kg=40.0",
    "diverged": "flight.arena_m=0.2",
}


@pytest.mark.parametrize("law", ["mmrac", "px4"])
@pytest.mark.parametrize("lost", SETTINGS)
def test_what_is_kept_gives_the_score_of_all_rows(monkeypatch, law, lost):
    """A metric of a column that is not kept would have no value, or another."""
    mission = override(with_law(load("noisy_state"), law), SETTINGS[lost])
    of = [(scenario(mission), mission)]
    (kept,) = score.fly_several(of, far_m=100.0)
    monkeypatch.setattr(score, "KEPT", EVERYTHING)
    assert kept.lost == lost
    assert repr([kept]) == repr(score.fly_several(of, far_m=100.0))  # a nan is a nan
