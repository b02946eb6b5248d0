"""What is known of an airframe before it flies: what its rotors can do, and what its gains leave.

All of it follows from what is believed (`fcu/airframes`), but the hover time, which is that of the
vehicle that the simulator plays. The gains are M-MRAC's, as they are without a mission.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fcu.guard import governor, margin, stability, wrench
from fcu.interface.airframe import LAW, PINNED, AirframeFile, full_thrust
from fcu.interface.files.spelling import suggestion
from fcu.interface.parameter import default
from fcu.kernel.algebra import Rotors, Vec3
from fcu.laws import loader, scales
from fcu.process.configuration import pinned
from fcu.process.settings import PARAMETERS, Settings, settings
from sitl_plant.physics import battery
from sitl_plant.physics.parameters import plant_params
from sitl_plant.physics.truth import truth

RATE_HZ = 500.0
AXES = ("roll", "pitch", "yaw")
MOST_DB, HALVINGS = 20.0, 12  # of a search for a margin
MOST_TICKS = 64  # of delay
STEPS = 100  # of the charge


@dataclass(frozen=True)
class Rotor:
    """One rotor, as it is believed to be."""

    number: int
    forward_m: float
    left_m: float
    up_m: float
    spin: int  # 1 counter-clockwise from above, -1 clockwise
    thrust_max_n: float
    hover_thrust_n: float
    hover_speed_rad_s: float


@dataclass(frozen=True)
class Authority:
    """What there is beside a level hover, about one axis at a time."""

    axis: str
    torque_n_m: float
    acceleration_rad_s2: float


@dataclass(frozen=True)
class Channel:
    """The closed loop of one channel about hover, and how far it is from not settling."""

    name: str
    stable: bool  # by the rule on gains, with all that it asks for
    settles_s: float  # time constant of its slowest mode; inf if it does not settle
    gain_down_db: float  # estimates of mass and inertia below the truth, that it stands
    gain_up_db: float  # above it; MOST_DB: at least
    delay_s: float  # from measurement to rotor, that it stands; of whole ticks


@dataclass(frozen=True)
class Gain:
    """A value of M-MRAC's parameters, or of its guard's, that is the vehicle's."""

    key: str
    value: Any
    unit: str
    pinned: bool  # by the airframe file; else it follows from it
    follows: Any  # what would follow


@dataclass(frozen=True)
class AirframeCheck:
    """What `gcs airframe` tells."""

    airframe: str
    sha256: str
    rotors: tuple[Rotor, ...]
    mass_kg: tuple[float, float]
    inertia_kg_m2: tuple[float, ...]  # about each axis, middle of what is believed
    hover_throttle: float  # speed over full speed
    thrust_to_weight: float  # of the middle mass
    authority: tuple[Authority, ...]
    rotor_lag_s: float
    rotor_response_s: float  # what it is made to look like
    channels: tuple[Channel, ...]
    unstable: str  # the channel that the rule on gains refuses; empty: none
    grounded: str  # what keeps it from hovering; empty: nothing
    wind_m_s: float  # that the guard believes in
    room_n: float  # of force, in hover, whatever that wind does; below 0 it lacks
    torque_left_n_m: float  # about a level axis, in hover, beside the gusts of that wind
    speed_m_s: float  # of the reference, that the guard allows
    braking_m_s2: float
    hover_time_s: float  # of the simulated vehicle, from a full battery
    hover_power_w: float
    gains: tuple[Gain, ...]
    doubts: tuple[str, ...]  # what flies and is still unlikely to be meant, a sentence each

    @property
    def flies(self) -> bool:
        """Whether the gains are stable and hover leaves room for what is believed."""
        lacks = min(self.room_n, self.torque_left_n_m) < 0.0
        return not (self.unstable or self.grounded or lacks)

    def as_json(self) -> dict[str, Any]:
        """For JSON: what is endless is None."""
        return {"flies": self.flies, **_finite(asdict(self))}


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def airframe_check(file: AirframeFile) -> AirframeCheck:
    """What is known of an airframe. Raises ParameterError, AirframeError."""
    file = pinned(file, loader.load())
    tables = file.tables
    told = settings(file.rotors, tables, RATE_HZ)
    law, guard = told
    tau, alpha = scales.torque(tables), scales.authority(tables)
    known = margin.known(guard, law)
    still = Vec3(0.0, 0.0, 0.0)
    speed, braking = governor.speeds(known)
    seconds, power = _hover_time(file)
    least, most = tables["vehicle"]["mass_kg"]
    return AirframeCheck(
        airframe=file.source,
        sha256=file.sha256,
        rotors=_rotors(file),
        mass_kg=(float(least), float(most)),
        inertia_kg_m2=tuple(scales.inertia(tables)),
        hover_throttle=scales.hover_throttle(tables),
        thrust_to_weight=scales.thrust_to_weight(tables),
        authority=tuple(
            Authority(axis, float(t), float(a)) for axis, t, a in zip(AXES, tau, alpha, strict=True)
        ),
        rotor_lag_s=file.rotors.rotor_lag,
        rotor_response_s=file.rotors.rotor_lag / law.rotors.kappa,
        channels=tuple(_channel(told, name) for name in stability.CHANNELS),
        unstable=stability.unstable(law, guard),
        grounded=stability.grounded(law, guard),
        wind_m_s=guard.w_max,
        room_n=float(margin.condition(known, still, still, 0.0)),
        torque_left_n_m=float(wrench.spare(guard, law)),
        speed_m_s=float(speed),
        braking_m_s2=float(braking),
        hover_time_s=seconds,
        hover_power_w=power,
        gains=_gains(tables),
        doubts=tuple(_doubts(file)),
    )


STRONG = 3.0  # times thrust_max_n: rotors that give more are hardly meant
TWISTS = 0.1  # m of torque over thrust: six times that of the S1000


def _doubts(file: AirframeFile) -> Iterator[str]:
    """Numbers that may be in another unit, limits that nothing meets, tables that no law reads."""
    full, most = full_thrust(file.rotors), float(file.tables["limits"]["thrust_max_n"])
    if full > STRONG * most:
        yield (
            f"[rotors] full_speed_rad_s: at full speed the rotors give {full:.4g} N, and [limits]"
            f" thrust_max_n is {most:.4g} N: is it in rpm? 1 rpm is 0.1047 rad/s"
        )
    if most > 1.05 * full:
        yield (
            f"[limits] thrust_max_n is {most:.4g} N, and at full speed the rotors give {full:.4g} N:"
            " the difference is never there"
        )
    if file.rotors.k_Q > TWISTS:
        yield (
            f"[rotors] torque_to_thrust_m is {file.rotors.k_Q:g} m: torque in N m over thrust in N,"
            " not the torque itself?"
        )
    for name in file.tables.get(LAW, {}):
        if name not in loader.SHIPPED:
            yield (
                f"[law.{name}] is read for a law of yours called {name}, and no other"
                f"{suggestion(name, loader.SHIPPED)}"
            )


def _rotors(file: AirframeFile) -> tuple[Rotor, ...]:
    of = file.rotors
    speeds = scales.hover_speeds(file.tables)
    return tuple(
        Rotor(
            number=i + 1,
            forward_m=of.x[i],
            left_m=of.y[i],
            up_m=of.z[i],
            spin=round(of.spin[i]),
            thrust_max_n=of.c_T[i] * of.Omega_max[i] ** 2,
            hover_thrust_n=of.c_T[i] * Omega**2,
            hover_speed_rad_s=Omega,
        )
        for i, Omega in enumerate(speeds)
    )


def _channel(told: Settings, name: str) -> Channel:
    law, guard = told
    here = stability.hover_of(guard)

    def settles(off: float = 1.0, ticks: int = 0) -> bool:
        return stability.radius(law, here, name, off, ticks) < 1.0

    def most_db(sign: float) -> float:
        low, high = 0.0, MOST_DB
        if settles(10.0 ** (sign * high / 20.0)):
            return high
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            holds = settles(10.0 ** (sign * middle / 20.0))
            low, high = (middle, high) if holds else (low, middle)
        return low

    radius = stability.radius(law, here, name)
    if radius >= 1.0:
        return Channel(name, False, math.inf, 0.0, 0.0, 0.0)
    fewest, most = 0, MOST_TICKS
    while most - fewest > 1:
        middle = (fewest + most) // 2
        fewest, most = (middle, most) if settles(ticks=middle) else (fewest, middle)
    return Channel(
        name=name,
        stable=stability.stable(law, guard, name),
        settles_s=-law.h / math.log(radius),
        gain_down_db=most_db(-1.0),
        gain_up_db=most_db(1.0),
        delay_s=fewest * law.h,
    )


def _gains(tables: Any) -> tuple[Gain, ...]:
    pins = tables[PINNED]
    bare = {name: table for name, table in tables.items() if name not in (LAW, PINNED)}
    return tuple(
        Gain(
            key=row.key,
            value=default(row, tables),
            unit=row.unit,
            pinned=row.key in pins,
            follows=default(row, bare),
        )
        for row in PARAMETERS
        if row.key and (row.rule is not None or row.key in pins)
    )


def _hover_time(file: AirframeFile) -> tuple[float, float]:
    """Seconds of hover from a full battery until it is empty, and the mean power (W)."""
    true = truth(file)
    params = plant_params(true, RATE_HZ)
    tables = {
        "rotors": true.rotors,
        "vehicle": {"mass_kg": [params.m, params.m]},
    }
    speeds = scales.hover_speeds(tables)
    Omega = Rotors(*speeds, *[0.0] * (len(Rotors._fields) - len(speeds)))
    all_left = Rotors(*[1.0] * len(Rotors._fields))
    full = params.battery._replace(remaining_0=1.0)
    seconds, energy = 0.0, 0.0
    for spent in (np.arange(STEPS) + 0.5) / STEPS:
        state = battery.BatteryState(charge=float(spent) * full.capacity, energy=0.0)
        told = battery.report(full, params.airframe, Omega, all_left, state)
        part = full.capacity / STEPS / told.current
        seconds += part
        energy += part * told.current * told.voltage
    return float(seconds), float(energy / seconds)
