"""A law of the folder fcu/laws, and a rigid body in plain Python for it to fly."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import airframe
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Rotors, Vec3, cross
from fcu.kernel.rotations import from_euler, matrix, normalised, quaternion_rate
from fcu.laws import loader

ZERO = Vec3(0.0, 0.0, 0.0)
G = 9.81


class Flown(NamedTuple):
    """A law with its Params."""

    face: Any
    params: Any


def flown(name: str, tables: Mapping[str, Any], rate_hz: float = 500.0, **chosen: Any) -> Flown:
    """The law of that name for an airframe file's tables, with values other than the defaults."""
    law = loader.load(name)
    believed = airframe(tables["rotors"])
    params = law.settings.settings(believed, tables, rate_hz, chosen).law
    return Flown(law.face, params)


def with_rotors(params: Any, **given: Any) -> Any:
    """Params whose rotors are believed otherwise."""
    return params._replace(rotors=params.rotors._replace(**given))


def small(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of a vehicle of 0.7 kg in place of the 8 kg of `tables`: shorter, lighter, quicker."""
    made: dict[str, Any] = deepcopy(dict(tables))
    made["vehicle"] = {
        "mass_kg": [0.65, 0.75],
        "inertia_kg_m2": [[0.0018, 0.0022], [0.0018, 0.0022], [0.003, 0.0036]],
    }
    made["limits"] |= {"thrust_min_n": 0.3, "thrust_max_n": 24.0}
    made["rotors"] |= {
        "radius_m": 0.11,
        "thrust_coefficient": 5e-7,
        "full_speed_rad_s": 2450.0,
        "lag_s": 0.02,
    }
    made["rotors"]["inertia_kg_m2"] = 1e-6
    return made


def hovering(params: Any, **given: Any) -> VehicleState:
    """A measurement: at rest, level, rotors carrying the weight, but for what is named."""
    speeds = np.sqrt(params.m * G / 8.0 / np.resize(params.rotors.c_T, 8))
    level = from_euler(0.0, 0.0, 0.0)
    return VehicleState(ZERO, ZERO, level, ZERO, Rotors(*speeds.tolist()))._replace(**given)


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0, psi: float = 0.0) -> Setpoint:
    """A position that stands still."""
    return Setpoint(Vec3(x, y, z), ZERO, ZERO, psi, 0.0)


Push = Callable[[float], tuple[Vec3, Vec3]]  # time, s -> force, N, E; torque, N m, B


def still(t: float) -> tuple[Vec3, Vec3]:
    """Nothing pushes."""
    return ZERO, ZERO


def fly(
    law: Flown,
    setpoint: Setpoint,
    seconds: float,
    push: Push = still,
    lag: float = 0.02,
    substeps: int = 2,
    start: VehicleState | None = None,
) -> list[tuple[VehicleState, Any, Any, Any]]:
    """(measured, state, outputs, internals) of every tick of a flight of a rigid body.

    It has the mass, inertia and rotors that the law believes, and a lag of the rotors (s).
    """
    params, face = law.params, law.face
    rotors, h = params.rotors, params.h
    seen = start or hovering(params)
    full = np.resize(rotors.Omega_max, 8)
    x, y, spin = (np.array(row) for row in (rotors.x, rotors.y, rotors.spin))
    c_T, J, dt = np.resize(rotors.c_T, 8), params.J, h / substeps
    decay = math.exp(-dt / lag) if lag > 0.0 else 0.0
    rows: list[tuple[VehicleState, Any, Any, Any]] = []
    state = None
    for k in range(round(seconds / h)):
        if state is None:
            told = face.take_over(params, setpoint, seen)
        else:
            told = face.step(state, params, setpoint, seen)
        state, command, outputs, internals = told
        rows.append((seen, state, outputs, internals))
        r, v, q, w, Omega = seen.r_E, seen.v_E, seen.q_EB, seen.w_B, np.array(seen.Omega)
        wanted = full * np.array(command.u)
        for i in range(substeps):
            force, torque = push(k * h + i * dt)
            Omega = wanted + decay * (Omega - wanted)
            f = c_T * Omega**2
            tau = Vec3(float(y @ f), -float(x @ f), -rotors.k_Q * float(spin @ f)) + torque
            a = (float(f.sum()) * matrix(q).e3 + force) / params.m + Vec3(0.0, 0.0, -G)
            w = w + dt * ((tau - cross(w, J * w)) / J)
            v = v + dt * a
            r = r + dt * v
            q = normalised(q + dt * quaternion_rate(q, w))
        seen = VehicleState(r, v, q, w, Rotors(*Omega.tolist()))
    return rows
