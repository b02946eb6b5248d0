"""The governor: out of the way when there is room, and never beyond the limits when there is not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.guard import governor, guard, margin, wrench
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3, norm
from fcu.kernel.buffers import to_buffer
from fcu.laws.approach import approach
from fcu.laws.face import Reference

STILL = Vec3(0.0, 0.0, 0.0)
THERE = Reference(STILL, STILL)
HOVER_N = 8.0 * 9.81


def vec(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


def at_rest(hover):
    """Taken over long ago: nothing left of the start."""
    state, _ = guard.idle(hover())
    return state


def governed_from(settings, state, reference, setpoint, r=STILL, v=STILL):
    """What `governor.governed` makes of a setpoint."""
    params, law = settings.guard, settings.law
    known = margin.known(params, law)
    return governor.governed(params, law, known, state, reference, setpoint, r, v, 0.0, HOVER_N)


def test_with_room_the_setpoint_passes_to_the_bit(settings_of, hover, fixed):
    state = at_rest(hover)._replace(a_m=Vec3(0.1, 0.0, 0.05))
    near = fixed((0.1, 0.0, 0.05))
    given, a_m, governed = governed_from(settings_of(), state, THERE, near)
    assert given == near
    assert (a_m, governed) == ((0.1, 0.0, 0.05), 0.0)


def test_a_guard_that_warns_flies_any_setpoint(settings_of, hover, fixed):
    settings, far = settings_of(guard="warn"), fixed((400.0, 0.0, -700.0))
    given, _, governed = governed_from(settings, at_rest(hover), THERE, far)
    assert (given, governed) == (far, 0.0)
    yaw, rate, limited = governor.turned(
        settings.guard, settings.law, at_rest(hover), fixed(psi=2.0), 0.0, HOVER_N
    )
    assert (yaw, rate, limited) == (2.0, 0.0, 0.0)


def test_a_guard_that_refuses_flies_no_faster_than_the_rotors_turn(settings_of, hover, fixed):
    settings, near = settings_of(guard="refuse"), fixed((2.0, 0.0, 0.0), psi=2.0)
    j = wrench.jerk_ahead(settings.guard, settings.law, 0.0)
    given, a_m, governed = governed_from(settings, at_rest(hover), THERE, near)
    assert a_m == pytest.approx((j * settings.law.h, 0.0, 0.0))
    assert governed == 1.0
    assert given.psi_c == 0.0  # from where it points; there it goes with
    most = wrench.yaw_acceleration(settings.guard, settings.law, HOVER_N)
    assert given.psi_dot_c == pytest.approx(most * settings.law.h)


def test_below_the_position_level_nothing_is_governed(settings_of, hover, fixed):
    lying = fixed((400.0, 0.0, 0.0), 2.0)._replace(level=1.0)
    given, _, governed = governed_from(settings_of(), at_rest(hover), THERE, lying)
    assert (given, governed) == (lying, 0.0)


def test_the_reference_model_given_r_g_accelerates_as_governed(settings_of, hover):
    """(34) with r_g in place of r_c, for a setpoint that moves too."""
    settings, rng = settings_of(f_m=1.7, zeta_m=0.9), np.random.default_rng(3)
    f_m, zeta_m = settings.law.f_m, settings.law.zeta_m
    for _ in range(50):
        reference = Reference(vec(rng.normal(size=3)), vec(rng.normal(size=3)))
        state = at_rest(hover)._replace(a_m=vec(rng.normal(size=3)))
        setpoint = Setpoint(*(vec(rng.normal(size=3) * 20.0) for _ in range(3)), 0.0, 0.0)
        given, a_m, _ = governed_from(settings, state, reference, setpoint, *reference)
        r_m, v_m = np.array(reference.r_m), np.array(reference.v_m)
        as_34 = np.array(given.a_c) - 2.0 * f_m * zeta_m * (v_m - given.v_c)
        as_34 -= f_m**2 * (r_m - given.r_c)
        np.testing.assert_allclose(a_m, as_34, atol=1e-9)


def test_what_is_demanded_stays_inside_by_the_allowance(settings_of, hover):
    """With a tracking error too: the reference gives way, not the vehicle's limits."""
    settings, rng = settings_of(), np.random.default_rng(4)
    known = margin.known(settings.guard, settings.law)
    f_m, zeta_m, held = settings.law.f_m, settings.law.zeta_m, 0
    for _ in range(300):
        reference = Reference(STILL, vec(rng.normal(size=3)))
        state = at_rest(hover)._replace(a_m=vec(rng.normal(size=3) * 10.0))
        setpoint = Setpoint(vec(rng.normal(size=3) * 60.0), STILL, STILL, 0.0, 0.0)
        r, v = vec(rng.normal(size=3)), vec(np.array(reference.v_m) + rng.normal(size=3) * 0.5)
        _, a_m, governed = governed_from(settings, state, reference, setpoint, r, v)
        demanded = (
            np.array(a_m)
            - 2.0 * f_m * zeta_m * (np.array(v) - reference.v_m)
            - f_m**2 * (np.array(r) - reference.r_m)
        )
        assert governed == 1.0
        allowance = margin.allowance(known, reference.v_m, 0.0)
        f_v = margin.dragging(known, reference.v_m)
        if allowance < (1.0 - margin.KEPT) * margin.room(known, STILL, f_v):
            assert margin.room(known, vec(demanded), f_v) >= allowance - 1e-9
            held += 1
    assert held > 250


@pytest.mark.computes
def test_room_for_the_doubt_is_made_no_faster_than_attitude_follows(settings_of, hover):
    """Else a change of the reference, which adds to the doubt, would feed itself."""
    settings, rng = settings_of(), np.random.default_rng(5)
    known, cut = margin.known(settings.guard, settings.law), 0
    j = wrench.jerk(settings.guard, settings.law, HOVER_N) * settings.law.h
    for _ in range(30):
        way = rng.normal(size=3)
        far = Setpoint(vec(100.0 * way / np.linalg.norm(way)), STILL, STILL, 0.0, 0.0)
        state = at_rest(hover)
        grown = np.inf
        while grown > 1e-12:  # until the demand is as large as may be
            _, a_m, _ = governed_from(settings, state, THERE, far)
            grown = norm(a_m - state.a_m)
            state = state._replace(a_m=a_m)
        before = a_m
        _, a_m, _ = governed_from(settings, state._replace(beta=10.0), THERE, far)
        assert norm(a_m - before) <= j * (1.0 + 1e-9)
        cut += norm(before) - norm(a_m) > 0.9 * j
        assert margin.condition(known, a_m, STILL, 0.0) >= -1e-9
    assert cut > 15


def test_the_scale_is_the_largest_that_fits(settings_of):
    """Against halving, in every direction, straight up and down too."""
    settings, rng = settings_of(), np.random.default_rng(6)
    known, cut = margin.known(settings.guard, settings.law), 0
    for k in range(400):
        a = vec(rng.normal(size=3) * 10.0 * ([0.0, 0.0, 1.0] if k % 4 == 0 else [1.0, 1.0, 1.0]))
        f_v = margin.dragging(known, vec(rng.normal(size=3)))
        radius = rng.uniform(0.0, 0.9) * margin.room(known, STILL, f_v)
        part = governor.within(known, a, f_v, radius)
        assert 0.0 < part <= 1.0
        assert margin.room(known, part * a, f_v) >= radius - 1e-6
        if part < 1.0:
            cut += 1
            assert margin.room(known, (1.001 * part) * a, f_v) < radius + 1e-9
    assert cut > 100


@pytest.mark.parametrize("masses", [[0.3, 9.0], [7.0, 25.0]])
def test_beliefs_that_no_hover_meets_leave_the_position_loop_closed(flight, fixed, masses):
    """Nothing can be kept then; it is flown to, at the speed of the governor."""
    settings = ("law.guard=govern", f"law.guard_mass_kg={masses}")
    rows = flight([(0.0, fixed((4.0, 0.0, 4.0)))], 20.0, wind=True, settings=settings)
    r = rows["measured"]["r_E"][-1]
    assert math.dist((r["x"], r["y"], r["z"]), (4.0, 0.0, 4.0)) < 0.2
    assert rows["guard"]["margin"]["condition"].max() < 0.0


@pytest.mark.parametrize("f_m", [0.5, 1.0, 3.0])
def test_the_slowest_change_that_is_allowed_arrives(flight, fixed, f_m):
    settings = ("law.guard=govern", "law.guard_jerk_m_s3=5.0", f"law.f_m={f_m}")
    rows = flight([(0.0, fixed((20.0, 0.0, 0.0)))], 40.0, settings=settings)
    x = rows["outputs"]["reference"]["r_m"]["x"]
    assert x.max() < 20.0 * 1.03
    assert x[-1] == pytest.approx(20.0, abs=0.05)


def test_the_governed_reference_changes_its_acceleration_no_faster_than_told(
    settings_of, hover, fixed
):
    settings = settings_of()
    _, a_m, _ = governed_from(settings, at_rest(hover), THERE, fixed((20.0, 0.0, 0.0)))
    j = wrench.jerk(settings.guard, settings.law, HOVER_N)
    assert 1.0 < j < settings.guard.jerk
    assert a_m == pytest.approx((j * settings.law.h, 0.0, 0.0))
    weak = settings_of(guard_jerk_m_s3=5.0, c_angle=5.0, c_rate=10.0)
    _, a_m, _ = governed_from(weak, at_rest(hover), THERE, fixed((20.0, 0.0, 0.0)))
    assert a_m == pytest.approx((5.0 * settings.law.h, 0.0, 0.0))


@pytest.mark.parametrize("x", [0.01, 0.5, 3.0, 40.0])
def test_a_point_is_approached_at_a_speed_that_stops_in_time(x):
    c, limit, h = 0.625, 0.8, 1e-3
    hardest, speed = 0.0, approach(c, limit, x)
    while x > 1e-4:
        x -= h * speed
        after = approach(c, limit, x)
        hardest, speed = max(hardest, (speed - after) / h), after
    assert hardest <= limit * (1.0 + 1e-3)
    assert x > 0.0


def test_at_its_greatest_speed_the_condition_holds_in_every_direction(settings_of):
    settings = settings_of()
    known = margin.known(settings.guard, settings.law)
    top, brake = governor.speeds(known)
    assert 2.0 < top < 6.0
    assert brake > 0.3
    rng = np.random.default_rng(5)
    for _ in range(200):
        way = rng.normal(size=3)
        v = governor.sunk(known, vec(top * way / np.linalg.norm(way)))
        assert margin.condition(known, STILL, v, 0.0) > -1e-9
        braking = (-brake / norm(v)) * v
        # what a tilt needs to steer is the same, however the vehicle brakes
        steers = margin.steering(known, v)
        assert margin.condition(known, braking, v, 0.0) > 0.0 or abs(steers) < 1e-9


def test_a_step_at_f_m_1_4_saturates_nothing_and_arrives(flight, fixed):
    """The paper's Figures 9 to 11, with its wind, governed: r_c = (4, 7, 18) from rest."""
    there = fixed((4.0, 7.0, 18.0))
    settings = ("law.guard=govern", "law.f_m=1.4", "law.J_hat_0=0.3")
    rows = flight([(0.0, there)], 20.0, wind=True, settings=settings)
    inside = rows["guard"]
    for name in ("thrust", "tilt", "torque", "yaw"):
        assert not rows["outputs"]["saturation"][name].any(), name
    r = rows["measured"]["r_E"]
    away = np.sqrt((r["x"] - 4.0) ** 2 + (r["y"] - 7.0) ** 2 + (r["z"] - 18.0) ** 2)
    assert away[rows["t"] > 10.0].max() < 0.1
    assert inside["margin"]["condition"][rows["t"] > 0.5].min() > 0.0
    assert inside["governed"][rows["t"] < 5.0].mean() > 0.9
    assert not inside["governed"][rows["t"] > 12.0].any()


def test_the_same_step_as_it_is_asked_saturates(flight, fixed):
    there = fixed((4.0, 7.0, 18.0))
    settings = ("law.guard=warn", "law.f_m=1.4", "law.J_hat_0=0.3")
    rows = flight([(0.0, there)], 3.0, wind=True, settings=settings)
    assert rows["outputs"]["saturation"]["thrust"].sum() > 100
    assert rows["guard"]["margin"]["force"].min() < 0.0
    assert rows["guard"]["margin"]["condition"].min() < -100.0


@pytest.mark.parametrize(("f_m", "lasts_s"), [(0.3, 50.0), (1.0, 50.0), (3.0, 90.0)])
@pytest.mark.computes
def test_a_long_way_is_flown_at_a_steady_speed_and_without_turning_back(
    flight, fixed, f_m, lasts_s
):
    """With f_m 3 a gust leaves torque for 1 m/s."""
    there = fixed((60.0, 0.0, 0.0))
    settings = ("law.guard=govern", f"law.f_m={f_m}")
    rows = flight([(0.0, there)], lasts_s, settings=settings)
    x = rows["outputs"]["reference"]["r_m"]["x"]
    assert x.max() < 60.0 + 0.02 * 60.0  # the model's own overshoot at zeta_m = 0.8 is 1.5 %
    assert x[-1] == pytest.approx(60.0, abs=0.1)
    assert not rows["outputs"]["saturation"]["tilt"].any()


def test_a_wrong_start_too_is_governed(flight, fixed):
    """The reference 8.7 m off at take-over: the vehicle is not thrown after it."""
    here = fixed()
    settings = ("law.guard=govern", "law.r_m_offset=[-5.0, -5.0, -5.0]", "law.J_hat_0=0.3")
    outputs = flight([(0.0, here)], 15.0, wind=True, settings=settings)["outputs"]
    assert not outputs["saturation"]["thrust"].any()
    assert not outputs["saturation"]["tilt"].any()
    e = outputs["e_r"][-1]
    assert math.sqrt(e["x"] ** 2 + e["y"] ** 2 + e["z"] ** 2) < 0.1


def test_yaw_begins_no_faster_than_it_can_turn(flight, fixed):
    settings = ("law.guard=govern", "law.J_hat_0=0.3")
    rows = flight([(0.0, fixed()), (2.0, fixed(psi=1.5))], 6.0, settings=settings)
    rate = rows["guard_state"]["psi_g_dot"]
    fastest = np.abs(np.diff(rate)).max() * 500.0
    most = wrench.PART * 0.0159 * (8.0 * 9.81 - 5.0) / 0.5192  # in hover, of the largest inertia
    assert fastest == pytest.approx(most, rel=0.05)
    assert not rows["outputs"]["saturation"]["torque"].any()
    assert not rows["outputs"]["saturation"]["yaw"].any()
    assert rows["outputs"]["angles"]["z"][-1] == pytest.approx(1.5, abs=0.01)


def test_python_and_compiled_code_give_the_same_bits(settings_of, hover, fixed):
    params, law = settings_of().guard, settings_of().law
    arguments = (
        params,
        law,
        margin.known(params, law),
        at_rest(hover),
        Reference(STILL, Vec3(1.0, 0.5, -0.2)),
        fixed((9.0, -3.0, 2.0), 1.0),
        Vec3(0.1, 0.0, 0.0),
        STILL,
        0.2,
        HOVER_N,
    )
    plain, compiled = governor.governed.py_func(*arguments), governor.governed(*arguments)
    for a, b in zip(plain[:2], compiled[:2], strict=True):
        assert to_buffer(a).tobytes() == to_buffer(b).tobytes()
