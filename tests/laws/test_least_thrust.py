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


@pytest.fixture(params=[*SHIPPED, "ahead"], scope="module")
def vehicle(request):
    if request.param == "ahead":
        return airframe.airframe(AHEAD)
    return airframe.believed(SHIPPED[request.param])[0]


@pytest.fixture(scope="module")
def rotors(vehicle):
    return allocation.believed_rotors(vehicle, 0.002, 0.03, f_min=0.02, kappa=3.0)


def demands(rotors, seed, n=150):
    """Thrusts of 2 to 98 % of the greatest, torques to 2.2 times what the pseudo-inverse fits beside them."""
    rng, per = np.random.default_rng(seed), max(np.hypot(rotors.B_x, rotors.B_y))
    for _ in range(n):
        T = rng.uniform(0.02, 0.98) * rotors.W * rotors.f_max
        beside = min(T / rotors.W - rotors.f_min, rotors.f_max - T / rotors.W)
        tau, angle = rng.uniform(0.0, 2.2) * beside / per, rng.uniform(0.0, 2.0 * math.pi)
        yield float(T), Vec3(float(tau * math.cos(angle)), float(tau * math.sin(angle)), 0.0)


def test_no_thrusts_give_a_torque_from_less(vehicle, rotors):
    """Against a linear program over all thrusts that pull upwards and give no torque about yaw."""
    of = effect(vehicle)
    for T, tau in demands(rotors, 1):
        given = np.array(least_thrust.thrusts(rotors.pairs, tau.x, tau.y))[: vehicle.n]
        assert given.min() >= 0.0
        np.testing.assert_allclose(of[1:] @ given, tau, atol=1e-11 * T)
        least = linprog(np.ones(vehicle.n), A_eq=of[1:], b_eq=tau).fun
        assert given.sum() == pytest.approx(least, rel=1e-9, abs=1e-12)


def test_of_an_octocopter_it_is_three_fifths_of_what_the_pseudo_inverse_needs():
    """1.707 times the torque beside the same thrust, about any axis."""
    octo = airframe.believed(SHIPPED["s1000"])[0]
    rotors = allocation.believed_rotors(octo, 0.002, 0.03, f_min=0.02, kappa=3.0)
    for angle in np.linspace(0.0, 2.0 * math.pi, 25).tolist():
        x, y = math.cos(angle), math.sin(angle)
        evenly = 8.0 * max(x * rotors.B_x + y * rotors.B_y)
        pairs = sum(least_thrust.thrusts(rotors.pairs, x, y))
        assert evenly / pairs == pytest.approx(1.0 + math.sqrt(0.5), rel=1e-9)


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
    assert met > 50
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
    assert fitted > 30


def test_thrusts_change_no_faster_than_the_demand(rotors):
    """Along a line of torques through what fits and what does not there is no jump."""
    T, per = 0.25 * rotors.W * rotors.f_max, max(np.hypot(rotors.B_x, rotors.B_y))
    for angle in np.linspace(0.0, 2.0 * math.pi, 9).tolist():
        sizes = np.linspace(0.0, 2.5 * T / rotors.W / per, 4001).tolist()
        found = [
            allocation.allocate(rotors, T, Vec3(s * math.cos(angle), s * math.sin(angle), 0.0))[0]
            for s in sizes
        ]
        assert np.abs(np.diff(found, axis=0)).max() < 20.0 * per * sizes[1]


def test_points_that_are_one_and_points_on_a_side_are_no_corners():
    square = np.array([[0, 0], [2, 0], [2, 2], [0, 2], [1, 0], [2, 1], [0, 0], [1, 1]], float)
    assert least_thrust.outermost(square) == [0, 1, 2, 3]


def test_a_rotor_that_is_absent_gives_nothing(vehicle, rotors):
    given = least_thrust.thrusts(rotors.pairs, 0.3, -0.2)
    assert given[vehicle.n :] == (0.0,) * (8 - vehicle.n)
    assert total_of(inverse8(rotors.w) * given) > 0.0


def total_of(each: Rotors) -> float:
    return sum(each)
