"""Setpoints of attitude and body rates, flown."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.rows import column, view
from fcu.process.tick import Remembered, Tick, tick
from gcs_tools.flight import law_alone

W = 8.0 * 9.81
HERE = (0.0, 0.0, 10.0)


def lying(here, phi=0.0, theta=0.0, psi=0.0, T=W):
    return here._replace(level=1.0, tilt_c=Vec3(phi, theta, 0.0), psi_c=psi, T_c=T)


def turning(here, p=0.0, q=0.0, r=0.0, T=W):
    return here._replace(level=2.0, w_c=Vec3(p, q, r), T_c=T)


def vectors(column):
    """(n, 3) of a Vec3 of the rows."""
    return np.stack([column[axis] for axis in "xyz"], axis=1)


@pytest.mark.parametrize("rate_hz", [250.0, 500.0, 1000.0])
def test_level_and_with_the_weight_as_thrust_it_stays_where_it_is(flight, fixed, rate_hz):
    here = fixed(HERE)
    rows = flight([(0.0, here), (20.0, lying(here))], 30.0, rate_hz)
    late = rows[rows["t"] > 20.0]
    v = vectors(late["measured"]["v_E"])
    assert np.abs(v - v[0]).max() < 0.005
    assert late["outputs"]["T_achieved"][-1] == pytest.approx(W, rel=1e-4)


@pytest.mark.parametrize(
    ("phi_deg", "theta_deg", "psi_deg", "way"),
    [
        (10.0, 0.0, 0.0, (0.0, -1.0)),
        (-10.0, 0.0, 0.0, (0.0, 1.0)),
        (0.0, 10.0, 0.0, (1.0, 0.0)),
        (0.0, -10.0, 0.0, (-1.0, 0.0)),
        (10.0, 0.0, 90.0, (1.0, 0.0)),
        (0.0, 10.0, 90.0, (0.0, 1.0)),
    ],
)
def test_tilted_it_accelerates_that_way(flight, fixed, phi_deg, theta_deg, psi_deg, way):
    """By g tan 10 degrees less drag (0.15 N/(m/s)^2 on 8 kg), if the thrust carries the weight."""
    here = fixed(HERE, math.radians(psi_deg))
    phi, theta, psi = (math.radians(a) for a in (phi_deg, theta_deg, psi_deg))
    T = W / math.cos(math.radians(10.0))
    rows = flight([(0.0, here), (6.0, lying(here, phi, theta, psi, T))], 8.0)
    v = vectors(rows["measured"]["v_E"])
    last_s = v[-501:]
    gained, along = last_s[-1] - last_s[0], last_s[:, :2] @ way
    expected = 9.81 * math.tan(math.radians(10.0)) - 0.15 / 8.0 * np.mean(along**2)
    assert gained[:2] @ way == pytest.approx(expected, rel=0.01)
    assert abs(gained[:2] @ (-way[1], way[0])) < 0.02
    assert abs(gained[2]) < 0.05
    angles = vectors(rows["outputs"]["angles"])[-1]
    assert np.degrees(angles) == pytest.approx((phi_deg, theta_deg, psi_deg), abs=0.2)


def test_more_thrust_than_weight_climbs_by_the_difference(flight, fixed):
    here = fixed(HERE)
    rows = flight([(0.0, here), (6.0, lying(here, T=1.1 * W))], 7.5)
    v_z = rows["measured"]["v_E"]["z"]
    assert v_z[-1] - v_z[-250] == pytest.approx(0.5 * 0.981, rel=0.05)


@pytest.mark.parametrize(("axis", "rate"), [("x", 0.2), ("y", -0.2), ("z", 0.5)])
def test_a_body_rate_turns_its_angle_at_that_rate(flight, fixed, axis, rate):
    here = fixed(HERE)
    sent = turning(here)._replace(w_c=Vec3(0.0, 0.0, 0.0)._replace(**{axis: rate}))
    rows = flight([(0.0, here), (3.0, sent)], 5.0)
    late = rows[rows["t"] > 4.0]
    angle = late["outputs"]["angles"][axis]
    assert (angle[-1] - angle[0]) / (late["t"][-1] - late["t"][0]) == pytest.approx(rate, rel=0.02)


def test_in_wind_an_attitude_is_held(flight, fixed):
    """The paper's wind moves the vehicle, not its angles: within half a degree."""
    here = fixed(HERE)
    rows = flight([(0.0, here), (5.0, lying(here, phi=0.2, psi=0.5))], 10.0, wind=True)
    angles = vectors(rows["outputs"]["angles"])[rows["t"] > 8.0]
    np.testing.assert_allclose(angles, [[0.2, 0.0, 0.5]] * len(angles), atol=math.radians(0.5))


@pytest.mark.parametrize("rate_hz", [250.0, 500.0, 1000.0])
@pytest.mark.parametrize("prediction", ["achieved", "demanded"])
def test_the_way_back_to_positions_is_without_a_jump(flight, fixed, rate_hz, prediction):
    """The reference starts where the vehicle is, at its velocity, and tracks from there."""
    here, there = fixed(HERE), fixed((0.0, -6.0, 10.0))
    settings = ["plant.rotor_lag_s=0", "law.rotor_lag_s=0"] if prediction == "demanded" else []
    settings.append(f"law.prediction={prediction}")
    sent = [(0.0, here), (8.0, lying(here, phi=0.25)), (9.0, turning(here, q=0.1)), (9.5, there)]
    rows = flight(sent, 14.0, rate_hz, settings=settings)
    back = round(9.5 * rate_hz)
    assert vectors(rows["outputs"]["e_r"])[round(8.0 * rate_hz) : back].any() == 0.0
    e_r = np.linalg.norm(vectors(rows["outputs"]["e_r"]), axis=1)
    a_max = 20.0  # m/s^2, more than it has; what is left of it over a tick is no jump
    assert e_r[back] < 0.5 * a_max / rate_hz**2
    v = vectors(rows["measured"]["v_E"])[back]
    assert np.linalg.norm(v) > 1.5  # it was under way
    assert vectors(rows["outputs"]["reference"]["v_m"])[back] == pytest.approx(
        v, abs=a_max / rate_hz
    )
    r_m = vectors(rows["outputs"]["reference"]["r_m"])
    assert np.abs(np.diff(r_m[back - 5 : back + 5], n=2, axis=0)).max() < a_max / rate_hz**2
    if prediction == "achieved":  # as printed it tracks worse, with or without this
        assert e_r[-1] < 0.03


def test_flights_and_ticks_on_buffers_give_the_same_bits_at_every_level(told, fixed):
    """What a process does with what was measured, against the compiled flight; wind and all."""
    here = fixed(HERE)
    sent = [
        (0.0, here), (0.5, lying(here, 0.1, -0.1, 0.3, 90.0)), (1.0, turning(here, 0.3, 0.2, 0.1)),
        (1.5, lying(here, 2.0, -2.0, 3.0, 500.0)._replace(psi_dot_c=0.4)),
        (1.7, turning(here, 3.0, 3.0, 3.0, -5.0)), (1.9, fixed((1.0, 2.0, 12.0), 1.0)),
    ]  # fmt: skip
    scene = told(sent, 2.5, wind=True)
    _, flown = law_alone.fly(scene)
    assert set(column(Tick, flown, "setpoint.level")) == {0.0, 1.0, 2.0}

    settings, again = to_buffer(scene.settings), np.zeros_like(flown)
    remembered = np.zeros(size(Remembered))
    for k, (row, inputs) in enumerate(zip(again, flown, strict=True)):
        latest = int(np.searchsorted(scene.sent_at, k, side="right")) - 1
        age = ((k - scene.sent_at[latest]) * scene.period_us) * 1e-6
        was = view(Tick, inputs)
        tick(
            was.t, was.engaged, remembered, settings, scene.setpoints[latest], age,
            to_buffer(was.measured), row,
        )  # fmt: skip
    assert again.tobytes() == flown.tobytes()
