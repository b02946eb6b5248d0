"""The margin: distances against geometry, the allowance against drag of every kind."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from fcu.guard import foreseen, margin
from fcu.guard.types import GuardState
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3, norm
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rows import column
from fcu.process.tick import Tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import from_tables

STILL = Vec3(0.0, 0.0, 0.0)


def vec(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


def known_of(settings):
    return margin.known(settings.guard, settings.law)


def reachable(law, T):
    """Whether the actuators reach a force for every heading, as the law keeps to."""
    aside, size = math.hypot(T[0], T[1]), math.sqrt(T @ T)
    tilt = math.atan2(aside, T[2])
    limits, floor = law.limits, T[2] >= law.T_dz_min
    return limits.T_min <= size <= limits.T_max and tilt <= limits.phi_star and floor


@pytest.mark.computes
def test_a_ball_as_large_as_the_margin_can_be_reached_and_a_larger_one_cannot(settings_of):
    """The set is convex but for its least thrust; from inside, the distance is exact."""
    settings, rng = settings_of(), np.random.default_rng(1)
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    tested = 0
    while tested < 60:
        T = rng.uniform([-150.0, -150.0, 0.0], [150.0, 150.0, 200.0])
        found = margin.distance(known_of(settings), vec(T))
        assert (found >= 0.0) == reachable(settings.law, T)
        if found < 2.0:
            continue
        tested += 1
        assert all(reachable(settings.law, T + 0.999 * found * d) for d in directions)
        assert not all(reachable(settings.law, T + 1.05 * found * d) for d in directions)


@pytest.mark.parametrize(
    ("T", "limit"),
    [
        ((0.0, 0.0, 190.0), 10.0),  # thrust
        ((0.0, 0.0, 28.0), 8.0),  # the floor of the vertical force
        ((0.0, 30.0, 80.0), 50.0 * math.sqrt(0.5)),  # tilt, at 45 degrees
        ((0.0, 90.0, 80.0), -10.0 * math.sqrt(0.5)),
        ((0.0, 0.0, 230.0), -30.0),
    ],
)
def test_the_margin_is_to_the_nearest_limit(settings_of, T, limit):
    assert margin.distance(known_of(settings_of()), vec(T)) == pytest.approx(limit, rel=1e-9)


def test_the_tilt_that_is_left(settings_of):
    assert margin.tilt_left(
        settings_of().law.limits.phi_star, Vec3(0.0, 0.0, 80.0)
    ) == pytest.approx(math.radians(45.0))
    leaning = Vec3(80.0 * math.tan(math.radians(50.0)), 0.0, 80.0)
    assert margin.tilt_left(settings_of().law.limits.phi_star, leaning) == pytest.approx(
        math.radians(-5.0)
    )


@pytest.mark.computes
def test_no_drag_leaves_the_ball_whatever_the_wind_and_the_attitude(settings_of):
    """Quadratic drag along body axes, coefficients up to the believed, winds up to the believed."""
    settings, rng = settings_of(), np.random.default_rng(2)
    guard, nearest = settings.guard, math.inf
    for _ in range(4000):
        v = rng.normal(size=3) * rng.uniform(0.0, 6.0)
        w = rng.normal(size=3)
        w *= guard.w_max / np.linalg.norm(w) * rng.uniform() ** 0.2
        if rng.uniform() < 0.5:
            w = -guard.w_max * v / np.linalg.norm(v)  # head on
        R = Rotation.random(random_state=rng).as_matrix()
        if rng.uniform() < 0.3:
            R = Rotation.align_vectors([v], [[1.0, 0.0, 0.0]])[0].as_matrix()
        c = guard.c_D * rng.uniform(size=3) if rng.uniform() < 0.5 else np.full(3, guard.c_D)
        air = R.T @ (v - w)
        against = R @ (c * np.abs(air) * air)  # what thrust has to make up for
        off = np.linalg.norm(against - np.array(margin.dragging(known_of(settings), vec(v))))
        speed = float(np.linalg.norm(v))
        room = margin.allowance(known_of(settings), vec(v), 0.0) - margin.difference(
            known_of(settings), speed
        )
        assert off <= room * (1.0 + 1e-12)
        nearest = min(nearest, room - off)
    assert nearest < 0.01  # the bound is met


@pytest.mark.parametrize("rho", [0.7, 1.0, 1.3])
def test_the_control_differences_bound_is_the_l1_norm_of_its_response(rho):
    """x_til' = -lambda x_til + z, z' = delta - rho gamma x_til: delta to z, lambda = sqrt(gamma).

    rho = m_hat/m: the constants are those of 0.7, where the bound is largest.
    """
    gamma = 1000.0
    k, w = math.sqrt(gamma), math.sqrt(rho * gamma)
    w_d = math.sqrt(w * w - 0.25 * k * k)

    def h(t):
        return math.exp(-0.5 * k * t) * (math.cos(w_d * t) + (0.5 * k / w_d) * math.sin(w_d * t))

    grid = np.linspace(0.0, 2.0, 400)
    l1 = sum(quad(lambda t: abs(h(t)), a, b)[0] for a, b in pairwise(grid)) * math.sqrt(gamma)
    peak = max(abs(h(t)) / math.exp(-0.5 * k * t) for t in np.linspace(0.0, 1.0, 20001))
    slow = quad(h, 0.0, 2.0, limit=200)[0] * math.sqrt(gamma)
    worst = pytest.approx if rho == 0.7 else lambda x, rel: AtMost(x)
    assert l1 == worst(margin.LASTS, rel=1e-6)
    assert peak == worst(margin.PEAK, rel=1e-6)
    assert slow == worst(margin.SETTLES, rel=1e-6)


@pytest.mark.parametrize(
    ("rate_hz", "at_ticks", "between"),
    [(1000.0, 1.0, 1.02), (500.0, 1.0, 1.041), (250.0, 1.0, 1.086), (100.0, 1.008, 1.239)],
)
def test_a_sampled_loop_keeps_the_bound_at_its_ticks_and_what_it_adds_between_them(
    rate_hz, at_ticks, between
):
    """Backward Euler of a disturbance whose rate is at most one, gamma = 2000, m_hat = 0.7 m.

    Between ticks the estimate stands still, and the disturbance goes on by a tick at most.
    """
    h, gamma, rho = 1.0 / rate_hz, 2000.0, 0.7
    wide = 1.0 + h * math.sqrt(gamma) + h * h * rho * gamma
    # prediction error and control difference after a tick; the disturbance's mean over it is half a tick on
    A = np.array([[1.0 / wide, h / wide], [0.0, 0.0]])
    A[1] = np.array([0.0, 1.0]) - h * rho * gamma * A[0]
    x = np.array([0.5 * h * h / wide, h - h * rho * gamma * 0.5 * h * h / wide])
    l1 = 0.0
    for _ in range(round(2.0 * rate_hz)):
        l1, x = l1 + abs(x[1]), A @ x
    bound = margin.LASTS / math.sqrt(gamma)
    assert 0.99 * at_ticks < l1 / bound <= at_ticks
    assert 0.99 * between < (l1 + h) / bound <= between


def behind_lags(rho, lam, c_theta, c_q):
    """A, B, C of m z over m, with the thrust achieved behind two lags and m_hat = rho m, which stays.

    x: v_til' + lambda v_til, v_til, and by how much attitude and rates lag behind T_0/m.  Inputs: the
    rate of drag, and that of the acceleration demanded.
    """
    gamma, k = lam * lam, 1.0 / rho - 1.0
    A = np.array(
        [
            [0.0, -gamma, 0.0, k * c_q],
            [1.0, -lam, 0.0, 0.0],
            [0.0, rho * gamma, -c_theta, 0.0],
            [0.0, 0.0, c_theta, -c_q],
        ]
    )
    B = np.array([[-1.0, 0.0], [0.0, 0.0], [0.0, rho], [0.0, 0.0]])
    return A, B, np.array([-1.0, 0.0, 1.0 - 1.0 / rho, 1.0 - 1.0 / rho])


BEHIND = [(31.6, 10.0, 20.0), (44.7, 4.7, 9.8), (60.0, 15.0, 30.0)]  # lambda, c_theta, c_q, 1/s
NOTHING = margin.Doubted(unturned=0.0, unflown=0.0, beta=0.0)


@pytest.mark.parametrize("rho", [7.0 / 9.0, 9.0 / 7.0, 1.3])
@pytest.mark.parametrize(("lam", "c_theta", "c_q"), BEHIND)
def test_what_a_change_leaves_with_a_wrong_mass_is_bounded_at_each_moment(
    settings_of, rho, lam, c_theta, c_q
):
    """The response of m z to a jump of the demand, until a thousandth of the jump is left."""
    h = 0.0005
    law = settings_of(gamma=lam * lam, c_angle=c_theta, c_rate=c_q).law._replace(h=h)
    A, B, C = behind_lags(rho, lam, c_theta, c_q)
    step, x, met, told = expm(A * h), B[:, 1], [], []
    left = margin.changed(NOTHING, margin.FORGOTTEN)
    while margin.left(left) > 0.001:
        met.append(abs(C @ x))
        told.append(margin.left(left))
        x, left = step @ x, margin.faded(law, left)
    met, told = np.array(met), np.array(told)
    assert (met <= told * (1.0 + 1e-9)).all()
    late = told < 0.1 * margin.FORGOTTEN
    assert rho > 1.0 or (met / told)[late].max() > 0.6  # not far from it
    assert (
        met > margin.PEAK * margin.FORGOTTEN * np.exp(-0.5 * lam * h * np.arange(len(met)))
    ).any()


@pytest.mark.parametrize(
    ("rho", "slow", "peak", "size", "misses"),
    [
        (0.7, 1.0 - margin.FORGOTTEN, margin.PEAK, margin.FORGOTTEN, 0.0035),  # in flight
        (0.7, 1.0, 1.0, 0.3, 0.0418),  # in a look ahead: m_hat - m, of m
        (7.0 / 9.0, 1.0, 1.0, 2.0 / 9.0, 0.0203),
    ],
)
def test_what_is_missing_of_a_change_is_as_much_as_the_readme_tells(
    settings_of, rho, slow, peak, size, misses
):
    """By how much the response of m z to a jump exceeds what is told of it, over the jump. The slowest gains."""
    h, (lam, c_theta, c_q) = 0.0005, BEHIND[1]
    law = settings_of(gamma=lam * lam, c_angle=c_theta, c_rate=c_q).law._replace(h=h)
    A, B, C = behind_lags(rho, lam, c_theta, c_q)
    step, x, left, most = expm(A * h), B[:, 1], margin.changed(NOTHING, size), 0.0
    for _ in range(6000):
        most = max(most, abs(C @ x) - margin.left(left))
        x, left = step @ x, foreseen.fading(law, left, slow, peak)
    assert most == pytest.approx(misses, abs=0.0002)


@pytest.mark.parametrize("rho", [7.0 / 9.0, 9.0 / 7.0])
def test_what_a_reference_that_jerks_leaves_with_a_wrong_mass_is_bounded(settings_of, rho):
    """From a second on, what the first jump leaves forgotten."""
    h, (lam, c_theta, c_q), rng = 0.001, BEHIND[1], np.random.default_rng(5)
    law = settings_of(gamma=lam * lam, c_angle=c_theta, c_rate=c_q).law._replace(h=h)
    A, B, C = behind_lags(rho, lam, c_theta, c_q)
    step = expm(np.block([[A, B[:, 1:]], [np.zeros((1, 5))]]) * h)
    x, jerk, left, worst = np.zeros(4), 30.0, NOTHING, 0.0
    for k in range(20_000):
        if rng.uniform() < 0.01:
            jerk = rng.choice([-30.0, 30.0])
        x = step[:4] @ np.array([*x, jerk])
        left = margin.changed(margin.faded(law, left), margin.FORGOTTEN * h * abs(jerk))
        if k * h > 1.0:
            worst = max(worst, abs(C @ x) / margin.left(left))
    assert 0.3 < worst < 1.0


def test_the_guard_counts_the_changes_of_its_reference_in_flight():
    """`unturned`, `unflown` and `beta` of a governed flight, from the a_m that it recorded."""
    tables = {
        "title": "A step.",
        "flight": {"duration_s": 3.0, "setpoints": [{"at_s": 0.0, "position_m": [4.0, 0.0, 3.0]}]},
        "law": {"guard": "govern"},
    }
    scene = scenario(from_tables("step", tables))
    _, rows = law_alone.fly(scene)[:2]
    guard, law = scene.settings.guard, scene.settings.law
    told = column(Tick, rows, "guard_state")
    a_m, names = told[:, :3], [*GuardState._fields]
    first = 2 + names.index("unturned")
    left = margin.Doubted(*told[0, first : first + 3].tolist())
    for before, now, row in zip(a_m[:-1], a_m[1:], told[1:], strict=True):
        change = margin.doubt(guard, Vec3(*(now - before).tolist()))
        left = margin.changed(margin.faded(law, left), change)
        assert row[first : first + 3] == pytest.approx(list(left), rel=1e-9, abs=1e-12)
    assert told[:, first].max() > 1.0


def test_what_the_wind_leaves_behind_the_lags_is_as_much_as_the_readme_tells(settings_of):
    """The L1 norm of the rate of drag to m z, over LASTS, with an m_hat that stays at an end of the beliefs."""
    law, h, found = settings_of(prediction="achieved").law, 0.0005, {}
    lam, c_theta, c_q = law.lambda_v, law.c_angle.y, law.c_rate.y
    for rho in (7.0 / 9.0, 1.0, 9.0 / 7.0):
        A, B, C = behind_lags(rho, lam, c_theta, c_q)
        step, x, l1 = expm(A * h), B[:, 0], 0.0
        for _ in range(8000):
            l1, x = l1 + abs(C @ x) * h, step @ x
        found[rho] = lam * l1 / margin.LASTS
    assert found[1.0] < 1.0
    assert found[9.0 / 7.0] == pytest.approx(1.81, abs=0.005)
    assert found[7.0 / 9.0] == pytest.approx(2.08, abs=0.005)


class AtMost:
    """Equal to what is no larger."""

    def __init__(self, limit):
        self.limit = limit

    def __eq__(self, other):
        return other <= self.limit


@pytest.mark.parametrize("zeta_m", [0.3, 0.5, 0.8, 0.95])
def test_what_closing_the_error_adds_is_an_l1_norm(settings_of, zeta_m):
    t, steps = np.linspace(0.0, 80.0, 400_001, retstep=True)
    w = math.sqrt(1.0 - zeta_m**2)
    h = np.exp(-zeta_m * t) * (
        2.0 * zeta_m * np.cos(w * t) + (1.0 - 2.0 * zeta_m**2) / w * np.sin(w * t)
    )
    gain = foreseen.closed(settings_of(zeta_m=zeta_m).law) * margin.LASTS / margin.SETTLES
    assert gain == pytest.approx(np.abs(h).sum() * steps, rel=1e-3)


def test_the_worse_mass_counts(settings_of):
    settings = settings_of(guard_mass_kg=[7.0, 9.0])
    up, aside = Vec3(0.0, 0.0, 11.0), Vec3(5.0, 0.0, 0.0)
    heavy, light = (settings_of(guard_mass_kg=[m, m]) for m in (9.0, 7.0))
    assert margin.room(known_of(settings), up, STILL) == margin.room(known_of(heavy), up, STILL)
    assert margin.room(known_of(settings), aside, STILL) == margin.room(
        known_of(light), aside, STILL
    )
    assert margin.room(known_of(heavy), up, STILL) < margin.room(known_of(light), up, STILL)


def test_what_is_left_of_the_start_fades_no_faster_than_it_should(settings_of):
    settings = settings_of()
    beta = start = margin.beta_1(settings.guard, settings.law, STILL)
    for _ in range(100):  # 0.2 s
        nothing_new = GuardState(*[0.0] * len(GuardState._fields))
        beta = margin.faded(settings.law, nothing_new._replace(beta=beta)).beta
    assert beta == pytest.approx(start * math.exp(-0.1 * settings.law.lambda_v), rel=0.06)
    assert beta >= start * math.exp(-0.1 * settings.law.lambda_v)
    late = settings_of(v_hat_offset=[-1.5, -1.5, -1.5])
    wrong = margin.beta_1(late.guard, late.law, STILL)
    assert wrong > start + 300.0
    assert margin.beta_1(settings.guard, settings.law, Vec3(5.0, 0.0, 0.0)) > start + 20.0


def test_the_way_to_a_setpoint_is_looked_at_in_full(settings_of):
    """A step asks most at its start; a setpoint that moves off, where it has got up to speed."""
    settings = settings_of(guard_wind_m_s=6.0)
    of_force = settings.guard._replace(lift=math.inf, lift_turns=math.inf)
    settings = settings._replace(guard=of_force)
    guard, law = settings.guard, settings.law._replace(h=0.005)
    step = Setpoint(Vec3(3.0, 0.0, 0.0), STILL, STILL, 0.0, 0.0)
    least, at, a, _ = foreseen.least(guard, law, step, STILL, STILL)
    jump, known = Vec3((1.0 + margin.FORGOTTEN) * 3.0, 0.0, 0.0), known_of(settings)
    more = foreseen.closed(law) * margin.difference(known, 0.0)
    at_once = margin.condition(known, jump, STILL, more)
    assert (
        at_once - 0.01 < least <= at_once
    )  # what the jump leaves grows by a little before it fades
    assert at < 0.05 and a == pytest.approx((3.0, 0.0, 0.0), rel=0.02)
    moving = step._replace(r_c=Vec3(-9.6, 0.0, 0.0), v_c=Vec3(6.0, 0.0, 0.0))
    _, at, _, v = foreseen.least(guard, law, moving, STILL, STILL)
    assert at > 0.5
    assert norm(v) > 3.0


def test_the_way_it_looks_along_is_the_reference_models_for_an_attitude_without_lag(settings_of):
    """And with the attitude's lag a reference model that is too fast for it overshoots."""
    step = Setpoint(Vec3(1.0, 0.0, 0.0), STILL, STILL, 0.0, 0.0)
    rows = np.zeros((8000, 8))

    def way(f_m, c_angle):
        gains = {"c_angle": Vec3(*[c_angle] * 3), "c_rate": Vec3(*[1e6] * 3)}
        settings = settings_of(f_m=f_m)
        law = settings.law._replace(h=0.001, **gains)
        foreseen.along(settings.guard, law, np.zeros(1), to_buffer(step)[None], STILL, STILL, rows)
        return rows[:, 5].copy()

    f, zeta, t = 1.0, 0.8, rows[:, 0]
    quick = way(f, 1e4)
    w_d = f * math.sqrt(1.0 - zeta**2)
    exact = f**2 / w_d * np.exp(-zeta * f * t) * np.sin(w_d * t)
    np.testing.assert_allclose(quick, exact, atol=2e-3)
    # 1 m at f_m = 3 behind a lag of 0.2 s, by SciPy's step of 9/(0.2 s^3 + s^2 + 4.8 s + 9)
    assert way(3.0, 5.0).min() == pytest.approx(-0.376, abs=0.01)
    assert way(3.0, 1e4).min() > -0.02


def test_a_script_of_setpoints_is_looked_at_as_one_way(settings_of):
    guard, law = settings_of().guard, settings_of().law._replace(h=0.01)
    there, back = (Setpoint(Vec3(x, 0.0, 0.0), STILL, STILL, 0.0, 0.0) for x in (2.0, -2.0))
    rows = np.zeros((1500, 8))
    script = np.array([to_buffer(there), to_buffer(back)])
    foreseen.along(guard, law, np.array([0.0, 7.0]), script, STILL, STILL, rows)
    first, second = rows[:700, 1], rows[700:, 1]
    assert first.min() == foreseen.least(guard, law, there, STILL, STILL)[0]
    assert second.min() < first.min()  # twice the way
    assert 7.0 <= rows[second.argmin() + 700, 0] <= 7.05
    assert np.abs(rows[-1, 5:]).max() < 0.01


@pytest.mark.computes
def test_the_condition_orders_as_it_should(settings_of):
    """More wind, less gain, more speed, more mass unknown: less margin, of force."""

    def force_alone(settings):
        return margin.known(
            settings.guard._replace(lift=math.inf, lift_turns=math.inf), settings.law
        )

    a, v = Vec3(1.0, 0.0, 0.5), Vec3(2.0, 0.0, 0.0)
    plain = margin.condition(force_alone(settings_of()), a, v, 0.0)
    assert margin.condition(force_alone(settings_of(guard_wind_m_s=13.0)), a, v, 0.0) < plain
    assert margin.condition(force_alone(settings_of(gamma=500.0)), a, v, 0.0) < plain
    assert margin.condition(force_alone(settings_of(guard_mass_kg=[6.5, 9.5])), a, v, 0.0) < plain
    assert margin.condition(force_alone(settings_of()), a, Vec3(3.0, 0.0, 0.0), 0.0) < plain
    assert margin.condition(force_alone(settings_of()), a, v, 5.0) == pytest.approx(plain - 5.0)


def test_python_and_compiled_code_give_the_same_bits(settings_of):
    settings, a, v = settings_of(), Vec3(1.0, -2.0, 0.5), Vec3(2.0, 1.0, -0.3)
    assert margin.condition.py_func(known_of(settings), a, v, 1.5) == margin.condition(
        known_of(settings), a, v, 1.5
    )


def test_how_the_reference_lags_has_nothing_to_do_with_yaw(settings_of):
    law = settings_of().law
    yaw = law._replace(
        c_angle=law.c_angle._replace(z=0.1), c_rate=law.c_rate._replace(x=law.c_rate.x, z=0.2)
    )
    assert foreseen.lags(yaw) == foreseen.lags(law)
    assert foreseen.lags(law) == pytest.approx(
        2.0 * law.zeta_m * law.f_m * (1.0 / law.c_angle.y + 1.0 / law.c_rate.y)
    )
