"""What is demanded now, and what a way adds: bounds held against draws, and against flights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.guard import admission, foreseen, margin, present, wrench
from fcu.guard.present import Beginning
from fcu.guard.types import GuardState
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3, norm
from fcu.kernel.buffers import to_buffer
from fcu.laws.mmrac import law as mmrac

STILL = Vec3(0.0, 0.0, 0.0)


def vec(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


def of_force(settings):
    """Settings whose condition is of force alone: tilts steer whatever the wind."""
    return settings._replace(guard=settings.guard._replace(lift=math.inf, lift_turns=math.inf))


def drag(R, c, u):
    """Force (N, E) of quadratic drag along body axes, at a velocity u (m/s, E) past the air."""
    air = R.T @ u
    return R @ (c * np.abs(air) * air)


def hover(guard, law, m=8.0, **fields):
    """Of a mass that hovers in still air, told in full."""
    told = {
        "T_0": Vec3(0.0, 0.0, m * law.g), "a_d": STILL, "r": STILL, "v": STILL,
        "up": Vec3(0.0, 0.0, 1.0), "psi": 0.0,
        "unturned": 0.0, "unflown": 0.0, "beta": 0.0, "told": 1.0,
    }  # fmt: skip
    return present.Present(**{**told, **fields})


@pytest.mark.computes
def test_drag_turns_with_its_axes_no_faster_than_told():
    rng, most = np.random.default_rng(1), 0.0
    for _ in range(20_000):
        u, axis = rng.normal(size=(2, 3))
        u, axis = u / np.linalg.norm(u), axis / np.linalg.norm(axis)
        if rng.uniform() < 0.5:
            axis = np.array([0.0, 0.0, 1.0])
            u = np.array([math.sqrt(1 / 3), math.sqrt(2 / 3), 0.0]) + 0.05 * rng.normal(size=3)
            u /= np.linalg.norm(u)
        c, small = rng.integers(0, 2, size=3).astype(float), 1e-6
        turned = Rotation.from_rotvec(small * axis).as_matrix()
        rate = np.linalg.norm(drag(turned, c, u) - drag(np.eye(3), c, u)) / small
        most = max(most, rate)
    assert 0.99 * present.TURNS < most <= present.TURNS * (1.0 + 1e-5)


@pytest.mark.computes
def test_no_change_of_drag_leaves_the_ball_whatever_wind_coefficients_and_attitude(settings_of):
    settings, rng, nearest = settings_of(), np.random.default_rng(2), math.inf
    guard, law = settings.guard, settings.law
    known = margin.known(guard, law)
    for _ in range(5000):
        w = rng.normal(size=3)
        w *= guard.w_max * rng.uniform() ** 0.3 / np.linalg.norm(w)
        v, dv, wind = rng.normal(size=(3, 3)) * rng.uniform(0.0, 3.0, size=3)[:, None]
        if rng.uniform() < 0.3:
            wind = -w * rng.uniform() - 0.01 * wind  # of itself
        if np.linalg.norm(w + wind) > guard.w_max:
            continue
        R = Rotation.random(random_state=rng)
        turn = rng.uniform(0.0, 0.5) * (rng.uniform() < 0.5)
        axis = rng.normal(size=3)
        after = Rotation.from_rotvec(turn * axis / np.linalg.norm(axis)) * R
        c = guard.c_D * rng.uniform(size=3) ** rng.choice([0.0, 1.0])
        was = drag(R.as_matrix(), c, v - w)
        change = drag(after.as_matrix(), c, v + dv - w - wind) - was
        now = hover(guard, law, v=vec(v))
        centre, radius = present.drift(
            known, now, float(np.linalg.norm(was)), vec(dv), float(np.linalg.norm(wind)),
            vec(v + dv), turn,
        )  # fmt: skip
        off = float(np.linalg.norm(change - np.array(centre)))
        assert off <= radius * (1.0 + 1e-9)
        nearest = min(nearest, radius - off)
    assert nearest < 0.3


def test_what_two_balls_have_in_common_lies_in_the_third():
    rng, smaller = np.random.default_rng(3), 0
    for _ in range(3000):
        p_kg, p, q_kg, q = rng.normal(size=(4, 3)) * np.array([2.0, 10.0, 2.0, 10.0])[:, None]
        R, S = rng.uniform(1.0, 30.0, size=2)
        c_kg, c, radius = present.common(vec(p_kg), vec(p), R, vec(q_kg), vec(q), S, 7.0, 9.0)
        smaller += radius < 0.99 * min(R, S)
        m = rng.uniform(7.0, 9.0)
        x = rng.normal(size=(40, 3))
        x = m * p_kg + p + R * rng.uniform(size=(40, 1)) * x / np.linalg.norm(x, axis=1)[:, None]
        x = x[np.linalg.norm(x - m * q_kg - q, axis=1) <= S]
        off = np.linalg.norm(x - m * np.array(c_kg) - np.array(c), axis=1)
        assert (off <= radius * (1.0 + 1e-9)).all()
    assert smaller > 500


def looked(settings, begins, far):
    guard, law = to_buffer(settings.guard), to_buffer(settings.law)
    way = np.array([[math.inf, *to_buffer(Setpoint(Vec3(*far), STILL, STILL, 0.0, 0.0))]])
    return admission.ahead(guard, law, way, begins)


def beginning(of):
    return to_buffer(present.Beginning(r_m=STILL, v_m=STILL, a_m=STILL, present=of))


@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
def test_the_present_only_ever_admits_more(settings_of, way):
    settings = of_force(settings_of(guard="refuse", guard_wind_rate_m_s2=5.0, f_m=1.0))
    more = 0
    for far in (0.5, 1.0, 3.0, 6.0, 9.0):
        step = [far * x for x in way]
        for T_z in (70.0, 78.5, 85.0):
            now = hover(settings.guard, settings.law, T_0=Vec3(3.0, 0.0, T_z))
            unknown = hover(settings.guard, settings.law, told=0.0)
            prior = looked(settings, beginning(unknown), step)
            told = looked(settings, beginning(now), step)
            assert told >= prior
            more += told > prior
    assert more > 0


def soon(settings, now):
    """The condition (N) a tick later, in a hover that goes on."""
    guard, law = settings.guard, settings.law
    since = present.gone_on(law, present.begun(law, now, STILL, STILL), STILL)
    adds = foreseen.closed(law)
    return present.condition(
        guard, law, margin.known(guard, law), now, since, STILL, 0.0, 1.0, adds
    )


def test_a_change_that_is_not_flown_is_made_with_any_estimate_of_the_mass(settings_of):
    """A jump of 2 m/s^2: at once with all of it, a second later with almost nothing."""
    guard, law = settings_of(guard="refuse")[::-1]
    law, known = law._replace(h=0.01), margin.known(guard, law)
    since = present.gone_on(law, present.begun(law, hover(guard, law), STILL, STILL), Vec3(2.0, 0.0, 0.0))  # fmt: skip
    assert margin.left(since.changed) == pytest.approx((2.0, 0.0, 0.0))
    per_kg, fixed = Vec3(2.0, 0.0, law.g), Vec3(3.0, 0.0, 0.0)
    worst = min(
        float(margin.distance(known, m * per_kg + fixed + (m_hat - m) * since.a_d))
        for m in (known.m_min, known.m_max)
        for m_hat in (law.bounds.m_min, law.bounds.m_max)
    )
    assert present.least(known, law.bounds, since, 1.0, per_kg, fixed, 0.0) == pytest.approx(worst)
    for _ in range(100):
        since = present.gone_on(law, since, since.a_d - foreseen.closing(law, since.e, since.e_dot))
    assert norm(margin.left(since.changed)) < 0.02


def test_what_is_left_of_changes_before_counts_now_and_fades(settings_of):
    settings = of_force(settings_of(guard_wind_rate_m_s2=1.0, guard_mass_kg=[7.9, 8.1]))
    law, told = settings.law, (settings.guard, settings.law)
    calm = soon(settings, hover(*told))
    for part in ("unturned", "unflown", "beta"):
        assert soon(settings, hover(*told, **{part: 3.0})) < calm - 3.0
    since = present.begun(law._replace(h=0.01), hover(*told, unturned=3.0), STILL, STILL)
    left = []
    for _ in range(100):
        since = present.gone_on(law._replace(h=0.01), since, STILL)
        left.append(margin.left(since.left))
    assert left[0] > 2.5 and left[-1] < 0.15


def test_a_drag_that_pushes_already_and_an_error_that_closes_count(settings_of):
    """From a hover near a limit less is left than from one in still air."""
    settings = of_force(settings_of(guard_wind_rate_m_s2=1.0, guard_mass_kg=[7.9, 8.1]))
    law, told = settings.law, (settings.guard, settings.law)
    calm = soon(settings, hover(*told))
    pushed = hover(*told, T_0=Vec3(20.0, 0.0, 78.5), up=Vec3(0.25, 0.0, 0.97))
    closes = Vec3(-0.3 * law.f_m * law.f_m, 0.0, 0.0)
    off = hover(*told, r=Vec3(0.3, 0.0, 0.0), a_d=closes, T_0=Vec3(8.0 * closes.x, 0.0, 78.5))
    known = margin.known(settings.guard, law)
    still = margin.condition(known, STILL, STILL, 0.0)
    assert calm > still + 5.0  # more than the beliefs leave
    assert soon(settings, pushed) < calm - 5.0
    assert soon(settings, off) < calm - 2.0


def test_turning_costs(settings_of):
    settings = of_force(settings_of(guard="refuse", guard_wind_rate_m_s2=1.0))
    calm = beginning(hover(*settings[::-1]))
    turned = beginning(hover(*settings[::-1], psi=1.0))
    guard, law = to_buffer(settings.guard), to_buffer(settings.law)
    way = np.array([[math.inf, *to_buffer(Setpoint(Vec3(1.0, 0.0, 0.0), STILL, STILL, 0.0, 0.0))]])
    plain = admission.ahead(guard, law, way, calm, 0.0)
    assert admission.ahead(guard, law, way, turned, 0.0) < plain


def test_what_has_not_flown_is_not_known(settings_of):
    settings = settings_of(guard="refuse")
    nothing = np.zeros(admission.BEGINNING)
    unknown = beginning(hover(*settings[::-1], told=0.0))
    assert looked(settings, nothing, (2.0, 0.0, 0.0)) == looked(settings, unknown, (2.0, 0.0, 0.0))


def test_a_descent_and_an_updraft_leave_less_to_turn_with(settings_of):
    settings = settings_of(guard="refuse", c_angle=7.0, c_rate=14.0)
    guard, law = settings.guard, settings.law
    most = law.h * wrench.jerk_ahead(guard, law, 0.0)

    def turns(now, a_z, change):
        since = present.begun(law, now, STILL, STILL)
        since = present.gone_on(law, since, Vec3(0.0, 0.0, a_z))
        return present.turns(guard, law, now, since, change)

    calm, aside = hover(guard, law), Vec3(most, 0.0, 0.0)
    assert turns(calm, 0.0, aside)
    assert turns(calm, 1.0, aside)
    assert not turns(calm, -1.0, aside)
    assert turns(calm, -1.0, Vec3(0.0, 0.0, most))  # along the thrust nothing turns
    assert not turns(hover(guard, law, T_0=Vec3(0.0, 0.0, 48.0)), 0.0, aside)


def test_where_a_way_lies_does_not_matter(settings_of):
    """Only differences of places count."""
    told = settings_of(guard="warn")

    def found(there, believed):
        setpoint = Setpoint(Vec3(20.0 + there, 0.0, 0.0), STILL, STILL, 0.0, 0.0)
        here = Vec3(there, 0.0, 0.0)
        begins = Beginning(
            r_m=here, v_m=STILL, a_m=STILL, present=hover(told.guard, told.law, r=here)
        )
        way = np.concatenate([[math.inf], to_buffer(setpoint)])[None]
        return admission.tightest(
            to_buffer(told.guard), to_buffer(told.law), way, to_buffer(begins), believed
        )

    for believed in (0.0, 1.0):
        assert found(0.0, believed)[:2] == pytest.approx(found(50.0, believed)[:2], rel=1e-9)


def test_what_is_seen_after_a_tick_is_the_vehicle_a_tick_on_and_the_way_its_thrust_points(
    settings_of, hover
):
    settings = settings_of(m_hat_0=8.0)
    law, v = settings.law, Vec3(2.0, -1.0, 0.5)
    measured = hover(r=(1.0, 2.0, 3.0), v=v, angles=(0.1, 0.2, 0.7))
    state = mmrac.beginning(law, measured)
    memory = state.memory._replace(f_c=Vec3(0.5, 0.0, law.g), e3=Vec3(0.6, 0.0, 0.8))
    guard_state = GuardState(*[0.0] * len(GuardState._fields))._replace(
        beta=3.0
    )  # all else is not looked at
    found = present.seen(law, state._replace(memory=memory), guard_state, measured)
    assert (found.v, found.up, found.beta) == (v, (0.6, 0.0, 0.8), 3.0)
    assert found.r == pytest.approx(np.array([1.0, 2.0, 3.0]) + law.h * np.array(v))
    assert np.array(found.T_0) == pytest.approx(8.0 * np.array([0.5, 0.0, law.g]))
    assert found.psi == pytest.approx(0.7)
    assert found.told == 1.0
