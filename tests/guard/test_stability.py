"""The rule on gains: what it says, and whether flights say the same."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.guard import stability
from fcu.guard.stability import hover_of, radius, rotor_lag, unstable
from fcu.interface.airframe import SHIPPED
from fcu.interface.airframe import believed as airframe_file
from fcu.process.settings import settings
from gcs_tools.campaigns.flights import fly
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load, override
from gcs_tools.studies.stability_map import KEPT, flight_order, gentle, points


@pytest.mark.parametrize("lag", [0.0, 0.001, 0.05, 0.3])
def test_believed_lag_is_read_off_the_parameters(law, lag):
    assert rotor_lag(law(rotor_lag_s=lag)) == pytest.approx(lag, rel=1e-9, abs=1e-12)


def test_predictor_and_estimates_alone_never_limit_the_gain(settings_of):
    """The proof of the README in numbers: with right estimates gamma shows in no loop."""
    for rate_hz in (100.0, 500.0, 1000.0):
        for gamma in (1.0, 1e3, 1e6):
            assert unstable(*settings_of(rate_hz, gamma=gamma)) == "", (rate_hz, gamma)


def test_slowest_mode_is_the_reference_model(settings_of):
    """Default gains: height and way decay as f_m zeta_m says, 0.8 a second, to 1 %."""
    params, guard = settings_of()
    for channel in ("height", "roll", "pitch"):
        slowest = radius(params, hover_of(guard), channel)
        assert -math.log(slowest) / params.h == pytest.approx(0.8, rel=0.01)


def test_rotor_inversion_is_refused_where_it_oscillates(settings_of):
    """Rotors alternate from tick to tick where kappa (1 - e^(-h/lag)) passes 2."""
    fast, guard = settings_of(400.0, rotor_response_s=0.001)
    assert fast.rotors.kappa * (1.0 - math.exp(-fast.h / 0.05)) == pytest.approx(2.44, abs=0.01)
    assert unstable(fast, guard) == "height"
    slower, guard = settings_of(400.0, rotor_response_s=0.002)
    assert slower.rotors.kappa * (1.0 - math.exp(-slower.h / 0.05)) == pytest.approx(1.22, abs=0.01)
    assert unstable(slower, guard) == ""


def test_gain_margin_is_3_dB(settings_of):
    """Pitch with estimates 3 dB low is unstable at an f_m that exact estimates fly."""
    params, guard = settings_of(f_m=6.0)
    here = hover_of(guard)
    assert radius(params, here, "pitch", 1.0) < 1.0 < radius(params, here, "pitch", 0.7)
    assert unstable(params, guard) == "pitch"


def test_printed_prediction_has_no_rule(settings_of):
    assert unstable(*settings_of(prediction="demanded", f_m=10.0)) == ""


def test_the_rule_asks_for_a_bounded_number_of_small_matrices(settings_of, monkeypatch):
    """It is asked between two ticks; how long that takes, `make bench` measures."""
    orders, eigvals = [], np.linalg.eigvals

    def counted(matrix):
        orders.append(len(matrix))
        return eigvals(matrix)

    told = settings_of()
    monkeypatch.setattr(np.linalg, "eigvals", counted)
    assert unstable(*told) == ""
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
@pytest.mark.computes
def test_rule_agrees_with_flights(settings, accepted, flies):
    mission = load("paper_nominal")
    for key, value in settings.items():
        mission = override(mission, f"{key}={value!r}")
    (flown,) = points([mission])
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
@pytest.mark.computes
def test_rule_agrees_with_flights_of_a_plant_that_reports_late(settings, ticks, accepted, does):
    mission = load("paper_nominal")
    late = {"law.guard_delay_s": 0.002 * ticks, "plant.delay_s": 0.002 * ticks}
    for key, value in {**settings, **late}.items():
        mission = override(mission, f"{key}={value!r}")
    scene = scenario(gentle(mission))
    assert (unstable(scene.law, scene.guard) == "") is accepted
    assert fly([flight_order(scene, False)], KEPT)[0].well is does


def test_a_delay_counts_in_whole_ticks_rounded_up(law):
    params = law()
    assert [stability.late(params, s) for s in (0.0, 0.0019, 0.002, 0.0021)] == [0, 1, 1, 2]


def test_the_vehicle_of_the_rule_is_the_middle_of_what_its_airframe_is_believed_to_be():
    def of(name):
        return hover_of(settings(*airframe_file(SHIPPED[name]), 500.0).guard)

    assert (of("s1000").m, of("s1000").J) == (8.0, (0.3245, 0.3245, 0.4616))
    assert of("racer").m == pytest.approx(0.765)
    assert pytest.approx((0.0025, 0.0021, 0.0043)) == of("racer").J


def test_an_inertia_counts_as_learnt_by_the_size_of_the_vehicle():
    """One gain learns the octocopter's and leaves a racer's, whose torque is a hundredth, at J_hat(0)."""
    for name, learns in (("s1000", True), ("racer", False)):
        law, guard = settings(*airframe_file(SHIPPED[name]), 500.0, {"gamma_LambdaJ": 1.0})
        assert stability.learns_inertia(law, guard.J_x) is learns


def test_a_roll_that_differs_from_pitch_by_its_inertia_alone_is_looked_at_too():
    tables = dict(airframe_file()[1])
    slow = {**tables["vehicle"], "inertia_kg_m2": [[3.0, 3.4], [0.3, 0.34], [3.2, 3.6]]}
    made = airframe_file()[0]
    wide = settings(
        made, {**tables, "vehicle": slow}, 500.0, {"gamma_LambdaJ": 0.0, "J_hat_0": 0.32}
    )
    assert unstable(*wide) == "roll"


def test_next_to_nothing_is_left_of_a_hover_that_an_updraft_carries(settings_of, monkeypatch):
    """A drag beyond the weight pushes no thrust below nought: a ten-thousandth of the weight at most."""
    params, guard = settings_of()
    weight, seen = guard.m_min * params.g, []
    tilt = stability.tilt

    def watched(law, lag, off, axis, here):
        seen.append(here.T_0)
        return tilt(law, lag, off, axis, here)

    monkeypatch.setattr(stability, "tilt", watched)
    for drag, least, greatest in (
        (0.0, weight, weight), (0.25 * weight, 0.75 * weight, 0.75 * weight),
        (weight, 0.0, 1e-4 * weight), (2.0 * weight, 0.0, 1e-4 * weight),
    ):  # fmt: skip
        seen.clear()
        stability.recovers(params, guard, drag)
        assert seen
        assert all(least <= T_0 <= greatest and T_0 > 0.0 for T_0 in seen)
