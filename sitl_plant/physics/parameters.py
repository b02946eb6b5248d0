"""Builds PlantParams from what is true of a vehicle, and the [plant] and [wind] tables of a mission."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from fcu.interface.airframe import ROTORS, AirframeError, G, airframe, shares
from fcu.interface.messages import VehicleState
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.rotations import from_euler
from sitl_plant.physics.battery import BatteryParams
from sitl_plant.physics.truth import Truth
from sitl_plant.physics.types import GroundParams, PlantParams, WindParams
from sitl_plant.physics.wind.sines import Phases, phases

NEVER = 1e18  # s: time of an event that does not happen (finite, so that JSON can hold it)
STEP = 0.001  # s: the longest integration step


def _vec(row: Any) -> Vec3:
    return Vec3(*[float(v) for v in row])


def _after(mass: float, change: Mapping[str, Any]) -> float:
    """The mass (kg) after a change of it: given, or as a part of the mass before."""
    part = change.get("mass_ratio")
    return float(change.get("mass_kg") or mass) if part is None else mass * float(part)


def steps_per_tick(rate_hz: float) -> int:
    """Integration steps per control period, each at most STEP long."""
    return math.ceil(1.0 / (rate_hz * STEP) - 1e-9)


def wind_params(h: float, wind: Mapping[str, Any] | None = None) -> WindParams:
    """WindParams from the [wind] table of a mission and the integration step h (s).

    Missing keys mean still air.
    """
    wind = wind or {}
    zero = (0.0, 0.0, 0.0)
    at = wind.get("step_at_s")
    azimuth = math.radians(float(wind.get("azimuth_deg") or 0.0))
    still, no_turn = Vec3(0.0, 0.0, 0.0), Phases(*[Vec3(0.0, 0.0, 0.0)] * 4)
    params = WindParams(
        steady=_vec(wind.get("steady_m_s", zero)),
        amplitude=_vec(wind.get("amplitude_m_s", zero)),
        frequency=_vec(wind.get("frequency_rad_s", zero)),
        phase=still,
        rotation_amplitude=_vec(wind.get("rotation_amplitude_rad_s", zero)),
        rotation_frequency=_vec(wind.get("rotation_frequency_rad_s", zero)),
        rotation_phase=still,
        step=_vec(wind.get("step_m_s", zero)),
        step_time=NEVER if at is None else float(at),
        azimuth_cos=math.cos(azimuth),
        azimuth_sin=math.sin(azimuth),
        half_step=no_turn,
        rotation=still,
        inflow=Rotors(*[1.0] * ROTORS),
    )
    return params._replace(
        half_step=phases(params, 0.5 * h),
        phase=_vec(wind.get("phase_rad", zero)),
        rotation_phase=_vec(wind.get("rotation_phase_rad", zero)),
    )


def _chosen_battery(plant: Mapping[str, Any]) -> dict[str, Any]:
    """Battery settings of a mission's [plant] table, with the keys of a truth's [battery]."""
    keys = {"battery_ah": "capacity_ah", "battery_remaining": "remaining"}
    return {key: plant[of] for of, key in keys.items() if plant.get(of) is not None}


def plant_params(
    truth: Truth,
    rate_hz: float,
    plant: Mapping[str, Any] | None = None,
    wind: Mapping[str, Any] | None = None,
    ground_z_m: float = 0.0,
    arena_m: float = 1000.0,
) -> PlantParams:
    """PlantParams for a control rate.

    plant, wind : tables of a mission; they override `truth`.  Raises AirframeError.
    """
    plant = plant or {}
    vehicle = {**truth.vehicle, **{k: v for k, v in plant.items() if v is not None}}
    rotors = dict(truth.rotors)
    if plant.get("rotor_lag_s") is not None:
        rotors["lag_s"] = plant["rotor_lag_s"]
    true = airframe(rotors, truth.source)

    loss_time, left = [NEVER] * ROTORS, [1.0] * ROTORS
    for i, loss in enumerate(plant.get("rotor_loss") or ()):
        if not 1 <= loss["rotor"] <= true.n:
            raise AirframeError(
                f"[plant] rotor_loss[{i}].rotor: expected 1 to {true.n}, the rotors of this airframe,"
                f" got {loss['rotor']}"
            )
        loss_time[loss["rotor"] - 1] = float(loss["at_s"])
        left[loss["rotor"] - 1] = float(loss["effectiveness"])

    h = 1.0 / (rate_hz * steps_per_tick(rate_hz))
    lag = true.rotor_lag
    change = plant.get("mass_change") or {}
    ground, battery = truth.ground, {**truth.battery, **_chosen_battery(plant)}
    return PlantParams(
        h=h,
        g=G,
        m=float(vehicle["mass_kg"]),
        m_after=_after(float(vehicle["mass_kg"]), change),
        m_time=float(change.get("at_s", NEVER)),
        J=_vec(vehicle["inertia_kg_m2"]),
        c_D=_vec(vehicle["drag"]),
        c_tau=_vec(vehicle["drag_torque"]),
        airframe=true,
        decay_half=math.exp(-0.5 * h / lag) if lag > 0.0 else 0.0,
        decay=math.exp(-h / lag) if lag > 0.0 else 0.0,
        loss_time=Rotors(*loss_time),
        effectiveness=Rotors(*left),
        wind=wind_params(h, wind),
        ground=GroundParams(
            z=float(ground_z_m),
            gear=float(ground["gear_m"]),
            stiffness=float(ground["stiffness_n_m"]),
            damping=float(ground["damping_n_s_m"]),
            friction=float(ground["friction"]),
            footprint=float(ground["footprint_m"]),
            impact_max=float(ground["impact_max_m_s"]),
            wall=0.0,
        ),
        battery=BatteryParams(
            capacity=3600.0 * float(battery["capacity_ah"]),
            remaining_0=float(battery["remaining"]),
            cells=float(battery["cells"]),
            resistance=float(battery["resistance_ohm"]),
            efficiency=float(battery["efficiency"]),
            avionics=float(battery["avionics_w"]),
        ),
        arena=float(arena_m),
    )


def start_state(params: PlantParams, start: Mapping[str, Any] | None = None) -> VehicleState:
    """The state at the start of a flight.

    In the air: at `position_m`, level, with the rotors at hover speed. On the ground
    (`on_ground`): standing on the gear with the rotors stopped.
    """
    start = start or {}
    x, y, z = (float(v) for v in start.get("position_m", (0.0, 0.0, 0.0)))
    weight = params.m * params.g
    share = shares(params.airframe)
    whole = sum(share)
    Omega = [
        math.sqrt(weight * w / whole / c_T) if w > 0.0 else 0.0
        for w, c_T in zip(share, params.airframe.c_T, strict=True)
    ]
    ground = params.ground
    if start.get("on_ground"):
        z = ground.z + ground.gear - weight / ground.stiffness
        Omega = [0.0] * ROTORS
    q: Quat = from_euler(0.0, 0.0, math.radians(float(start.get("yaw_deg", 0.0))))
    return VehicleState(
        r_E=Vec3(x, y, z),
        v_E=_vec(start.get("velocity_m_s", (0.0, 0.0, 0.0))),
        q_EB=q,
        w_B=Vec3(0.0, 0.0, 0.0),
        Omega=Rotors(*Omega),
    )
