"""Types of the simulator: constants (PlantParams), recorded row (PlantRecord).

The integrated state is a VehicleState, of which the noise is no part. Frames: E is Earth East-North-Up, B is body Forward-Left-Up; SI units.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.interface.airframe import Airframe
from fcu.interface.messages import Battery, VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from sitl_plant.physics.battery import BatteryParams
from sitl_plant.physics.wind.sines import Phases


class WindParams(NamedTuple):
    """Parameters of the velocity and rotation of the air over time (paper, Section VIII)."""

    steady: Vec3  # m/s, E: the direction the air moves to, not where it comes from
    amplitude: Vec3  # m/s, E
    frequency: Vec3  # rad/s
    phase: Vec3  # rad, at time 0
    rotation_amplitude: Vec3  # rad/s, B: air-mass rotation
    rotation_frequency: Vec3  # rad/s
    rotation_phase: Vec3  # rad, at time 0
    step: Vec3  # m/s, E: added from step_time on
    step_time: float  # s; NEVER without a step
    azimuth_cos: float  # of the angle by which the velocity is turned about the vertical
    azimuth_sin: float
    half_step: Phases  # phase advance per half integration step
    rotation: Vec3  # rad/s, B: air-mass rotation of a field
    inflow: Rotors  # factor of thrust and torque of each rotor in a field, 1 without


class GroundParams(NamedTuple):
    """Landing gear on flat ground: a spring and damper, friction, a righting torque."""

    z: float  # height of the ground, or of the roof below the vehicle, m
    gear: float  # height of the centre of mass above the feet of the gear, m
    stiffness: float  # N/m
    damping: float  # N s/m
    friction: float  # coefficient
    footprint: float  # m, half the width of the gear, its lever arm against tilt
    impact_max: float  # m/s: a faster touchdown is a crash
    wall: float  # 0; 1 in a building, 2 outside the field of wind


class PlantParams(NamedTuple):
    """True parameters of the vehicle and its environment."""

    h: float  # integration step, s
    g: float  # m/s^2
    m: float  # kg
    m_after: float  # kg, from m_time on
    m_time: float  # s; NEVER if the mass is constant
    J: Vec3  # principal moments of inertia, kg m^2
    c_D: Vec3  # quadratic drag, N/(m/s)^2, body axes
    c_tau: Vec3  # quadratic drag torque, N m/(rad/s)^2, body axes
    airframe: Airframe
    decay_half: float  # exp(-h/2 / rotor_lag), 0 without lag
    decay: float  # exp(-h / rotor_lag)
    loss_time: Rotors  # s; time at which each rotor loses effectiveness, or NEVER
    effectiveness: Rotors  # remaining fraction of thrust and torque from loss_time on
    wind: WindParams
    ground: GroundParams
    battery: BatteryParams
    arena: float  # m; a flight that gets farther from its start has diverged


class PlantRecord(NamedTuple):
    """The true state at one control tick; trajectory hashes cover the first 22 columns."""

    t: float  # s
    state: VehicleState
    v_air_E: Vec3  # velocity of the air, m/s
    w_air_B: Vec3  # rotation of the air mass, rad/s
    f_D_E: Vec3  # drag force, N
    T: float  # total thrust, N
    tau_B: Vec3  # torque of the rotors, N m
    m: float  # current mass, kg
    J: Vec3  # current inertia, kg m^2
    on_ground: float  # 1 while the gear touches
    battery: Battery
    ended: float  # 0 flying, 1 diverged, 2 crashed, 3 hit a building, 4 left the field of wind
