"""A flight that goes on again from a tick that was kept: the ticks of a law alone, to the bit."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.laws.loader import LawError
from gcs_tools.flight import law_alone
from gcs_tools.flight.resumption import Resumption
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load


@pytest.mark.parametrize("mission", ["noisy_state", "figure_eight"])
def test_resumed_flights_have_the_ticks_of_a_law_alone(mission):
    """With noise, and with setpoints that move."""
    scene = scenario(load(mission, ["flight.duration_s=2", "wind={steady_m_s=[3,1,0]}"]))
    plant, law = law_alone.fly(scene)
    flight = Resumption(scene)
    flight.fly(300)
    kept = flight.keep()
    for until in (310, 700, scene.ticks):
        flight.resume(kept)
        assert flight.fly(until)
        assert flight.tick == until
    assert flight.law_rows.tobytes() == law.tobytes()
    assert flight.plant_rows[:, : plant.shape[1]].tobytes() == plant.tobytes()


def test_what_the_air_does_from_a_tick_on_changes_nothing_before_it():
    scene = scenario(load("gust_step", ["flight.duration_s=2", "wind={}"]))
    flight = Resumption(scene)
    flight.fly(scene.ticks)
    calm = flight.law_rows.copy()
    flight.resume(flight.begin)
    flight.air[500:, 2] = 5.0
    flight.fly(scene.ticks)
    assert np.array_equal(flight.law_rows[:500], calm[:500])
    assert not np.array_equal(flight.law_rows[502:], calm[502:])


def test_items_are_flown_by_a_whole_vehicle():
    with pytest.raises(LawError, match="flown by a whole vehicle"):
        Resumption(scenario(load("square_and_land")))
