"""Bounds of the position and body-rate loops of the octocopter in flight, with a moving regressor.

The loops are those of the achieved form (`fcu.theory.octocopter`), with constant mass and inertia
and without saturation. rho = Lambda / Lambda_hat is m_hat/m or J_hat/J, a is the
acceleration that the reference model demands at the actual state, and T is the force or torque.
Then, exactly,

    x_til' = -k x_til + z              z' = delta - G(t) x_til
    delta  = s' - (1 - rho) a'         G  = rho (gamma + gamma_Lambda T T^T)
    e' = A e + B z                     T  = m (a + z - s - g)

and a follows from the reference trajectory and z. In a frame that rotates with T, G is diagonal;
the frame rotates at most at |T'|/|T|. The rotation, the change of G and a' are bounded in terms of
the bounds themselves: a small-gain argument. NoBoundError is raised if its gain is not below one.
An iteration finds the ranges of T and T' (`position_bounds` says why they hold at all times).

While the projection of m_hat (J_hat) acts, the term with gamma_Lambda is smaller, down to 0. The
bounds of the rates count on gamma alone; those of the position do with `Flight.projected`, else
they are those of a flight in which that projection does not act, which only the flight tells.
s_hat = s + (1 - 1/rho) T/m - z is below `s_hat`: its projection onto a larger set never acts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fcu.guard.responses import Matrix, decay, gain, peak
from fcu.laws.mmrac.types import Params
from fcu.theory.control_difference import ControlDifference
from fcu.theory.linear_loop import Loop, NoBoundError
from fcu.theory.octocopter import position_model

ROUNDS = 60  # iterations; the iteration converges geometrically or diverges
SLACK = 1e-3  # relative increase of the assumed bounds over the found bounds, per iteration


class Flight(NamedTuple):
    """Assumptions about a flight by axis (each (3,), bounds of absolute values at all times)."""

    s: Matrix  # disturbance, m/s^2 or rad/s^2
    s_rate: Matrix  # rate of s
    a: Matrix  # acceleration of the reference trajectory
    jerk: Matrix  # rate of that acceleration
    rho_low: Matrix | float = (
        1.0  # estimate of mass (one) or inertia (3,) over the truth, in flight
    )
    rho_high: Matrix | float = 1.0
    z_0: Matrix | float = 0.0  # |z| at the start: s(0) - s_hat(0) + (rho - 1) T/m_hat
    x_til_0: Matrix | float = 0.0
    e_0: float = 0.0  # norm of the initial tracking error
    projected: bool = False  # whether the projection of the mass or inertia estimate may act


class FlightBounds(NamedTuple):
    """Bounds of norms, over all times and after the transient."""

    prediction: float  # m/s, rad/s
    prediction_settled: float
    control: ControlDifference  # (30); N, N m
    tracking: float  # of position (m) or of the rates (rad/s)
    tracking_settled: float
    loop_gain: float  # of the small-gain argument, below 1
    z: float  # |z| at all times, m/s^2, rad/s^2
    s_hat: float  # |s_hat| at all times, m/s^2, rad/s^2: a larger set for it never acts


def at_rest(s: Matrix, s_rate: Matrix) -> Flight:
    """Hover: the reference trajectory is a point, and mass or inertia is known."""
    return Flight(np.asarray(s), np.asarray(s_rate), np.zeros(3), np.zeros(3))


def position_loop(params: Params, mass: float, G: Matrix | None = None) -> Loop:
    """Loop of x_til = v_til (m/s), z (m/s^2), e of position and velocity; control in N.

    G : 3 x 3, 1/s^2; default: G at hover. Paper (34)-(38).
    """
    if G is None:
        G = np.diag(stiffness(params, mass, mass * params.g))
    (A, drive_e), eye = position_model(params), np.eye(3)
    return Loop(
        F=-params.lambda_v * eye, drive=eye, output=eye, G=G, A=A, drive_e=drive_e,
        control=mass * eye, unknown=0.0 * eye, unknown_e=0.0 * drive_e, unknown_v=mass * eye,
    )  # fmt: skip


def stiffness(params: Params, mass: float, T_0: float, m_hat: float | None = None) -> Matrix:
    """G (1/s^2), the adaptation rate of z: across (twice) and along a constant force T_0 (N).

    The achieved form estimates 1/m; the printed form estimates m from the demanded specific force.
    """
    m_hat = mass if m_hat is None else m_hat
    across = params.gamma * m_hat / mass
    if params.achieved:
        along = across + params.gamma_Lambda * T_0 * T_0 * m_hat / mass
    else:
        along = across + params.gamma_m * (T_0 / m_hat) ** 2 / mass
    return np.array([across, across, along])


class _Channels(NamedTuple):
    """c coupled second-order channels, followed by the reference model."""

    k: float  # 1/s
    low: Matrix  # (c,), lower bound of G
    high: Matrix  # (c,), upper bound of G
    delta: Matrix  # (c,), |s'| + |1 - rho| |a'| of the reference trajectory
    turning: Matrix  # (c, c), rotation rate of the channels into each other, rad/s
    echo: Matrix  # (c, c), gain from a bound of |z| to delta


class _Bound(NamedTuple):
    X: Matrix  # (c,), |x_til|
    Z: Matrix  # (c,), |z|
    loop_gain: float


def _solved(channels: _Channels, x_0: Matrix, z_0: Matrix, lasting: bool, rate: float) -> _Bound:
    """Bounds of e^(rate t) |x_til| and |z| that delta (if `lasting`) and the start cause."""
    c = len(channels.low)
    to_X, to_Z = np.zeros((c, 2 * c)), np.zeros((c, 2 * c))
    begun_X, begun_Z = np.zeros(c), np.zeros(c)
    for i in range(c):
        M = np.array([[-channels.k, 1.0], [-0.5 * (channels.low[i] + channels.high[i]), 0.0]])
        g = gain(M + rate * np.eye(2), norm="entries")
        to_X[i, [i, c + i]], to_Z[i, [i, c + i]] = g[0], g[1]
        if x_0[i] > 0.0 or z_0[i] > 0.0:
            begun = peak(M, rate=rate, norm="entries") @ [x_0[i], z_0[i]]
            begun_X[i], begun_Z[i] = begun
    departure = np.diag(0.5 * (channels.high - channels.low))
    into = np.block([
        [channels.turning, np.zeros((c, c))],
        [departure, channels.turning + channels.echo],
    ])  # fmt: skip
    way = np.vstack([to_X, to_Z])
    feedback = way @ into
    radius = float(np.abs(np.linalg.eigvals(feedback)).max())
    if radius >= 1.0:
        raise NoBoundError(
            f"no bound: force or estimates move too far, loop gain {radius:.3g}, not below 1"
        )
    source = np.concatenate([begun_X, begun_Z])
    if lasting:
        source = source + way[:, c:] @ channels.delta
    found = np.linalg.solve(np.eye(2 * c) - feedback, source)
    return _Bound(found[:c], found[c:], radius)


def _pair(across: Matrix, along: float) -> Matrix:
    return np.array([float(np.linalg.norm(across)), along])


def position_bounds(params: Params, mass: float, flight: Flight) -> FlightBounds:
    """Bounds of the position loop in flight: prediction (m/s), control (N), tracking (m).

    Z (across and along T), X (across) and `tilt` are assumed bounds of |z|, of |x_til| and of the
    sine of the angle between T and the vertical. The iteration ends when they are invariant:

        1. While |z| <= Z and the sine is at most `tilt`, T = m (a + z - s - g) is from `least` to
           `most` long, and its own tilt follows: it must be at most `tilt`.
        2. While also |x_til| <= X, T turns at `turning` at most. So G(t) is from `low` to `high`,
           and delta is bounded, in the frame of T.
        3. For such G and delta the small-gain argument gives `ever`, bounds of |z| and |x_til|.

    If `ever` is below Z and X, no signal is the first to leave its assumed bound: all are
    continuous, start below it, and stay below `ever` until one of them leaves. So 1 to 3 hold at
    all times. Each round assumes the bounds that the last one found, and SLACK more, which keeps
    the inequalities strict; bounds of 0 are those of a loop at rest without an input.

    Raises NoBoundError if the force or the mass estimate may vary too much for a bound.
    """
    (A, B), k, g = position_model(params), params.lambda_v, params.g
    rho_low, rho_high = float(flight.rho_low), float(flight.rho_high)
    off = max(1.0 - rho_low, rho_high - 1.0)
    asked = B.T @ A  # a as a function of e; a' adds asked B as a function of z
    a_of_z = float(gain(A, B, asked)[0, 0])
    jerk_of_z = _jerk(A, B, asked, 0.0)
    a_0 = float(np.linalg.norm(flight.a)) + float(peak(A, C=asked)[0, 0]) * flight.e_0
    jerk_0 = float(np.linalg.norm(flight.jerk)) + float(peak(A, C=asked @ A)[0, 0]) * flight.e_0
    z_start, x_start = (np.full(3, v) if np.ndim(v) == 0 else np.asarray(v)
                        for v in (flight.z_0, flight.x_til_0))  # fmt: skip

    Z, X, tilt = _pair(z_start[:2], float(z_start[2])), 0.0, 0.0
    for _ in range(ROUNDS):
        Z, X, tilt = Z * (1.0 + SLACK), X * (1.0 + SLACK), tilt * (1.0 + SLACK)
        aside = float(np.linalg.norm(flight.s[:2])) + a_0 + (1.0 + a_of_z) * (Z[0] + tilt * Z[1])
        upward = float(flight.s[2]) + a_0 + (1.0 + a_of_z) * (Z[1] + tilt * Z[0])
        most = mass * math.hypot(g + upward, aside)
        least = mass * max(g - upward, 0.0)
        if least <= 0.0:
            raise NoBoundError(
                "no bound: the force may vanish, which leaves its direction undefined"
            )
        assumed, tilt = tilt, min(aside * mass / least, 1.0)
        high = rho_high * (params.gamma + np.array([0.0, params.gamma_Lambda * most**2]))
        taught = 0.0 if flight.projected else params.gamma_Lambda * least**2
        low = rho_low * (params.gamma + np.array([0.0, taught]))
        jerk = jerk_0 + jerk_of_z * float(Z.sum())
        # across its direction T = m_hat (a - g - s_hat) changes only by a', s_hat' = gamma x_til
        turning = rho_high * mass * (jerk + params.gamma * X) / least
        level, up = float(np.linalg.norm(flight.s_rate[:2])), float(flight.s_rate[2])
        delta = np.array([level + tilt * up, up + tilt * level]) + off * jerk_0
        seen = off * np.array([[1.0, tilt], [tilt, 1.0]])  # Earth axes from the axes of T
        channels = _Channels(k, low, high, delta, turning * (1.0 - np.eye(2)), jerk_of_z * seen)
        x_0 = _pair(x_start[:2], float(x_start[2])) + tilt * np.linalg.norm(x_start)
        z_0 = _pair(z_start[:2], float(z_start[2])) + tilt * np.linalg.norm(z_start)
        ever = _solved(channels, x_0, z_0, True, 0.0)
        if np.all(ever.Z <= Z) and ever.X[0] <= X and tilt <= assumed:
            break
        Z, X = ever.Z, float(ever.X[0])
    else:
        raise NoBoundError(
            "no bound: the force bound iteration did not converge; the flight moves too far"
        )

    settled = _solved(channels, 0.0 * x_0, 0.0 * z_0, True, 0.0)
    slow = 0.5 * min(decay(A), *(_slowest(k, G) for G in 0.5 * (low + high)))
    weighted = channels._replace(echo=_jerk(A, B, asked, slow) * seen)
    beta_1 = _forgetting(weighted, x_0, z_0, slow)
    # e'' + 2 zeta f e' + f^2 e = z = x_til' + k x_til: bound by z or by x_til, whichever is smaller
    position = np.hstack([np.eye(3), np.zeros((3, 3))])
    by_z = float(gain(A, B, position)[0, 0])
    by_x = float(gain(A, A @ B + k * B, position)[0, 0])
    begun = float(peak(A, C=position)[0, 0]) * flight.e_0
    from_x_0 = float(peak(A, B, position)[0, 0]) * float(np.linalg.norm(x_start))
    X_ever, Z_ever = float(np.linalg.norm(ever.X)), float(np.linalg.norm(ever.Z))
    X_settled, Z_settled = float(np.linalg.norm(settled.X)), float(np.linalg.norm(settled.Z))
    return FlightBounds(
        prediction=X_ever,
        prediction_settled=X_settled,
        control=ControlDifference(mass * beta_1, slow, mass * Z_settled),
        tracking=min(by_z * Z_ever, by_x * X_ever + from_x_0) + begun,
        tracking_settled=min(by_z * Z_settled, by_x * X_settled),
        loop_gain=ever.loop_gain,
        z=Z_ever,
        s_hat=float(np.linalg.norm(flight.s))
        + _misjudged(rho_low, rho_high) * most / mass
        + Z_ever,
    )


def _misjudged(rho_low: float, rho_high: float) -> float:
    """Largest |1 - 1/rho|: the part of T/m that s_hat may hold, because s_hat = s - z + that."""
    return max(1.0 / rho_low - 1.0, 1.0 - 1.0 / rho_high)


def _slowest(k: float, G: float) -> float:
    return decay(np.array([[-k, 1.0], [-G, 0.0]]))


def _jerk(A: Matrix, B: Matrix, asked: Matrix, rate: float) -> float:
    """L1 gain from z to the part of a' that depends on e: asked (A e + B z)."""
    M = A + rate * np.eye(len(A))
    return float(gain(M, B, asked @ A)[0, 0] + np.linalg.norm(asked @ B, 2))


def _forgetting(channels: _Channels, x_0: Matrix, z_0: Matrix, rate: float) -> float:
    """beta_1 of (30) for z at this decay rate; 0 if the initial errors are 0."""
    if not (np.any(x_0) or np.any(z_0)):
        return 0.0
    return float(np.linalg.norm(_solved(channels, x_0, z_0, False, rate).Z))


def rate_bounds(params: Params, inertia: Matrix, flight: Flight) -> list[FlightBounds]:
    """Bounds of each of the three rate loops: prediction and tracking (rad/s), control (N m).

    inertia : (3,), kg m^2. Neglects the couplings: assumes no rotation except that caused by the
    errors. Raises NoBoundError.
    """
    return [_rate_bounds(params, axis, float(inertia[axis]), flight) for axis in range(3)]


def _rate_bounds(params: Params, axis: int, J: float, flight: Flight) -> FlightBounds:
    c, k = float(params.c_rate[axis]), params.lambda_w
    rho_low, rho_high = (
        float(np.broadcast_to(rho, 3)[axis]) for rho in (flight.rho_low, flight.rho_high)
    )
    off = max(1.0 - rho_low, rho_high - 1.0)
    s, s_rate = float(flight.s[axis]), float(flight.s_rate[axis])
    z_0, x_0 = (np.broadcast_to(np.asarray(v, dtype=float), 3)[axis : axis + 1]
                for v in (flight.z_0, flight.x_til_0))  # fmt: skip
    a_0, jerk_0 = (
        float(flight.a[axis]) + c * flight.e_0,
        float(flight.jerk[axis]) + c * c * flight.e_0,
    )
    Z = float(z_0[0])
    for _ in range(ROUNDS):
        Z *= 1.0 + SLACK
        torque = J * (a_0 + s + 2.0 * Z)  # the gain from z to a is 1, and z itself adds 1
        low = np.array([rho_low * params.gamma])
        high = np.array([rho_high * (params.gamma + params.gamma_LambdaJ * torque**2)])
        echo = np.array([[off * 2.0 * c]])  # a' of z: -c s/(s + c)
        delta = np.array([s_rate + off * jerk_0])
        channels = _Channels(k, low, high, delta, np.zeros((1, 1)), echo)
        ever = _solved(channels, x_0, z_0, True, 0.0)
        if float(ever.Z[0]) <= Z:
            break
        Z = float(ever.Z[0])
    else:
        raise NoBoundError(
            "no bound: the torque bound iteration did not converge; the flight moves too far"
        )
    settled = _solved(channels, 0.0 * x_0, 0.0 * z_0, True, 0.0)
    slow = 0.5 * min(c, _slowest(k, float(0.5 * (low + high)[0])))
    echo = np.array([[off * (c + c * c / (c - slow))]])
    beta_1 = _forgetting(channels._replace(echo=echo), x_0, z_0, slow)
    by_x = float(gain(np.array([[-c]]), np.array([[k - c]]))[0, 0]) + 1.0
    start = float(x_0[0]) + flight.e_0

    def tracking(of: _Bound) -> float:
        return min(float(of.Z[0]) / c, by_x * float(of.X[0]))

    return FlightBounds(
        prediction=float(ever.X[0]),
        prediction_settled=float(settled.X[0]),
        control=ControlDifference(J * beta_1, slow, J * float(settled.Z[0])),
        tracking=tracking(ever) + start,
        tracking_settled=tracking(settled),
        loop_gain=ever.loop_gain,
        z=float(ever.Z[0]),
        s_hat=s + _misjudged(rho_low, rho_high) * torque / J + float(ever.Z[0]),
    )
