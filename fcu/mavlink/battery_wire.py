"""Battery <-> the payload of BATTERY_STATUS: scale factors, and what is refused.

Charge goes as mA h, energy as hJ, voltage as mV, current as cA, what is left as percent, so a
battery arrives coarser than it was sent. Its voltage is that of the whole pack, which MAVLink
has in the place of the first cell. Out of a field's range a value is saturated; what is not a
number is sent as the field's "unknown", and refused at the other end.
"""

from __future__ import annotations

import struct

from fcu.interface.messages import Battery

_PAYLOAD = struct.Struct("<iih10HhBBBb")  # charge, energy, temperature, cells, current, ..., left
_NO_CELL = 2**16 - 1
_NO_TEMPERATURE = 2**15 - 1
_ALL_FUNCTIONS, _LIPO = 1, 1  # MAV_BATTERY_FUNCTION_ALL, MAV_BATTERY_TYPE_LIPO


def _whole(x: float, low: int, high: int, unknown: int) -> int:
    return unknown if x != x else round(min(max(x, low), high))


def pack(battery: Battery) -> bytes:
    """The payload, without MAVLink 2's extensions."""
    return _PAYLOAD.pack(
        _whole(1e3 * battery.drawn_Ah, -(2**31), 2**31 - 1, -1),
        _whole(1e-2 * battery.energy_J, -(2**31), 2**31 - 1, -1),
        _NO_TEMPERATURE,
        _whole(1e3 * battery.voltage, 0, _NO_CELL - 1, _NO_CELL),
        *[_NO_CELL] * 9,
        _whole(1e2 * battery.current, -(2**15), 2**15 - 1, -1),
        0, _ALL_FUNCTIONS, _LIPO,
        _whole(1e2 * battery.remaining, -(2**7), 2**7 - 1, -1),
    )  # fmt: skip


def unpack(payload: bytes) -> Battery | None:
    """The battery of a payload of full length; None if a field is unknown or out of range."""
    charge, energy, _, pack_mV, *_, current, _, _, _, percent = _PAYLOAD.unpack_from(payload)
    if min(charge, energy, current) < 0 or pack_mV == _NO_CELL or not 0 <= percent <= 100:
        return None
    return Battery(1e-3 * pack_mV, 1e-2 * current, 1e-3 * charge, 1e-2 * percent, 1e2 * energy)
