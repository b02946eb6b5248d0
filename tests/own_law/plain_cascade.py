"""A plain cascade: P on position, PD on velocity, P on attitude, P on body rates. It learns nothing."""

from math import atan2, cos, hypot, nan, sin
from typing import NamedTuple

from fcu.interface.messages import RotorCommand
from fcu.interface.parameter import Parameter
from fcu.kernel.algebra import Vec3, clip, clip3, maximum, select, select3
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, matrix, wrap
from fcu.laws.allocation import RotorParams, achieved, allocate, speed_command
from fcu.laws.face import Limits, Outputs, Reference, Saturation


class Params(NamedTuple):
    h: float  # control period, s
    limits: Limits
    rotors: RotorParams
    m: float  # mass, kg
    J: float  # inertia about every axis, kg m^2
    k_r: float  # commanded velocity over error of position, 1/s
    k_v: float  # commanded acceleration over error of velocity, 1/s
    d_v: float  # the same over rate of velocity
    k_angle: float  # commanded body rate over error of angle, 1/s
    k_rate: float  # commanded angular acceleration over error of body rate, 1/s


PARAMETERS = (
    Parameter("m", "PC_MASS", 8.0, 1.0, 20.0, "kg", "believed mass"),
    Parameter("J", "PC_INERTIA", 0.35, 0.01, 2.0, "kg m^2", "believed inertia"),
    Parameter("k_r", "PC_K_R", 1.0, 0.1, 5.0, "1/s", "gain of position", gain=True),
    Parameter("k_v", "PC_K_V", 3.0, 0.1, 10.0, "1/s", "gain of velocity", gain=True),
    Parameter("d_v", "PC_D_V", 0.1, 0.0, 1.0, "", "gain of the rate of velocity", gain=True),
    Parameter("k_angle", "PC_K_ANGLE", 6.0, 0.1, 20.0, "1/s", "gain of the angles", gain=True),
    Parameter("k_rate", "PC_K_RATE", 20.0, 0.1, 60.0, "1/s", "gain of the body rates", gain=True),
)


class State(NamedTuple):
    v_E: Vec3  # velocity at the last tick, m/s, E
    v_dot: Vec3  # its rate, low-passed, m/s^2, E


class Internals(NamedTuple):
    v_c: Vec3  # commanded velocity, m/s, E
    tau_c: Vec3  # commanded torque, N m, B


@kernel
def take_over(params, setpoint, measured):
    return step(State(v_E=measured.v_E, v_dot=Vec3(0.0, 0.0, 0.0)), params, setpoint, measured)


@kernel
def step(state, params, setpoint, measured):
    limits, v, angles = params.limits, measured.v_E, euler(matrix(measured.q_EB))
    v_c = clip3(setpoint.v_c + params.k_r * (setpoint.r_c - measured.r_E), -5.0, 5.0)
    v_dot = state.v_dot + 20.0 * (v - state.v_E - params.h * state.v_dot)
    a = setpoint.a_c + params.k_v * (v_c - v) - params.d_v * v_dot
    f = Vec3(a.x, a.y, maximum(a.z + 9.81, 2.0))  # never downwards: it would turn over
    ahead = cos(angles.z) * f.x + sin(angles.z) * f.y
    left = cos(angles.z) * f.y - sin(angles.z) * f.x
    T_wanted = select(setpoint.level > 0.5, setpoint.T_c, params.m * hypot(hypot(ahead, left), f.z))
    T_c = clip(T_wanted, limits.T_min, limits.T_max)
    wanted = Vec3(-atan2(left, hypot(ahead, f.z)), atan2(ahead, f.z), 0.0)
    wanted = select3(setpoint.level > 0.5, setpoint.tilt_c, wanted)
    tilt = clip3(wanted, -limits.phi_star, limits.phi_star)
    w_c = Vec3(tilt.x - angles.x, tilt.y - angles.y, 0.2 * wrap(setpoint.psi_c - angles.z))
    w_c = select3(setpoint.level > 1.5, setpoint.w_c, params.k_angle * w_c)
    tau_c = (params.J * params.k_rate) * (w_c - measured.w_B)
    thrusts, gave_up = allocate(params.rotors, T_c, tau_c)
    u = speed_command(params.rotors, thrusts, measured.Omega)
    T, none = achieved(params.rotors, measured.Omega * measured.Omega)[0], Vec3(nan, nan, nan)
    past = select((tilt.x != wanted.x) | (tilt.y != wanted.y), 1.0, 0.0)
    cut = Saturation(select(T_c != T_wanted, 1.0, 0.0), past, gave_up.torque, gave_up.yaw)
    outputs = Outputs(
        reference=Reference(r_m=none, v_m=none), e_r=none, T_c=T_c, T_achieved=T, angles=angles,
        angles_c=Vec3(tilt.x, tilt.y, setpoint.psi_c), w_c=w_c, thrusts=thrusts, saturation=cut,
    )  # fmt: skip
    return State(v_E=v, v_dot=v_dot), RotorCommand(u=u), outputs, Internals(v_c=v_c, tau_c=tau_c)
