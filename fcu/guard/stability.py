"""Which gains fly together: the closed loop about hover, tick by tick, and whether it is stable.

Law and vehicle linearised about hover at rest, without wind, as they act once a tick: the law's
step as it is in its folder, then a rigid body under rotors whose lag is known, exactly. One
matrix a channel; it is stable if all its eigenvalues lie inside the unit circle. It is asked to
be so for estimates of mass and inertia that are right and that are 3 dB off either way (the gain
margin), and with rotors that answer late because their command is cut.
README, "Which gains go together". Only for prediction = "achieved".

Each matrix also has what noise of the measurement goes in by, and what is demanded comes out by; and
may have what is measured come late (`noise`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Protocol

import numpy as np

from fcu.guard.types import GuardParams
from fcu.laws.actuation import rotor_lag as rotor_lag
from fcu.laws.mmrac.types import Params

Matrix = np.ndarray[Any, np.dtype[np.float64]]
Row = Matrix  # of one number, over those before the tick

LIFT, SINK = 1.3, 0.25  # of its weight: the least T_max, the greatest T_min
LEARNT = 0.1  # gamma_LambdaJ J^2 (s^2) under which an inertia is as good as not learnt
FIRST = 2.0  # factor by which the first estimate of mass may be off
ROTATION = ("roll", "pitch", "yaw")
TILTS = ROTATION[:2]
OFF = (1.0, 1.0 / math.sqrt(2.0), math.sqrt(2.0))  # estimates over truth: right, and 3 dB off
CARRIED, HALVINGS = 0.95, 8  # part of the weight that drag carries at most; of a search for less
# What is left of the inverted lag when its command is cut. Set by flights: with 2, combinations pass
# that fail even in small steps; with 1, combinations that settle after large ones do not.
KAPPA_CUT = 1.5
LAGS = (0.4, 1.6)  # of the believed lag of a rotor, between which the true one is believed to lie
NEAR_NOTHING = 1e-3  # N


class Fade(NamedTuple):
    """What is left after a tick of a step that a rotor has not followed yet, and its integrals."""

    left: float  # e^(-h/lag)
    once: float  # over the tick, s
    twice: float  # and again, s^2
    thrice: float
    fourfold: float


def fade(params: Params, part: float = 1.0) -> Fade:
    """Of e^(-t/lag) over a tick.  part : of the believed lag, that the rotors have."""
    h, lag = params.h, part * rotor_lag(params)
    left = math.exp(-h / lag) if lag > 0.0 else 0.0
    once = lag * (1.0 - left)
    twice = lag * (h - once)
    thrice = lag * (h * h / 2.0 - twice)
    return Fade(left, once, twice, thrice, lag * (h * h * h / 6.0 - thrice))


class Hover(NamedTuple):
    """What hovers, in still air unless it is said."""

    m: float  # kg
    J: tuple[float, ...]  # kg m^2, three body axes
    T_0: float = math.nan  # N, its thrust; nan: its weight. Less of it where the air rises
    turns: bool = False  # whether the drag that carries the rest of its weight turns with the body
    side: float = math.nan  # N, to the side over a tilt, of one that leans

    def thrust(self, g: float) -> float:
        """Its total thrust, N."""
        return self.m * g if math.isnan(self.T_0) else self.T_0

    def pull(self, g: float) -> float:
        """Acceleration to the side over the tilt, m/s^2."""
        if not math.isnan(self.side):
            return self.side / self.m
        return g if self.turns else self.thrust(g) / self.m


def hover_of(guard: GuardParams) -> Hover:
    """The middle of what is believed of the airframe."""
    return Hover(m=guard.m, J=(guard.J_x, guard.J_y, guard.J_z))


class Loop(NamedTuple):
    """One tick of a channel: x' = A x + B n, y = C x + D n, n of INPUTS, y the demand.

    x begins with what is measured, as it is; then what the law remembers; then, for a delay, what
    was measured at the ticks before, the last first.
    """

    A: Matrix  # n x n
    B: Matrix  # n x 5
    C: Matrix  # 2 x n
    D: Matrix  # 2 x 5


NOISE = ("position", "velocity", "attitude", "rate")  # m, m/s, rad, rad/s, of what is measured
INPUTS = (*NOISE, "reference")  # and m/s^2, acceleration of the reference model, of a tilt alone


def _basis(own: int, seen: int, ticks: int) -> tuple[Matrix, list[Row], Matrix]:
    """Rows of the state of a channel, of what is reported of it `ticks` late, and of the INPUTS.

    own : how many numbers it has without a delay, of which the first `seen` are reported.
    """
    rows = np.eye(own + seen * ticks + len(INPUTS))
    late = rows[own : own + seen * ticks]
    reported = late[-seen:] if ticks else rows[:seen]
    return rows[:own], list(reported), rows[-len(INPUTS) :]


def _loop(own: Matrix, seen: int, ticks: int, after: list[Row], demand: list[Row]) -> Loop:
    """A Loop of a tick: what is `after` it, and what is demanded in it, over the rows of `_basis`."""
    n = len(own) + seen * ticks
    late = np.eye(n, n + len(INPUTS))[len(own) : n - seen]
    whole = np.vstack([after, own[:seen], late]) if ticks else np.array(after)
    told = np.array(demand)
    return Loop(A=whole[:, :n], B=whole[:, n:], C=told[:, :n], D=told[:, n:])


def height(params: Params, lag: Fade, off: float, here: Hover, ticks: int = 0) -> Loop:
    """One tick of height (8 numbers, 3 of them measured), with m_hat = off * m.

    State: height, its rate, thrust, thrust a tick ago, v_hat, s_hat + T_0 Lambda_hat (one
    number: in hover drag and mass cannot be told apart), trim, T_c a tick ago; all but the
    first two as departures from hover. Demanded: T_c, and T_c with the trim, N.
    """
    h, w, m, m_hat = params.h, params.rotors.mean, here.m, off * here.m
    own, reported, noise = _basis(8, 3, ticks)
    z, v, T, T_prev, v_hat, s, trim, T_c_prev = own
    z_seen, v_seen, T_seen = reported[0] + noise[0], reported[1] + noise[1], reported[2]
    T_0 = here.thrust(params.g)
    gain = params.gamma + params.gamma_Lambda * T_0 * T_0
    trim_rate = params.trim_rate if params.trim_max > 0.0 else 0.0

    T_mean = w * T_prev + (1.0 - w) * T_seen
    e_minus = v_seen - v_hat - h * (s + T_mean / m_hat)
    e = e_minus / (1.0 + h * params.lambda_v + h * h * gain)
    s = s + h * gain * e
    trim = (trim if trim_rate > 0.0 else 0.0 * trim) + h * trim_rate * (T_c_prev - T_mean)
    T_c = m_hat * (_a_ref(params, z_seen, v_seen) - s)

    aim = T_seen + params.rotors.kappa * (T_c + trim - T_seen)
    gap = T - aim
    after = [
        z + h * v + (aim * (h * h / 2.0) + gap * lag.twice) / m,
        v + (aim * h + gap * lag.once) / m,
        aim + gap * lag.left,
        T_seen, v_seen - e, s, trim, T_c,
    ]  # fmt: skip
    return _loop(own, 3, ticks, after, [T_c, T_c + trim])


def tilt(
    params: Params, lag: Fade, off: float, axis: int, here: Hover, ticks: int = 0,
    off_J: float | None = None,
) -> Loop:  # fmt: skip
    """One tick of a tilt and the way it leads to (12 numbers, 5 measured), axis 0 roll, 1 pitch.

    State: way, its rate, tilt, body rate, torque, tilt and torque a tick ago, v_hat, s_v_hat,
    w_hat, s_w_hat, tilt filter; way, rate and v_hat less those of the reference model. m_hat = off * m,
    J_hat = off_J * J, or off * J. Signs are those of pitch.
    Demanded: force along the way, N, and torque, N m.
    """
    h, w, J = params.h, params.rotors.mean, here.J[axis]
    J_hat = (off if off_J is None else off_J) * J
    own, reported, noise = _basis(12, 5, ticks)
    x, v, a, q, tau, a_prev, tau_prev, v_hat, s_v, w_hat, s_w, a_filter = own
    x_seen, v_seen, a_seen, q_seen = (reported[i] + noise[i] for i in range(4))
    a_m = noise[INPUTS.index("reference")]
    tau_seen = reported[4]
    T_0 = here.thrust(params.g)
    m_hat, pull = off * here.m, here.pull(params.g)
    lift = T_0 / m_hat

    e_v = v_seen - v_hat - h * (s_v + lift * 0.5 * (a_seen + a_prev))
    e_v = e_v / (1.0 + h * params.lambda_v + h * h * params.gamma)
    s_v = s_v + h * params.gamma * e_v
    known = (w * tau_prev + (1.0 - w) * tau_seen) / J_hat
    e_w, s_w = _rate(params, q_seen, w_hat, s_w, known)

    a_d = a_m + _a_ref(params, x_seen, v_seen) - s_v
    a_c = a_d / lift
    b = params.tilt_rate_bandwidth
    a_filter = (a_filter + h * b * a_c) / (1.0 + h * b)
    q_c = b * (a_c - a_filter) + params.c_angle[axis] * (a_c - a_seen)
    tau_c = J_hat * (params.c_rate[axis] * (q_c - q_seen) - s_w)

    aim = tau_seen + params.rotors.kappa * (tau_c - tau_seen)
    gap = tau - aim
    jerk = aim * (h * h * h / 6.0) + gap * lag.thrice
    snap = aim * (h * h * h * h / 24.0) + gap * lag.fourfold
    after = [
        x + h * v + pull * (a * (h * h / 2.0) + q * (h * h * h / 6.0) + snap / J) - a_m * (h * h / 2.0),
        v + pull * (h * a + q * (h * h / 2.0) + jerk / J) - h * a_m,
        a + h * q + (aim * (h * h / 2.0) + gap * lag.twice) / J,
        q + (aim * h + gap * lag.once) / J,
        aim + gap * lag.left,
        a_seen, tau_seen, v_seen - e_v - h * a_m, s_v, q_seen - e_w, s_w, a_filter,
    ]  # fmt: skip
    return _loop(own, 5, ticks, after, [m_hat * a_d, tau_c])


def yaw(params: Params, lag: Fade, off: float, here: Hover, ticks: int = 0) -> Loop:
    """One tick of yaw (6 numbers, 3 of them measured), with J_hat = off * J.

    State: yaw, body rate, torque, torque a tick ago, w_hat, s_w_hat. Demanded: the rate, rad/s,
    and torque, N m.
    """
    h, w, J, J_hat = params.h, params.rotors.mean, here.J[2], off * here.J[2]
    own, reported, noise = _basis(6, 3, ticks)
    psi, r, tau, tau_prev, w_hat, s_w = own
    psi_seen, r_seen, tau_seen = reported[0] + noise[2], reported[1] + noise[3], reported[2]
    known = (w * tau_prev + (1.0 - w) * tau_seen) / J_hat
    e, s_w = _rate(params, r_seen, w_hat, s_w, known)
    r_c = -params.c_angle.z * psi_seen
    tau_c = J_hat * (params.c_rate.z * (r_c - r_seen) - s_w)
    aim = tau_seen + params.rotors.kappa * (tau_c - tau_seen)
    gap = tau - aim
    after = [
        psi + h * r + (aim * (h * h / 2.0) + gap * lag.twice) / J,
        r + (aim * h + gap * lag.once) / J,
        aim + gap * lag.left,
        tau_seen, r_seen - e, s_w,
    ]  # fmt: skip
    return _loop(own, 3, ticks, after, [r_c, tau_c])


def _a_ref(params: Params, r: Matrix, v: Matrix) -> Matrix:
    """Paper (34), with the setpoint at rest in the origin."""
    return -2.0 * params.f_m * params.zeta_m * v - params.f_m * params.f_m * r


def _rate(
    params: Params, w: Matrix, w_hat: Matrix, s_w: Matrix, known: Matrix
) -> tuple[Matrix, Matrix]:
    """Prediction error and disturbance of a body rate after the tick."""
    h, gamma = params.h, params.gamma
    e = (w - w_hat - h * (s_w + known)) / (1.0 + h * params.lambda_w + h * h * gamma)
    return e, s_w + h * gamma * e


class _Channel(Protocol):
    def __call__(
        self, params: Params, lag: Fade, off: float, here: Hover, ticks: int = 0
    ) -> Loop: ...


def _about(axis: int) -> _Channel:
    def of(params: Params, lag: Fade, off: float, here: Hover, ticks: int = 0) -> Loop:
        return tilt(params, lag, off, axis, here, ticks)

    return of


CHANNELS: dict[str, _Channel] = {
    "height": height,
    "roll": _about(0),
    "pitch": _about(1),
    "yaw": yaw,
}

# MAVLink's parameters that decide whether a channel is stable; what stands first is what it is
# held against.
_OF_TILT = (
    "MR_C_TILT",
    "MR_C_PQ",
    "MR_F_M",
    "MR_ZETA_M",
    "MR_GAMMA",
    "MR_ROTOR_RESP",
    "MR_GRD_DELAY",
)
DECIDES: dict[str, tuple[str, ...]] = {
    "height": (
        "MR_F_M",
        "MR_GAMMA",
        "MR_ZETA_M",
        "MR_G_LAM",
        "MR_TRIM_RATE",
        "MR_ROTOR_RESP",
        "MR_GRD_DELAY",
    ),
    "roll": _OF_TILT,
    "pitch": _OF_TILT,
    "yaw": ("MR_C_YAW", "MR_C_R", "MR_GAMMA", "MR_ROTOR_RESP", "MR_GRD_DELAY"),
}


def late(params: Params, delay_s: float) -> int:
    """How many whole ticks a delay between measurement and rotor is at most."""
    return math.ceil(delay_s / params.h - 1e-6)


def radius(params: Params, here: Hover, channel: str, off: float = 1.0, ticks: int = 0) -> float:
    """Spectral radius of a channel: what its slowest mode is multiplied by in a tick.

    `off`: estimates of mass and inertia over the truth. `ticks`: by which what is measured is late.
    """
    loop = CHANNELS[channel](params, fade(params), off, here, ticks)
    return float(np.abs(np.linalg.eigvals(loop.A)).max())


def learns_inertia(params: Params, J: float) -> bool:
    """Whether an inertia (kg m^2) is learnt: by a torque of J times 1 rad/s^2."""
    return params.gamma_LambdaJ * J * J >= LEARNT


def stable(params: Params, guard: GuardParams, channel: str) -> bool:
    """Whether a channel is, with the gain margin, and with a cut rotor command.

    Of a tilt the margin has to be there with the greatest lag of LAGS too. An inertia that is not
    learnt has to be right enough from the start. `guard`: what is believed of the airframe, and to
    pass between measurement and rotor.
    """
    ticks, here = late(params, guard.delay_s), hover_of(guard)
    offs = list(OFF)
    if channel in ROTATION and not learns_inertia(params, guard.J_x):
        offs.append(params.initial.J_hat_0 / here.J[ROTATION.index(channel)])
    margin = all(radius(params, here, channel, off, ticks) < 1.0 for off in offs)
    if channel in TILTS:  # the mass alone may be off, which the gain of a tilt is in proportion to
        axis = ROTATION.index(channel)
        doubts = [(1.0, guard.heavier, 1.0), (max(LAGS), guard.heavier, 1.0)]
        doubts += [(max(LAGS), off, off) for off in offs]
        margin = margin and all(
            _settles(tilt(params, fade(params, part), off, axis, here, ticks, off_J))
            for part, off, off_J in doubts
        )
    return margin and radius(_cut(params), here, channel, ticks=ticks) < 1.0


def lift(params: Params, guard: GuardParams) -> float:
    """The greatest drag from below (N) under which tilts of the least mass are stable, with the gain margin.

    An inertia that is not learnt is tested at J_hat(0) over the greatest about a level axis, too.

    Drag along body axes turns with the body: a tilt pulls by g, thrust and drag together, where the law
    counts on thrust over m_hat, so the loop gain grows by m g/T. Not of the printed prediction, which has
    no rule: all of the weight. Takes 1 to 2 ms without a delay.
    """
    weight, ticks = guard.m_min * params.g, late(params, guard.delay_s)
    if params.achieved < 0.5:
        return weight
    light = hover_of(guard)._replace(m=guard.m_min, turns=True)
    most, axes = OFF[2], _tilts(params, light)
    offs_J = [most]
    if not learns_inertia(params, guard.J_x):
        offs_J.append(params.initial.J_hat_0 / guard.J_tilt)

    def steers(drag: float) -> bool:
        here = light._replace(T_0=weight - drag)
        loops = (
            tilt(params, fade(params), most, axis, here, ticks, off_J)
            for axis in axes
            for off_J in offs_J
        )
        return all(_settles(loop) for loop in loops)

    low, high = 0.0, CARRIED * weight
    if steers(high):
        return high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if steers(middle) else (low, middle)
    return low


def recovers(params: Params, guard: GuardParams, drag: float) -> bool:
    """Whether hover of the least mass under a drag (N) from below settles while rotor commands are cut.

    Where it does not, a saturation in such a wind may be final.
    """
    if params.achieved < 0.5:
        return True
    left = max(guard.m_min * params.g - drag, NEAR_NOTHING)
    here = hover_of(guard)._replace(m=guard.m_min, T_0=left, turns=True)
    axes = _tilts(params, here)
    return all(_settles(tilt(_cut(params), fade(params), 1.0, axis, here)) for axis in axes)


def _cut(params: Params) -> Params:
    """With rotors whose command is cut."""
    kappa = min(params.rotors.kappa, KAPPA_CUT)
    return params._replace(rotors=params.rotors._replace(kappa=kappa))


def _settles(loop: Loop) -> bool:
    """Whether all its modes fade."""
    return float(np.abs(np.linalg.eigvals(loop.A)).max()) < 1.0


def alike(params: Params) -> bool:
    """Whether roll is pitch, of one inertia: both have the same gains."""
    c, a = params.c_rate, params.c_angle
    return bool(c.x == c.y and a.x == a.y)


def _tilts(params: Params, here: Hover) -> tuple[int, ...]:
    """The axes of tilts that differ."""
    return (1,) if alike(params) and here.J[0] == here.J[1] else (0, 1)


def grounded(params: Params, guard: GuardParams) -> str:
    """What keeps the middle of the airframe's beliefs from hovering, whatever its gains; empty if nothing.

    Thrust limits that leave no room about its weight, sets that do not hold its mass or inertia
    (Section IV asks for sets that do), and a first estimate of mass that is too far off for the
    time that a fall leaves to learn it.
    """
    here, b = hover_of(guard), params.bounds
    m, weight, least, most = here.m, here.m * params.g, min(here.J), max(here.J)
    if params.limits.T_max < LIFT * weight:
        return f"too weak for {m:g} kg ({LIFT * weight:.3g} N at least)"
    if params.limits.T_min > SINK * weight:
        return f"no way down at {m:g} kg ({SINK * weight:.2g} N at most)"
    if not b.m_min <= m <= b.m_max:
        return f"{m:g} kg is outside the set of masses"
    if not b.J_min <= least <= most <= b.J_max:
        return f"{least:.2g} to {most:.2g} kg m^2 is outside the set of inertias"
    if not m / FIRST <= params.initial.m_hat_0 <= m * FIRST:
        return f"mass at arming: {m / FIRST:g} to {m * FIRST:g} kg"
    return ""


def unstable(params: Params, guard: GuardParams) -> str:
    """The channel that is not stable; empty if all are, or for the printed prediction.

    Takes less than a millisecond without a believed delay; with one of ten ticks 20.
    """
    if params.achieved < 0.5:
        return ""
    roll_too = 0 in _tilts(params, hover_of(guard))
    for channel in CHANNELS:
        if (roll_too or channel != "roll") and not stable(params, guard, channel):
            return channel
    return ""
