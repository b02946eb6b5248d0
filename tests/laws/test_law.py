"""The law as a whole: what it demands, how it starts, that it does not care where east is."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Quat, Rotors, Vec3, dot
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.rotations import from_euler, matrix
from fcu.kernel.rows import column, view
from fcu.laws.mmrac import attitude, position, reference_model
from fcu.laws.mmrac import law as mmrac
from fcu.process.tick import IDLE, Remembered, Tick, tick
from tests.laws.values import with_fields

EARTH = ("r_m", "v_m", "v_hat", "s_v_hat", "f_c", "e3")  # of State


def vec3(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


def reference_error(params, seconds):
    """Greatest error (m, m/s) of the reference model against its matrix exponential.

    From a standstill 18 m away, towards a setpoint that moves and accelerates.
    """
    r, v, r_c, v_c, a_c = 18.0, 0.0, 0.5, 2.0, 0.7
    k, d = params.f_m**2, 2.0 * params.zeta_m * params.f_m
    A = np.zeros((5, 5))  # of r, v, r_c, v_c, a_c
    A[0, 1] = A[2, 3] = A[3, 4] = 1.0
    A[1] = (-k, -d, k, d, 1.0)
    exact, a_tick = np.array([r, v, r_c, v_c, a_c]), expm(params.h * A)
    r_m, v_m = Vec3(r, -r, 2.0 * r), Vec3(v, -v, 2.0 * v)
    sent = Setpoint(*(Vec3(x, -x, 2.0 * x) for x in (r_c, v_c, a_c)), 0.0, 0.0)
    worst, signs = 0.0, np.array([1.0, -1.0, 2.0])
    for i in range(round(seconds / params.h)):
        setpoint = reference_model.carried(sent, i * params.h)
        r_m, v_m = reference_model.advance(params, setpoint, r_m, v_m)
        exact = a_tick @ exact
        errors = np.abs([np.array(r_m) - exact[0] * signs, np.array(v_m) - exact[1] * signs])
        worst = max(worst, float(errors.max()))
    return worst


@pytest.mark.computes
def test_the_reference_model_is_its_matrix_exponential(law):
    for rate_hz in (250.0, 500.0, 1000.0):
        assert reference_error(law(rate_hz=rate_hz, f_m=1.0), 5.0) < 1e-9


def test_the_reference_models_error_falls_16_fold_when_the_period_halves(law):
    """At the fastest reference model allowed, where there is an error to see."""
    coarse, fine = (reference_error(law(rate_hz=rate, f_m=10.0), 1.0) for rate in (250.0, 500.0))
    assert coarse < 1e-5
    assert coarse / fine == pytest.approx(16.0, rel=0.05)


def test_a_setpoint_is_carried_along_its_own_derivatives():
    sent = Setpoint(Vec3(1.0, 2.0, 3.0), Vec3(1.0, 0.0, -1.0), Vec3(0.0, 4.0, 0.0), 0.5, -0.25)
    carried = reference_model.carried(sent, 2.0)
    assert carried.r_c == (3.0, 10.0, 1.0)
    assert carried.v_c == (1.0, 8.0, -1.0)
    assert carried.a_c == (0.0, 4.0, 0.0)
    assert (carried.psi_c, carried.psi_dot_c) == (0.0, -0.25)
    assert carried[5:] == sent[5:]


def test_with_the_truth_estimated_the_vehicle_accelerates_as_the_reference(law, hover):
    """Unsaturated and tilted as commanded: T e3 / m + s + g is a_ref, to rounding."""
    params, rng = law(), np.random.default_rng(37)
    m, s_v = 7.0, np.array([1.0, -2.0, 0.5])
    estimates = mmrac.nothing_learnt(m, Vec3(1.0, 1.0, 1.0))._replace(s_v_hat=vec3(s_v))
    for _ in range(100):
        r, v, r_c = (rng.uniform(-1.0, 1.0, 3) for _ in range(3))
        psi = float(rng.uniform(-math.pi, math.pi))
        setpoint = Setpoint(vec3(r_c), vec3([0.5, 0.0, 0.0]), vec3([0.0, 0.3, 0.0]), psi, 0.0)
        lies = attitude.measured(from_euler(0.0, 0.0, psi))
        there = hover(r, v)
        asked = position.achieved(params, estimates, setpoint, there, lies)
        lies = attitude.measured(from_euler(*asked.angles_c))
        force = position.achieved(params, estimates, setpoint, there, lies)
        T, e3 = force.T_c, lies.R_EB.e3
        assert force.cut == 0.0
        assert params.limits.T_min < T < params.limits.T_max
        acceleration = T * np.array(e3) / m + s_v + (0.0, 0.0, -9.81)
        a_ref = np.array(reference_model.a_ref(params, setpoint, vec3(r), vec3(v)))
        np.testing.assert_allclose(acceleration, a_ref, atol=1e-12)


@pytest.mark.parametrize(
    "T_d", [(0.0, 0.0, -500.0), (300.0, 0.0, 10.0), (-80.0, 90.0, 20.0), (0.0, 0.0, 400.0)]
)
def test_a_demand_that_cannot_be_met_is_not_answered_upside_down(law, hover, fixed, T_d):
    """Achieved: a demand that points down asks the least thrust, not the most (39)."""
    params = law()
    safe, _ = position.safe(params, Vec3(*T_d))
    assert safe.z >= params.T_dz_min
    m, level = 8.0, attitude.measured(from_euler(0.0, 0.0, 0.0))
    printed, a = law(prediction="demanded"), np.array(T_d) / m
    estimates = mmrac.nothing_learnt(m, Vec3(1.0, 1.0, 1.0))
    # with s_v_hat of this size f_c is T_d / m, with and without gravity in the bracket
    asks = estimates._replace(s_v_hat=vec3(np.array([0.0, 0.0, 9.81]) - a))
    met = position.achieved(params, asks, fixed(), hover(), level)
    assert pytest.approx(T_d) == met.T_0
    least, most, _ = params.limits
    assert met.T_c == pytest.approx(min(max(T_d[2], params.T_dz_min), most))
    asks = estimates._replace(s_v_hat=vec3(-a))
    as_printed = position.demanded(printed, asks, fixed(), hover(), level)
    assert as_printed.T_d == as_printed.T_0 == pytest.approx(T_d)
    assert as_printed.T_c == pytest.approx(min(max(np.linalg.norm(T_d), least), most))


def test_a_demand_past_the_tilt_limit_keeps_its_height_and_its_heading(law):
    """The vertical force along the clipped tilt is what was asked, not what full thrust gives."""
    params, T_d = law(), Vec3(-300.0, 400.0, 80.0)
    safe, narrowed = position.safe(params, T_d)
    assert narrowed == 1.0
    assert safe.z == 80.0
    assert math.hypot(safe.x, safe.y) == pytest.approx(80.0 * math.tan(params.limits.phi_star))
    assert safe.y / safe.x == pytest.approx(T_d.y / T_d.x)
    phi_c, theta_c, _ = position.tilt(params.limits.phi_star, safe, 1.0, 0.0)
    e3 = matrix(from_euler(phi_c, theta_c, 0.0)).e3
    assert dot(safe, e3) * e3.z == pytest.approx(80.0)
    within = Vec3(30.0, -40.0, 80.0)
    assert position.safe(params, within) == (within, 0.0)


def turned(alpha, R, setpoint, measured):
    """Setpoint and measurement in a world turned by alpha about the vertical."""
    half = Quat(math.cos(0.5 * alpha), 0.0, 0.0, math.sin(0.5 * alpha))
    return (
        Setpoint(*(vec3(R @ row) for row in setpoint[:3]), setpoint.psi_c + alpha, 0.1),
        measured._replace(
            r_E=vec3(R @ measured.r_E), v_E=vec3(R @ measured.v_E), q_EB=half * measured.q_EB
        ),
    )


@pytest.mark.parametrize("prediction_form", ["achieved", "demanded"])
@pytest.mark.parametrize("alpha", [0.5 * math.pi, 1.0, -2.5])
def test_turning_the_world_changes_no_rotor_command(law, hover, prediction_form, alpha):
    """Yaw equivariance of take-over and of five steps, everything in motion."""
    params, rng = law(prediction=prediction_form, m_hat_0=8.0), np.random.default_rng(11)
    R = Rotation.from_rotvec([0.0, 0.0, alpha]).as_matrix()
    state = state_turned = None
    for _ in range(6):
        measured = hover(
            rng.normal(size=3) * 0.3, rng.normal(size=3) * 0.3,
            rng.uniform(-0.3, 0.3, 3), rng.normal(size=3) * 0.3,
        )._replace(Omega=Rotors(*rng.uniform(300.0, 400.0, 8).tolist()))  # fmt: skip
        setpoint = Setpoint(*(vec3(rng.normal(size=3) * 0.3) for _ in range(3)), 0.2, 0.1)
        setpoint_turned, measured_turned = turned(alpha, R, setpoint, measured)
        if state is None:
            state, command, _, _ = mmrac.take_over(params, setpoint, measured)
            state_turned, command_turned, _, _ = mmrac.take_over(
                params, setpoint_turned, measured_turned
            )
        else:
            state, command, _, _ = mmrac.step(state, params, setpoint, measured)
            state_turned, command_turned, _, _ = mmrac.step(
                state_turned, params, setpoint_turned, measured_turned
            )
        np.testing.assert_allclose(command_turned.u, command.u, atol=1e-9)
        for part, part_turned in zip(state, state_turned, strict=True):
            for name, value, found in zip(part._fields, part, part_turned, strict=True):
                expected = R @ np.array(value) if name in EARTH else value
                np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9, err_msg=name)


def test_the_law_takes_over_where_the_vehicle_is(law, hover, fixed):
    params = law(r_m_offset=[-5.0, -5.0, -5.0], v_hat_offset=[-1.5, -1.5, -1.5])
    measured = hover((1.0, 2.0, 3.0), (0.5, 0.0, 0.0))
    state = mmrac.beginning(params, measured)
    assert state.reference == ((-4.0, -3.0, -2.0), measured.v_E)
    assert state.predictor.v_hat == (-1.0, -1.5, -1.5)
    estimates = state.estimates
    assert estimates.m_hat == 5.0
    assert estimates.J_hat == (0.1, 0.1, 0.1)
    assert estimates.s_v_hat == estimates.s_w_hat == (0.0, 0.0, 0.0)
    assert state.memory.T_c == pytest.approx(78.48)
    printed = mmrac.beginning(law(prediction="demanded"), measured)
    assert printed.estimates.J_hat == (0.0, 0.0, 0.0)


def test_trim_pushes_towards_what_was_commanded_and_stops_at_saturation(law, hover, fixed):
    params = law()
    memory = mmrac.beginning(params, hover()).memory._replace(T_c=80.0, T_trim=1.0)
    moved = position.trim(params, memory, 70.0)
    assert moved == pytest.approx(1.0 + 0.002 * 3.0 * 10.0)
    for limit in (params.limits.T_min, params.limits.T_max):
        assert position.trim(params, memory._replace(T_c=limit), 70.0) == 1.0
    assert position.trim(params, memory._replace(T_trim=30.0), 0.0) == params.trim_max
    printed, measured = law(prediction="demanded"), hover(w=(0.1, 0.2, 0.3))
    state = with_fields(mmrac.beginning(printed, measured), T_c=80.0, T_trim=1.0)
    state, _, _, _ = mmrac.step(state, printed, fixed(), measured)
    assert state.memory.T_trim == 1.0


def test_a_clamp_shows_while_it_holds(law, hover, fixed):
    """The tilt command's own rate, and the thrust trim: each has a flag of its own."""
    params, measured = law(m_hat_0=8.0), hover()
    state, _, _, still = mmrac.take_over(params, fixed(), measured)
    assert (still.flags.tilt_rate, still.flags.trim) == (0.0, 0.0)
    _, _, _, jumped = mmrac.step(state, params, fixed((5.0, 0.0, 0.0)), measured)
    assert (jumped.flags.tilt_rate, jumped.flags.trim) == (1.0, 0.0)
    for T_trim in (params.trim_max, -params.trim_max):
        at_limit = with_fields(state, T_trim=T_trim, T_c=params.limits.T_max)
        _, _, _, trimmed = mmrac.step(at_limit, params, fixed(), measured)
        assert trimmed.flags.trim == 1.0


def test_the_tilt_rate_is_that_of_the_command_after_the_filter_has_settled(law):
    params, filtered = law(), Vec3(0.0, 0.0, 0.0)
    for k in range(500):
        told = Vec3(0.2 * k * 0.002, -0.1 * k * 0.002, 0.0)
        filtered = attitude.filtered(params, filtered, told)
    lies = attitude.measured(from_euler(*told))
    fed = attitude.achieved(params, lies, told, filtered, 0.0)
    # at the commanded angles nothing but the command's own rate is left
    as_it_is = attitude.body_rates(lies.R_EB, Vec3(0.2, -0.1, 0.0))
    assert fed.w_c == pytest.approx(as_it_is, abs=1e-9)
    assert fed.tilt_cut == 0.0
    step, level = Vec3(1.5, -1.5, 0.0), attitude.measured(from_euler(0.0, 0.0, 0.0))
    jumped = attitude.achieved(params, level, step, attitude.filtered(params, filtered, step), 0.0)
    top, c = params.tilt_rate_max, params.c_angle.x
    assert jumped.w_c == pytest.approx((top + 1.5 * c, -top - 1.5 * c, 0.0))
    assert jumped.tilt_cut == 1.0
    printed = attitude.demanded(law(prediction="demanded"), level, step, 0.0)
    assert printed.w_c == pytest.approx((1.5 * c, -1.5 * c, 0.0))
    assert printed.tilt_cut == 0.0


def test_an_idle_tick_follows_the_measurement_and_stops_the_rotors(settings_of, hover, fixed):
    measured = hover((1.0, 2.0, 3.0), angles=(0.1, 0.2, 0.3))
    row, remembered = np.zeros(size(Tick)), np.zeros(size(Remembered))
    tick(
        4.0, IDLE, remembered, to_buffer(settings_of()), to_buffer(fixed()), 0.0,
        to_buffer(measured), row,
    )  # fmt: skip
    flown = view(Tick, row)
    assert (flown.t, flown.engaged) == (4.0, IDLE)
    assert flown.measured == measured
    assert flown.state.reference.r_m == measured.r_E
    assert flown.outputs.angles.z == pytest.approx(0.3)
    assert flown.command.u == (0.0,) * 8
    np.testing.assert_array_equal(remembered, to_buffer(Remembered(flown.state, flown.guard_state)))


def test_a_step_and_a_tick_on_buffers_are_the_same_step(settings_of, hover, fixed, ticks):
    """With a guard that governs nothing."""
    settings = settings_of(guard="warn")
    params, law_ticks = settings.law, ticks(settings)
    measured, setpoint = hover(v=(0.1, 0.2, 0.3)), fixed((4.0, 7.0, 18.0), 0.4)
    state, _, _, _ = mmrac.take_over(params, setpoint, measured)
    expected = mmrac.step(state, params, setpoint, measured)
    for _ in range(2):
        law_ticks.tick(to_buffer(measured), to_buffer(setpoint))
    for name, value in zip(("state", "command", "outputs", "internals"), expected, strict=True):
        np.testing.assert_array_equal(column(Tick, law_ticks.row, name), to_buffer(value))
