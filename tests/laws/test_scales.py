"""What follows from an airframe: the octocopter's own numbers, scaling, and gains that are stable."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from fcu.guard import stability
from fcu.interface.airframe import OCTO, SHIPPED, Airframe, believed, checked
from fcu.laws import scales
from fcu.process.settings import Settings, settings

NAMES = tuple(SHIPPED)
HAND_MADE = {  # set for the octocopter by the paper and by flights, before any of it followed
    "f_m": 2.0, "gamma": 2000.0, "c_angle": (7.0, 7.0, 3.0), "c_rate": (14.0, 14.0, 6.0),
}  # fmt: skip


def told(tables: Any, made: Airframe, rate_hz: float = 500.0, **chosen: Any) -> Settings:
    return settings(made, tables, rate_hz, chosen)


def without_pins(name: str) -> tuple[Airframe, dict[str, Any]]:
    made, tables = believed(SHIPPED[name])
    return made, {key: table for key, table in tables.items() if key not in ("law", "pinned")}


def test_what_follows_from_the_octocopter_is_what_was_set_for_it_by_hand():
    made, tables = without_pins("s1000")
    law = told(tables, made).law
    for key, hand in HAND_MADE.items():
        np.testing.assert_allclose(getattr(law, key), hand, rtol=0.05)


def test_the_octocopter_flies_what_its_file_pins():
    made, tables = believed(OCTO)
    law = told(tables, made).law
    for key, hand in HAND_MADE.items():
        assert getattr(law, key) == pytest.approx(hand, rel=1e-15)


def test_authority_of_the_octocopter_by_hand():
    """A tilt is held by the rotor that gives most: 9.19 N to its floor, over 0.442 1/m."""
    _, tables = believed(OCTO)
    arm, spread = 0.5225, math.cos(math.radians(22.5))
    room = 8.0 * scales.G / 8.0 - 5.0 / 8.0
    torque = room * 4.0 * arm / spread  # the sum of y^2 is 4 arm^2
    assert scales.torque(tables).x == pytest.approx(torque)
    assert scales.torque(tables).z == pytest.approx(8.0 * room * 0.0159)
    assert scales.authority(tables).x == pytest.approx(torque / 0.3245)
    assert scales.hover_throttle(tables) == pytest.approx(math.sqrt(9.81 / 8.2e-5) / 552.2)


def test_a_coaxial_rotor_below_is_counted_with_its_smaller_share():
    """Above and below turn equally fast in hover, though the ones below give less."""
    _, tables = believed(SHIPPED["x8"])
    speeds = scales.hover_speeds(tables)
    assert speeds == pytest.approx([speeds[0]] * 8)
    thrusts = np.array(tables["rotors"]["thrust_coefficient"]) * np.array(speeds) ** 2
    assert thrusts.sum() == pytest.approx(3.1 * scales.G)
    assert thrusts[4] / thrusts[0] == pytest.approx(0.7)


@pytest.mark.parametrize("name", NAMES)
def test_gains_of_every_shipped_airframe_are_stable_and_it_hovers(name):
    made, tables = without_pins(name)
    law, guard = told(tables, made)
    assert (stability.unstable(law, guard), stability.grounded(law, guard)) == ("", "")


def scaled(tables: dict[str, Any], size: float) -> dict[str, Any]:
    """An airframe `size` times as long, of the same materials: Froude's scaling of every number."""
    s, mass, time = size, size**3, math.sqrt(size)
    inertia = mass * s * s
    rotors = tables["rotors"]
    return {
        **tables,
        "vehicle": {
            "mass_kg": [m * mass for m in tables["vehicle"]["mass_kg"]],
            "inertia_kg_m2": [[J * inertia for J in row] for row in tables["vehicle"]["inertia_kg_m2"]],
        },
        "rotors": {
            **rotors,
            "radius_m": rotors["radius_m"] * s,
            "thrust_coefficient": rotors["thrust_coefficient"] * mass * time * time,
            "torque_to_thrust_m": rotors["torque_to_thrust_m"] * s,
            "full_speed_rad_s": rotors["full_speed_rad_s"] / time,
            "lag_s": rotors["lag_s"] * time,
        },
        "limits": {
            **tables["limits"],
            "thrust_min_n": tables["limits"]["thrust_min_n"] * mass,
            "thrust_max_n": tables["limits"]["thrust_max_n"] * mass,
        },
    }  # fmt: skip


@pytest.mark.parametrize("size", [0.5, 2.0, 4.0])
def test_a_vehicle_of_another_size_has_the_same_gains_in_its_own_time(size):
    """Rates go with one over the root of the length, thrust with its cube, as the tables do."""
    _, small = without_pins("s1000")
    large, time = scaled(small, size), math.sqrt(size)
    assert scales.thrust_to_weight(large) == pytest.approx(scales.thrust_to_weight(small))
    assert scales.authority(large).x * size == pytest.approx(scales.authority(small).x)
    for rates in (scales.rate_bandwidth, scales.attitude_bandwidth):
        np.testing.assert_allclose(np.array(rates(large)) * time, rates(small), rtol=1e-9)
    assert scales.position_bandwidth(large) * time == pytest.approx(
        scales.position_bandwidth(small)
    )
    made, tables = checked(large, "large")
    law, guard = told(tables, made)
    assert stability.unstable(law, guard) == ""


def drawn(draw: np.random.Generator) -> dict[str, Any]:
    """An airframe that somebody might build: 0.1 to 30 kg, four, six or eight rotors."""
    n, m = int(draw.choice([4, 6, 8])), 10.0 ** draw.uniform(-1.0, 1.48)
    radius = 0.11 * (m / 0.75) ** (1.0 / 3.0) * draw.uniform(0.8, 1.6)
    lift = draw.uniform(1.8, 5.0)  # times the weight
    lag = draw.uniform(0.013, 0.04) * (m / 0.75) ** (1.0 / 3.0)
    J_x = draw.uniform(0.08, 0.2) * m * radius * radius
    full = 110.0 / radius  # a tip's speed, rad/s
    c_T = lift * 1.12 * m * scales.G / n / full**2
    axes = (J_x, J_x * draw.uniform(0.8, 1.25), 1.8 * J_x)
    return {
        "vehicle": {
            "mass_kg": [0.93 * m, 1.12 * m],
            "inertia_kg_m2": [[0.87 * J, 1.13 * J] for J in axes],
        },
        "rotors": {
            "angle_deg": [360.0 / n * (k + 0.5) for k in range(n)],
            "spin": [1 if k % 2 else -1 for k in range(n)],
            "radius_m": radius,
            "thrust_coefficient": c_T,
            "torque_to_thrust_m": 0.06 * radius * draw.uniform(0.7, 2.0),
            "full_speed_rad_s": full,
            "lag_s": lag,
            "inertia_kg_m2": 1e-6 * m,
        },
        "limits": {
            "thrust_min_n": 0.06 * m * scales.G,
            "thrust_max_n": 0.999 * n * c_T * full**2,
            "tilt_max_deg": 45.0,
        },
        "air": {"drag": [0.03 * m ** (2.0 / 3.0)] * 3},
        "battery": {"cells": 4, "capacity_mah": 5000.0},
    }


@pytest.mark.computes
def test_gains_of_airframes_drawn_at_random_are_stable():
    draw = np.random.default_rng(15)
    for _ in range(40):
        made, tables = checked(drawn(draw), "drawn")
        law, guard = told(tables, made)
        assert stability.unstable(law, guard) == "", tables
        assert stability.grounded(law, guard) == "", tables


def test_a_slow_rotor_makes_slow_gains_and_a_weak_one_does():
    _, tables = without_pins("quad")
    slow = {**tables, "rotors": {**tables["rotors"], "lag_s": 0.1}}
    assert scales.rate_bandwidth(slow).x == pytest.approx(scales.ROTOR / 0.02)
    heavy = {**tables, "vehicle": {**tables["vehicle"], "inertia_kg_m2": [[0.1, 0.14]] * 3}}
    assert scales.rate_bandwidth(heavy).x == pytest.approx(
        math.sqrt(2.0 * scales.torque(tables).y / 0.12 / scales.STEP)
    )
    assert scales.rotor_response(heavy) == pytest.approx(
        scales.ROTOR / scales.rate_bandwidth(heavy).x
    )


def test_the_wind_that_is_expected_weighs_a_part_of_the_vehicle_and_ends_at_a_storm():
    _, tables = without_pins("quad")
    drag = 0.05 * scales.wind(tables) ** 2
    assert drag == pytest.approx(scales.CARRIED * 1.4 * scales.G)
    sleek = {**tables, "air": {"drag": [0.001] * 3}}
    assert scales.wind(sleek) == scales.STORM


def test_the_printed_law_begins_with_masses_of_the_airframe():
    """Section VIII is 8 kg: 5 kg at arming, between 0.5 and 12; of another vehicle the same parts."""
    for name, mass in (("s1000", 8.0), ("racer", 0.765)):
        made, tables = believed(SHIPPED[name])
        law = told(tables, made, prediction="demanded").law
        found = (law.initial.m_hat_0, law.bounds.m_min, law.bounds.m_max)
        assert found == pytest.approx((0.625 * mass, mass / 16.0, 1.5 * mass))
