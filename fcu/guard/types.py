"""What the guard is told once (GuardParams), remembers (GuardState), and tells (GuardInternals)."""

from __future__ import annotations

from typing import NamedTuple

from fcu.kernel.algebra import Vec3


class GuardParams(NamedTuple):
    """What is believed of the flight to come, and what is done when it does not fit the actuators."""

    policy: float  # 0 warn, 1 govern, 2 refuse
    m_min: float  # kg, the vehicle's mass is believed to lie
    m_max: float  # kg, between these
    c_D: float  # N/(m/s)^2, greatest drag coefficient of any body axis
    w_max: float  # m/s, greatest velocity of the air
    w_dot_max: float  # m/s^2, greatest rate of that velocity
    jerk: float  # m/s^3, fastest change of the reference's acceleration, whatever the rotors hold
    J_tilt: float  # kg m^2, greatest inertia about roll and pitch
    J_yaw: float  # kg m^2, about yaw
    m: float  # kg, middle of the mass that the airframe is believed to have
    J_x: float  # kg m^2, and of its inertia about each body axis
    J_y: float
    J_z: float
    heavier: float  # greatest over least mass of the airframe: m_hat over m at most
    gaussian: float  # 1: noise of what is measured is white, of these sigmas; 0: within these
    noise_r: float  # m, of position, each axis
    noise_v: float  # m/s, of velocity
    noise_q: float  # rad, of attitude
    noise_w: float  # rad/s, of the body rates
    delay_s: float  # s, from measurement to rotor, beside the rotor's lag
    noise_force: float  # N, what that noise takes of the force in hover (`noise.derived`)
    noise_top: float  # N, of it at full thrust
    noise_torque: float  # N m, of the torque about a level axis
    noise_turning: float  # N m N, and over the thrust
    lift: float  # N, greatest drag from below under which a tilt steers (`stability.lift`)
    swinging: float  # 1/s, angular acceleration over the rate of the demand, at most (`torque`)
    spread: float  # 1/m, thrust of the rotor that gives most of it for a torque about a level axis
    lift_turns: float  # N, greatest drag from below beside which a tilt has torque for a gust
    lean_turns: float  # N, greatest level drag beside which it has torque for a gust along that
    T_turns: float  # N, greatest thrust beside which roll and pitch have torque for the least jerk
    promises: float  # 1: what is believed holds; 0: a rotor is lost, and what follows is kept to
    top: float  # m/s, greatest speed of the reference of the whole vehicle (`governor.speeds`)
    brake: float  # m/s^2, that it brakes with
    down: float  # m/s, greatest speed downwards (`margin.sinking`)


class Signs(NamedTuple):
    """What speaks against the beliefs, smoothed: `contradictions`."""

    mass: float  # N, up: a lasting force that no believed mass explains
    drag: float  # N, horizontal drag that is estimated, beyond the most that is believed
    thrust: float  # N, commanded minus achieved
    trim: float  # part of the time that the trim of thrust is at its limit


class GuardState(NamedTuple):
    """What the guard remembers from tick to tick."""

    a_m: Vec3  # acceleration of the reference model at the last tick, m/s^2, E
    unturned: float  # control difference of its changes that attitude has not followed, N
    unflown: float  # and that the rates have not
    beta: float  # control difference left of take-over, and of what is flown, N (30)
    psi_g: float  # yaw that is commanded, rad: the setpoint's, or governed
    psi_g_dot: float  # its rate, rad/s
    signs: Signs


class Margin(NamedTuple):
    """How far the demand is from what the actuators reach; negative outside."""

    force: float  # N, from the demanded force to the nearest limit
    tilt: float  # rad, from its tilt to the tilt limit
    condition: float  # N, by which the condition for what is still to come holds


class Contradicted(NamedTuple):
    """What in flight contradicts the beliefs, 1 while it does."""

    lighter: float  # mass below the least believed, thrust above the believed, or wind from below
    heavier: float  # mass above the greatest believed, thrust below the believed, or from above
    drag: float  # wind or drag coefficient above the greatest believed
    thrust: float  # the rotors do not give the thrust commanded
    trim: float  # the trim of thrust is at its limit


class GuardInternals(NamedTuple):
    """What the guard did at one tick: recorded, shown, never fed back."""

    r_g: Vec3  # position setpoint that the reference model is given, m, E: r_c, or governed
    governed: float  # 1 while that is not r_c
    margin: Margin
    contradicted: Contradicted
