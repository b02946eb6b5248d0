"""The plant's constants (PlantParams) and what changes (PlantState, PlantRecord).

Frames: E is Earth East-North-Up, B is body Forward-Left-Up; SI units.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.interface.airframe import Airframe
from fcu.interface.messages import Battery
from fcu.kernel.algebra import Quat, Rotors, Vec3
from sitl_plant.physics.battery import BatteryParams
from sitl_plant.physics.wind.field import Phases


class WindParams(NamedTuple):
    """The velocity and rotation of the air, as functions of time (paper, Section VIII)."""

    steady: Vec3  # m/s, E: the velocity of the air, not where it comes from
    amplitude: Vec3  # m/s, E
    frequency: Vec3  # rad/s
    rotation_amplitude: Vec3  # rad/s, B: air-mass rotation
    rotation_frequency: Vec3  # rad/s
    step: Vec3  # m/s, E: added from step_time on
    step_time: float  # s; NEVER without a step
    half_step: Phases  # what the phases turn by in half an integration step


class GroundParams(NamedTuple):
    """Landing gear on flat ground: a spring and damper, friction, a levelling torque."""

    z: float  # height of the ground, m
    gear: float  # height of the centre of mass over the gear's feet, m
    stiffness: float  # N/m
    damping: float  # N s/m
    friction: float  # coefficient
    footprint: float  # m, half width over which the gear resists tilt
    impact_max: float  # m/s: touching down faster is a crash


class PlantParams(NamedTuple):
    """What is true of the vehicle and its world."""

    h: float  # integration step, s
    g: float  # m/s^2
    m: float  # kg
    m_after: float  # kg, from m_time on
    m_time: float  # s; NEVER without
    J: Vec3  # principal moments of inertia, kg m^2
    c_D: Vec3  # quadratic drag, N/(m/s)^2, body axes
    c_tau: Vec3  # quadratic drag torque, N m/(rad/s)^2, body axes
    airframe: Airframe
    decay_half: float  # exp(-h/2 / rotor_lag), 0 without lag
    decay: float  # exp(-h / rotor_lag)
    loss_time: Rotors  # s from which a rotor has lost effectiveness; NEVER without
    effectiveness: Rotors  # the fraction of thrust and torque left from then on
    wind: WindParams
    ground: GroundParams
    battery: BatteryParams
    arena: float  # m from the start beyond which the flight is called diverged


class PlantState(NamedTuple):
    """The state that is integrated."""

    r_E: Vec3  # m
    v_E: Vec3  # m/s
    q_EB: Quat  # body to Earth
    w_B: Vec3  # rad/s
    Omega: Rotors  # rad/s, unsigned


class PlantRecord(NamedTuple):
    """The truth at one control tick, as recorded; the first 22 are what the hash covers."""

    t: float  # s
    state: PlantState
    v_air_E: Vec3  # velocity of the air, m/s
    w_air_B: Vec3  # rotation of the air mass, rad/s
    f_D_E: Vec3  # drag force, N
    T: float  # total thrust, N
    tau_B: Vec3  # torque of the rotors, N m
    m: float  # mass in force, kg
    J: Vec3  # inertia in force, kg m^2
    on_ground: float  # 1 while the gear touches
    battery: Battery
    ended: float  # 0 flying, 1 diverged, 2 crashed
