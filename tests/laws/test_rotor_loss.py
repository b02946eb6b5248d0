"""Rotors that are lost: what the others can do, and what the allocation makes of them."""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import linprog

from fcu.interface.airframe import (
    HOVERS,
    LEAST_SHARE,
    SHIPPED,
    AirframeError,
    airframe,
    believed,
    full_thrust,
)
from fcu.kernel.algebra import Rotors, Vec3, inverse8
from fcu.laws import allocation
from fcu.laws.face import Limits
from fcu.laws.rotor_loss import BALANCED, LEAST_TILT, Fate, best_hover, hovers, without
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
@pytest.mark.computes
def test_the_lost_rotor_gets_no_work_and_the_others_do_what_is_asked(name, rotor):
    rotors, limits, T_hover, heaviest = vehicle(name)
    _, after, less = without(rotors, limits, {rotor}, T_hover, heaviest)
    best = best_hover(rotors, {rotor}, T_hover, heaviest)
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


class Possible(NamedTuple):
    """By linear programs, of the rotors that are left."""

    level: float  # N, greatest total thrust without torque
    level_all: float  # N, of a hover in which every rotor has its least share
    turning: float  # N, greatest total thrust without torque about roll and pitch
    turning_all: float
    tilts: float  # hold roll and pitch in a hover: how far every rotor is from its limits, over full thrust
    turns: float  # and yaw


def possible(rotors, lost, T_hover):
    """Return what the rotors that are left can do."""
    x, y = np.array(rotors.x), np.array(rotors.y)
    there = [i for i in range(8) if rotors.spin[i] and i + 1 not in lost]
    full = (np.array(rotors.c_T) * np.array(rotors.Omega_max) ** 2)[there]
    n = len(there)
    effect = np.stack([np.ones(n), y[there], -x[there], -rotors.k_Q * np.array(rotors.spin)[there]])

    def greatest(rows, share):
        low = share * full.max()
        bounds = [(low, each) for each in full]
        found = linprog(-np.ones(n), A_eq=effect[1:rows], b_eq=np.zeros(rows - 1), bounds=bounds)
        return -found.fun if found.status == 0 else 0.0

    def inside(rows):
        if np.linalg.matrix_rank(effect[:rows]) < rows:
            return 0.0
        A = np.hstack([effect[:rows], np.zeros((rows, 1))])  # thrusts, and the way to the limits
        away = np.vstack(
            [
                np.hstack([-np.eye(n), full[:, None]]),
                np.hstack([np.eye(n), full[:, None]]),
            ]
        )
        found = linprog(
            [*np.zeros(n), -1.0], A_eq=A, b_eq=[T_hover, *np.zeros(rows - 1)],
            A_ub=away, b_ub=[*np.zeros(n), *full], bounds=[(0.0, None)] * (n + 1),
        )  # fmt: skip
        return -found.fun if found.status == 0 else 0.0

    return Possible(
        greatest(4, 0.0), greatest(4, LEAST_SHARE), greatest(3, 0.0), greatest(3, LEAST_SHARE),
        inside(3), inside(4),
    )  # fmt: skip


def check(rotors, limits, lost, T_hover, heaviest):
    """Hold the choice of rotors to linear programs."""
    can = possible(rotors, lost, T_hover)
    fate, after, less = without(rotors, limits, lost, T_hover, heaviest)
    yaw = tuple(after.B_z) != (0.0,) * 8
    enough = HOVERS * heaviest
    # no more than can be done
    if fate is not Fate.FALLS:
        assert less.T_max <= (can.level if yaw else can.turning) * (1.0 + 1e-6)
        assert yaw or can.tilts > 0.0
    if fate is Fate.FLIES:
        assert yaw
        assert can.level >= enough * (1.0 - 1e-6)
    # and no less. A rotor that all but stands to balance the others counts as one that stands
    if can.tilts > LEAST_SHARE / 2.0:
        assert fate is not Fate.FALLS
    if can.turns > 1e-3 and can.level_all >= enough:
        assert fate is Fate.FLIES
    for weight in (T_hover, heaviest):
        if can.tilts > 1e-3 and can.turning_all >= weight:
            assert less.T_max >= weight * (1.0 - 1e-6)
    if can.turns > 1e-3 and can.level_all >= heaviest:
        assert yaw
    if fate is not Fate.FALLS and less.phi_star > LEAST_TILT:
        held = heaviest if fate is Fate.FLIES else T_hover
        assert less.T_max * math.cos(less.phi_star) >= held * (1.0 - 1e-9)
    return fate


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.computes
def test_no_linear_program_does_better_without_a_rotor_or_two(name):
    rotors, limits, T_hover, heaviest = vehicle(name)
    fates = {
        lost: check(rotors, limits, lost, T_hover, heaviest)
        for n in (1, 2)
        for lost in combinations(range(1, rotors.n + 1), n)
    }
    if name == "hexa":  # roll and pitch are held by the other three corners of a triangle
        assert [lost for lost in fates if fates[lost] is Fate.FALLS] == [
            (1, 2), (1, 6), (2, 3), (3, 4), (4, 5), (5, 6),
        ]  # fmt: skip


def odd(random):
    """Rotors, limits, thrust of hover and greatest weight of an airframe with nothing even about it."""
    while True:
        n = int(random.integers(5, 9))
        angles, arms = np.sort(random.uniform(0.0, 2.0 * math.pi, n)), random.uniform(0.3, 0.6, n)
        tables = {
            "spin": random.choice([-1, 1], n).tolist(),
            "position_m": np.stack([arms * np.cos(angles), arms * np.sin(angles)], 1).tolist(),
            "thrust_coefficient": random.uniform(4e-5, 1.2e-4, n).tolist(),
            "torque_to_thrust_m": 0.016, "full_speed_rad_s": 550.0, "lag_s": 0.05,
            "inertia_kg_m2": 2e-4,
        }  # fmt: skip
        try:
            made = airframe(tables)
        except AirframeError:
            continue
        heaviest = full_thrust(made) / random.uniform(1.25, 2.6)
        limits = Limits(0.054 * heaviest, full_thrust(made), math.radians(45.0))
        rotors = allocation.believed_rotors(made, 0.002, 0.03, f_min=math.nan, kappa=3.0)
        return rotors._replace(f_min=limits.T_min / rotors.W), limits, 0.9 * heaviest, heaviest


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.computes
def test_no_linear_program_does_better_with_an_odd_airframe(seed):
    rotors, limits, T_hover, heaviest = odd(np.random.default_rng([32, seed]))
    for rotor in range(1, rotors.n + 1):
        check(rotors, limits, (rotor,), T_hover, heaviest)


def best_of_all(rotors, lost, T_hover, heaviest):
    """The hover that the docstring of best_hover names, where every hover is worked out."""

    def rank(each):
        carried = sum(each.T_max >= weight for weight in (T_hover, heaviest))
        room = each.room if carried else each.T_max
        return carried, each.yaw, each.T_max >= HOVERS * heaviest, room

    found = list(hovers(rotors, lost, T_hover))
    best = max(found, key=rank, default=None)
    if best is not None and best.T_max >= HOVERS * heaviest:
        return best
    found += hovers(rotors, lost, T_hover, even=False)
    best = max(found, key=rank, default=None)
    if best is not None and best.T_max >= heaviest:
        return best
    turning = [
        each for even in (True, False) for each in hovers(rotors, lost, T_hover, even, level=False)
    ]
    found += [each for each in turning if each.T_max >= T_hover]
    return max(found, key=rank, default=None)


@pytest.mark.parametrize(
    ("of", "lost"),
    [(name, (rotor,)) for name, rotor in EACH if rotor < 3]
    + [(name, (2, other)) for name in (*FLIES, "hexa") for other in (1, 4, 6)]
    + [(4, (1, 8)), (4, (2,)), (7, (3,)), (9, (1, 3))],
)
def test_what_is_left_out_of_the_search_is_not_chosen(of, lost):
    """To the bit. Of the odd airframe 4 two hovers differ in the last bit of their thrust."""
    made = vehicle(of) if isinstance(of, str) else odd(np.random.default_rng([32, of]))
    rotors, _, T_hover, heaviest = made
    chosen = best_hover(rotors, lost, T_hover, heaviest)
    all_of_it = best_of_all(rotors, lost, T_hover, heaviest)
    assert (chosen is None) == (all_of_it is None)
    if chosen is not None:
        assert chosen.w.tobytes() == all_of_it.w.tobytes()
        assert chosen.B.tobytes() == all_of_it.B.tobytes()
        assert chosen[2:] == all_of_it[2:]


@pytest.mark.parametrize("turn", range(8))
def test_the_same_loss_turned_leaves_the_same(turn):
    """The rotors 1 and 3 of an octocopter: they carry the weight, and some torque about yaw is left."""
    rotors, limits, T_hover, heaviest = vehicle("s1000")
    lost = {1 + turn, 1 + (turn + 2) % 8}
    fate, after, less = without(rotors, limits, lost, T_hover, heaviest)
    assert fate is Fate.LANDS
    full = rotors.c_T[0] * rotors.Omega_max[0] ** 2
    assert less.T_max == pytest.approx((3.0 + math.sqrt(2.0)) * full)
    assert less.T_max > heaviest
    assert tuple(after.B_z) == (0.0,) * 8
    f, (T, tau), gave_up = given(after, T_hover, Vec3(0.5, -0.5, 0.0))
    assert (pytest.approx(T_hover), pytest.approx(0.5), pytest.approx(-0.5)) == (T, tau.x, tau.y)
    assert f.min() >= 0.0
    assert gave_up.torque == 0.0
    assert 0.0 < abs(tau.z) < 0.6


def test_no_lost_rotor_changes_no_bit():
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
