"""What thrust holds beside it of torque, and how fast a demand may turn for that."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

from fcu.guard import wrench
from fcu.kernel.algebra import Vec3
from fcu.laws import allocation


@pytest.mark.parametrize("T", [20.0, 40.0, 78.0, 120.0, 180.0])
def test_such_a_torque_fits_the_pseudo_inverse_whatever_its_axis_and_more_does_not(settings_of, T):
    law, guard = settings_of()
    rotors = law.rotors
    most = wrench.tilting(guard, rotors, T)

    def evenly(tau):
        even = tau.x * rotors.B_x + tau.y * rotors.B_y
        return allocation.tilted(rotors, T, tau) == even

    axes = [
        Vec3(math.cos(a), math.sin(a), 0.0) for a in np.linspace(0.0, 2.0 * math.pi, 145).tolist()
    ]
    assert all(evenly(0.999 * most * tau) for tau in axes)
    assert not all(evenly(1.001 * most * tau) for tau in axes)


@pytest.mark.parametrize(("T", "more"), [(20.0, 1.7), (40.0, 1.7), (60.0, 1.5), (180.0, 1.7)])
def test_rotors_hold_more_than_is_counted_before_thrust_is_moved(settings_of, T, more):
    """By 1 + 1/sqrt(2) on an octocopter, about any axis."""
    law, guard = settings_of()
    most = wrench.tilting(guard, law.rotors, T)
    for a in np.linspace(0.0, 2.0 * math.pi, 145).tolist():
        tau = more * most * Vec3(math.cos(a), math.sin(a), 0.0)
        assert allocation.allocate(law.rotors, T, tau)[1].torque == 0.0
    assert (
        allocation.allocate(law.rotors, T, Vec3(1.72 * most / math.cos(math.pi / 8.0), 0.0, 0.0))[
            1
        ].torque
        == 1.0
    )


def acceleration_over_rate(c_angle, c_rate, bandwidth, response=0.01):
    """L1 norm from the rate of a tilt command to the angular acceleration that is demanded.

    Attitude and rates as they are (departure 15), rotors that answer with a lag of `response`.
    """
    s = np.poly1d([1.0, 0.0])
    above = c_rate * (s * (bandwidth + c_angle) + c_angle * bandwidth) * s * (response * s + 1.0)
    below = (s + bandwidth) * (s * s * (response * s + 1.0) + c_rate * s + c_rate * c_angle)
    direct, rest = np.polydiv(above.coeffs, below.coeffs)
    t = np.linspace(0.0, 30.0 / c_angle, 20_001)
    _, y = signal.impulse(signal.TransferFunction(rest, below.coeffs), T=t)
    return float(direct[-1] + np.trapezoid(np.abs(y), t))


@pytest.mark.parametrize("c_angle", [3.0, 5.0, 7.0, 10.0])
@pytest.mark.parametrize("ratio", [1.5, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("bandwidth", [15.0, 30.0])
@pytest.mark.computes
def test_the_norm_of_attitude_and_rates_is_not_exceeded(law, c_angle, ratio, bandwidth):
    params = law(c_angle=c_angle, c_rate=ratio * c_angle)
    norm = acceleration_over_rate(c_angle, ratio * c_angle, bandwidth)
    assert 0.5 * wrench.turning(params) < norm <= wrench.turning(params)


@pytest.mark.computes
def test_the_disturbance_estimate_follows_no_faster_than_told():
    """From the rate of the drag to that of its estimate: an L1 norm, for m_hat/m from 0.7 to 1.3."""
    for off in np.linspace(0.7, 1.3, 13):
        t = np.linspace(0.0, 60.0, 60_001)  # lambda = sqrt(gamma) = 1
        _, y = signal.impulse(signal.TransferFunction([off], [1.0, 1.0, off]), T=t)
        assert np.trapezoid(np.abs(y), t) <= wrench.FOLLOWS


def test_softer_gains_and_calmer_air_leave_more(settings_of):
    def jerk(**chosen):
        told = settings_of(**chosen)
        return wrench.jerk(told.guard, told.law, math.inf)

    cap = {"guard_jerk_m_s3": 1000.0}
    stiff, soft = jerk(**cap), jerk(c_angle=7.0, c_rate=14.0, **cap)
    assert soft > 1.5 * stiff > 0.0
    assert jerk(guard_wind_rate_m_s2=5.0, **cap) > stiff
    assert jerk(guard_wind_m_s=100.0, guard_wind_rate_m_s2=100.0) == wrench.LEAST


def test_in_hover_jerk_and_gust_together_take_the_torque_there_is(settings_of):
    told = settings_of(c_angle=7.0, c_rate=14.0, guard_jerk_m_s3=1000.0)
    guard, law = told.guard, told.law
    j, m = wrench.jerk(guard, law, math.inf), guard.m_min
    gust = wrench.FOLLOWS * guard.c_D * guard.w_max * guard.w_dot_max
    tau = guard.J_tilt * wrench.turning(law) * (m * j + gust) / (m * law.g)
    assert tau == pytest.approx(wrench.tilting(guard, law.rotors, m * law.g))


def test_less_thrust_turns_slower(settings_of):
    told = settings_of()
    accelerations = [wrench.yaw_acceleration(told.guard, told.law, T) for T in (5.0, 40.0, 78.0)]
    assert accelerations[0] == 0.0
    assert 0.0 < accelerations[1] < accelerations[2] <= told.law.yaw_acceleration


def test_ahead_half_of_the_wind_lifts(settings_of):
    settings = settings_of()
    calm = settings.guard._replace(w_max=0.0)
    j = wrench.jerk_ahead(settings.guard, settings.law, 0.0)
    lifted = 7.0 * 9.81 - 0.15 * 6.0**2
    assert j == wrench.jerk(settings.guard, settings.law, lifted)
    assert wrench.LEAST < j < 0.75 * wrench.jerk(settings.guard, settings.law, math.inf)
    softer = settings_of(c_angle=7.0, c_rate=14.0)
    down = [wrench.jerk_ahead(*softer[::-1], a_z) for a_z in (1.0, 0.0, -0.5, -1.0)]
    assert down[0] == down[1] > down[2] > down[3] >= wrench.LEAST
    assert wrench.jerk_ahead(calm, settings.law, 0.0) == wrench.jerk(calm, settings.law, 7.0 * 9.81)
