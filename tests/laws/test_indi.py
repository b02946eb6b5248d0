"""INDI against its publications: the responses of Tal and Karaman's Section IV, and Smeur's poles.

Vehicle and gains are those of the papers where these give them: the second-order Butterworth filter
at 188.5 rad/s, motors of first order with 20 ms, K_x = 18, K_v = 7.8, K_xi = 175, K_Omega = 19.5,
a control rate of 2 kHz. The lag is not inverted there.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.rotations import from_euler
from fcu.laws.filter import Filtered, low_pass
from tests.laws.conftest import OCTO
from tests.laws.yardstick import ZERO, Flown, G, at, flown, fly, hovering, with_rotors

CUTOFF, LAG, RATE = 188.5, 0.02, 2000.0
K_W = 19.5
PAPER = {
    "K_x": (18.0, 18.0, 13.5), "K_v": (7.8, 7.8, 5.9), "K_xi": (175.0, 175.0, 82.0),
    "K_w": (19.5, 19.5, 19.2), "cutoff_v": CUTOFF, "cutoff_w": CUTOFF, "trim_rate": 0.0,
}  # fmt: skip
MOTOR = signal.TransferFunction([1.0], [LAG, 1.0])
LOW_PASS = signal.TransferFunction([CUTOFF**2], [1.0, math.sqrt(2.0) * CUTOFF, CUTOFF**2])


def paper(**chosen):
    """The law with the paper's gains, on rotors whose lag is not inverted."""
    law = flown("indi", OCTO, RATE, **{**PAPER, **chosen})
    return Flown(law.face, with_rotors(law.params, kappa=1.0))


def product(*systems):
    num, den = np.array([1.0]), np.array([1.0])
    for system in systems:
        num, den = np.polymul(num, system.num), np.polymul(den, system.den)
    return num, den


def responses(num, den, t):
    """Step response of num/den at times t (s)."""
    return signal.step((num, den), T=t)[1]


def test_the_filter_is_the_second_order_butterworth_filter():
    f = Filtered(x=ZERO, x_dot=ZERO)
    told = []
    for _ in range(200):
        f = low_pass(f, Vec3(1.0, 0.0, -2.0), CUTOFF, 1.0 / RATE)
        told.append((f.x.x, f.x.z, f.x_dot.x))
    t = np.arange(201) / RATE
    x = responses(LOW_PASS.num, LOW_PASS.den, t)[1:]
    rate = responses(np.polymul(LOW_PASS.num, [1.0, 0.0]), LOW_PASS.den, t)[1:]
    np.testing.assert_allclose(told, np.stack([x, -2.0 * x, rate], axis=1), atol=1e-9 * CUTOFF)


def rates(law, setpoint, seconds, torque=0.0):
    """Pitch rate (rad/s) of a flight that begins in hover, with a torque (N m) from the start."""
    rows = fly(law, setpoint, seconds, lambda t: (ZERO, Vec3(0.0, torque, 0.0)), LAG)
    return np.array([row[0].w_B.y for row in rows])


def turning(q=0.0):
    return at()._replace(level=2.0, w_c=Vec3(0.0, q, 0.0), T_c=8.0 * G)


def test_a_disturbance_torque_is_left_as_one_minus_filter_times_motor():
    """(45): alpha = (1 - H M) mu_ext/J, which is gone after some 60 ms. K_w as weak as it may be."""
    law = paper(K_w=0.1)
    tau = 0.5
    w = rates(law, turning(), 0.15, tau)
    t = np.arange(len(w)) / RATE
    hm_num, hm_den = product(LOW_PASS, MOTOR)
    num = np.polysub(hm_den, hm_num)
    expected = tau / law.params.J.y * responses(num, np.polymul(hm_den, [1.0, 0.0]), t)
    plain = tau / law.params.J.y * t  # of a law without increments
    assert np.abs(w - expected).max() < 0.03 * expected.max()
    assert w[-1] < 0.25 * plain[-1]


@pytest.mark.computes
def test_a_command_is_followed_as_fast_as_the_motors_are():
    """(44): alpha = M alpha_c, whatever the filter; around it (28) closes the loop of the rate."""
    for cutoff in (60.0, CUTOFF):
        w = rates(paper(cutoff_w=cutoff), turning(0.2), 0.4)
        t = np.arange(len(w)) / RATE
        num, den = K_W * MOTOR.num, np.polyadd(np.polymul(MOTOR.den, [1.0, 0.0]), K_W * MOTOR.num)
        assert np.abs(w - 0.2 * responses(num, den, t)).max() < 0.02 * 0.2


@pytest.mark.parametrize("epsilon", [0.5, 2.0])
@pytest.mark.computes
def test_a_wrong_inertia_is_corrected(epsilon):
    """(47): alpha = epsilon M/((epsilon - 1) H M + 1) alpha_c, of an inertia believed epsilon times."""
    law = paper()
    believed = law.params._replace(J=epsilon * law.params.J)
    kernels = SimpleNamespace(
        take_over=lambda _, setpoint, seen: law.face.take_over(believed, setpoint, seen),
        step=lambda state, _, setpoint, seen: law.face.step(state, believed, setpoint, seen),
    )
    w = rates(Flown(kernels, law.params), turning(0.2), 0.4)
    t = np.arange(len(w)) / RATE
    hm_num, hm_den = product(LOW_PASS, MOTOR)
    inner_num = epsilon * np.polymul(MOTOR.num, LOW_PASS.den)
    inner_den = np.polyadd(hm_den, (epsilon - 1.0) * hm_num)
    num, den = K_W * inner_num, np.polyadd(np.polymul(inner_den, [1.0, 0.0]), K_W * inner_num)
    assert np.abs(w - 0.2 * responses(num, den, t)).max() < 0.03 * 0.2


@pytest.mark.computes
def test_a_steady_force_and_torque_leave_no_error_of_position():
    """Figure 7: the position comes back; a law that is not incremental stays away."""
    m = 8.0
    rows = fly(paper(), at(), 2.5, lambda t: (Vec3(m * 1.0, 0.0, 0.0), Vec3(0.0, 0.5, 0.0)), LAG)
    x = np.array([row[0].r_E.x for row in rows])
    left_alone = 1.0 / 18.0  # m: what K_x alone leaves of 1 m/s^2
    assert 0.002 < x.max() < 0.6 * left_alone
    assert abs(x[-1]) < 0.02 * x.max()
    f_ext = rows[-1][3].f_ext
    assert f_ext == pytest.approx((m, 0.0, 0.0), abs=0.01 * m)


# --- Smeur, de Croon, Chu 2018, corrigendum of 2023

K_OMEGA, K_ETA, ALPHA, T_S = 28.0, 10.7, 0.1, 1.0 / 512.0
GAINED = K_OMEGA * ALPHA * T_S, K_ETA * K_OMEGA * ALPHA * T_S**2
# denominator of the corrected (12), highest power of z first
DENOMINATOR = [1.0, sum(GAINED) + ALPHA - 3.0, 3.0 - 2.0 * ALPHA - GAINED[0], ALPHA - 1.0]


def test_the_poles_are_those_of_the_corrigendum():
    """0.964 and 0.965 +- 0.0445i: of K_eta = 10.7 a radian (21.4 of a quaternion's vector part)."""
    poles = np.roots(DENOMINATOR)
    poles = poles[np.argsort(np.abs(poles.imag))]
    assert poles[0].real == pytest.approx(0.964, abs=6e-4)
    assert poles[1:].real == pytest.approx(0.965, abs=6e-4)
    assert sorted(poles[1:].imag) == pytest.approx([-0.0445, 0.0445], abs=6e-4)


def test_attitude_moves_as_the_corrected_transfer_function_says():
    """(12), the paper's sampled loop with the motor 0.1/(z - 0.9), flown by the law's kernels."""
    law = flown(
        "indi", OCTO, 1.0 / T_S, K_xi=K_OMEGA * K_ETA, K_w=K_OMEGA, cutoff_w=50.0, cutoff_v=50.0
    )
    params = with_rotors(law.params, kappa=1.0, mean=0.0)
    step = 0.002
    setpoint = at()._replace(level=1.0, tilt_c=Vec3(0.0, step, 0.0), T_c=8.0 * G)
    full, c_T = np.resize(params.rotors.Omega_max, 8), np.resize(params.rotors.c_T, 8)
    x, eta, q = np.array(params.rotors.x), 0.0, 0.0
    seen = hovering(params)
    state, command, _, _ = law.face.take_over(params, setpoint, seen)
    told = [0.0]
    for _ in range(300):
        Omega = np.array(seen.Omega)
        Omega = Omega + ALPHA * (full * np.array(command.u) - Omega)
        q += T_S * float(-x @ (c_T * Omega**2)) / params.J.y
        eta += T_S * q
        told.append(eta / step)
        seen = hovering(params)._replace(
            q_EB=from_euler(0.0, eta, 0.0), w_B=Vec3(0.0, q, 0.0), Omega=Rotors(*Omega.tolist())
        )
        state, command, _, _ = law.face.step(state, params, setpoint, seen)
    _, (expected,) = signal.dstep(([GAINED[1], 0.0, 0.0], DENOMINATOR, T_S), n=302)
    assert told[-1] == pytest.approx(1.0, abs=1e-3)
    assert np.abs(np.array(told) - expected[:301, 0]).max() < 2e-3
