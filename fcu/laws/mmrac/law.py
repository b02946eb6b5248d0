"""The whole law, once a tick: predict and adapt, demand, allocate. Paper Section VII.

`step(state, params, setpoint, measured)` is pure. Where what is printed and what is flown with the
achieved force differ, each form is a function of its own; which of them flies is asked here alone.
"""

from __future__ import annotations

from fcu.interface.messages import RotorCommand
from fcu.kernel.algebra import Vec3, select
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, matrix
from fcu.laws import allocation
from fcu.laws.face import Outputs, Reference, Saturation
from fcu.laws.mmrac import adaptation, attitude, entry, position, prediction, rates, reference_model
from fcu.laws.mmrac.parameters import PARAMETERS, check, pace, printed
from fcu.laws.mmrac.parameters import law_params as params
from fcu.laws.mmrac.types import (
    Achieved,
    Demand,
    Estimates,
    Flags,
    Internals,
    Memory,
    Params,
    PredictionError,
    Predictor,
    State,
)  # fmt: skip
from fcu.laws.outputs import at_rest

__all__ = [
    "GUARD", "PARAMETERS", "Internals", "Params", "State", "check", "idle", "pace", "params",
    "printed", "step", "take_over",
]  # fmt: skip  # what the shell knows of a law

GUARD = "fcu.guard.guard"  # which the law is flown with


@kernel
def step(state, params, setpoint, measured):
    """One tick of the law in flight: (state, command, outputs, internals) from the last state.

    state : State, params : Params, setpoint : Setpoint, measured : VehicleState.
    """
    past = prediction.past(params.rotors, state.memory, measured)
    if params.achieved > 0.5:
        error = prediction.achieved(params, state, measured, past)
        estimates = adaptation.achieved(params, state.estimates, error, past)
        T_trim = position.trim(params, state.memory, past.T_mean)
    else:
        error = prediction.demanded(params, state, measured, past)
        estimates = adaptation.demanded(params, state.estimates, error, past, state.memory)
        T_trim = state.memory.T_trim
    predictor = Predictor(v_hat=measured.v_E - error.v_til, w_hat=measured.w_B - error.w_til)
    learnt = State(
        reference=state.reference, predictor=predictor, estimates=estimates, memory=state.memory
    )
    return command(learnt, params, setpoint, measured, error, T_trim)


@kernel
def command(state, params, setpoint, measured, error, T_trim):
    """The rest of a tick, with estimates as they stand: from position to the rotors.

    error : PredictionError of this tick.  T_trim : trim of thrust, N.
    """
    estimates, memory, rotors = state.estimates, state.memory, params.rotors
    lies = attitude.measured(measured.q_EB)

    # force and tilt from the position, angle rates from the tilt
    if params.achieved > 0.5:
        wanted = position.achieved(params, estimates, setpoint, measured, lies)
    else:
        wanted = position.demanded(params, estimates, setpoint, measured, lies)
    force = entry.force(params.limits, estimates, setpoint, lies, wanted)
    tilt_filter = attitude.filtered(params, memory.tilt_filter, force.angles_c)
    if params.achieved > 0.5:
        turn = attitude.achieved(params, lies, force.angles_c, tilt_filter, setpoint.psi_dot_c)
    else:
        turn = attitude.demanded(params, lies, force.angles_c, setpoint.psi_dot_c)
    turn = entry.turn(setpoint, turn)

    # torque from the body rates, thrusts and speeds from both
    Omega_m = allocation.omega_m(rotors, measured.Omega)
    f_wc = rates.f_wc(params.c_rate, estimates, measured.w_B, turn.w_c, Omega_m)
    tau_d = estimates.J_hat * f_wc  # (44)
    thrusts, gave_up = allocation.allocate(rotors, force.T_c + T_trim, tau_d)
    u = allocation.speed_command(rotors, thrusts, measured.Omega)

    reference = reference_model.shown(setpoint, measured, state.reference)
    after = State(
        reference=reference_model.followed(params, setpoint, measured, reference),
        predictor=state.predictor,
        estimates=estimates,
        memory=remembered(measured, lies, force, f_wc, T_trim, tilt_filter),
    )
    outputs = outputs_of(params, measured, reference, lies, force, turn, thrusts, gave_up)
    internals = recorded(params, estimates, measured, lies, error, force, turn, tau_d, T_trim)
    return after, RotorCommand(u=u), outputs, internals


@kernel
def remembered(measured, lies, force, f_wc, T_trim, tilt_filter):
    """The Memory of a tick for the next."""
    return Memory(
        f_c=force.f_c,
        f_wc=f_wc,
        T_c=force.T_c,
        e3=lies.R_EB.e3,
        w=measured.w_B,
        Omega=measured.Omega,
        T_trim=T_trim,
        tilt_filter=tilt_filter,
    )


@kernel
def outputs_of(params, measured, reference, lies, force, turn, thrusts, gave_up):
    """The Outputs of a tick."""
    T_achieved, _ = allocation.achieved(params.rotors, measured.Omega * measured.Omega)
    return Outputs(
        reference=reference,
        e_r=measured.r_E - reference.r_m,
        T_c=force.T_c,
        T_achieved=T_achieved,
        angles=lies.angles,
        angles_c=force.angles_c,
        w_c=turn.w_c,
        thrusts=thrusts,
        saturation=Saturation(
            thrust=position.at_limit(params.limits, force.T_c),
            tilt=force.cut,
            torque=gave_up.torque,
            yaw=gave_up.yaw,
        ),
    )


@kernel
def recorded(params, estimates, measured, lies, error, force, turn, tau_d, T_trim):
    """The Internals of a tick."""
    T_achieved, tau_a = allocation.achieved(params.rotors, measured.Omega * measured.Omega)
    T_a = T_achieved * lies.R_EB.e3
    return Internals(
        prediction=error,
        demand=Demand(f_c=force.f_c, T_0=force.T_0, T_d=force.T_d, tau_d=tau_d),
        achieved=Achieved(T_a=T_a, tau_a=tau_a, delta_u=T_a - force.T_d),  # (9)
        flags=Flags(
            projected=adaptation.held(params.bounds, estimates),
            tilt_rate=turn.tilt_cut,
            yaw_rate=turn.yaw_cut,
            trim=select(abs(T_trim) >= params.trim_max, 1.0, 0.0),
        ),
    )


@kernel
def take_over(params, setpoint, measured):
    """The tick at which the law takes over: no past to learn from yet. As `step` returns."""
    zero = Vec3(0.0, 0.0, 0.0)
    error = PredictionError(v_til=zero, w_til=zero)
    return command(beginning(params, measured), params, setpoint, measured, error, 0.0)


@kernel
def beginning(params, measured):
    """The State in which the law takes over a vehicle it has just measured."""
    zero, J_0 = Vec3(0.0, 0.0, 0.0), params.initial.J_hat_0
    R_EB = matrix(measured.q_EB)
    angles = euler(R_EB)
    T_a, _ = allocation.achieved(params.rotors, measured.Omega * measured.Omega)
    return State(
        reference=reference_model.at_take_over(params, measured),
        predictor=Predictor(v_hat=measured.v_E + params.initial.v_hat_offset, w_hat=measured.w_B),
        estimates=nothing_learnt(params.initial.m_hat_0, Vec3(J_0, J_0, J_0)),
        memory=Memory(
            f_c=zero,
            f_wc=zero,
            T_c=T_a,
            e3=R_EB.e3,
            w=measured.w_B,
            Omega=measured.Omega,
            T_trim=0.0,
            tilt_filter=Vec3(angles.x, angles.y, 0.0),
        ),
    )


@kernel
def nothing_learnt(m_hat, J_hat):
    """Estimates of nothing but a mass (kg) and an inertia (kg m^2)."""
    zero = Vec3(0.0, 0.0, 0.0)
    return Estimates(
        s_v_hat=zero,
        m_hat=m_hat,
        s_w_hat=zero,
        J_hat=J_hat,
        c_p1_hat=0.0,
        c_p2_hat=0.0,
        c_q1_hat=0.0,
        c_q2_hat=0.0,
        c_r1_hat=0.0,
    )


@kernel
def idle(measured):
    """(state, outputs, internals) of a law that does not fly: it follows the measurement."""
    zero = Vec3(0.0, 0.0, 0.0)
    reference = Reference(r_m=measured.r_E, v_m=measured.v_E)
    state = State(
        reference=reference,
        predictor=Predictor(v_hat=measured.v_E, w_hat=measured.w_B),
        estimates=nothing_learnt(0.0, zero),
        memory=Memory(
            f_c=zero,
            f_wc=zero,
            T_c=0.0,
            e3=zero,
            w=measured.w_B,
            Omega=measured.Omega,
            T_trim=0.0,
            tilt_filter=zero,
        ),
    )
    internals = Internals(
        prediction=PredictionError(v_til=zero, w_til=zero),
        demand=Demand(f_c=zero, T_0=zero, T_d=zero, tau_d=zero),
        achieved=Achieved(T_a=zero, tau_a=zero, delta_u=zero),
        flags=Flags(projected=0.0, tilt_rate=0.0, yaw_rate=0.0, trim=0.0),
    )
    return state, at_rest(measured, reference, zero), internals
