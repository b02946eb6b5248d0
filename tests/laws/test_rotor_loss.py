"""Rotors that are lost: what the others can do, and what the allocation makes of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from fcu.interface.airframe import HOVERS, SHIPPED, believed
from fcu.kernel.algebra import Rotors, Vec3, inverse8
from fcu.laws import allocation
from fcu.laws.face import Limits
from fcu.laws.rotor_loss import BALANCED, Fate, hovers, without
from fcu.laws.scales import G, hover_thrust

FLIES = ("s1000", "x8")


def vehicle(name):
    """Rotors, limits, thrust of hover and greatest weight of a shipped airframe."""
    made, tables = believed(SHIPPED[name])
    most = tables["limits"]
    limits = Limits(most["thrust_min_n"], most["thrust_max_n"], math.radians(most["tilt_max_deg"]))
    rotors = allocation.believed_rotors(made, 0.002, 0.03, f_min=math.nan, kappa=3.0)
    rotors = rotors._replace(f_min=limits.T_min / rotors.W)
    return rotors, limits, hover_thrust(tables), G * tables["vehicle"]["mass_kg"][1]


def given(rotors, T, tau):
    """Thrusts, and the thrust and torque that they give, of an allocation."""
    f, gave_up = allocation.allocate(rotors, T, tau)
    return np.array(f), allocation.achieved(rotors, inverse8(rotors.c_T) * f), gave_up


EACH = [(name, rotor) for name in SHIPPED for rotor in range(1, believed(SHIPPED[name])[0].n + 1)]


@pytest.mark.parametrize(("name", "rotor"), EACH)
def test_an_octocopter_flies_on_a_hexacopter_lands_a_quadrotor_falls(name, rotor):
    rotors, limits, T_hover, heaviest = vehicle(name)
    fate, after, less = without(rotors, limits, {rotor}, T_hover, heaviest)
    if name in FLIES:
        assert fate is Fate.FLIES
        assert less.T_max >= HOVERS * heaviest
    elif name == "hexa":
        assert fate is Fate.LANDS
        assert tuple(after.B_z) == (0.0,) * 8
    else:
        assert fate is Fate.FALLS
        assert (after, less) == (rotors, limits)


@pytest.mark.parametrize(("name", "rotor"), [e for e in EACH if e[0] in (*FLIES, "hexa")])
def test_the_lost_rotor_gets_no_work_and_the_others_do_what_is_asked(name, rotor):
    rotors, limits, T_hover, heaviest = vehicle(name)
    _, after, less = without(rotors, limits, {rotor}, T_hover, heaviest)
    best = max(hovers(rotors, {rotor}, T_hover), key=lambda each: (each.yaw, each.room))
    random = np.random.default_rng(rotor)
    for _ in range(40):
        T = T_hover + random.uniform(-0.1, 0.1) * T_hover
        tau = 0.3 * best.room * random.uniform(-1.0, 1.0, 2)
        f, (T_given, tau_given), gave_up = given(after, T, Vec3(*tau.tolist(), 0.0))
        assert f[rotor - 1] == 0.0
        assert f.min() >= 0.0
        assert f.max() <= after.f_max * (1.0 + 1e-12)
        assert gave_up.torque == 0.0
        assert T_given == pytest.approx(T, rel=1e-9)
        np.testing.assert_allclose(tau_given[:2], tau, atol=1e-9 * T_hover)
        if name != "hexa":
            assert tau_given[2] == pytest.approx(0.0, abs=1e-9 * T_hover)
    # a hover at the greatest thrust is within every rotor's own
    f, (T_given, _), _ = given(after, less.T_max, Vec3(0.0, 0.0, 0.0))
    full = np.array(rotors.c_T) * np.array(rotors.Omega_max) ** 2
    assert (f <= full * (1.0 + 1e-9)).all()
    assert T_given == pytest.approx(less.T_max)
    assert less.T_max * math.cos(less.phi_star) >= T_hover * (1.0 - 1e-9)


@pytest.mark.parametrize("name", FLIES)
def test_without_a_rotor_yaw_is_steered_both_ways(name):
    rotors, limits, T_hover, heaviest = vehicle(name)
    _, after, _ = without(rotors, limits, {1}, T_hover, heaviest)
    for tau in (0.05, -0.05):
        _, (_, (_, _, z)), gave_up = given(after, T_hover, Vec3(0.0, 0.0, tau))
        assert z == pytest.approx(tau, abs=1e-9)
        assert gave_up.yaw == 0.0


@pytest.mark.parametrize("safe", [0.0, 1.0])
def test_yaw_that_is_left_free_is_told_as_given_up(safe):
    for name, given_up in (("hexa", 1.0), ("s1000", 0.0)):
        rotors, limits, T_hover, heaviest = vehicle(name)
        _, after, _ = without(rotors._replace(safe=safe), limits, {1}, T_hover, heaviest)
        for tau in (0.02, -0.02):
            assert given(after, T_hover, Vec3(0.0, 0.0, tau))[2].yaw == given_up
        assert given(after, T_hover, Vec3(0.0, 0.0, 0.0))[2].yaw == 0.0


@pytest.mark.parametrize(("name", "rotor"), EACH)
def test_it_says_that_there_is_no_hover_where_a_linear_program_finds_none(name, rotor):
    """A hover that holds roll and pitch: some thrusts, a little above nought, balance every small torque."""
    rotors, limits, T_hover, heaviest = vehicle(name)
    fate = without(rotors, limits, {rotor}, T_hover, heaviest)[0]
    x, y = np.array(rotors.x), np.array(rotors.y)
    there = [i for i in range(8) if rotors.spin[i] and i != rotor - 1]
    full = (np.array(rotors.c_T) * np.array(rotors.Omega_max) ** 2)[there]
    rows = np.stack([np.ones(len(there)), y[there], -x[there]])
    yaw = -rotors.k_Q * np.array(rotors.spin)[there]

    def balances(tau, turn=None):
        A, b = (
            (rows, [T_hover, *tau])
            if turn is None
            else (np.vstack([rows, yaw]), [T_hover, *tau, turn])
        )
        bounds = [(0.0, each) for each in full]
        return linprog(np.zeros(len(there)), A_eq=A, b_eq=b, bounds=bounds).status == 0

    small = 0.01 * T_hover * float(np.hypot(x, y).max())
    around = [(small * math.cos(a), small * math.sin(a)) for a in np.arange(8) * math.pi / 4.0]
    tilts = all(balances(tau) for tau in around)
    turns = tilts and all(balances((0.0, 0.0), s * 0.01 * small) for s in (1, -1)) and all(
        balances(tau, 0.0) for tau in around
    )  # fmt: skip
    assert fate is (Fate.FLIES if turns else Fate.LANDS if tilts else Fate.FALLS)


def test_nothing_is_lost_changes_nothing():
    rotors, limits, T_hover, heaviest = vehicle("s1000")
    assert without(rotors, limits, (), T_hover, heaviest) == (Fate.FLIES, rotors, limits)


def test_two_opposite_rotors_of_an_octocopter_leave_too_little_thrust_for_a_flight():
    rotors, limits, T_hover, heaviest = vehicle("s1000")
    fate, after, less = without(rotors, limits, {1, 5}, T_hover, heaviest)
    assert fate is Fate.LANDS
    assert T_hover < less.T_max < HOVERS * heaviest
    assert less.phi_star == pytest.approx(math.acos(T_hover / less.T_max))
    _, (T, tau), _ = given(after, T_hover, Vec3(0.0, 0.0, 0.0))
    assert pytest.approx(T_hover) == T
    assert np.abs(tau).max() < BALANCED * T_hover
    assert isinstance(after.w, Rotors)
