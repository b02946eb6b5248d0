"""The rule on gains: what it says, and whether flights say the same."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.guard import stability
from fcu.guard.stability import radius, rotor_lag, unstable
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load, override
from gcs_tools.studies.stability_map import flies, gentle, point


@pytest.mark.parametrize("lag", [0.0, 0.001, 0.05, 0.3])
def test_believed_lag_is_read_off_the_parameters(law, lag):
    assert rotor_lag(law(rotor_lag_s=lag)) == pytest.approx(lag, rel=1e-9, abs=1e-12)


def test_predictor_and_estimates_alone_never_limit_the_gain(law):
    """The proof of the README in numbers: with right estimates gamma shows in no loop."""
    for rate_hz in (100.0, 500.0, 1000.0):
        for gamma in (1.0, 1e3, 1e6):
            assert unstable(law(rate_hz, gamma=gamma)) == "", (rate_hz, gamma)


def test_slowest_mode_is_the_reference_model(law):
    """Default gains: height and way decay as f_m zeta_m says, 0.8 a second, to 1 %."""
    params = law()
    for channel in ("height", "roll", "pitch"):
        assert -math.log(radius(params, channel)) / params.h == pytest.approx(0.8, rel=0.01)


def test_rotor_inversion_is_refused_where_it_oscillates(law):
    """Rotors alternate from tick to tick where kappa (1 - e^(-h/lag)) passes 2."""
    fast = law(400.0, rotor_response_s=0.001)
    assert fast.rotors.kappa * (1.0 - math.exp(-fast.h / 0.05)) == pytest.approx(2.44, abs=0.01)
    assert unstable(fast) == "height"
    slower = law(400.0, rotor_response_s=0.002)
    assert slower.rotors.kappa * (1.0 - math.exp(-slower.h / 0.05)) == pytest.approx(1.22, abs=0.01)
    assert unstable(slower) == ""


def test_gain_margin_is_3_dB(law):
    """Pitch with estimates 3 dB low is unstable at an f_m that exact estimates fly."""
    params = law(f_m=6.0)
    assert radius(params, "pitch", 1.0) < 1.0 < radius(params, "pitch", 0.7)
    assert unstable(params) == "pitch"


def test_printed_prediction_has_no_rule(law):
    assert unstable(law(prediction="demanded", f_m=10.0)) == ""


def test_the_rule_asks_for_a_bounded_number_of_small_matrices(law, monkeypatch):
    """It is asked between two ticks; how long that takes, `make bench` measures."""
    orders, eigvals = [], np.linalg.eigvals

    def counted(matrix):
        orders.append(len(matrix))
        return eigvals(matrix)

    monkeypatch.setattr(np.linalg, "eigvals", counted)
    assert unstable(law()) == ""
    assert 4 <= len(orders) <= 32
    assert max(orders) <= 12


MAP = [
    # setting, whether the rule accepts it, whether it flies in still air and in wind
    ({}, True, True),
    ({"law.gamma": 1.0}, True, True),
    ({"law.gamma": 1e6}, True, True),
    ({"law.gamma": 1e6, "flight.rate_hz": 100}, True, True),
    ({"law.f_m": 4.0}, True, True),
    ({"law.f_m": 7.5}, False, False),
    ({"law.c_angle": 20.0}, True, True),
    ({"law.c_angle": 60.0}, False, False),
    ({"law.c_rate": 5.0}, True, True),
    ({"law.c_rate": 300.0}, True, True),
    ({"law.c_rate": 1.5}, False, False),
    ({"law.c_rate": 1500.0}, False, False),
    ({"law.c_angle": 30.0, "law.c_rate": 200.0}, False, False),
    ({"law.rotor_lag_s": 0.25, "plant.rotor_lag_s": 0.25, "law.c_rate": 100.0}, False, False),
    ({"law.rotor_response_s": 0.001, "flight.rate_hz": 250}, False, False),
    # refused for its margin, and flies
    ({"law.c_angle": 30.0}, False, True),
]


@pytest.mark.parametrize(("settings", "accepted", "flies"), MAP, ids=[str(m[0]) for m in MAP])
def test_rule_agrees_with_flights(settings, accepted, flies):
    mission = load("paper_nominal")
    for key, value in settings.items():
        mission = override(mission, f"{key}={value!r}")
    flown = point(mission)
    assert (not flown.refused) is accepted
    assert (flown.still and flown.wind) is flies


SOFT = {"law.c_angle": 5.0, "law.c_rate": 10.0, "law.rotor_response_s": 0.05}
LATE = [
    # setting, delay in ticks, whether the rule accepts it, whether a step of 1 m flies
    ({}, 6, True, True),
    ({}, 8, False, True),  # refused for its margin
    ({}, 10, False, False),
    ({"law.rotor_response_s": 0.03}, 4, False, True),  # for rotors with the greatest lag
    ({"law.rotor_response_s": 0.03}, 7, False, True),  # for an m_hat at its greatest
    ({"law.rotor_response_s": 0.03}, 15, False, False),
    (SOFT, 4, True, True),
    (SOFT, 13, False, True),  # for rotors with the greatest lag
    (SOFT, 15, False, True),
    (SOFT, 25, False, False),
]


@pytest.mark.parametrize(("settings", "ticks", "accepted", "does"), LATE)
def test_rule_agrees_with_flights_of_a_plant_that_reports_late(settings, ticks, accepted, does):
    mission = load("paper_nominal")
    late = {"law.guard_delay_s": 0.002 * ticks, "plant.delay_s": 0.002 * ticks}
    for key, value in {**settings, **late}.items():
        mission = override(mission, f"{key}={value!r}")
    scene = scenario(gentle(mission))
    assert (unstable(scene.law, scene.guard.delay_s) == "") is accepted
    assert flies(scene, False) is does


def test_a_delay_counts_in_whole_ticks_rounded_up(law):
    params = law()
    assert [stability.late(params, s) for s in (0.0, 0.0019, 0.002, 0.0021)] == [0, 1, 1, 2]


def test_the_vehicle_of_the_rule_is_the_middle_of_what_is_believed():
    assert (stability.MASS, stability.INERTIA) == (8.0, (0.3245, 0.3245, 0.4616))
