"""What noise and delay take: the linearised loop's word against flights, and what the guard makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from fcu.guard import margin, noise, stability, wrench
from fcu.guard.noise import NOTHING, SIGMAS, amounts, response, sums, taken
from fcu.guard.stability import Hover, fade
from fcu.kernel.algebra import Vec3, norm
from fcu.kernel.rows import column
from fcu.process.tick import Tick
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import from_tables, load
from gcs_tools.studies.attack.flight import fly
from gcs_tools.studies.attack.wind import OWN, Gust

STILL = Vec3(0.0, 0.0, 0.0)
OCTO = Hover(m=8.0, J=(0.3245, 0.3245, 0.4616))
# of the mission noisy_state: m, m/s, rad, rad/s
AMOUNTS = np.array([0.01, 0.02, math.radians(0.2), 0.01])
NOISY = dict(
    zip(
        (
            "guard_noise_position_m",
            "guard_noise_velocity_m_s",
            "guard_noise_attitude_rad",
            "guard_noise_rate_rad_s",
        ),
        AMOUNTS.tolist(),
        strict=True,
    )
)
WIND = Gust(kind=float(OWN), speed=0.0, rate=20.0, every=1.0, along=STILL)


def hover(seconds, delay_s=0.0, up=0.0, rate_hz=500, **law):
    """A scene: hover at the law's defaults, as believed; in still air, or in air that rises (m/s)."""
    return scenario(from_tables("hover", {
        "title": "Drawn.",
        "flight": {
            "duration_s": seconds, "rate_hz": rate_hz, "ground_z_m": -1e4, "arena_m": 1e4,
            "setpoints": [[0.0, 0.0, 0.0, 0.0]],
        },
        "law": {"guard": "warn", "J_hat_0": 0.3245, **law},
        "plant": {"drag": [0.15] * 3 if up else [0.0] * 3, "drag_torque": [0.0] * 3, "delay_s": delay_s},
        "wind": {"steady_m_s": [0.0, 0.0, up]},
        "expect": {},
    }))  # fmt: skip


def demanded(scene, noise, last):
    """float64[n, 6] of the last ticks of a flight: force (N, E) and torque (N m, B) demanded."""
    rows = fly(scene, WIND, noise).fcu[-last:]
    return np.hstack([column(Tick, rows, f"internals.demand.{name}") for name in ("T_0", "tau_d")])


def predicted(law, gaussian, ticks=0, **here):
    """float64[2, 2] of height and pitch: what the demand moves by, with the AMOUNTS."""
    loops = [
        stability.height(law, fade(law), 1.0, OCTO._replace(**here), ticks),
        stability.tilt(law, fade(law), 1.0, 1, OCTO._replace(**here), ticks),
    ]
    both = [sums(response(loop), gaussian)[:, : len(AMOUNTS)] * AMOUNTS for loop in loops]
    return np.array([noise.together(of, gaussian) for of in both])


def test_the_amounts_are_those_of_the_mission():
    given = load("noisy_state").plant.noise
    attitude = math.radians(given.attitude_deg)
    assert (given.position_m, given.velocity_m_s, attitude, given.rate_rad_s) == tuple(AMOUNTS)


@pytest.mark.parametrize("part", [0.1, 1.0])
@pytest.mark.parametrize("delay_s", [0.0, 0.004])
@pytest.mark.computes
def test_white_noise_moves_the_demand_as_foretold(part, delay_s):
    """Standard deviations in hover, of force along and across the thrust and of torque."""
    scene, ticks = hover(40.0, delay_s), round(delay_s * 500)
    white = np.random.default_rng(1).normal(size=(scene.ticks, 12)) * part * np.repeat(AMOUNTS, 3)
    flown = demanded(scene, white, scene.ticks // 2).std(axis=0)
    (along, _), (across, torque) = part * predicted(scene.law, True, ticks)
    np.testing.assert_allclose(flown[[2, 0, 1]], [along, across, across], rtol=0.15)
    np.testing.assert_allclose(flown[3:5], torque, rtol=0.15)


@pytest.mark.parametrize(
    "chosen",
    [
        {"gamma": 5000.0, "f_m": 3.0},
        {"gamma": 500.0, "f_m": 0.4},
        {"rate_hz": 250},
        {"up": 12.0},
    ],
    ids=str,
)
def test_white_noise_moves_the_demand_as_foretold_with_other_settings_too(chosen):
    scene = hover(40.0, **chosen)
    white = np.random.default_rng(1).normal(size=(scene.ticks, 12)) * np.repeat(AMOUNTS, 3)
    flown = demanded(scene, white, scene.ticks // 2)
    thrust = float(flown[:, 2].mean())
    assert thrust < 60.0 or "up" not in chosen
    torque = predicted(scene.law, True, T_0=thrust)[1, 1]
    np.testing.assert_allclose(flown[:, 3:5].std(axis=0), torque, rtol=0.15)


def test_noise_that_is_chosen_for_it_moves_the_demand_by_its_bound_and_no_more():
    """The bound is met by the signs of the response: nothing below it is certain."""
    scene, part = hover(20.0), 0.05
    law = scene.law
    h = response(stability.tilt(law, fade(law), 1.0, 1, OCTO)).h[:, 1]  # torque about pitch
    worst, n = np.zeros((scene.ticks, 12)), min(len(h), scene.ticks // 2)
    at = {0: 0, 1: 3, 2: 7, 3: 10}  # a noise of the channel -> its column of a report
    for i, j in at.items():
        worst[-n:, j] = part * AMOUNTS[i] * np.sign(h[n - 1 :: -1, i] if n else 0.0)
    flown = demanded(scene, worst, 1)[0, 4]
    bound = part * predicted(law, False)[1, 1]
    assert 0.9 * bound < flown < 1.02 * bound


@pytest.mark.parametrize("gaussian", [False, True])
@pytest.mark.parametrize("T", [35.0, 47.0, 88.0, 120.0, 190.0])
@pytest.mark.computes
def test_two_numbers_tell_it_at_every_thrust(settings_of, gaussian, T):
    """Torque is one number and one over the thrust; force grows from hover to full thrust, no more than straight."""
    words = "gaussian" if gaussian else "bounded"
    told = settings_of(guard_noise=words, c_angle=7.0, c_rate=14.0, **NOISY)
    guard, law = told.guard, told.law
    kept = SIGMAS if gaussian else 1.0
    for m in (guard.m_min, guard.m_max):
        J = (guard.J_tilt,) * 3
        (along, _), (across, torque) = kept * predicted(law, gaussian, m=m, J=J, T_0=T)
        assert torque <= wrench.disturbed(guard, T)
        most = max(along, across) if gaussian else math.hypot(along, across, across)
        known, W = margin.known(guard, law), guard.m_max * law.g
        chord = (T - W) / (law.limits.T_max - W) * (guard.noise_top - guard.noise_force)
        assert most <= guard.noise_force + max(chord, 0.0)
        # a demand that is inside by what is counted in hover, is inside with its own noise
        top = known.T_top - guard.noise_force
        assert top + np.interp(
            top, (W, law.limits.T_max), (guard.noise_force, guard.noise_top)
        ) <= (law.limits.T_max + 1e-9)


def test_what_is_not_believed_takes_nothing(settings_of):
    told = settings_of()
    assert taken(told.guard, told.law) == NOTHING
    assert wrench.disturbed(told.guard, 40.0) == 0.0


def test_without_noise_every_bit_is_as_without_the_belief(settings_of):
    """Room, jerk and yaw, against what they are made of."""
    told, random = settings_of(), np.random.default_rng(1)
    guard, law = told.guard, told.law
    known = margin.known(guard, law)
    assert (known.T_top, known.noise) == (guard.T_turns, 0.0)
    for _ in range(200):
        a, f_v = (Vec3(*(size * random.normal(size=3)).tolist()) for size in (8.0, 10.0))
        up = Vec3(a.x, a.y, a.z + law.g)
        demands = [m * up + f_v for m in (guard.m_min, guard.m_max)]
        apart = [margin.distance(known, T) for T in demands]
        top = guard.T_turns - max(map(norm, demands))
        assert margin.room(known, a, f_v) == min(*apart, top)
    for T in (30.0, 60.0, 90.0):
        gust, rates = wrench.FOLLOWS * guard.c_D * guard.w_max * guard.w_dot_max, []
        for m in (guard.m_min, guard.m_max):
            there = min(m * law.g, T)
            rate = there * wrench.tilting(guard, law.rotors, there) / guard.J_tilt
            rates.append((rate / wrench.turning(law) - gust) / m)
            rates.append(rate / guard.swinging / m)
        assert wrench.jerk(guard, law, T) == max(min(guard.jerk, *rates), wrench.LEAST)
        torque = law.rotors.k_Q * max(T - 8.0 * law.rotors.f_min, 0.0)
        yaw = min(law.yaw_acceleration, wrench.PART * torque / guard.J_yaw)
        assert wrench.yaw_acceleration(guard, law, T) == yaw


@pytest.mark.parametrize("words", ["bounded", "gaussian"])
@pytest.mark.computes
def test_each_noise_takes_force_and_torque_and_twice_of_it_twice(settings_of, words):
    def of(times, **chosen):
        noise = {name: times * amount for name, amount in chosen.items()}
        told = settings_of(guard_noise=words, **noise)
        return np.array(taken(told.guard, told.law))

    for name, amount in NOISY.items():
        once = of(1.0, **{name: amount})
        assert once[1] > 0.0
        np.testing.assert_allclose(of(2.0, **{name: amount}), 2.0 * once, rtol=1e-9)
    whole = of(1.0, **NOISY)
    assert np.all(whole >= of(1.0, guard_noise_velocity_m_s=0.02))


def test_the_guard_leaves_room_for_it(settings_of):
    """Less acceleration, less jerk, slower yaw; and the least of each where there is no room."""
    tenth = {name: 0.1 * amount for name, amount in NOISY.items()}
    soft = {"c_angle": 7.0, "c_rate": 14.0}
    clean, noisy, drowned = (
        settings_of(**soft),
        settings_of(**soft, **tenth),
        settings_of(**soft, **NOISY),
    )

    def of(told):
        known = margin.known(
            told.guard._replace(lift=math.inf, lift_turns=math.inf), told.law
        )  # of force
        return np.array([
            margin.condition(known, STILL, STILL, 0.0),
            wrench.jerk(told.guard, told.law, math.inf),
            wrench.yaw_acceleration(told.guard, told.law, 60.0),
            wrench.spare(told.guard, told.law),
        ])  # fmt: skip

    assert np.all(of(clean)[[0, 1, 3]] > of(noisy)[[0, 1, 3]])
    assert of(noisy)[3] > 0.0 > of(drowned)[3]
    assert of(drowned)[1] == wrench.LEAST
    assert of(clean)[2] > of(drowned)[2] > 0.0
    assert of(clean)[0] - of(noisy)[0] == pytest.approx(noisy.guard.noise_force)


def test_a_loop_that_does_not_settle_leaves_nothing(settings_of):
    told = settings_of(f_m=7.5, **NOISY)
    assert stability.unstable(*told) != ""
    assert told.guard.noise_force == noise.ENDLESS
    assert wrench.jerk(told.guard, told.law, math.inf) == wrench.LEAST


def test_probability_is_the_union_over_ticks_rotors_and_force():
    def of(sigmas):
        return 16.0 * stats.norm.sf(sigmas) + stats.chi(3).sf(sigmas)

    for sigmas in (2.0, 4.0, SIGMAS):
        assert noise.beyond(8, sigmas) == pytest.approx(of(sigmas), rel=1e-6)


def test_a_loop_that_hardly_settles_takes_no_longer_to_work_out(settings_of, monkeypatch):
    """What is not computed of its response goes on as its slowest mode: rather too much than too little."""
    params = settings_of(trim_rate=0.05).law
    loop = stability.height(params, fade(params), 1.0, OCTO)
    cut = response(loop)
    assert len(cut.h) == 2**noise.LONGEST + 1
    monkeypatch.setattr(noise, "LONGEST", 18)
    whole = response(loop)
    assert len(whole.h) > 4 * len(cut.h)
    for gaussian in (False, True):
        few, all_of_it = sums(cut, gaussian), sums(whole, gaussian)
        assert (few >= 0.99 * all_of_it).all() and (few <= 1.15 * all_of_it).all()


def test_of_the_printed_law_noise_takes_nothing_that_is_known(settings_of):
    printed = settings_of(prediction="demanded", **NOISY)
    assert amounts(printed.guard).any()
    assert taken(printed.guard, printed.law) == NOTHING


def test_noise_turns_about_roll_by_the_gains_of_roll(settings_of):
    """Of a law with other gains about roll than about pitch the two torques differ."""
    told = settings_of(**NOISY)
    law = told.law
    c_angle, c_rate = law.c_angle, law.c_rate
    soft = law._replace(
        c_angle=c_angle._replace(x=0.5 * c_angle.x), c_rate=c_rate._replace(x=0.5 * c_rate.x)
    )
    both, one = (noise._of(told.guard, each, 8.0, 8.0, 80.0) for each in (law, soft))
    assert both.torque[0] == pytest.approx(both.torque[1])
    assert one.torque[0] < 0.8 * one.torque[1]
    assert one.torque[1] == pytest.approx(both.torque[1])
