"""A tilt in a wind from below: where it steers no more, what is kept of that, and flights down there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.guard import margin, stability
from fcu.guard.stability import Hover
from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import column
from fcu.tick import Tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.run import prepared
from gcs_tools.flight.scenario import Scenario

SHIPPED = ()
SECTION_VIII = ("law.f_m=1.0", "law.gamma=1000.0", "law.c_angle=10", "law.c_rate=20")
LIGHT = ("plant.mass_kg=7", "law.m_hat_0=7")
KNOWN = (*LIGHT, "law.bounds.m_min=6.99", "law.bounds.m_max=7.01")


def rising(speed: float, to: list[float], duration_s: float, *more: str) -> Scenario:
    """A setpoint in air that does nothing but rise."""
    return prepared(
        "urban_step",
        [
            "wind.amplitude_m_s=[0,0,0]",
            "wind.rotation_amplitude_rad_s=[0,0,0]",
            f"wind.steady_m_s=[0,0,{speed}]",
            f"flight.setpoints=[{{at_s=0.0,position_m={to}}}]",
            f"flight.duration_s={duration_s}",
            *more,
        ],
    )[1]


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
        here = Hover(m=7.0, T_0=T_0, turns=True)
        loop = stability.tilt(scene.law, stability.fade(scene.law), 1.0, 1, here)
        assert bool(np.abs(np.linalg.eigvals(loop.A)).max() < 1.0) is flies, speed
        assert (late(scene) < 1e-4) is flies, speed


def test_what_is_kept_has_the_gain_margin(settings_of):
    """At the lift that is told the loop holds 3 dB more gain; with a little more drag it does not."""
    law, guard = settings_of()
    assert guard.lift == stability.lift(law, guard.m_min)
    m, weight = guard.m_min, guard.m_min * law.g
    for drag, stable in ((guard.lift, True), (guard.lift + 0.005 * weight, False)):
        here = Hover(m=m, T_0=weight - drag, turns=True)
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
    assert margin.steering(known, below) < 0.0 < margin.steering(known, Vec3(0.0, 0.0, 9.0))
    easy = known._replace(T_z_min=0.0, T_min=0.0, sin=1.0, cos=0.0, z_0=0.0, z_1=0.0)
    still = Vec3(0.0, 0.0, 0.0)
    assert margin.condition(easy, still, below, 0.0) == margin.steering(easy, below)


@pytest.mark.parametrize("gains", [SHIPPED, SECTION_VIII])
def test_a_long_way_down_in_the_strongest_wind_from_below_arrives(gains):
    """With the gains of Section VIII the vehicle was lost 80 m down."""
    scene = rising(
        12.0,
        [0.0, 0.0, -120.0],
        130.0,
        *LIGHT,
        "flight.ground_z_m=-1000",
        "flight.arena_m=1000",
        *gains,
    )
    ticks, rows = law_alone.fly(scene)
    assert len(rows) == scene.ticks
    off = column(Tick, rows, "measured.r_E")[-1000:] + np.array([0.0, 0.0, 120.0])
    assert np.abs(off).max() < 0.3
    known = margin.known(scene.guard, scene.law)
    fastest = -column(Tick, rows, "outputs.reference.v_m")[:, 2].min()
    assert 0.9 * max(margin.sinking(known), 1.0) < fastest < max(margin.sinking(known), 1.0) + 0.01
    assert column(Tick, rows, "guard.margin.condition")[1000:].min() > -0.2


def test_of_the_printed_law_nothing_is_known(settings_of):
    law, guard = settings_of(prediction="demanded")
    assert guard.lift == pytest.approx(guard.m_min * law.g)
