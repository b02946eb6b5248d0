"""The wind that is shown: exact for the drag that is believed, whatever the mass is taken for."""

from __future__ import annotations

import math

import pytest

from fcu.interface.messages import VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.rotations import from_euler, matrix, rotate, rotate_back
from fcu.process.wind import of
from fcu.services.wind import Wind

DRAG = Vec3(0.15, 0.2, 0.25)
M = 8.0


def drag_force(v_a, q_EB):
    """On a body with this velocity against the air (E): N, E."""
    R_EB = matrix(q_EB)
    v = rotate_back(R_EB, v_a)
    return rotate(R_EB, Vec3(*[-c * x * abs(x) for c, x in zip(DRAG, v, strict=True)]))


@pytest.mark.parametrize("m_hat", [5.0, 8.0, 12.0])
@pytest.mark.parametrize("v_air", [(8.0, 0.0), (0.0, -12.0), (6.0, 6.0), (-15.0, 3.0)])
@pytest.mark.parametrize("v", [(0.0, 0.0, 0.0), (5.0, -2.0, 0.0), (0.0, 0.0, 2.0)])
def test_a_level_wind_comes_out_whatever_the_mass_is_taken_for(v_air, v, m_hat):
    """The law knows m_hat s_v_hat across; upwards it holds the error of mass as well."""
    v_E, wind = Vec3(*v), Vec3(*v_air, 0.0)
    q_EB = from_euler(0.12, -0.2, 0.7)
    f_E = drag_force(v_E - wind, q_EB)
    s_v_hat = (1.0 / m_hat) * (f_E + Vec3(0.0, 0.0, (m_hat - M) * 9.81))
    state = VehicleState(Vec3(0, 0, 20), v_E, q_EB, Vec3(0, 0, 0), Rotors(*[400.0] * 8))
    found = of(state, s_v_hat, m_hat, DRAG)
    assert (found.x, found.y) == pytest.approx(v_air, abs=0.05)
    assert math.isnan(found.z)


def test_wind_is_unknown_before_the_first_look_and_follows_within_a_second():
    wind = Wind(DRAG)
    assert math.isnan(wind.v_air_E.x)
    assert wind.variance < 0.0
    q_EB = from_euler(0.0, 0.0, 0.0)
    state = VehicleState(Vec3(0, 0, 9), Vec3(0, 0, 0), q_EB, Vec3(0, 0, 0), Rotors(*[400.0] * 8))
    for k, blows in ((0, 0.0), *((k, 4.0) for k in range(1, 1001))):
        push = drag_force(Vec3(-blows, 0.0, 0.0), q_EB)
        wind.see(k * 0.001, state, (1.0 / M) * push, M)
    assert wind.v_air_E.x == pytest.approx(4.0 * (1.0 - math.exp(-1.0)), rel=1e-3)
