"""How far a demand is from the actuators' limits, and whether it stays inside whatever comes.

The law asks the actuators for forces T (N, E) with T_min <= |T| <= T_max, a tilt below phi* and
T_z >= T_dz_min, which they reach for every heading. On a path with acceleration a and velocity v the law demands

    T = m (a + g e3) - f_D + m z

with drag f_D and the control difference m z of (30). Mass and wind are not known; bounds of
them are (GuardParams). A demand is safe if m (a + g e3) + f_v lies inside by the radius `allowance`:
f_v is the half of the drag that goes with v, the radius all the rest.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from fcu.kernel.algebra import Vec3, maximum, minimum, norm, select
from fcu.kernel.compile import kernel

# Across the thrust, with lambda = sqrt(gamma) and m_hat down to 0.7 of the mass, where it is worst:
# the supremum of the control difference is LASTS / sqrt(gamma) times that of the disturbance's rate
# (an L1 norm), and its response to an initial difference peaks at PEAK e^(-nu_1 t) (README).
LASTS = 1.9374136
PEAK = 1.2472191
SETTLES = 1.4285714  # its gain for what changes slowly, 1 / 0.7, over sqrt(gamma) too
FORGOTTEN = 0.3  # part of the mass that m_hat may be off by when the reference changes
NEAR_NOTHING = 1e-9
KEPT = 0.1  # part of the room at a standstill that is never given away


class Known(NamedTuple):
    """What the margin needs of GuardParams and the law's Params, worked out once a tick."""

    T_min: float  # N
    T_max: float  # N
    T_top: float  # N, so much of that as leaves torque, and room for noise, counted as in hover
    T_z_min: float  # N, floor of the vertical force
    sin: float  # of phi_star
    cos: float
    m_min: float  # kg
    m_max: float  # kg
    g: float  # m/s^2
    c_D: float  # N/(m/s)^2
    w_max: float  # m/s
    z_0: float  # N, control difference that lasts, at rest
    z_1: float  # N/(m/s), and what a speed adds to it
    noise: float  # N, what noise of the measurement takes, in hover
    lift: float  # N, greatest drag from below under which a tilt steers, with torque for a gust
    lean: float  # N, greatest drag from anywhere under which it does
    lean_turns: float  # N, greatest level drag beside which it has torque for a gust along that
    promises: float  # 0: a rotor is lost
    top: float  # m/s, greatest speed of the reference then
    brake: float  # m/s^2
    down: float  # m/s


@kernel
def leant(params, law):
    """The greatest drag (N) in air from anywhere but below under which a tilt steers, whatever torque that leaves."""
    weight = params.m_min * law.g
    k = maximum(params.lift, NEAR_NOTHING) / maximum(weight - params.lift, NEAR_NOTHING)
    return weight / math.sqrt(1.0 / (k * k) + 0.5)


@kernel
def known(params, law):
    """What is known of actuators, air and vehicle; with it the bound beta_2 gamma^(-1/2).

    The control difference m z is bounded by LASTS/sqrt(gamma) times the rate of drag,
    2 c (|v| + w_max) (w_dot_max + g/2), beside what fades (`left`). Paper (30).
    """
    per_rate = LASTS / math.sqrt(law.gamma)
    per_speed = 2.0 * params.c_D * (params.w_dot_max + 0.5 * law.g)
    # noise grows from hover to full thrust, along a chord that lies above it
    noise, hover = params.noise_force, params.m_max * law.g
    more = (params.noise_top - noise) / maximum(law.limits.T_max - hover, 1.0)
    top = (law.limits.T_max + more * (hover + noise)) / (1.0 + more)
    return Known(
        T_min=law.limits.T_min,
        T_max=law.limits.T_max,
        T_top=minimum(top, params.T_turns),
        T_z_min=select(law.achieved > 0.5, law.T_dz_min, 0.0),
        sin=math.sin(law.limits.phi_star),
        cos=math.cos(law.limits.phi_star),
        m_min=params.m_min,
        m_max=params.m_max,
        g=law.g,
        c_D=params.c_D,
        w_max=params.w_max,
        z_0=per_rate * per_speed * params.w_max,
        z_1=per_rate * per_speed,
        noise=noise,
        lift=minimum(params.lift, params.lift_turns),
        lean=leant(params, law),
        lean_turns=params.lean_turns,
        promises=params.promises,
        top=params.top,
        brake=params.brake,
        down=params.down,
    )  # (30)


@kernel
def distance(known, T):
    """From a force T (N, E) to the boundary of what the actuators reach; negative outside.

    Exact inside; outside no farther than it says. The set is the one the law keeps to
    (departure 13): tilt within a cone of phi_star, thrust within [T_min, T_max], height off a floor.
    """
    aside2 = T.x * T.x + T.y * T.y
    aside, size = math.sqrt(aside2), math.sqrt(aside2 + T.z * T.z)
    cone = T.z * known.sin - aside * known.cos
    thrust = minimum(known.T_max - size, size - known.T_min)
    return minimum(minimum(cone, T.z - known.T_z_min), thrust)


@kernel
def tilt_left(phi_star, T):
    """From the tilt of a force to the tilt limit, rad; negative outside."""
    return phi_star - math.atan2(math.sqrt(T.x * T.x + T.y * T.y), T.z)


@kernel
def dragging(known, v):
    """The half of the drag (N, E) that goes with velocity v (m/s, E), against it taken positive.

    Drag is -D (v - w) with D = diag(c_i |v_i - w_i|) in some axes, 0 <= D <= c (|v| + w_max):
    D v lies in a ball about this vector, of the same radius.
    """
    return (0.5 * known.c_D * (norm(v) + known.w_max)) * v


@kernel
def difference(known, speed):
    """Bound (N) of the control difference m z at a speed (m/s), its start forgotten. Paper (30)."""
    return known.z_0 + known.z_1 * speed


@kernel
def allowance(known, v, beta):
    """Radius (N) of what is not known of the demand at velocity v (m/s, E).

    beta : what is left of the control difference of take-over and of changes (`left`), N.
    """
    speed, w_max = norm(v), known.w_max
    drag = known.c_D * (speed + w_max) * (w_max + 0.5 * speed)
    return drag + difference(known, speed) + beta + known.noise


@kernel
def room(known, a, f_v):
    """Distance (N) of m (a + g e3) + f_v to the limits, of the worse mass.

    a : m/s^2, E.  f_v : `dragging`, N, E.
    """
    up = Vec3(a.x, a.y, a.z + known.g)
    light, heavy = known.m_min * up + f_v, known.m_max * up + f_v
    top = known.T_top - maximum(norm(light), norm(heavy))
    return minimum(minimum(distance(known, light), distance(known, heavy)), top)


@kernel
def steering(known, v):
    """By how much (N) drag may still grow at velocity v (m/s, E) for a tilt to steer."""
    rising, fast = known.w_max - minimum(v.z, 0.0), known.w_max + norm(v)
    from_below = known.lift - known.c_D * (rising * rising)
    return minimum(from_below, known.lean - known.c_D * (fast * fast))


@kernel
def steered(params):
    """The greatest speed (m/s) downwards at which a tilt steers, whatever torque that leaves for a gust."""
    return math.sqrt(params.lift / params.c_D) - params.w_max


@kernel
def sinking(known):
    """The greatest speed (m/s) downwards at which a tilt steers in the strongest wind from below.

    It has torque there for a gust. Below zero where it does not steer in hover. Without a rotor it is that
    of the whole vehicle.
    """
    believed = math.sqrt(known.lift / known.c_D) - known.w_max
    return select(known.promises > 0.5, believed, known.down)


@kernel
def condition(known, a, v, beta):
    """By how much (N) the demand of acceleration a at velocity v stays inside, whatever comes.

    The exact set along the reference: what the guard uses. Above zero the demand saturates
    nothing while the beliefs hold.
    """
    left = room(known, a, dragging(known, v)) - allowance(known, v, beta)
    return minimum(left, steering(known, v))


@kernel
def beta_1(params, law, v):
    """Control difference (N) at take-over at v (m/s, E) at most. Paper (30), beta_1.

    Weight that m_hat leaves out, drag that s_v_hat does, and a predictor that starts wrong; the last
    by what the fastest channel, along full thrust, makes of it.
    """
    m_0, T_max = law.initial.m_hat_0, law.limits.T_max
    off = maximum(abs(params.m_max - m_0), abs(params.m_min - m_0))
    air = norm(v) + params.w_max
    fastest = math.sqrt(law.gamma + law.gamma_Lambda * T_max * T_max)
    wrong = params.m_max * fastest * norm(law.initial.v_hat_offset)
    return PEAK * (off * law.g + params.c_D * air * air + wrong)  # (30)


@kernel
def doubt(params, a):
    """Control difference (N) of a change a (m/s^2, E) of what is demanded: m_hat may be off."""
    return FORGOTTEN * params.m_max * norm(a)


class Doubted(NamedTuple):
    """Changes that were demanded, as far as m_hat may be off by them: numbers, or Vec3s."""

    unturned: Any  # that attitude has not followed
    unflown: Any  # and that the rates have not
    beta: Any  # and that is not learnt


@kernel
def left(state):
    """The control difference (N) left of take-over and of the reference's changes.

    m z = (1 - m/m_hat) (T_0 - T_a) + m (v_til' + lambda v_til): of the demand that attitude and rates have
    not followed yet m_hat may be off, whatever is learnt. What is flown is learnt with nu_1 (beta).

    state : GuardState, or a Doubted.
    """
    return state.unturned + state.unflown + state.beta


@kernel
def changed(state, change):
    """A Doubted (or what has its parts) of which a change has just been demanded, as a Doubted."""
    return Doubted(unturned=state.unturned + change, unflown=state.unflown, beta=state.beta)


@kernel
def passed_on(state, kept_angle, kept_rate, kept, peak):
    """A Doubted a step later: from the first to the second to the third.

    state : as of `left`.  kept_angle, kept_rate, kept : what a step leaves of each.  peak : PEAK, or 1 without.
    """
    unflown = state.unflown + (1.0 - kept_angle) * state.unturned
    beta = kept * state.beta + (peak * (1.0 - kept_rate)) * unflown
    return Doubted(unturned=kept_angle * state.unturned, unflown=kept_rate * unflown, beta=beta)


@kernel
def faded(law, state):
    """The Doubted of a state (as of `left`) a tick later.

    beta decays with nu_1 = lambda/2. Paper (30). With an m_hat that is low a demand changes by less than it
    should, and attitude and rates take longer to follow what it should be: by 1/(1 - FORGOTTEN).
    """
    slow = (1.0 - FORGOTTEN) * law.h
    of_attitude = 1.0 / (1.0 + slow * law.c_angle.y)
    of_rates = 1.0 / (1.0 + slow * law.c_rate.y)
    kept = 1.0 / (1.0 + 0.5 * law.h * law.lambda_v)  # (30)
    return passed_on(state, of_attitude, of_rates, kept, PEAK)
