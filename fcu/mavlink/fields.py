"""The fields of the ground link's messages, to and from values in the frames inside.

Setpoints and attitudes go through the kernels of `frames`, so that a flight over the wire and
one in compiled code are equal. An exchange of axes is not worth a call into compiled code.
"""

from __future__ import annotations

import math
import struct

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Quat, Vec3
from fcu.mavlink.enums import (
    FORCE,
    GLOBAL_FRAMES,
    IGNORE_ACCELERATION,
    IGNORE_ATTITUDE,
    IGNORE_PITCH_RATE,
    IGNORE_POSITION,
    IGNORE_ROLL_RATE,
    IGNORE_SPIN_RATE,
    IGNORE_THRUST,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    IGNORE_YAW_RATE,
    THRUST_BODY,
    Frame,
)
from fcu.mavlink.frames import attitude_enu_ned, setpoint_to_wire, yaw_enu_ned
from fcu.mavlink.geodesy import Geodetic

NUMBERS = struct.Struct("<11f")
# Beyond these a setpoint is nonsense, whoever sends it.
FARTHEST, FASTEST, HARDEST, SPINNIEST = 1e5, 100.0, 100.0, 10.0  # m, m/s, m/s^2, rad/s
UNIT_WITHIN = 1e-3  # of a quaternion's norm

_GROUPS = {  # of a setpoint: bits, which of the eleven fields they take out of use, and a limit
    "position": (IGNORE_POSITION, slice(0, 3), FARTHEST, "m"),
    "velocity": (IGNORE_VELOCITY, slice(3, 6), FASTEST, "m/s"),
    "acceleration": (IGNORE_ACCELERATION, slice(6, 9), HARDEST, "m/s^2"),
    "yaw": (IGNORE_YAW, slice(9, 10), 1e3, "rad"),
    "yaw rate": (IGNORE_YAW_RATE, slice(10, 11), SPINNIEST, "rad/s"),
}
_ALL = IGNORE_POSITION | IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW | IGNORE_YAW_RATE
_KNOWN_BITS = _ALL | FORCE
_FRAMES = frozenset(Frame)
_EACH_RATE = (IGNORE_ROLL_RATE, IGNORE_PITCH_RATE, IGNORE_SPIN_RATE)
_RATES = IGNORE_ROLL_RATE | IGNORE_PITCH_RATE | IGNORE_SPIN_RATE


def earth(v_E: Vec3) -> Vec3:
    """NED components of a vector in ENU, or ENU from NED."""
    return Vec3(v_E.y, v_E.x, -v_E.z)


def body(v_B: Vec3) -> Vec3:
    """FRD components of a vector in FLU, or FLU from FRD."""
    return Vec3(v_B.x, -v_B.y, -v_B.z)


def attitude(q: Quat) -> Quat:
    """FRD to NED from FLU to ENU, or back; w >= 0."""
    turned: Quat = attitude_enu_ned(Quat(float(q.w), float(q.x), float(q.y), float(q.z)))
    return turned


def heading(psi: float) -> float:
    """Clockwise from North, rad, of a yaw from East counter-clockwise; or back."""
    return float(yaw_enu_ned(float(psi)))


def _floats(v: Vec3) -> Vec3:
    # Exactly float, or the kernels are compiled anew for another type, in flight.
    return Vec3(float(v.x), float(v.y), float(v.z))


def setpoint_numbers(setpoint: Setpoint) -> bytes:
    """The eleven float32 fields that a setpoint becomes on the wire, as sent and echoed.

    The bits of `setpoint_to_wire`, without handing tuples to compiled code and back, which costs
    more than all the rest. What float32 cannot hold is left to it.
    """
    s = setpoint
    row = *earth(s.r_c), *earth(s.v_c), *earth(s.a_c), heading(s.psi_c), -s.psi_dot_c
    try:
        if math.inf in row or -math.inf in row:
            raise OverflowError
        return NUMBERS.pack(*row)
    except OverflowError:
        floats = Setpoint(
            _floats(s.r_c), _floats(s.v_c), _floats(s.a_c), float(s.psi_c), float(s.psi_dot_c)
        )
        r, v, a, yaw, yaw_rate = setpoint_to_wire(floats)
        return NUMBERS.pack(*r, *v, *a, yaw, yaw_rate)


def setpoint_of(numbers: bytes, type_mask: int) -> Setpoint:
    """The setpoint in such fields; what the mask ignores is as SetpointMessage says.

    The bits of `setpoint_from_wire`, as above.
    """
    f = NUMBERS.unpack(numbers)
    nowhere, still = Vec3(math.nan, math.nan, math.nan), Vec3(0.0, 0.0, 0.0)
    return Setpoint(
        nowhere if type_mask & IGNORE_POSITION else Vec3(f[1], f[0], -f[2]),
        still if type_mask & IGNORE_VELOCITY else Vec3(f[4], f[3], -f[5]),
        still if type_mask & IGNORE_ACCELERATION else Vec3(f[7], f[6], -f[8]),
        math.nan if type_mask & IGNORE_YAW else heading(f[9]),
        0.0 if type_mask & IGNORE_YAW_RATE else -f[10],
    )


def turned_setpoint(numbers: bytes, type_mask: int, frame: int) -> Setpoint:
    """A setpoint with the axes of its frame; positions of global frames are left out.

    The body frames' axes are the heading's: forward, left, up from forward, right, down, and a
    yaw that is counter-clockwise.
    """
    if frame in (Frame.LOCAL_NED, Frame.LOCAL_OFFSET_NED):
        return setpoint_of(numbers, type_mask)
    f = NUMBERS.unpack(numbers)
    r, v, a = Vec3(*f[0:3]), Vec3(*f[3:6]), Vec3(*f[6:9])
    ahead = frame in (Frame.BODY_NED, Frame.BODY_OFFSET_NED, Frame.BODY_FRD)
    offset = frame in (Frame.BODY_OFFSET_NED, Frame.BODY_FRD)
    axes = body if ahead else earth
    nowhere, still = Vec3(math.nan, math.nan, math.nan), Vec3(0.0, 0.0, 0.0)
    placeless = type_mask & IGNORE_POSITION or frame in GLOBAL_FRAMES
    return Setpoint(
        nowhere if placeless else body(r) if offset else earth(r),
        still if type_mask & IGNORE_VELOCITY else axes(v),
        still if type_mask & IGNORE_ACCELERATION else axes(a),
        math.nan if type_mask & IGNORE_YAW else -f[9] if offset else heading(f[9]),
        0.0 if type_mask & IGNORE_YAW_RATE else -f[10],
    )


def refusal(numbers: bytes, type_mask: int, frame: int, geodetic: Geodetic | None) -> str:
    """Why a received setpoint must not be flown; empty if it may."""
    if frame not in _FRAMES:
        return f"frame {frame} is not supported"
    if type_mask & _ALL == _ALL:
        return "it commands nothing"
    # some clients set the bit with everything they ignore: without an acceleration it means nothing
    if type_mask & FORCE and type_mask & IGNORE_ACCELERATION != IGNORE_ACCELERATION:
        return "a force is not supported"
    if type_mask & ~_KNOWN_BITS:
        return f"type mask {type_mask:#x} has unknown bits"
    fields = NUMBERS.unpack(numbers)
    for name, (bits, where, limit, unit) in _GROUPS.items():
        if type_mask & bits not in (0, bits):
            return f"part of its {name} is ignored"
        if type_mask & bits or (name == "position" and geodetic is not None):
            continue
        if not all(map(math.isfinite, fields[where])):
            return f"its {name} is not finite"
        if max(map(abs, fields[where])) > limit:
            return f"its {name} is above {limit:g} {unit}"
    if geodetic is not None and not type_mask & IGNORE_POSITION:
        if not (abs(geodetic.lat_deg) <= 90.0 and abs(geodetic.lon_deg) <= 180.0):
            return "its place is not on Earth"
        if not abs(geodetic.alt_m) <= FARTHEST:
            return f"its height is not within {FARTHEST:g} m"
    return ""


def attitude_refusal(mask: int, q: Quat, w: Vec3, thrust: float) -> str:
    """Why a received attitude setpoint must not be flown; empty if it may."""
    if mask & THRUST_BODY:
        return "thrust as a vector is not supported"
    if mask & IGNORE_THRUST:
        return "it has no thrust"
    if mask & ~(_RATES | THRUST_BODY | IGNORE_THRUST | IGNORE_ATTITUDE):
        return f"type mask {mask:#x} has unknown bits"
    if not 0.0 <= thrust <= 1.0:
        return "its thrust is not between 0 and 1"
    if mask & IGNORE_ATTITUDE and mask & _RATES:
        return "without attitude it needs all three body rates"
    used = [rate for bit, rate in zip(_EACH_RATE, w, strict=True) if not mask & bit]
    if not all(abs(rate) <= SPINNIEST for rate in used):
        return f"its body rates are not within {SPINNIEST:g} rad/s"
    if not mask & IGNORE_ATTITUDE and not abs(math.hypot(*q) - 1.0) <= UNIT_WITHIN:
        return "its attitude is not a unit quaternion"
    return ""
