"""What a seed draws: the same for every law, within what is believed, and never a seed of tuning."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools.campaigns import procedure
from gcs_tools.campaigns.seed_draws import Beliefs, Stream, sampled
from gcs_tools.flight import law_alone
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load, override, with_law

DRAWS = procedure.read().draws


def test_seed_0_is_the_mission_as_written():
    mission = load("benchmark/gusts")
    assert sampled(mission, DRAWS, Stream.TEST, 0) is mission


def test_what_is_drawn_lies_within_what_the_airframe_believes():
    mission = load("benchmark/gusts")
    beliefs = Beliefs.of(mission.airframe)
    flown = [sampled(mission, DRAWS, Stream.TEST, seed) for seed in range(1, 41)]
    masses = [each.plant.mass_kg for each in flown]
    low, high = beliefs.mass
    assert low <= min(masses) < low + 0.2 * (high - low) < high - 0.2 * (high - low) < max(masses) <= high  # fmt: skip
    for i, (least, most) in enumerate(beliefs.inertia):
        assert all(least <= each.plant.inertia_kg_m2[i] <= most for each in flown)
    lags = np.array([each.plant.rotor_lag_s for each in flown]) / beliefs.lag
    assert lags.min() >= DRAWS.rotor_lag[0]
    assert lags.max() <= DRAWS.rotor_lag[1]
    assert len({each.flight.seed for each in flown}) == 40
    assert len({each.wind.azimuth_deg for each in flown}) == 40
    assert len({each.wind.phase_rad for each in flown}) == 40


def test_another_law_meets_the_same_draw(cascade):
    mission = load("benchmark/drop")
    other = sampled(with_law(mission, cascade), DRAWS, Stream.TEST, 7)
    own = sampled(mission, DRAWS, Stream.TEST, 7)
    assert own.flown is not other.flown
    assert (own.plant, own.wind, own.flight) == (other.plant, other.wind, other.flight)


@pytest.mark.computes
def test_streams_missions_and_seeds_draw_apart():
    drop, gusts = load("benchmark/drop"), load("benchmark/gusts")
    seeds = {
        sampled(mission, DRAWS, stream, seed).flight.seed
        for mission in (drop, gusts)
        for stream in Stream
        for seed in range(1, 101)
    }
    assert len(seeds) == 2 * 3 * 100


def test_what_a_mission_says_of_the_plant_stays():
    mission = override(load("benchmark/drop"), "plant.mass_kg=7.25")
    found = sampled(mission, DRAWS, Stream.TEST, 3)
    assert found.plant.mass_kg == 7.25
    assert found.plant.mass_change == mission.plant.mass_change
    assert found.plant.rotor_lag_s is not None


def test_the_values_in_force_say_what_was_drawn():
    found = sampled(load("benchmark/drop"), DRAWS, Stream.TEST, 3)
    values = found.values_in_force()
    assert values["plant.mass_kg"].origin == "seed 3"
    assert values["plant.mass_kg"].value == found.plant.mass_kg
    assert values["wind.phase_rad"].origin == "seed 3"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["benchmark/noise", "benchmark/figure_eight"])
def test_a_drawn_flight_is_the_vehicles_bit_for_bit(name):
    mission = override(load(name), "flight.duration_s=4")
    scene = scenario(sampled(mission, DRAWS, Stream.TEST, 2))
    plant, fcu = law_alone.fly(scene)
    flown = MemoryFlight(scene, None, (lambda rows: None, lambda rows: None)).fly()
    assert len(plant) == 2000
    assert plant.tobytes() == np.ascontiguousarray(flown.plant).tobytes()
    assert fcu.tobytes() == np.ascontiguousarray(flown.fcu).tobytes()
