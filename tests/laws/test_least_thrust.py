"""The least total thrust that gives a torque about roll and pitch, and what the allocation makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from fcu.interface import airframe
from fcu.interface.airframe import SHIPPED, effect
from fcu.kernel.algebra import Rotors, Vec3, inverse8
from fcu.laws import allocation, least_thrust

AHEAD = {
    "position_m": [[0.23, -0.2], [-0.17, 0.2], [0.23, 0.2], [-0.17, -0.2], [0.03, 0.4], [0.03, -0.4]],
    "spin": [1, 1, -1, -1, 1, -1], "thrust_coefficient": 1e-5, "torque_to_thrust_m": 0.016,
    "full_speed_rad_s": [1000.0, 1000.0, 1000.0, 900.0, 1000.0, 1000.0], "lag_s": 0.03,
    "inertia_kg_m2": 1e-5,
}  # fmt: skip
FIVE = {
    **AHEAD, "position_m": [[0.4 * math.cos(a), 0.4 * math.sin(a)] for a in np.arange(5) * 0.4 * math.pi],
    "spin": [1, -1, 1, -1, 1], "full_speed_rad_s": 1000.0,
}  # fmt: skip


@pytest.fixture(params=[*SHIPPED, "ahead", "five"], scope="module")
def vehicle(request):
    if request.param in ("ahead", "five"):
        return airframe.airframe(AHEAD if request.param == "ahead" else FIVE)
    return airframe.believed(SHIPPED[request.param])[0]


@pytest.fixture(scope="module")
def rotors(vehicle):
    return allocation.believed_rotors(vehicle, 0.002, 0.03, f_min=0.02, kappa=3.0)


def demands(rotors, seed, n=100):
    """Thrusts of 2 to 98 % of the greatest, torques to 2.2 times what the pseudo-inverse fits beside them."""
    rng, per = np.random.default_rng(seed), max(np.hypot(rotors.B_x, rotors.B_y))
    for _ in range(n):
        T = rng.uniform(0.02, 0.98) * rotors.W * rotors.f_max
        beside = min(T / rotors.W - rotors.f_min, rotors.f_max - T / rotors.W)
        tau, angle = rng.uniform(0.0, 2.2) * beside / per, rng.uniform(0.0, 2.0 * math.pi)
        yield float(T), Vec3(float(tau * math.cos(angle)), float(tau * math.sin(angle)), 0.0)


@pytest.mark.computes
def test_no_thrusts_give_a_torque_from_less(vehicle, rotors):
    """Against a linear program over all thrusts that pull upwards and give no torque about yaw."""
    of = effect(vehicle)
    for T, tau in demands(rotors, 1):
        given = np.array(least_thrust.thrusts(rotors.pairs, tau.x, tau.y))[: vehicle.n]
        assert given.min() >= 0.0
        np.testing.assert_allclose(of[1:] @ given, tau, atol=1e-11 * T)
        least = linprog(np.ones(vehicle.n), A_eq=of[1:], b_eq=tau).fun
        assert given.sum() == pytest.approx(least, rel=1e-9, abs=1e-12)


def test_least_thrust_of_an_octocopter_is_three_fifths_of_the_pseudo_inverses():
    """1.707 times the torque beside the same thrust, about any axis."""
    octo = airframe.believed(SHIPPED["s1000"])[0]
    rotors = allocation.believed_rotors(octo, 0.002, 0.03, f_min=0.02, kappa=3.0)
    for angle in np.linspace(0.0, 2.0 * math.pi, 25).tolist():
        x, y = math.cos(angle), math.sin(angle)
        evenly = 8.0 * max(x * rotors.B_x + y * rotors.B_y)
        pairs = sum(least_thrust.thrusts(rotors.pairs, x, y))
        assert evenly / pairs == pytest.approx(1.0 + math.sqrt(0.5), rel=1e-9)


@pytest.mark.computes
def test_what_fits_beside_the_least_of_a_rotor_is_given_whole(vehicle, rotors):
    """Low thrust: whatever any allocation could give. Torque and thrust are met, and nothing is given up."""
    of, w = effect(vehicle), np.array(rotors.w)[: vehicle.n]
    bounds = [(rotors.f_min * share, rotors.f_max * share) for share in w]
    met = beyond = 0
    for T, tau in demands(rotors, 2):
        f, gave_up = allocation.allocate(rotors, T, tau)
        given = np.array(f)[: vehicle.n]
        assert (given >= rotors.f_min * w - 1e-12).all()
        assert (given <= rotors.f_max * w + 1e-12).all()
        whole = linprog(np.zeros(vehicle.n), A_eq=of, b_eq=[T, *tau], bounds=bounds).status == 0
        if gave_up.torque == 0.0:
            assert whole
            np.testing.assert_allclose(of @ given, [T, *tau], atol=1e-9)
        elif 0.3 * rotors.W * rotors.f_max > T:
            least = sum(least_thrust.thrusts(rotors.pairs, tau.x, tau.y)) + rotors.W * rotors.f_min
            assert not whole or least + 1e-9 > T
        met += gave_up.torque == 0.0
        beyond += not whole
    assert met > 30
    assert beyond > 10


def test_what_the_pseudo_inverse_fits_is_its_own_to_the_bit(vehicle, rotors):
    fitted = 0
    for T, tau in demands(rotors, 3):
        even = tau.x * rotors.B_x + tau.y * rotors.B_y
        own = allocation.alike(T / rotors.W) + even
        there = np.array(own)[: vehicle.n]
        if there.min() >= rotors.f_min and there.max() <= rotors.f_max:
            assert allocation.allocate(rotors, T, tau) == (rotors.w * own, (0.0, 0.0))
            fitted += 1
    assert fitted > 20


def test_roll_and_pitch_never_get_less_than_by_the_pseudo_inverse_nor_is_more_thrust_moved(
    vehicle, rotors
):
    """Whatever does not fit: the rule is the same, with the pseudo-inverse in place of `tilted`."""
    of, (low, high) = effect(vehicle), (rotors.f_min, rotors.f_max)
    for T, tau in demands(rotors, 4):
        even = tau.x * rotors.B_x + tau.y * rotors.B_y
        top, bottom = max(even), min(even)
        k = min(1.0, (high - low) / max(top - bottom, 1e-12))
        share = min(max(T / rotors.W, low - k * bottom), high - k * top)
        f, _ = allocation.allocate(rotors, T, tau)
        thrust, x, y, _ = of @ np.array(f)[: vehicle.n]
        assert math.hypot(x, y) > k * math.hypot(tau.x, tau.y) - 1e-9
        assert abs(thrust - T) < abs(share * rotors.W - T) + 1e-9


@pytest.mark.computes
def test_no_rotor_jumps_where_the_demand_does_not(rotors):
    """Along lines of thrust and torque, through what fits and what does not, by bisection."""
    random, per = np.random.default_rng(5), max(np.hypot(rotors.B_x, rotors.B_y))
    for _ in range(30):
        T, way = random.uniform(0.02, 0.98) * rotors.W * rotors.f_max, random.normal(size=3)
        begin = random.normal(size=2) * rotors.f_max / per

        def given(s, T=T, begin=begin, way=way):
            tau = begin + 0.3 * s * rotors.f_max / per * way[:2]
            thrust = T + 0.1 * s * rotors.W * rotors.f_max * way[2]
            f, _ = allocation.allocate(
                rotors, float(thrust), Vec3(float(tau[0]), float(tau[1]), 0.0)
            )
            return np.array(f)

        s = np.linspace(0.0, 1.0, 101)
        steps = np.abs(np.diff([given(each) for each in s], axis=0)).max(axis=1)
        low, high = s[steps.argmax()], s[steps.argmax() + 1]
        for _ in range(40):
            middle = 0.5 * (low + high)
            first, then, last = given(low), given(middle), given(high)
            nearer = np.abs(then - first).max() > np.abs(last - then).max()
            low, high = (low, middle) if nearer else (middle, high)
        assert np.abs(last - first).max() < 1e-6 * rotors.f_max


def test_points_that_are_one_and_points_on_a_side_are_no_corners():
    square = np.array([[0, 0], [2, 0], [2, 2], [0, 2], [1, 0], [2, 1], [0, 0], [1, 1]], float)
    assert least_thrust.outermost(square) == [0, 1, 2, 3]


def test_a_rotor_that_is_absent_gives_nothing(vehicle, rotors):
    given = least_thrust.thrusts(rotors.pairs, 0.3, -0.2)
    assert given[vehicle.n :] == (0.0,) * (8 - vehicle.n)
    assert total_of(inverse8(rotors.w) * given) > 0.0


def total_of(each: Rotors) -> float:
    return sum(each)
