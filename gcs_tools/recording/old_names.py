"""Older recordings: the one table of old and new names, and what they told in sentences.

Versions 1 to 3 do not say where in a row the fields of a topic belong: `ROWS` does. Version 1 has
nothing but truth, ticks, parameters and events. Version 2 had no guard: what they lack is read as
not a number. Names that changed are in `COLUMNS` and `PARAMS`, by what they begin with. Versions 1
to 4 tell events and values in force in sentences, which nothing else reads.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Mapping
from typing import Any

from fcu.interface.event_log import Event

VERSIONS = (*(WITHOUT_ROWS := ("1", "2", "3")), "4")

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


# --- sentences

_TABLES = ("flight.", "law.", "wind.", "plant.")  # of values in force
_OF_A_BUS = "values."
_WHO = ("fcu", "plant")
_CODES = {  # what a text holds -> its code
    "Crashed: hit the ground (gcs reset puts it back)": "CRASHED",
    "Lost: left the arena (gcs reset puts it back)": "DIVERGED",
    "Reset: at the start, time begins again": "RESET",
    "the flight ended": "FLIGHT_ENDED",
}
_ITEM = re.compile(r"item (\d+) of (\d+), (\w+)(, to its begin)?(?:: to \(([^)]*)\) m)?")


def of_metadata(metadata: Mapping[str, str]) -> dict[str, str]:
    """Metadata as they are now: values in force as JSON, in place of "60.0 (mission)"."""
    found, values = {}, {}
    for name, told in metadata.items():
        key = name.removeprefix(_OF_A_BUS)
        written, _, origin = told.rpartition(" (")
        if written and (key != name or key.startswith(_TABLES)):
            values[key] = {"value": _literal(written), "origin": origin.removesuffix(")")}
        else:
            found[name] = told
    return {**found, "values": json.dumps(values)} if values else found


def _literal(written: str) -> Any:
    try:
        value = ast.literal_eval(written)
        json.dumps(value)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return written
    return value


def of_event(told: Event) -> Event:
    """An event as it is now, with the code and the numbers that others read of it."""
    who, colon, text = told.text.partition(": ")
    if colon and who in _WHO:
        codes = (code for part, code in _CODES.items() if part in text)
        return told._replace(text=text, who=who, code=next(codes, ""))
    if (match := _ITEM.fullmatch(told.text)) is None:
        return told
    item, of, kind, to_begin, place = match.groups()
    leg = "go_to" if to_begin else "path" if kind == "follow" else kind
    r = map(float, place.split(", ")) if place else ()
    return told._replace(code="ITEM_BEGUN", values=(float(item), float(of), kind, leg, *r))
