"""The reference model: what the vehicle should do when told to be somewhere. Paper (34)."""

from __future__ import annotations

from fcu.kernel.algebra import select3
from fcu.kernel.compile import kernel
from fcu.laws.face import Reference
from fcu.laws.setpoint import carried


@kernel
def at_take_over(params, measured):
    """The Reference at take-over: beside the vehicle if told to be, with its velocity."""
    return Reference(r_m=measured.r_E + params.initial.r_m_offset, v_m=measured.v_E)


@kernel
def shown(setpoint, measured, reference):
    """The Reference at this tick: the model's, or below the position level the vehicle."""
    lower = setpoint.level > 0.5
    return Reference(
        r_m=select3(lower, measured.r_E, reference.r_m),
        v_m=select3(lower, measured.v_E, reference.v_m),
    )


@kernel
def a_ref(params, setpoint, r, v):
    """Acceleration (m/s^2, E) that the reference model asks of position r and velocity v.

    A moving setpoint adds its velocity and acceleration; both are zero for a fixed one,
    which leaves the printed right-hand side. Paper (34), also in (36) and (37).
    """
    f_m, zeta_m = params.f_m, params.zeta_m
    r_c, v_c, a_c = setpoint.r_c, setpoint.v_c, setpoint.a_c
    return a_c - 2.0 * f_m * zeta_m * (v - v_c) - f_m * f_m * (r - r_c)  # (34) departure 5


@kernel
def advance(params, setpoint, r_m, v_m):
    """Position and velocity of the reference model one tick later (m, m/s, E). Paper (34).

    One classical Runge-Kutta step: over an 18 m step its error stays below 1e-9 m at f_m = 1
    rad/s, 1e-6 m at the highest f_m allowed, 10 rad/s (tests/laws/test_law.py).
    The setpoint is carried along its own velocity and acceleration within the tick.
    """
    h = params.h
    k1_r, k1_v = v_m, a_ref(params, setpoint, r_m, v_m)
    mid = carried(setpoint, 0.5 * h)
    k2_r = v_m + 0.5 * h * k1_v
    k2_v = a_ref(params, mid, r_m + 0.5 * h * k1_r, k2_r)
    k3_r = v_m + 0.5 * h * k2_v
    k3_v = a_ref(params, mid, r_m + 0.5 * h * k2_r, k3_r)
    k4_r = v_m + h * k3_v
    k4_v = a_ref(params, carried(setpoint, h), r_m + h * k3_r, k4_r)
    return (
        r_m + (h / 6.0) * (k1_r + 2.0 * k2_r + 2.0 * k3_r + k4_r),
        v_m + (h / 6.0) * (k1_v + 2.0 * k2_v + 2.0 * k3_v + k4_v),
    )


@kernel
def followed(params, setpoint, measured, reference):
    """The Reference at the next tick: by the model, or below the position level where
    the vehicle goes, so that the model goes on from there when a position is asked for again.
    """
    r, v = measured.r_E, measured.v_E
    lower = setpoint.level > 0.5
    r_m, v_m = advance(params, setpoint, reference.r_m, reference.v_m)
    return Reference(r_m=select3(lower, r + params.h * v, r_m), v_m=select3(lower, v, v_m))
