"""Rotations against SciPy: body to Earth, Hamilton, Z-Y-X angles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.kernel import rotations
from fcu.kernel.algebra import Quat, Vec3

RNG = np.random.default_rng(33)
ATTITUDES = Rotation.random(50, rng=RNG)
ANGLES = [
    (float(phi), float(theta), float(psi))
    for phi, theta, psi in RNG.uniform((-3.1, -1.55, -3.1), (3.1, 1.55, 3.1), (50, 3))
]


def quat(rotation):
    return Quat(*rotation.as_quat(scalar_first=True).tolist())


def columns(R):
    return np.array(R).T


def test_the_matrix_is_scipys():
    for attitude in ATTITUDES:
        R_EB = columns(rotations.matrix(quat(attitude)))
        np.testing.assert_allclose(R_EB, attitude.as_matrix(), atol=1e-15)


def test_rotate_takes_body_components_to_earth_and_rotate_back_undoes_it():
    for attitude in ATTITUDES:
        v_B = Vec3(*RNG.normal(size=3).tolist())
        R_EB = rotations.matrix(quat(attitude))
        v_E = rotations.rotate(R_EB, v_B)
        np.testing.assert_allclose(v_E, attitude.apply(v_B), atol=1e-14)
        np.testing.assert_allclose(rotations.rotate_back(R_EB, v_E), v_B, atol=1e-14)


def test_products_and_inverses_are_those_of_rotations():
    for a, b in zip(ATTITUDES[:25], ATTITUDES[25:], strict=True):
        product = rotations.matrix(quat(a) * quat(b))
        np.testing.assert_allclose(columns(product), (a * b).as_matrix(), atol=1e-14)
        inverse = rotations.matrix(rotations.conjugate(quat(a)))
        np.testing.assert_allclose(columns(inverse), a.inv().as_matrix(), atol=1e-14)


def test_angles_are_yaw_then_pitch_then_roll():
    for phi, theta, psi in ANGLES:
        attitude = Rotation.from_euler("ZYX", [psi, theta, phi])
        R_EB = rotations.matrix(rotations.from_euler(phi, theta, psi))
        np.testing.assert_allclose(columns(R_EB), attitude.as_matrix(), atol=1e-14)


def test_the_thrust_axis_is_the_one_in_the_papers_notation():
    for phi, theta, psi in ANGLES:
        e3 = rotations.matrix(rotations.from_euler(phi, theta, psi)).e3
        c, s = math.cos, math.sin
        expected = (
            c(psi) * s(theta) * c(phi) + s(psi) * s(phi),
            s(psi) * s(theta) * c(phi) - c(psi) * s(phi),
            c(theta) * c(phi),
        )
        np.testing.assert_allclose(e3, expected, atol=1e-14)


def test_angles_survive_the_round_trip():
    for angles in ANGLES:
        back = rotations.euler(rotations.matrix(rotations.from_euler(*angles)))
        np.testing.assert_allclose(back, angles, atol=1e-12)


def test_euler_of_a_vertical_nose_is_finite_and_exact_in_pitch():
    R_EB = rotations.matrix(rotations.from_euler(0.0, 0.5 * math.pi, 0.3))
    phi, theta, psi = rotations.euler(R_EB)
    assert theta == pytest.approx(0.5 * math.pi, abs=1e-7)
    assert math.isfinite(phi)
    assert math.isfinite(psi)


def test_the_quaternion_rate_is_the_derivative_for_a_body_rate():
    h = 1e-6
    for attitude in ATTITUDES[:20]:
        w_B = RNG.normal(size=3) * 3.0
        q = np.array(quat(attitude))
        after, before = (
            np.array(quat(attitude * Rotation.from_rotvec(k * h * w_B))) for k in (1, -1)
        )
        # of the two quaternions of one rotation, the one next to q
        numeric = (after * np.sign(after @ q) - before * np.sign(before @ q)) / (2.0 * h)
        rate = rotations.quaternion_rate(quat(attitude), Vec3(*w_B.tolist()))
        np.testing.assert_allclose(rate, numeric, atol=1e-8)


def test_normalised_has_unit_length_and_the_same_direction():
    q = rotations.normalised(Quat(2.0, -4.0, 5.0, 6.0))
    assert q == pytest.approx((2 / 9, -4 / 9, 5 / 9, 6 / 9), abs=1e-15)


def test_wrap_keeps_the_angle_and_brings_it_into_half_a_turn():
    for angle in np.linspace(-40.0, 40.0, 801).tolist():
        wrapped = rotations.wrap(angle)
        assert -math.pi <= wrapped < math.pi
        assert math.remainder(wrapped - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-13)
    assert rotations.wrap(math.pi) == -math.pi
    assert rotations.wrap(-math.pi) == -math.pi
    assert rotations.wrap(0.25) == 0.25


def test_a_small_rotation_is_right_to_third_order():
    for size in (1e-1, 1e-2, 1e-3):
        v = size * np.array([0.6, -0.64, 0.48])
        error = Rotation.from_quat(
            rotations.small_rotation(Vec3(*v.tolist())), scalar_first=True
        ) * Rotation.from_rotvec(-v)
        assert error.magnitude() <= size**3 / 12.0 * 1.01 + 1e-15
