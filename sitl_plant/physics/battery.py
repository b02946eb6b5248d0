"""A lithium polymer battery: power drawn by the rotors, charge, voltage and current.

Voltage does not limit thrust, because the limits in the paper's plant are constant. An empty
battery reports a charge of 0 and keeps delivering power. The controller decides how to react.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from fcu.interface.messages import Battery
from fcu.kernel.algebra import clip, maximum, total
from fcu.kernel.compile import kernel

# Open-circuit voltage of one cell (V) against remaining charge: points of the chart that vendors
# of lithium polymer packs print (blog.ampow.com/lipo-voltage-chart), linearly interpolated.
_EMPTY = 3.27
_S1, _S2, _S3, _S4, _S5 = 0.05, 0.10, 0.40, 0.60, 0.80
_V1, _V2, _V3, _V4, _V5, _FULL = 3.61, 3.69, 3.80, 3.87, 4.02, 4.20


class BatteryParams(NamedTuple):
    """True parameters of the battery and of its loads."""

    capacity: float  # C
    remaining_0: float  # charge at the start of the flight, 0 to 1
    cells: float  # in series
    resistance: float  # of the whole pack and its leads, ohm
    efficiency: float  # mechanical power of the blades over electrical power
    avionics: float  # W, constant


class BatteryState(NamedTuple):
    """Charge and energy drawn since the start of the flight."""

    charge: float  # C
    energy: float  # J, at the terminals


@kernel
def power(params, airframe, Omega, left):
    """Electrical power (W) at rotor speeds Omega (rad/s); `left`: remaining effectiveness."""
    blades = airframe.k_Q * total(airframe.c_T * left * (Omega * Omega * Omega))
    return blades / params.efficiency + params.avionics


@kernel
def rest_voltage(params, remaining):
    """Open-circuit voltage (V) of the pack at a charge of `remaining` (0 to 1)."""
    s = remaining
    cell = (
        _EMPTY
        + (_V1 - _EMPTY) / _S1 * clip(s, 0.0, _S1)
        + (_V2 - _V1) / (_S2 - _S1) * clip(s - _S1, 0.0, _S2 - _S1)
        + (_V3 - _V2) / (_S3 - _S2) * clip(s - _S2, 0.0, _S3 - _S2)
        + (_V4 - _V3) / (_S4 - _S3) * clip(s - _S3, 0.0, _S4 - _S3)
        + (_V5 - _V4) / (_S5 - _S4) * clip(s - _S4, 0.0, _S5 - _S4)
        + (_FULL - _V5) / (1.0 - _S5) * clip(s - _S5, 0.0, 1.0 - _S5)
    )
    return params.cells * cell


@kernel
def report(params, airframe, Omega, left, state):
    """The Battery at rotor speeds Omega (rad/s); `left`: remaining effectiveness of each rotor.

    P = V I and V = E - R I give a quadratic equation in I. If it has no real root, the battery
    cannot deliver P and delivers its maximum power instead, at I = E / (2 R).
    """
    remaining = clip(params.remaining_0 - state.charge / params.capacity, 0.0, 1.0)
    E, R = rest_voltage(params, remaining), params.resistance
    P = power(params, airframe, Omega, left)
    root = math.sqrt(maximum(E * E - 4.0 * R * P, 0.0))
    current = 2.0 * P / (E + root)  # the smaller root, without cancellation
    current = clip(current, 0.0, 0.5 * E / R)
    voltage = E - R * current
    return Battery(voltage, current, state.charge / 3600.0, remaining, state.energy)


@kernel
def drained(state, battery, dt):
    """The state after dt (s) at the current and voltage of `battery`."""
    charge = battery.current * dt
    return BatteryState(state.charge + charge, state.energy + battery.voltage * charge)
