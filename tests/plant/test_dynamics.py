"""The rigid body, rotors, air and ground: conservation, order of convergence, signs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcu.interface.messages import VehicleState
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.buffers import columns, size
from sitl_plant.physics import dynamics, rotors, tick
from sitl_plant.physics.parameters import start_state, wind_params

STILL = Vec3(0.0, 0.0, 0.0)
LEVEL = Quat(1.0, 0.0, 0.0, 0.0)
STOPPED = Rotors(*[0.0] * 8)
AIRLESS = {"drag": [0.0, 0.0, 0.0], "drag_torque": [0.0, 0.0, 0.0]}
UNEVEN = [0.3, 0.45, 0.6]  # kg m^2: tumbling about the middle axis is the hard case


def vec3(row):
    return Vec3(*np.asarray(row, dtype=float).tolist())


def quat(rotation):
    return Quat(*rotation.as_quat(scalar_first=True).tolist())


def attitude(state):
    return Rotation.from_quat(state.q_EB, scalar_first=True)


def energy(params, state):
    v, w, J = np.array(state.v_E), np.array(state.w_B), np.array(params.J)
    return 0.5 * params.m * v @ v + params.m * params.g * state.r_E.z + 0.5 * w @ (J * w)


def angular_momentum_E(params, state):
    return attitude(state).apply(np.array(params.J) * np.array(state.w_B))


def test_tumbling_in_vacuum_conserves_energy_and_angular_momentum(plant, fly):
    params = plant(inertia_kg_m2=UNEVEN, **AIRLESS)
    start = VehicleState(STILL, Vec3(3.0, -2.0, 40.0), LEVEL, Vec3(0.05, 4.0, 0.1), STOPPED)
    end = fly(params, start, 0.0, 10.0)
    assert energy(params, end) == pytest.approx(energy(params, start), rel=1e-9)
    np.testing.assert_allclose(
        angular_momentum_E(params, end), angular_momentum_E(params, start), atol=1e-8
    )
    turned = attitude(end).as_matrix()[2, 2]
    assert turned != pytest.approx(1.0, abs=1e-3)  # it did tumble
    fall = 40.0 * 10.0 - 0.5 * 9.81 * 100.0
    np.testing.assert_allclose(end.r_E, (30.0, -20.0, fall), atol=1e-8)


def test_the_gyroscopic_torque_turns_momentum_and_does_no_work(plant):
    """Rotors that carry momentum and no thrust: w . tau = 0, tau = -w x (J_m Omega_m e3)."""
    params, rng = plant(inertia_kg_m2=UNEVEN, **AIRLESS), np.random.default_rng(33)
    J, J_m = np.array(params.J), params.airframe.J_m
    for Omega_m in (350.0, -120.0):
        w = rng.normal(size=3)
        push = dynamics.Push(8.0, 0.0, STILL, Omega_m, STILL, STILL)
        rates = [
            dynamics.derivative(
                params, dynamics.Body(STILL, STILL, LEVEL, vec3(w)), push._replace(Omega_m=speed)
            ).w_B
            for speed in (Omega_m, 0.0)
        ]
        tau = J * (np.array(rates[0]) - np.array(rates[1]))
        np.testing.assert_allclose(tau, -np.cross(w, (0.0, 0.0, J_m * Omega_m)), atol=1e-15)
        assert w @ tau == pytest.approx(0.0, abs=1e-15)


def test_spinning_rotors_conserve_energy_without_thrust(plant, fly):
    params = plant(inertia_kg_m2=UNEVEN, rotor_lag_s=0.0, **AIRLESS)
    params = params._replace(airframe=params.airframe._replace(c_T=STOPPED, J_m=0.001))
    u = np.where(np.array(params.airframe.spin) > 0.0, 0.8, 0.2)
    start = VehicleState(STILL, STILL, LEVEL, Vec3(1.0, 2.0, 0.5), STOPPED)
    end = fly(params, start, u, 10.0)
    w0, w1, J = np.array(start.w_B), np.array(end.w_B), np.array(params.J)
    assert w1 @ (J * w1) == pytest.approx(w0 @ (J * w0), rel=1e-9)
    assert np.abs(w1 - w0).max() > 0.1


def test_runge_kuttas_error_falls_16_fold_when_the_step_halves(plant, fly):
    wind = {
        "steady_m_s": [9.0, 7.0, 5.0],
        "amplitude_m_s": [2.0, 2.0, 2.0],
        "frequency_rad_s": [3.0, 4.0, 5.0],
    }
    params = plant(wind=wind)
    u = np.array([0.62, 0.63, 0.64, 0.63, 0.62, 0.61, 0.62, 0.63])
    start = start_state(params)._replace(w_B=Vec3(0.8, -0.6, 1.0))

    def end(h):
        lag = params.airframe.rotor_lag
        stepped = params._replace(
            h=h,
            decay=math.exp(-h / lag),
            decay_half=math.exp(-0.5 * h / lag),
            wind=wind_params(h, wind),
        )
        state = fly(stepped, start, u, 0.64)
        return np.array([*state.r_E, *state.v_E, *state.q_EB, *state.w_B])

    exact = end(0.0005)
    errors = [np.linalg.norm(end(h) - exact) for h in (0.016, 0.008, 0.004)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.15)


# Rotor: which way its thrust rolls (+ right down), pitches (+ nose down), its drag yaws (+ left)
SIGNS = {1: "+--", 2: "--+", 3: "---", 4: "-++", 5: "-+-", 6: "+++", 7: "++-", 8: "+-+"}


@pytest.mark.parametrize("rotor", SIGNS)
def test_each_rotor_lifts_and_turns_the_way_of_its_arm_and_spin(plant, rotor):
    params = plant()
    Omega = Rotors(*[300.0 if i == rotor - 1 else 0.0 for i in range(8)])
    thrust, tau = rotors.thrust_and_torque(params, Omega, Rotors(*[1.0] * 8))
    assert thrust == pytest.approx(8.2e-5 * 300.0**2)
    angle = math.radians([22.5, -22.5, -67.5, -112.5, -157.5, 157.5, 112.5, 67.5][rotor - 1])
    arm = 0.5225 * np.array([math.cos(angle), math.sin(angle), 0.0])
    np.testing.assert_allclose(tau[:2], np.cross(arm, (0.0, 0.0, thrust))[:2], atol=1e-12)
    assert abs(tau.z) == pytest.approx(0.0159 * thrust)
    assert "".join("+" if c > 0.0 else "-" for c in tau) == SIGNS[rotor]


def test_rotor_speeds_sum_by_spin_and_rotor_1_turns_counter_clockwise(plant):
    Omega = Rotors(10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 90.0)
    assert rotors.omega_m(plant(), Omega) == 10 - 20 + 30 - 40 + 50 - 60 + 70 - 90


def test_at_hover_trim_the_vehicle_stays(plant, fly, truth):
    params = plant()
    start = start_state(params, {"position_m": [1.0, 2.0, 3.0], "yaw_deg": 30.0})
    thrust = truth(params, start).T
    assert thrust == pytest.approx(8.0 * 9.81, rel=1e-12)
    u = start.Omega.r1 / params.airframe.Omega_max.r1
    end = fly(params, start, u, 5.0)
    np.testing.assert_allclose(end.r_E, (1.0, 2.0, 3.0), atol=1e-9)
    np.testing.assert_allclose(end.w_B, (0.0, 0.0, 0.0), atol=1e-9)
    assert attitude(end).as_euler("ZYX", degrees=True)[0] == pytest.approx(30.0, abs=1e-9)


def test_drag_opposes_the_motion_through_the_air(plant, truth):
    params = plant(drag=[0.1, 0.2, 0.3])
    yawed = quat(Rotation.from_euler("Z", 90.0, degrees=True))  # body x is north
    moving = VehicleState(STILL, Vec3(2.0, 3.0, -4.0), yawed, STILL, STOPPED)
    np.testing.assert_allclose(
        truth(params, moving).f_D_E, (-0.2 * 4.0, -0.1 * 9.0, 0.3 * 16.0), atol=1e-12
    )


def test_the_vehicle_drifts_and_turns_with_the_air(plant, fly, truth):
    wind = {
        "steady_m_s": [6.0, 0.0, 0.0],
        "rotation_amplitude_rad_s": [0.0, 0.0, 2.0],
        "rotation_frequency_rad_s": [0.0, 0.0, 1.0],
    }
    params = plant(wind=wind)
    start = start_state(params)
    assert truth(params, start).v_air_E == (6.0, 0.0, 0.0)
    np.testing.assert_allclose(truth(params, start).f_D_E, (0.15 * 36.0, 0.0, 0.0), atol=1e-12)
    end = fly(params, start, start.Omega.r1 / params.airframe.Omega_max.r1, 1.0)
    assert end.v_E.x == pytest.approx(0.15 * 36.0 / 8.0, rel=0.15)
    assert end.w_B.z > 0.05


def test_wind_is_steady_plus_sinusoids_plus_a_step(plant, truth):
    wind = {
        "steady_m_s": [1.0, 2.0, 3.0],
        "amplitude_m_s": [7.2, 7.2, 5.7],
        "frequency_rad_s": [1.5, 1.6, 1.7],
        "step_m_s": [0.0, -4.0, 0.0],
        "step_at_s": 2.0,
    }
    params = plant(wind=wind)
    start = start_state(params)
    for t, step in ((0.0, 0.0), (1.999, 0.0), (2.0, -4.0), (7.0, -4.0)):
        expected = (
            1.0 + 7.2 * math.sin(1.5 * t),
            2.0 + 7.2 * math.sin(1.6 * t) + step,
            3.0 + 5.7 * math.sin(1.7 * t),
        )
        np.testing.assert_allclose(truth(params, start, t).v_air_E, expected, atol=1e-12)


@pytest.mark.parametrize("lag", [0.02, 0.05, 0.1])
def test_the_rotor_lag_is_exact(plant, fly, lag):
    params = plant(rotor_lag_s=lag)
    start = start_state(params)._replace(Omega=STOPPED)
    end = fly(params, start, 0.5, lag)
    assert end.Omega.r1 == pytest.approx((1.0 - math.exp(-1.0)) * 0.5 * 552.2, rel=1e-12)


def test_a_rotor_without_lag_follows_its_command_throughout_the_step(plant, fly):
    params = plant(rotor_lag_s=0.0, **AIRLESS)
    start = start_state(params)._replace(Omega=STOPPED)
    end = fly(params, start, 0.7, 0.001)
    Omega = 0.7 * 552.2
    assert end.Omega == Rotors(*[params.airframe.Omega_max.r1 * 0.7] * 8)
    lift = 8.0 * 8.2e-5 * Omega**2 / 8.0 - 9.81
    assert end.v_E.z == pytest.approx(0.001 * lift, rel=1e-12)


def test_a_mass_change_takes_effect_at_its_time(plant, fly, truth):
    params = plant(mass_change={"at_s": 1.0, "mass_kg": 6.0}, **AIRLESS)
    start = start_state(params)
    u = start.Omega.r1 / params.airframe.Omega_max.r1
    before = fly(params, start, u, 1.0)
    assert before.v_E.z == pytest.approx(0.0, abs=1e-9)
    assert truth(params, before, 0.999).m == 8.0
    assert truth(params, before, 1.0).m == 6.0
    after = fly(params, before, u, 0.1, t=1.0)
    assert after.v_E.z == pytest.approx(0.1 * 9.81 * (8.0 / 6.0 - 1.0), rel=1e-9)


def test_a_mass_may_change_by_a_part_of_what_it_is(plant, truth):
    params = plant(mass_kg=9.0, mass_change={"at_s": 1.0, "mass_ratio": 0.75}, **AIRLESS)
    assert truth(params, start_state(params), 1.0).m == 0.75 * 9.0


def test_the_wind_begins_at_its_phases_and_is_turned_about_the_vertical(plant, truth):
    sines = {
        "steady_m_s": [1.0, 0.5, -0.5], "amplitude_m_s": [2.0, 3.0, 4.0],
        "frequency_rad_s": [1.5, 1.6, 1.7], "rotation_amplitude_rad_s": [0.7, 0.6, 0.5],
        "rotation_frequency_rad_s": [2.5, 2.4, 2.3],
    }  # fmt: skip
    phases = {"phase_rad": [0.3, 1.0, 2.0], "rotation_phase_rad": [0.1, 0.2, 0.3]}
    params = plant(wind={**sines, **phases, "azimuth_deg": 90.0})
    for t in (0.0, 2.345):
        row = truth(params, start_state(params), t)
        east = 1.0 + 2.0 * math.sin(0.3 + 1.5 * t)
        north = 0.5 + 3.0 * math.sin(1.0 + 1.6 * t)
        up = -0.5 + 4.0 * math.sin(2.0 + 1.7 * t)
        assert row.v_air_E == pytest.approx((-north, east, up), abs=1e-12)  # east is now north
        turning = (0.7, 2.5, 0.1), (0.6, 2.4, 0.2), (0.5, 2.3, 0.3)
        assert row.w_air_B == pytest.approx([a * math.sin(p + f * t) for a, f, p in turning])


def test_within_a_step_the_wind_goes_on_from_its_phases(plant, fly, truth):
    """A vehicle that drag alone moves flies the same, whether time or phase came first."""
    sines = {"amplitude_m_s": [5.0, 6.0, 7.0], "frequency_rad_s": [1.5, 1.6, 1.7]}
    later = plant(wind={**sines, "phase_rad": [1.5 * 2.0, 1.6 * 2.0, 1.7 * 2.0]})
    start = start_state(later)
    moved = fly(later, start, 0.5, 0.2)
    same = fly(plant(wind=sines), start, 0.5, 0.2, t=2.0)
    assert moved.v_E == pytest.approx(same.v_E, abs=1e-12)


def test_a_weak_rotor_loses_thrust_and_torque_at_its_time(plant, fly, truth):
    params = plant(rotor_loss=[{"rotor": 3, "at_s": 0.5, "effectiveness": 0.6}])
    start = start_state(params)
    before, after = truth(params, start, 0.499), truth(params, start, 0.5)
    lost, missing = 0.4 * 8.0 * 9.81 / 8.0, before.T - after.T
    assert missing == pytest.approx(lost, rel=1e-9)
    assert after.tau_B.x == pytest.approx(0.5225 * math.sin(math.radians(67.5)) * lost, rel=1e-9)
    assert after.tau_B.y == pytest.approx(0.5225 * math.cos(math.radians(67.5)) * lost, rel=1e-9)
    assert after.tau_B.z == pytest.approx(0.0159 * lost, rel=1e-9)
    u = start.Omega.r1 / params.airframe.Omega_max.r1
    np.testing.assert_allclose(fly(params, start, u, 0.5).w_B, (0.0, 0.0, 0.0), atol=1e-9)
    assert fly(params, start, u, 0.6).w_B.x > 0.05


def test_attitude_stays_a_rotation(plant, fly):
    params = plant(drag_torque=[0.0, 0.0, 0.0])
    start = start_state(params)._replace(w_B=Vec3(30.0, -20.0, 25.0))
    end = fly(params, start, 0.0, 5.0)
    assert math.hypot(*end.q_EB) == pytest.approx(1.0, abs=1e-15)


def test_each_number_of_the_noise_disturbs_one_component_of_the_report():
    """Three each of position, velocity, attitude (a small rotation about body axes) and body rate."""
    true = np.zeros(size(VehicleState))
    true[columns(VehicleState).index("q_EB.w")] = 1.0
    whole = ["r_E", "v_E", "q_EB", "w_B"]
    for i in range(tick.NOISE):
        noise, reported = np.zeros(tick.NOISE), np.zeros(size(VehicleState))
        noise[i] = 0.02
        tick.sense(true, noise, reported)
        name, axis = whole[i // 3], "xyz"[i % 3]
        off = {columns(VehicleState)[k]: reported[k] for k in np.flatnonzero(reported)}
        q_w = off.pop("q_EB.w")
        half = 0.5 if name == "q_EB" else 1.0  # of a quaternion: half the angle
        assert off == pytest.approx({f"{name}.{axis}": half * 0.02}, rel=1e-4)
        assert q_w == pytest.approx(1.0, abs=1e-4)
