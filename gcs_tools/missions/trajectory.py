"""What a mission tells the vehicle at a time: the setpoint, and when one is sent.

Plain arithmetic, so that whoever flies a mission, over the wire or in one process, flies
the same one to the bit. Frame: Earth East-North-Up, SI.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from gcs_tools.missions.flight_table import FigureEight, Flight

Rows = np.ndarray[Any, np.dtype[np.float64]]

_REST = Vec3(0.0, 0.0, 0.0)


def _microseconds(t: float) -> int:
    return round(t * 1e6)


def _position(flight: Flight, t: float) -> Vec3:
    """The latest timed setpoint at time t (s)."""
    now = _microseconds(t)
    if not flight.setpoints:  # of a script nothing is known: the start
        return Vec3(*flight.start.position_m)
    latest = flight.setpoints[0]
    for timed in flight.setpoints[1:]:
        if _microseconds(timed.at_s) <= now:
            latest = timed
    return Vec3(*latest.position_m)


def _phase(curve: FigureEight, t: float) -> tuple[float, float, float]:
    """Phase (rad), its rate and the rate of that: from rest, both rates without a jump."""
    half_length, width = 0.5 * curve.size_m[0], curve.size_m[1]
    if curve.period_s is not None:
        w = 2.0 * math.pi / curve.period_s
    else:
        assert curve.speed_max_m_s is not None  # the table has one of the two
        w = curve.speed_max_m_s / math.hypot(half_length, width)
    T = curve.ramp_s
    if t >= T:
        return w * (t - 0.5 * T), w, 0.0
    u = t / T
    uu = u * u
    return w * T * uu * (u - 0.5 * uu), w * uu * (3.0 - 2.0 * u), 6.0 * w * (u - uu) / T


def _on_curve(curve: FigureEight, t: float) -> tuple[Vec3, Vec3, Vec3]:
    """Position, velocity and acceleration on the figure of eight at time t (s)."""
    a, b = 0.5 * curve.size_m[0], 0.5 * curve.size_m[1]
    p, p_dot, p_ddot = _phase(curve, t)
    s1, c1, s2, c2 = math.sin(p), math.cos(p), math.sin(2.0 * p), math.cos(2.0 * p)
    r = Vec3(*curve.centre_m) + Vec3(a * s1, b * s2, 0.0)
    dr_dp = Vec3(a * c1, 2.0 * b * c2, 0.0)
    ddr_dp = Vec3(-a * s1, -4.0 * b * s2, 0.0)
    return r, dr_dp * p_dot, dr_dp * p_ddot + ddr_dp * (p_dot * p_dot)


def setpoint_at(flight: Flight, t: float) -> Setpoint:
    """What the vehicle is told at simulation time t (s), which is at or after 0."""
    if flight.curve is not None:
        r_c, v_c, a_c = _on_curve(flight.curve, t)
    else:
        r_c, v_c, a_c = _position(flight, t), _REST, _REST
    psi_c = math.radians(flight.start.yaw_deg if flight.yaw_deg is None else flight.yaw_deg)
    if flight.yaw is None:
        return Setpoint(r_c, v_c, a_c, psi_c, 0.0)
    amplitude, w = flight.yaw.amplitude_rad, flight.yaw.frequency_rad_s
    swing, swing_dot = amplitude * math.sin(w * t), amplitude * w * math.cos(w * t)
    return Setpoint(r_c, v_c, a_c, psi_c + swing, swing_dot)


def positions_at(flight: Flight, t: Rows) -> Rows:
    """The positions (m, float64 (n, 3)) that `setpoint_at` asks for at times (n,) s, to rounding."""
    if flight.curve is None and not flight.setpoints:
        return np.tile(np.array(flight.start.position_m), (len(t), 1))
    if flight.curve is None:
        begins = [_microseconds(timed.at_s) for timed in flight.setpoints]
        at = np.searchsorted(begins, np.rint(t * 1e6), side="right") - 1
        places: Rows = np.array([timed.position_m for timed in flight.setpoints])[at]
        return places
    curve = flight.curve
    steady, rate, _ = _phase(curve, curve.ramp_s)  # from the end of the ramp on it grows evenly
    p = steady + rate * (t - curve.ramp_s)
    ramp = t < curve.ramp_s
    p[ramp] = [_phase(curve, each)[0] for each in t[ramp].tolist()]
    a, b = 0.5 * curve.size_m[0], 0.5 * curve.size_m[1]
    off = np.stack([a * np.sin(p), b * np.sin(2.0 * p), np.zeros(len(p))], axis=1)
    on_curve: Rows = np.array(curve.centre_m) + off
    return on_curve


def setpoint_times(flight: Flight) -> list[int]:
    """The ticks at which a setpoint is sent: 0, each later step, each period of a moving one."""
    ticks = round(flight.duration_s * flight.rate_hz)
    # the first tick at or after a time, in whole numbers
    sent = {-(-_microseconds(s.at_s) * flight.rate_hz // 1_000_000) for s in flight.setpoints}
    if flight.curve is not None or flight.yaw is not None:
        periods = range(-(-ticks * flight.stream_hz // flight.rate_hz))
        sent |= {-(-i * flight.rate_hz // flight.stream_hz) for i in periods}
    return sorted(k for k in sent | {0} if k < ticks)


def last_change_s(flight: Flight) -> float:
    """When the position setpoint last stepped, s; a moving one never does, and counts from 0."""
    return flight.setpoints[-1].at_s if flight.setpoints else 0.0
