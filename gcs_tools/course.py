"""The setpoints of a flight over time: one function, for the runner and for rollout alike."""

from __future__ import annotations

import math

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from gcs_tools.mission_schema import FigureEight, Flight

NOTHING = Vec3(0.0, 0.0, 0.0)


def setpoint_at(flight: Flight, t: float) -> Setpoint:
    """The setpoint at time t (s): position, velocity, acceleration, yaw and yaw rate, ENU."""
    psi, psi_dot = math.radians(flight.yaw_deg), 0.0
    if flight.yaw is not None:
        A, f = flight.yaw.amplitude_rad, flight.yaw.frequency_rad_s
        psi, psi_dot = psi + A * math.sin(f * t), A * f * math.cos(f * t)
    if flight.curve is not None:
        r_c, v_c, a_c = figure_eight(flight.curve, t)
    else:
        now = [s for s in flight.setpoints if s.at_s <= t + 1e-9][-1]
        r_c, v_c, a_c = Vec3(*now.position_m), NOTHING, NOTHING
    return Setpoint(r_c, v_c, a_c, psi, psi_dot)


def figure_eight(curve: FigureEight, t: float) -> tuple[Vec3, Vec3, Vec3]:
    """Position (m), velocity (m/s), acceleration (m/s^2) at time t (s).

    x = a sin(s), y = b sin(2s)/2 about the centre, of a phase s that starts from rest:
    its rate rises over `ramp_s` as a smooth step. The speed is greatest where the lobes
    cross, at s = 0: the rate times sqrt(a^2 + b^2).
    """
    a, b = curve.size_m
    b *= 2.0  # y = b sin(s) cos(s) reaches half of b
    full = curve.speed_max_m_s / math.hypot(a, b)
    T = curve.ramp_s
    if t < T:
        x = t / T
        s = full * T * (x**3 - 0.5 * x**4)
        s_dot = full * (3.0 * x**2 - 2.0 * x**3)
        s_ddot = full * (6.0 * x - 6.0 * x**2) / T
    else:
        s, s_dot, s_ddot = full * (0.5 * T + (t - T)), full, 0.0
    sin, cos, sin2, cos2 = math.sin(s), math.cos(s), math.sin(2 * s), math.cos(2 * s)
    cx, cy, cz = curve.centre_m
    return (
        Vec3(cx + a * sin, cy + 0.5 * b * sin2, cz),
        Vec3(a * cos * s_dot, b * cos2 * s_dot, 0.0),
        Vec3(
            a * (cos * s_ddot - sin * s_dot * s_dot),
            b * (cos2 * s_ddot - 2.0 * sin2 * s_dot * s_dot),
            0.0,
        ),
    )


def moves(flight: Flight) -> bool:
    """Whether the setpoint moves between steps, so that it has to be streamed."""
    return flight.curve is not None or flight.yaw is not None


def setpoint_ticks(flight: Flight) -> list[int]:
    """Control ticks at which a setpoint is sent: at 0, at each step, and streamed if it moves."""
    n = round(flight.duration_s * flight.rate_hz)
    ticks = {0, *(round(s.at_s * flight.rate_hz) for s in flight.setpoints)}
    if moves(flight):
        period = max(1, round(flight.rate_hz / flight.stream_hz))
        ticks.update(range(0, n, period))
    return sorted(k for k in ticks if k < n)


def last_change_s(flight: Flight) -> float:
    """Time of the last step of the position setpoint (s); 0 if it moves or never steps."""
    return flight.setpoints[-1].at_s if flight.setpoints else 0.0
