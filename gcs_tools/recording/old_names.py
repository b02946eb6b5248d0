"""What older recordings call otherwise: the one table of old and new names.

Versions 1 to 3 do not say where in a row the fields of a topic belong: `ROWS` does. Version 1 has
nothing but truth, ticks, parameters and events; version 2 had no guard: what they lack is read as
not a number. Names that changed are in `COLUMNS` and `PARAMS`, by what they begin with.
"""

from __future__ import annotations

from collections.abc import Mapping

VERSIONS = ("1", "2", "3")

ROWS: dict[str, dict[str, str]] = {  # topic -> metadata of its channel, as version 4 has it
    "/plant/truth": {"row": "plant", "own": "", "prefix": ""},
    "/plant/timing": {"own": "t", "prefix": "timing."},
    "/fcu/measured": {"row": "fcu", "own": "t", "prefix": "measured."},
    "/fcu/setpoint": {"row": "fcu", "own": "t", "prefix": "setpoint."},
    "/fcu/law": {"row": "fcu", "own": "t engaged", "prefix": "state."},
    "/fcu/internals": {"row": "fcu", "own": "t", "prefix": "internals."},
    "/fcu/command": {"row": "fcu", "own": "t", "prefix": "command."},
    "/fcu/wind": {"own": "t", "prefix": "wind."},
    "/fcu/status": {"own": "t", "prefix": "status."},
    "/fcu/timing": {"own": "t", "prefix": "timing."},
    "/fcu/params": {"own": "t", "prefix": ""},
}

COLUMNS = {
    "state.r_m": "state.reference.r_m",
    "state.v_m": "state.reference.v_m",
    "state.v_hat": "state.predictor.v_hat",
    "state.w_hat": "state.predictor.w_hat",
    "state.s_v_hat": "state.estimates.s_v_hat",
    "state.m_hat": "state.estimates.m_hat",
    "state.s_w_hat": "state.estimates.s_w_hat",
    "state.J_hat": "state.estimates.J_hat",
    "state.c_p1_hat": "state.estimates.c_p1_hat",
    "state.c_p2_hat": "state.estimates.c_p2_hat",
    "state.c_q1_hat": "state.estimates.c_q1_hat",
    "state.c_q2_hat": "state.estimates.c_q2_hat",
    "state.c_r1_hat": "state.estimates.c_r1_hat",
    "state.f_c_prev": "state.memory.f_c",
    "state.f_wc_prev": "state.memory.f_wc",
    "state.T_c_prev": "state.memory.T_c",
    "state.e3_prev": "state.memory.e3",
    "state.w_prev": "state.memory.w",
    "state.Omega_prev": "state.memory.Omega",
    "state.T_trim": "state.memory.T_trim",
    "state.tilt_filter": "state.memory.tilt_filter",
    "state.a_m": "guard_state.a_m",
    "state.beta": "guard_state.beta",
    "state.psi_g": "guard_state.psi_g",
    "state.psi_g_dot": "guard_state.psi_g_dot",
    "internals.r_m": "outputs.reference.r_m",
    "internals.v_m": "outputs.reference.v_m",
    "internals.e_r": "outputs.e_r",
    "internals.T_c": "outputs.T_c",
    "internals.T_achieved": "outputs.T_achieved",
    "internals.angles": "outputs.angles",
    "internals.angles_c": "outputs.angles_c",
    "internals.w_c": "outputs.w_c",
    "internals.thrusts": "outputs.thrusts",
    "internals.thrust_saturated": "outputs.saturation.thrust",
    "internals.tilt_saturated": "outputs.saturation.tilt",
    "internals.rotor_saturated": "outputs.saturation.torque",  # or yaw: they were one
    "internals.v_til": "internals.prediction.v_til",
    "internals.w_til": "internals.prediction.w_til",
    "internals.f_c": "internals.demand.f_c",
    "internals.T_d": "internals.demand.T_d",
    "internals.tau_d": "internals.demand.tau_d",
    "internals.T_a": "internals.achieved.T_a",
    "internals.tau_a": "internals.achieved.tau_a",
    "internals.delta_u": "internals.achieved.delta_u",
    "internals.projected": "internals.flags.projected",
    "internals.tilt_rate_saturated": "internals.flags.tilt_rate",
    "internals.yaw_rate_saturated": "internals.flags.yaw_rate",
    "internals.trim_saturated": "internals.flags.trim",
    "internals.r_g": "guard.r_g",
    "internals.governed": "guard.governed",
    "internals.margin": "guard.margin.force",
    "internals.margin_tilt": "guard.margin.tilt",
    "internals.margin_condition": "guard.margin.condition",
}

PARAMS = {
    **{name: f"law.limits.{name}" for name in ("T_min", "T_max", "phi_star")},
    **{
        name: f"law.rotors.{name}"
        for name in (
            "x", "y", "spin", "c_T", "k_Q", "Omega_max", "f_min", "f_max", "kappa",
            "B_x", "B_y", "B_z",
        )
    },
    "rotor_mean": "law.rotors.mean",
    **{
        name: f"law.initial.{name}" for name in ("m_hat_0", "J_hat_0", "r_m_offset", "v_hat_offset")
    },
    "guard": "guard",
}  # fmt: skip


def of_tick(name: str) -> str:
    """What a column of a tick is called now."""
    return _renamed(name, COLUMNS) or name


def of_params(name: str) -> str:
    """What a parameter is called now."""
    return name if name == "t" else _renamed(name, PARAMS) or f"law.{name}"


def _renamed(name: str, names: Mapping[str, str]) -> str:
    """By the longest beginning of a dotted name that has another; empty without one."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        if found := names.get(".".join(parts[:n])):
            return ".".join([found, *parts[n:]])
    return ""
