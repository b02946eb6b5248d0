"""A tilt in a wind from below: where it steers no more, what is kept of that, and flights down there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.guard import (
    admission,
    arrival,
    foreseen,
    governor,
    margin,
    present,
    stability,
    wrench,
)
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import column
from fcu.process.settings import Settings
from fcu.process.tick import Tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.run import prepared
from gcs_tools.flight.scenario import Scenario

STILL = Vec3(0.0, 0.0, 0.0)
SHIPPED = ()
SECTION_VIII = ("law.f_m=1.0", "law.gamma=1000.0", "law.c_angle=10", "law.c_rate=20")
DOWN = [10.0, 0.0, -120.0]
LIGHT = ("plant.mass_kg=7", "law.m_hat_0=7")
KNOWN = (*LIGHT, "law.bounds.m_min=6.99", "law.bounds.m_max=7.01")


def rising(
    speed: float, to: list[float], duration_s: float, *more: str, level: float = 0.0
) -> Scenario:
    """A setpoint in air that does nothing but rise, or moves level (m/s to East) besides."""
    return prepared(
        "urban_step",
        [
            "wind.amplitude_m_s=[0,0,0]",
            "wind.rotation_amplitude_rad_s=[0,0,0]",
            f"wind.steady_m_s=[{level},0,{speed}]",
            f"flight.setpoints=[{{at_s=0.0,position_m={to}}}]",
            f"flight.duration_s={duration_s}",
            *more,
        ],
    )[1]


def loose(scene: Scenario) -> Settings:
    """Its settings, with tilts that are taken to steer almost whatever the drag."""
    most = stability.CARRIED * 7.0 * scene.law.g
    guard = scene.guard._replace(lift=most, lift_turns=most, lean_turns=math.inf)
    return scene.settings._replace(guard=guard)


def late(scene: Scenario) -> float:
    """m, aside, in the last part of a flight; inf if it ended before its time."""
    ticks, rows = law_alone.fly(scene)
    if len(rows) < scene.ticks:
        return math.inf
    return float(np.abs(column(Tick, rows, "measured.r_E")[-1000:, 0] - 0.05).max())


@pytest.mark.parametrize(
    ("gains", "steady", "lost"), [(SHIPPED, 16.0, 17.0), (SECTION_VIII, 14.0, 15.5)]
)
def test_hover_in_air_that_rises_is_lost_where_the_matrix_says(gains, steady, lost):
    """The tilt's matrix with a drag that turns with the body, against flights of a step of 5 cm."""
    for speed, flies in ((steady, True), (lost, False)):
        scene = rising(speed, [0.05, 0.0, 0.0], 30.0, *KNOWN, 'law.guard="warn"', *gains)
        T_0 = 7.0 * 9.81 - max(scene.world.params.c_D) * speed**2
        here = stability.hover_of(scene.guard)._replace(m=7.0, T_0=T_0, turns=True)
        loop = stability.tilt(scene.law, stability.fade(scene.law), 1.0, 1, here)
        assert bool(np.abs(np.linalg.eigvals(loop.A)).max() < 1.0) is flies, speed
        assert (late(scene) < 1e-4) is flies, speed


def test_what_is_kept_has_the_gain_margin(settings_of):
    """At the lift that is told the loop holds 3 dB more gain; with a little more drag it does not."""
    law, guard = settings_of()
    assert guard.lift == stability.lift(law, guard)
    m, weight = guard.m_min, guard.m_min * law.g
    for drag, stable in ((guard.lift, True), (guard.lift + 0.005 * weight, False)):
        here = stability.hover_of(guard)._replace(m=m, T_0=weight - drag, turns=True)
        loop = stability.tilt(law, stability.fade(law), math.sqrt(2.0), 1, here)
        assert bool(np.abs(np.linalg.eigvals(loop.A)).max() < 1.0) is stable


def test_the_condition_ends_where_sinking_does(settings_of):
    """At rest in force there is room left: what fails is the tilt."""
    law, guard = settings_of()
    known = margin.known(guard, law)
    down = margin.sinking(known)
    assert 0.5 < down < 12.0
    at, below = Vec3(0.0, 0.0, -down), Vec3(0.0, 0.0, -1.01 * down)
    assert margin.steering(known, at) == pytest.approx(0.0, abs=1e-9)
    assert margin.steering(known, below) < 0.0 < margin.steering(known, Vec3(0.0, 0.0, 3.0))
    easy = known._replace(T_z_min=0.0, T_min=0.0, sin=1.0, cos=0.0, z_0=0.0, z_1=0.0)
    still = Vec3(0.0, 0.0, 0.0)
    assert margin.condition(easy, still, below, 0.0) == margin.steering(easy, below)


STIFF = ("law.c_angle=10", "law.c_rate=20")


@pytest.mark.parametrize("gains", [SHIPPED, SECTION_VIII, STIFF])
@pytest.mark.computes
def test_a_long_way_down_in_the_strongest_wind_from_below_arrives(gains):
    """With angles and rates as in Section VIII the vehicle was lost 80 m down."""
    scene = rising(
        12.0,
        DOWN,
        130.0,
        *LIGHT,
        "flight.ground_z_m=-1000",
        "flight.arena_m=1000",
        *gains,
    )
    ticks, rows = law_alone.fly(scene)
    assert len(rows) == scene.ticks
    off = column(Tick, rows, "measured.r_E")[-1000:] - np.array(DOWN)
    assert np.abs(off).max() < 0.3
    if gains == STIFF:  # and without the condition on it
        ticks, rows_loose = law_alone.fly(replace(scene, settings=loose(scene)))
        assert len(rows_loose) < scene.ticks or (
            np.abs(column(Tick, rows_loose, "measured.r_E")[-1] - np.array(DOWN)).max() > 5.0
        )
    known = margin.known(scene.guard, scene.law)
    fastest = -column(Tick, rows, "outputs.reference.v_m")[:, 2].min()
    assert 0.9 * max(margin.sinking(known), 1.0) < fastest < max(margin.sinking(known), 1.0) + 0.01
    assert column(Tick, rows, "guard.margin.condition")[1000:].min() > -0.2


def test_of_the_printed_law_nothing_is_known(settings_of):
    law, guard = settings_of(prediction="demanded")
    assert guard.lift == pytest.approx(guard.m_min * law.g)


def tilted_pull(u, c, T):
    """Sideways force of a tilt (N/rad) about the second axis, by differences: thrust, and drag along body axes."""

    def aside(angle):
        turned = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
        air = turned.T @ u
        return (turned @ (np.array([0.0, 0.0, T]) + c * np.abs(air) * air))[0]

    return (aside(1e-6) - aside(-1e-6)) / 2e-6


@pytest.mark.computes
def test_no_air_and_no_drag_raises_the_gain_of_a_tilt_by_more_than_is_counted(settings_of):
    """Trimmed in air from anywhere, whatever the coefficients: from below, and where it leans into it."""
    rng, settings = np.random.default_rng(6), settings_of(c_angle=7.0, c_rate=14.0, f_m=2.0)
    known, lift = known_of(settings), settings.guard.lift
    weight = known.m_min * known.g
    gain = weight / (weight - lift)
    nearest = 0.0
    for _ in range(20_000):
        u = rng.normal(size=3)
        u *= math.sqrt(known.lean / known.c_D) / np.linalg.norm(u) * rng.uniform() ** 0.2
        c = known.c_D * rng.integers(0, 2, size=3)
        if known.c_D * max(u[2], 0.0) ** 2 > known.lift:
            continue  # air from below has a bound of its own
        lean = math.asin(min(c[0] * u[0] * u[0] / weight, 0.99))  # of the thrust, against the drag
        T = max(weight * math.cos(lean) - c[2] * abs(u[2]) * u[2], 1.0)
        nearest = max(nearest, tilted_pull(u, c, T) / T / gain)
    assert 0.8 < nearest <= 1.0


def known_of(settings):
    return margin.known(settings.guard, settings.law)


QUICK = ("law.f_m=3.89", "law.zeta_m=1.09", "law.gamma=561", "law.c_angle=11.6", "law.c_rate=28.1")


@pytest.mark.computes
def test_a_climb_into_the_wind_with_drag_along_two_axes_is_not_lost():
    """In level air past a vehicle that climbs the gain of a tilt grows too: without that it was lost."""
    climb = [350.0, 0.0, 191.0]
    gains = (*QUICK, "law.guard_wind_m_s=6", "plant.drag=[0.15,0.15,0.0]")
    wind = ("flight.ground_z_m=-1000", "flight.arena_m=1000")
    scene = rising(-2.8, climb, 80.0, *LIGHT, *gains, *wind, level=-5.3)
    ticks, rows = law_alone.fly(scene)
    assert len(rows) == scene.ticks
    for limit in ("thrust", "tilt", "torque"):
        assert not column(Tick, rows, f"outputs.saturation.{limit}")[500:].any(), limit
    ticks, rows = law_alone.fly(replace(scene, settings=loose(scene)))
    assert column(Tick, rows, "outputs.saturation.torque")[500:].any() or len(rows) < scene.ticks


@pytest.mark.parametrize("a_c", [-1.0, -2.0])
@pytest.mark.computes
def test_an_acceleration_that_is_fed_forward_leads_to_no_more_than_the_greatest_speeds(
    a_c, settings_of
):
    """The reference alone, in the strongest updraft, where it has the least jerk."""
    guard, law = settings_of(c_angle=7.0, c_rate=14.0, f_m=2.0, gamma=2000.0)[::-1]
    known, j, v, a = margin.known(guard, law), wrench.LEAST, 0.0, 0.0
    cap, deepest = margin.sinking(known), 0.0
    far = Setpoint(Vec3(0.0, 0.0, -500.0), STILL, Vec3(0.0, 0.0, a_c), 0.0, 0.0)
    for _ in range(round(20.0 / law.h)):
        wanted = governor.wanted(law, known, far, STILL, Vec3(0.0, 0.0, v), j).z
        a += min(max(wanted - a, -j * law.h), j * law.h)
        v += law.h * a
        deepest = min(deepest, v)
    assert -1.03 * cap < deepest < -0.9 * cap


@pytest.mark.parametrize(
    ("changed", "delay_s"), [({"gamma_LambdaJ": 0.0, "J_hat_0": 0.284}, 0.0), ({}, 0.006)]
)
def test_a_delay_and_an_inertia_that_is_not_learnt_leave_less(settings_of, changed, delay_s):
    soft = {"c_angle": 7.0, "c_rate": 14.0, "f_m": 2.0, "gamma": 2000.0}
    plain, less = settings_of(**soft), settings_of(**soft, **changed, guard_delay_s=delay_s)
    assert 0.0 < less.guard.lift < plain.guard.lift - 1.0


def test_roll_counts_as_pitch_does(settings_of):
    soft = settings_of(c_angle=(7.0, 7.0, 3.0), c_rate=(14.0, 14.0, 6.0)).guard.lift
    assert settings_of(c_angle=(10.0, 7.0, 3.0), c_rate=(14.0, 14.0, 6.0)).guard.lift < soft - 1.0


def test_what_is_demanded_now_admits_nothing_that_a_tilt_does_not_steer(settings_of):
    """A way down in still air, looked along with the present told: force has room, tilts do not."""
    law, guard = settings_of(guard="refuse", c_angle=7.0, c_rate=14.0, f_m=0.4, gamma=2000.0)
    now = present.Present(
        T_0=Vec3(0.0, 0.0, 7.0 * law.g), a_d=STILL, r=STILL, v=STILL, up=Vec3(0.0, 0.0, 1.0), psi=0.0,
        unturned=0.0, unflown=0.0, beta=0.0, told=1.0,
    )  # fmt: skip
    since = present.begun(law, now, STILL, STILL)
    known = margin.known(guard, law)
    sinks = Vec3(0.0, 0.0, -1.2 * margin.sinking(known))
    adds = foreseen.closed(law)
    found = present.condition(guard, law, known, now, since, sinks, 0.0, 1.0, adds)
    assert found == margin.steering(known, sinks) < 0.0


def test_a_way_down_takes_longer_and_plans_keep_to_it(settings_of):
    told = settings_of(c_angle=9.0, c_rate=18.0, f_m=2.0, gamma=2000.0)
    law, guard = told
    known = margin.known(guard, law)
    level = arrival.at_most_s(guard, law, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    down = arrival.at_most_s(guard, law, 20.0, 0.0, 0.0, 0.0, 20.0, 0.0)
    top, _ = governor.speeds(known)
    slower = 1.0 / margin.sinking(known) - 1.0 / top
    assert down - level == pytest.approx(20.0 * slower, rel=0.2)
    away = arrival.at_most_s(guard, law, 20.0, 0.0, 0.0, 2.0, 0.0, 0.0)
    assert math.isfinite(away)  # faster than it sinks, but level
    assert arrival.at_most_s(guard, law, 20.0, 0.0, 0.0, 3.0, 20.0, 3.0) == math.inf
    pace = admission.Look(guard, law).pace
    assert pace.down == pytest.approx(margin.sinking(known))
    assert pace.down < pace.top == pytest.approx(margin.steered(guard))


def test_a_plan_of_who_refuses_turns_no_faster_than_its_own_braking_leaves(settings_of):
    law, guard = settings_of(guard="refuse", c_angle=7.0, c_rate=14.0)
    pace = admission.Look(guard, law).pace
    assert pace.jerk == wrench.jerk_ahead(guard, law, -pace.acceleration)
    assert pace.jerk < wrench.jerk_ahead(guard, law, 0.0)


def test_a_guard_that_refuses_turns_slower_on_the_way_down(settings_of):
    """In the look ahead and in flight alike: of the acceleration that the reference has."""
    law, guard = settings_of(guard="refuse", c_angle=7.0, c_rate=14.0)
    down, _ = foreseen.fastest(guard, law, Vec3(0.0, 0.0, -1.0))
    level, _ = foreseen.fastest(guard, law, STILL)
    assert down == wrench.jerk_ahead(guard, law, -1.0) < level
