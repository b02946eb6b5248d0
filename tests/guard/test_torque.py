"""What torque a jerk of the reference asks for, and flights that asked for more than there was."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import fcu
from fcu.guard import governor, margin, stability, torque, wrench
from fcu.guard.stability import INPUTS, LAGS, Hover
from fcu.interface.airframe import airframe, load
from fcu.kernel.algebra import Vec3, dot, norm
from fcu.kernel.rows import column
from fcu.process.settings import settings
from fcu.process.tick import Tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import scenario
from gcs_tools.gusts.limits import outputs, torque_room
from gcs_tools.missions.mission import from_tables
from gcs_tools.studies.attack.draws import How, Numbers, attack
from gcs_tools.studies.attack.flight import fly
from gcs_tools.studies.attack.verdict import verdict

SOFT = {"c_angle": 7.0, "c_rate": 14.0, "f_m": 2.0, "gamma": 2000.0}
STILL = Vec3(0.0, 0.0, 0.0)


def pitch(told, part=1.0, off=1.0, off_J=1.0):
    """The matrix of pitch of the least mass, with a part of the believed lag and estimates that are off."""
    law, guard = told.law, told.guard
    here = Hover(m=guard.m_min, J=(guard.J_tilt,) * 3)
    return stability.tilt(law, stability.fade(law, part), off, 1, here, 0, off_J), here


def test_a_jerk_that_is_timed_for_it_asks_for_the_norm_and_no_other_for_more(settings_of):
    """Through the matrix itself, tick by tick."""
    told = settings_of(**SOFT)
    law = told.law
    loop, here = pitch(told, max(LAGS))
    bound = torque.norm(law, loop, here, 1)
    step = torque.stepped(loop, INPUTS.index("reference")).h[:, 1]
    worst, random = -np.sign(step[::-1]), np.random.default_rng(1)
    for jerk, low, high in ((worst, 0.99, 1.0), (random.choice([-1.0, 1.0], len(step)), 0.0, 0.7)):
        x, a_m, most = np.zeros(len(loop.A)), 0.0, 0.0
        for j in jerk:
            a_m += law.h * j
            most = max(most, abs(float(loop.C[1] @ x + loop.D[1, -1] * a_m)))
            x = loop.A @ x + loop.B[:, -1] * a_m
        asked = (
            most * law.g / here.J[1]
        )  # over the rate 1/g at which a jerk of one turns the demand
        assert low * bound <= asked <= high * bound * (1.0 + 1e-6)


@pytest.mark.parametrize(
    "gains",
    [SOFT, {**SOFT, "c_angle": 12.0, "c_rate": 28.0}, {}, {**SOFT, "rate_hz": 250.0}],
    ids=str,
)
def test_between_the_ends_of_what_is_believed_nothing_asks_for_more(settings_of, gains):
    told = settings_of(**gains)
    guard, wide = told.guard, told.guard.m_max / told.guard.m_min
    for part in np.linspace(*LAGS, 7):
        for off in np.linspace(1.0 / wide, wide, 5):
            loop, here = pitch(told, float(part), float(off))
            assert torque.norm(told.law, loop, here, 1) <= guard.swinging * (1.0 + 1e-9)
    assert guard.swinging > 1.4 * wrench.turning(told.law)


def test_what_is_believed_by_default_keeps_its_jerk_and_less_wind_gives_less_of_it(settings_of):
    """The gust's torque is not given away whole where none is believed."""
    windy, calm = settings_of(**SOFT), settings_of(**SOFT, guard_wind_m_s=0.0)
    assert wrench.jerk(windy.guard, windy.law, math.inf) == pytest.approx(7.94, abs=0.01)
    law, guard = calm
    j, m = wrench.jerk(guard, law, math.inf), guard.m_min
    asked = guard.J_tilt * guard.swinging * m * j / (m * law.g)
    assert asked == pytest.approx(wrench.tilting(guard, law.rotors, m * law.g))
    assert guard.J_tilt * wrench.turning(law) * j / law.g < 0.6 * asked


def test_a_mass_that_is_known_asks_for_less(settings_of):
    def of(**chosen):
        return settings_of(**SOFT, **chosen).guard.swinging

    assert of(guard_mass_kg=[7.9, 8.0]) < of()


def test_gains_that_do_not_settle_with_the_greatest_lag_have_no_jerk_and_are_refused(settings_of):
    told = settings_of(
        c_angle=11.8, c_rate=19.5, f_m=2.74, zeta_m=1.2, gamma=599.0, guard_wind_m_s=0.2
    )
    law, guard = told
    here = stability.hover_of(guard)
    pitched = stability.tilt(law, stability.fade(law), guard.heavier, 1, here, off_J=1.0)
    late = stability.tilt(law, stability.fade(law, max(LAGS)), guard.heavier, 1, here, off_J=1.0)
    radii = [np.abs(np.linalg.eigvals(loop.A)).max() for loop in (pitched, late)]
    assert radii[0] < 1.0 < radii[1]
    assert stability.unstable(law, guard) == "pitch"
    assert guard.swinging == torque.ENDLESS
    assert wrench.jerk(guard, law, math.inf) == wrench.LEAST
    assert wrench.spare(guard, law) < 0.0


def test_the_greatest_thrust_leaves_torque_for_the_least_jerk(settings_of):
    law, guard = settings_of(**SOFT)
    assert guard.m_max * law.g < guard.T_turns < law.limits.T_max
    least = guard.m_max * wrench.LEAST
    assert wrench.held(guard, law, guard.T_turns) == pytest.approx(least, rel=1e-4)
    assert wrench.held(guard, law, guard.T_turns + 1.0) < least
    known = margin.known(guard, law)
    up = (guard.T_turns + 0.1) / guard.m_max - law.g
    assert -0.11 < margin.room(known, Vec3(0.0, 0.0, up), STILL) < -0.09


def test_near_full_thrust_and_while_it_falls_less_turns(settings_of):
    law, guard = settings_of(**SOFT)
    j, hover = wrench.jerk(guard, law, math.inf), guard.m_min * law.g

    def across(T, rising=0.0):
        return wrench.jerk_across(guard, law, T, j, rising)

    assert across(hover) == across(1.5 * hover) == j
    assert j >= across(140.0) > across(160.0) > across(guard.T_turns)
    assert across(guard.T_turns) == pytest.approx(wrench.LEAST, rel=1e-3)
    assert across(hover, -j) < across(hover, -0.3 * j) < j


def test_a_change_is_cut_across_the_demand_alone():
    up, change = Vec3(1.0, 0.0, 9.0), Vec3(3.0, 2.0, 1.0)
    along, n = dot(change, up) / norm(up), (1.0 / norm(up)) * up
    cut = wrench.turned_to(change, up, 100.0, 0.5)
    assert dot(cut, n) == pytest.approx(along)
    assert norm(cut - along * n) == pytest.approx(0.5)
    assert wrench.turned_to(change, up, 100.0, 100.0) == change
    short = wrench.turned_to(change, up, 1.0, 100.0)  # of a long one the direction is kept
    assert short == pytest.approx((1.0 / norm(change)) * change)
    assert wrench.turned_to(change, up, 1.0, 1.0) == short
    assert wrench.turned_to(change, up, math.inf, math.inf) == change


# --- flights that an optimiser, and others who looked for them, found


FOUND = (
    # points every 0.2 s or so, rotors of 79 ms: it was lost
    {
        "f_m": 0.9787033028516935,
        "zeta_m": 0.9869548016131088,
        "gamma": 0.8730488431537592,
        "c_angle": 0.8805150589303876,
        "c_rate": 0.8313136786535934,
        "believed_wind": 0.04032313943260879,
        "J_hat_0": 0.5463209471382564,
        "m_hat_0": 0.024693386190035083,
        "rate": 0.5730064348313921,
        "heading": 0.04549315968774026,
        "mass": 0.5581419296883284,
        "J_x": 0.7478959716185256,
        "J_y": 0.4268070483437152,
        "J_z": 0.21165578262831763,
        "drag_x": 0.6007197658714818,
        "drag_y": 0.3956962917251502,
        "drag_z": 0.658218250007849,
        "lag": 0.989550917049164,
        "wind": 0.14163150812496283,
        "wind_speed": 0.3095459218574496,
        "wind_every": 0.1539288147932079,
        "wind_share": 0.44517431705281824,
        "wind_height": 0.49862575891955985,
        "wind_azimuth": 0.2794776998931421,
        "setpoints": 0.9297322051127946,
        "height": 0.6518404108615043,
        "azimuth": 0.49899584101092664,
        "far": 0.07436204331525958,
        "speed": 0.06170032573956402,
        "every": 0.1217709000262992,
        "times": 0.4930257880380533,
        "yaw_steps": 0.5822518207490348,
        "yaw": 0.547596319478364,
        "seed": 0.08177256744294625,
    },
    # a point on a circle, no wind believed to speak of, rotors of 70 ms: 12 N of room were missing
    {
        "f_m": 0.8493875158634211,
        "zeta_m": 0.44981482647494586,
        "gamma": 0.8268928727111114,
        "c_angle": 0.23835415965972162,
        "c_rate": 0.003864002215728024,
        "believed_wind": 0.0015398732584525066,
        "J_hat_0": 0.39685914085312407,
        "m_hat_0": 0.6797126271029421,
        "rate": 0.7078094441734896,
        "heading": 0.8803689485873578,
        "mass": 0.8915456237862087,
        "J_x": 0.8614718096235932,
        "J_y": 0.7619736785233466,
        "J_z": 0.9387303600523583,
        "drag_x": 0.33388496967965114,
        "drag_y": 0.20713444126435954,
        "drag_z": 0.049196146622993486,
        "lag": 0.8313017700403369,
        "wind": 0.815948667659766,
        "wind_speed": 0.11939599854938532,
        "wind_every": 0.3092868124684968,
        "wind_share": 0.5066210642216917,
        "wind_height": 0.7900019802505742,
        "wind_azimuth": 0.3776352953662847,
        "setpoints": 0.7613089463851068,
        "height": 0.27527879782562564,
        "azimuth": 0.4585840949363483,
        "far": 0.7598746837949538,
        "speed": 0.9156403621465385,
        "every": 0.16903171284234303,
        "times": 0.7621051491475865,
        "yaw_steps": 0.6199011269710544,
        "yaw": 0.9484159722437696,
        "seed": 0.7896962947264181,
    },
)


@pytest.mark.parametrize("numbers", FOUND, ids=["points", "circle"])
def test_high_gains_slow_rotors_and_little_wind_saturate_nothing(numbers):
    chosen = attack(Numbers(**numbers), How(policy="govern"))
    said = verdict(chosen, fly(chosen.scene, chosen.gust, chosen.noise))
    assert not (said.force or said.torque or said.lost)
    assert said.arrived


def flown(tables):
    """Whether thrust or tilt, and torque, saturated after 1 s."""
    scene = scenario(from_tables("found", {"title": "Found.", **tables}))
    _, rows = law_alone.fly(scene)
    assert len(rows) == scene.ticks
    up = {
        name: bool(column(Tick, rows, f"outputs.saturation.{name}")[round(scene.rate_hz) :].any())
        for name in ("thrust", "tilt", "torque")
    }
    return up


NOTHING = {"thrust": False, "tilt": False, "torque": False}
FAR = {"ground_z_m": -1e4, "arena_m": 1e4}


def test_a_climb_that_turns_aside_saturates_nothing():
    """At 195 N 1 N m is left of 17; the demand turned as fast as in hover."""
    setpoints = [[0.0, 0.0, 0.0, 0.0], [2.0, 8.0, -1.6, 58.0], [2.75, 14.0, -11.0, 63.0]]
    assert flown({
        "flight": {"duration_s": 20.0, **FAR, "setpoints": setpoints},
        "law": {"guard_wind_m_s": 0.0},
        "plant": {"mass_kg": 9.0},
    }) == NOTHING  # fmt: skip


def test_reversals_where_no_gust_is_believed_saturate_nothing():
    """The jerk took all of the torque: nothing was left for what closes the tracking error."""
    to, every = (5.678, 3.979, -0.306), 0.3037
    setpoints = [[0.0, 0.0, 0.0, 0.0]]
    setpoints += [[2.0 + every * k, *((-1.0) ** (k + 1) * x for x in to)] for k in range(18)]
    masses = [11.0, 14.3]
    assert flown({
        "flight": {"duration_s": 12.0, "rate_hz": 400, **FAR, "setpoints": setpoints},
        "law": {
            "guard_mass_kg": masses, "bounds": {"m_min": masses[0], "m_max": masses[1]},
            "m_hat_0": 14.3, "guard_wind_m_s": 0.0, "f_m": 1.15, "zeta_m": 1.266, "gamma": 742.0,
            "c_angle": [4.33, 4.33, 1.66], "c_rate": [12.3, 12.3, 2.08], "J_hat_0": 0.284,
        },
        "plant": {"mass_kg": 12.66, "inertia_kg_m2": [0.313, 0.361, 0.519], "drag": [0.12, 0.15, 0.14]},
    }) == NOTHING  # fmt: skip


# --- at speed, in level air


def shipped(name):
    """The law's parameters and the guard's of an airframe file, at 500 Hz."""
    tables = load(Path(fcu.__file__).with_name("airframes") / f"{name}.toml")
    return settings(airframe(tables["rotors"], name), tables, 500.0, {})


def test_a_hexacopter_flies_no_faster_than_leaves_torque_for_a_gust_along_the_way():
    """At the 5 m/s of before a computed wind asked for torque that 1.3 N more of thrust would hold."""
    law, guard = shipped("hexa")
    assert guard.lean_turns < margin.leant(guard, law)
    top, _ = governor.speeds(margin.known(guard, law))
    for faster, low, high in ((0.0, 0.97, 1.0), (0.06, 1.0, 1.03)):
        asked, holds = torque.for_gust(guard, law, guard.w_max + top + faster)
        assert low < asked / holds <= high
    free, _ = governor.speeds(margin.known(guard._replace(lean_turns=math.inf), law))
    assert 3.8 < top < free - 0.9


@pytest.mark.parametrize("name", ["quad", "racer", "s1000", "x8"])
def test_other_vehicles_are_as_fast_as_their_force_lets_them(name):
    law, guard = shipped(name)
    free = guard._replace(lean_turns=math.inf)
    assert governor.speeds(margin.known(guard, law)) == governor.speeds(margin.known(free, law))


def test_a_vehicle_that_leans_is_in_balance_and_a_gust_turns_its_drag_as_counted():
    law, guard = shipped("hexa")
    m, c, u = guard.m_min, guard.c_D, guard.w_max + 4.0
    T, side, gusts = torque.leaning(guard, law, u)
    cosine = T / (m * law.g)  # the drag lies across the thrust, which carries what is left
    sine = math.sqrt(1.0 - cosine * cosine)
    across = c * (u * cosine) ** 2
    assert T * sine == pytest.approx(across * cosine)  # level
    assert T * cosine + across * sine == pytest.approx(m * law.g)  # upright

    def aside(more):
        """Force along the thrust's normal of before, tilted by so much more."""
        lean = math.asin(sine) + more
        along = c * (u * math.cos(lean)) ** 2
        return T * math.sin(more) - along * math.cos(more) + across

    assert aside(1e-6) / 1e-6 == pytest.approx(side, rel=1e-4)
    after = c * ((u + 1e-6) * cosine) ** 2
    # of a gust along the way, the part across the thrust
    assert (after - across) / 1e-6 == pytest.approx(gusts, rel=1e-4)


def test_where_a_gust_takes_nothing_a_vehicle_is_as_fast_as_a_tilt_steers(settings_of):
    for told in (settings_of(**SOFT, guard_wind_rate_m_s2=0.1), settings_of(prediction="demanded")):
        assert told.guard.lean_turns == margin.leant(told.guard, told.law)
    told = settings_of(**SOFT, guard_wind_rate_m_s2=60.0)
    top, _ = governor.speeds(margin.known(told.guard, told.law))
    assert top == pytest.approx(governor.SLOWEST, abs=1e-9)


# --- on the way down


def sinking(told, speed):
    """Torque (N m) that a gust asks for at most, and that thrust holds, sinking into the greatest updraft."""
    law, guard = told.law, told.guard
    u = guard.w_max + speed
    here = stability.hover_of(guard)._replace(
        m=guard.m_min,
        J=(guard.J_tilt,) * 3,
        T_0=guard.m_min * law.g - guard.c_D * u * u,
        turns=True,
    )
    loop = stability.tilt(law, stability.fade(law, max(LAGS)), 1.0, 1, here)
    gust = guard.c_D * u * guard.w_dot_max / guard.m_min
    left = here.T_0 - law.rotors.W * law.rotors.f_min
    return gust * torque.per_gust(law, loop), left / torque.least_per_torque(law.rotors)


def test_the_greatest_speed_downwards_is_where_a_gust_takes_what_is_counted_on(settings_of):
    told = settings_of(**SOFT)
    assert told.guard.lift_turns < told.guard.lift
    down = margin.sinking(margin.known(told.guard, told.law))
    assert down == pytest.approx(1.37, abs=0.01)
    asked, holds = sinking(told, down)
    assert 0.97 < asked / (torque.NOT_REACHED * holds) <= 1.0
    beyond, left = sinking(told, down + 0.05)
    assert beyond > torque.NOT_REACHED * left


def torques(law, loop, a):
    """N m, of each tick, through the matrix: of drag that accelerates with a, m/s^2."""
    pushed = np.zeros(len(loop.A))
    pushed[:2] = 0.5 * law.h**2, law.h
    x, found = np.zeros(len(loop.A)), []
    for each in a:
        found.append(float(loop.C[1] @ x))
        x = loop.A @ x + pushed * each
    return np.array(found)


def test_a_gust_that_is_timed_for_it_asks_for_no_more_than_is_counted(settings_of):
    """Through the matrix, tick by tick: drag whose acceleration changes with 1 m/s^3."""
    told = settings_of(**SOFT)
    law, (loop, _) = told.law, pitch(told, max(LAGS))
    n, bound = 2000, torque.per_gust(law, loop)
    step = torques(law, loop, np.ones(n))
    step -= step[-1]
    worst = np.cumsum(-np.sign(step[::-1])) * law.h
    assert 0.99 * bound < np.abs(torques(law, loop, worst)).max() <= bound * (1.0 + 1e-6)
    random = np.cumsum(np.random.default_rng(1).choice([-1.0, 1.0], n)) * law.h
    assert np.abs(torques(law, loop, random)).max() < 0.6 * bound


def test_a_gust_that_has_little_to_swing_by_asks_for_less(settings_of):
    """Drag within 1 m/s^2: at a low rate that binds nothing, at a high one it is all that counts."""
    told = settings_of(**SOFT)
    law, (loop, _) = told.law, pitch(told, max(LAGS))
    assert torque.per_swing(law, loop, 0.1) == pytest.approx(0.1 * torque.per_gust(law, loop))
    each = np.diff(torques(law, loop, np.ones(2000)))
    wanted, most, plain = np.sign(each[::-1]), [], torque.per_gust(law, loop)
    for rate, part in ((2.0, 1.0), (10.0, 1.0), (50.0, 0.5), (1e6, 1e-3)):
        a = [0.0]
        for to in wanted:
            a.append(a[-1] + max(-rate * law.h, min(rate * law.h, to - a[-1])))
        bound = torque.per_swing(law, loop, rate)
        most.append(np.abs(torques(law, loop, a)).max() / bound)
        assert bound <= part * rate * plain
    assert max(most) <= 1.0 + 1e-6
    assert most[-1] > 0.98


def test_where_a_gust_takes_nothing_a_vehicle_sinks_as_a_tilt_steers(settings_of):
    for told in (settings_of(**SOFT, guard_wind_rate_m_s2=0.1), settings_of(prediction="demanded")):
        assert told.guard.lift_turns == told.guard.lift


def test_a_vehicle_always_sinks_at_one_metre_a_second(settings_of):
    """However fast the wind is believed to change."""
    told = settings_of(**SOFT, guard_wind_rate_m_s2=60.0)
    assert margin.sinking(margin.known(told.guard, told.law)) == pytest.approx(1.0, abs=1e-9)


def test_a_long_descent_in_air_that_turns_in_a_vertical_plane_keeps_its_torque():
    """Forty metres down at 7 kg with a drag of 0.15, in 12 m/s that turn by a radian in 0.61 s."""
    least = np.inf
    for phase in np.linspace(0.0, 2.0 * math.pi, 4, endpoint=False):
        scene = scenario(from_tables("turning.toml", {
            "title": "Down.",
            "flight": {
                "duration_s": 40.0, "ground_z_m": -1e3, "arena_m": 1e3,
                "setpoints": [[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, -40.0]],
            },
            "law": {},
            "plant": {"mass_kg": 7.0, "drag": [0.15, 0.15, 0.15]},
            "wind": {
                "amplitude_m_s": [12.0, 0.0, 12.0], "frequency_rad_s": [1.64, 0.0, 1.64],
                "phase_rad": [float(phase), 0.0, float(phase) + 0.5 * math.pi],
            },
            "expect": {},
        }))  # fmt: skip
        ticks, rows = law_alone.fly(scene)
        assert len(rows) == scene.ticks
        least = min(least, float(torque_room(scene, outputs(rows))[500:].min()))
        assert not column(Tick, rows, "outputs.saturation.torque")[500:].any()
        assert np.abs(column(Tick, rows, "measured.r_E")[-500:] - [0.0, 0.0, -40.0]).max() < 0.3
    assert least > 3.0
