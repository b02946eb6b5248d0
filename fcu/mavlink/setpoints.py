"""Setpoints on the wire: sent, read, judged, echoed. Eleven numbers, packed once each way.

A setpoint's message holds the eleven as they came; `request` is what they ask for, in the frames
inside (Earth ENU, or forward, left, up of the heading). What must not be flown has a `refusal`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

from fcu.interface.messages import AttitudeRequest, PositionRequest, Setpoint
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Quat, Vec3
from fcu.kernel.rotations import normalised
from fcu.mavlink.definitions import (
    BODY_FRAMES,
    FLOAT32_MAX,
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
    OFFSET_FRAMES,
    THRUST_BODY,
    Frame,
    Packed,
)
from fcu.mavlink.definitions import message as _message
from fcu.mavlink.frames import attitude, body, earth, heading
from fcu.mavlink.framing import Source
from fcu.mavlink.geodesy import Geodetic

Fields = dict[str, Any]
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
_LEVEL = Quat(1.0, 0.0, 0.0, 0.0)
_AS_SENT = slice(4, 48)  # of the payload of every message of the eleven: behind its time


class Target(NamedTuple):
    """The eleven fields of a position target, in the axes of its frame: NED, or FRD of the heading.

    In a message of a place on Earth the first three are its latitude, longitude and height.
    """

    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float
    afx: float
    afy: float
    afz: float
    yaw: float  # rad from North, clockwise seen from above
    yaw_rate: float  # rad/s, clockwise


def target_of(setpoint: Setpoint) -> Target:
    """What a setpoint is on the wire, in NED, before float32 rounds it."""
    r, v, a = earth(setpoint.r_c), earth(setpoint.v_c), earth(setpoint.a_c)
    return Target(
        x=r.x, y=r.y, z=r.z, vx=v.x, vy=v.y, vz=v.z, afx=a.x, afy=a.y, afz=a.z,
        yaw=heading(setpoint.psi_c), yaw_rate=-setpoint.psi_dot_c,
    )  # fmt: skip


def setpoint_of(target: Target) -> Setpoint:
    """The setpoint that a received target in NED stands for."""
    r, v, a = Vec3(*target[0:3]), Vec3(*target[3:6]), Vec3(*target[6:9])
    return Setpoint(earth(r), earth(v), earth(a), heading(target.yaw), -target.yaw_rate)


_ELEVEN = struct.Struct("<11f")


def setpoint_through_the_wire(setpoint: Setpoint) -> Setpoint:
    """The Setpoint that the flight controller decodes when a script sends `setpoint`."""
    held = (min(max(x, -FLOAT32_MAX), FLOAT32_MAX) if x == x else x for x in target_of(setpoint))
    return setpoint_of(Target(*_ELEVEN.unpack(_ELEVEN.pack(*held))))


def nonsense(decoded: Setpoint) -> Told | None:
    """The reason to refuse a setpoint in any state, or None."""
    return _refusal(target_of(decoded), 0, Frame.LOCAL_NED, None)


# --- SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT


class SetpointMessage(NamedTuple):
    """SET_POSITION_TARGET_LOCAL_NED or SET_POSITION_TARGET_GLOBAL_INT."""

    source: Source
    target_system: int
    target_component: int
    time_boot_ms: int
    type_mask: int
    frame: int
    target: Target  # as received: what the echo repeats
    geodetic: Geodetic | None  # the position, in the global frames
    refusal: Told | None  # why it must not be flown

    @property
    def request(self) -> PositionRequest:
        """What it asks for; a place on Earth (`geodetic`) is left out."""
        return requested(self.target, self.type_mask, self.frame)


def requested(target: Target, type_mask: int, frame: int) -> PositionRequest:
    """What a target asks for, with the axes of its frame. An axis that the mask ignores is NaN.

    The body frames' axes are the heading's: forward, left, up from forward, right, down, and a
    yaw that is counter-clockwise.
    """
    used = [math.nan if type_mask >> i & 1 else target[i] for i in range(9)]  # a bit for each field
    r, v, a = Vec3(*used[0:3]), Vec3(*used[3:6]), Vec3(*used[6:9])
    ahead, offset = frame in BODY_FRAMES, frame in OFFSET_FRAMES
    axes = body if ahead else earth
    psi = -target.yaw if offset else heading(target.yaw)
    placeless = _ignores(type_mask, IGNORE_POSITION) or frame in GLOBAL_FRAMES
    return PositionRequest(
        r=None if placeless else body(r) if offset else earth(r),
        v=None if _ignores(type_mask, IGNORE_VELOCITY) else axes(v),
        a=None if _ignores(type_mask, IGNORE_ACCELERATION) else axes(a),
        psi=None if type_mask & IGNORE_YAW else psi,
        psi_dot=0.0 if type_mask & IGNORE_YAW_RATE else -target.yaw_rate,
        along_heading=ahead,
        from_here=offset or frame == Frame.LOCAL_OFFSET_NED,
    )


def placed(request: PositionRequest, type_mask: int, r: Vec3) -> PositionRequest:
    """A request in a global frame at the place `r` (m, E). What its mask ignores of that is NaN."""
    x, y = (math.nan, math.nan) if type_mask & 3 else (r.x, r.y)
    return request._replace(r=Vec3(x, y, math.nan if type_mask & 4 else r.z))


def _ignores(type_mask: int, group: int) -> bool:
    """True if every field of a group is ignored."""
    return type_mask & group == group


def _refusal(
    target: Target, type_mask: int, frame: int, geodetic: Geodetic | None
) -> Told | None:  # fmt: skip
    if frame not in _FRAMES:
        return Told(Code.FRAME_UNSUPPORTED, (frame,))
    if type_mask & _ALL == _ALL:
        return Told(Code.COMMANDS_NOTHING)
    # some clients set the bit with everything they ignore: without an acceleration it means nothing
    if type_mask & FORCE and type_mask & IGNORE_ACCELERATION != IGNORE_ACCELERATION:
        return Told(Code.FORCE)
    if type_mask & ~_KNOWN_BITS:
        return Told(Code.MASK_BITS, (type_mask,))
    for name, (bits, where, limit, unit) in _GROUPS.items():
        if _ignores(type_mask, bits) or (name == "position" and geodetic is not None):
            continue
        first = bits & -bits  # the group's bits follow one another, as its fields do
        numbers = [x for i, x in enumerate(tuple(target)[where]) if not type_mask & first << i]
        if not all(map(math.isfinite, numbers)):
            return Told(Code.NOT_FINITE, (name,))
        if max(map(abs, numbers)) > limit:
            return Told(Code.ABOVE_LIMIT, (name, limit, unit))
    if geodetic is not None and not _ignores(type_mask, IGNORE_POSITION):
        level = type_mask & IGNORE_POSITION & 3  # latitude, longitude
        if level not in (0, 3):
            return Told(Code.PARTLY_IGNORED, ("latitude and longitude",))
        on_earth = abs(geodetic.lat_deg) <= 90.0 and abs(geodetic.lon_deg) <= 180.0
        if not (level or on_earth):
            return Told(Code.OFF_EARTH)
        if not (type_mask & 4 or abs(geodetic.alt_m) <= FARTHEST):
            return Told(Code.HEIGHT_RANGE, (FARTHEST,))
    if geodetic is None and frame in GLOBAL_FRAMES:
        return Told(Code.FRAME_NOT_LOCAL, (frame,))
    if geodetic is not None and frame not in GLOBAL_FRAMES:
        return Told(Code.FRAME_NOT_GLOBAL, (frame,))
    return None


_YAW_BITS = IGNORE_YAW.bit_length() - 1, IGNORE_YAW_RATE.bit_length() - 1


def _target(f: Fields, x: str, y: str, z: str) -> Target:
    return Target(
        f[x], f[y], f[z], f["vx"], f["vy"], f["vz"], f["afx"], f["afy"], f["afz"],
        f["yaw"], f["yaw_rate"],
    )  # fmt: skip


def _setpoint(
    f: Fields, source: Source, target: Target, geodetic: Geodetic | None
) -> SetpointMessage:  # fmt: skip
    frame, bits = f["coordinate_frame"], (*range(9), *_YAW_BITS)
    mask = f["type_mask"]
    for bit, number in zip(bits, target, strict=True):
        mask |= math.isnan(number) << bit  # no number is asked for nothing, as PX4 takes it
    return SetpointMessage(
        source, f["target_system"], f["target_component"], f["time_boot_ms"], mask, frame, target,
        geodetic, _refusal(target, mask, frame, geodetic),
    )  # fmt: skip


def _set_position_target(f: Fields, source: Source) -> SetpointMessage:
    return _setpoint(f, source, _target(f, "x", "y", "z"), None)


def _set_position_target_global(f: Fields, source: Source) -> SetpointMessage:
    place = Geodetic(f["lat_int"] * 1e-7, f["lon_int"] * 1e-7, f["alt"])
    return _setpoint(f, source, _target(f, "lat_int", "lon_int", "alt"), place)


def setpoint(to: Source, t: float, wanted: Setpoint, type_mask: int = 0) -> Packed:
    """SET_POSITION_TARGET_LOCAL_NED; `type_mask` as in `definitions`, 0 uses all."""
    return _message(
        "SET_POSITION_TARGET_LOCAL_NED", time_boot_ms=1e3 * t, coordinate_frame=Frame.LOCAL_NED,
        type_mask=type_mask, target_system=to.system, target_component=to.component,
        **target_of(wanted)._asdict(),
    )  # fmt: skip


def setpoint_global(
    to: Source, t: float, frame: int, place: Geodetic, wanted: Setpoint, type_mask: int = 0
) -> Packed:
    """SET_POSITION_TARGET_GLOBAL_INT: to `place`, its height as `frame` has it; else of `wanted`."""
    return _message(
        "SET_POSITION_TARGET_GLOBAL_INT", time_boot_ms=1e3 * t, coordinate_frame=frame,
        type_mask=type_mask, target_system=to.system, target_component=to.component,
        **_at_place(target_of(wanted), place),
    )  # fmt: skip


def _at_place(target: Target, place: Geodetic) -> dict[str, float]:
    fields = target._asdict()
    for name in "xyz":
        del fields[name]
    return {
        "lat_int": 1e7 * place.lat_deg,
        "lon_int": 1e7 * place.lon_deg,
        "alt": place.alt_m,
        **fields,
    }


# --- SET_ATTITUDE_TARGET


class AttitudeSetpointMessage(NamedTuple):
    """SET_ATTITUDE_TARGET."""

    source: Source
    target_system: int
    target_component: int
    time_boot_ms: int
    type_mask: int
    q_EB: Quat  # level where it is ignored or refused
    w_B: Vec3  # rad/s; as received, even where it is ignored
    thrust: float  # of full thrust, 0 to 1
    refusal: Told | None  # why it must not be flown

    @property
    def request(self) -> AttitudeRequest:
        """What it asks for."""
        if self.type_mask & IGNORE_ATTITUDE:
            return AttitudeRequest(None, self.w_B, self.thrust)
        rates = zip(_EACH_RATE, self.w_B, strict=True)
        w_B = Vec3(*(0.0 if self.type_mask & bit else rate for bit, rate in rates))
        return AttitudeRequest(self.q_EB, w_B, self.thrust)


def _attitude_refusal(mask: int, q: Quat, w: Vec3, thrust: float) -> Told | None:
    if mask & THRUST_BODY:
        return Told(Code.THRUST_VECTOR)
    if mask & IGNORE_THRUST:
        return Told(Code.NO_THRUST)
    if mask & ~(_RATES | THRUST_BODY | IGNORE_THRUST | IGNORE_ATTITUDE):
        return Told(Code.MASK_BITS, (mask,))
    if not 0.0 <= thrust <= 1.0:
        return Told(Code.THRUST_RANGE)
    if mask & IGNORE_ATTITUDE and mask & _RATES:
        return Told(Code.NEEDS_BODY_RATES)
    used = [rate for bit, rate in zip(_EACH_RATE, w, strict=True) if not mask & bit]
    if not all(abs(rate) <= SPINNIEST for rate in used):
        return Told(Code.BODY_RATES_RANGE, (SPINNIEST,))
    if not mask & IGNORE_ATTITUDE and not abs(math.hypot(*q) - 1.0) <= UNIT_WITHIN:
        return Told(Code.NOT_UNIT)
    return None


def _set_attitude_target(f: Fields, source: Source) -> AttitudeSetpointMessage:
    q, mask = Quat(*f["q"]), f["type_mask"]
    w = Vec3(f["body_roll_rate"], f["body_pitch_rate"], f["body_yaw_rate"])
    why = _attitude_refusal(mask, q, w, f["thrust"])
    q_EB = attitude(normalised(_LEVEL if why or mask & IGNORE_ATTITUDE else q))
    return AttitudeSetpointMessage(
        source, f["target_system"], f["target_component"], f["time_boot_ms"], mask, q_EB, body(w),
        f["thrust"], why,
    )  # fmt: skip


def attitude_setpoint(
    to: Source, t: float, q_EB: Quat, w_B: Vec3, thrust: float, type_mask: int = 0
) -> Packed:
    """SET_ATTITUDE_TARGET; thrust 0 to 1."""
    return _message(
        "SET_ATTITUDE_TARGET", time_boot_ms=1e3 * t, type_mask=type_mask, thrust=thrust,
        target_system=to.system, target_component=to.component, **_attitude_fields(q_EB, w_B),
    )  # fmt: skip


def _attitude_fields(q_EB: Quat, w_B: Vec3) -> dict[str, Any]:
    q, w = attitude(q_EB), body(w_B)
    return {
        "q": (q.w, q.x, q.y, q.z),
        "body_roll_rate": w.x, "body_pitch_rate": w.y, "body_yaw_rate": w.z,
    }  # fmt: skip


# --- what is flown: POSITION_TARGET_LOCAL_NED, POSITION_TARGET_GLOBAL_INT, ATTITUDE_TARGET


def position_target(t: float, frame: int, type_mask: int, target: Target) -> Packed:
    """POSITION_TARGET_LOCAL_NED."""
    return _message(
        "POSITION_TARGET_LOCAL_NED", time_boot_ms=1e3 * t, coordinate_frame=frame,
        type_mask=type_mask, **target._asdict(),
    )  # fmt: skip


def position_target_global(
    t: float, frame: int, type_mask: int, place: Geodetic, target: Target
) -> Packed:
    """POSITION_TARGET_GLOBAL_INT; the position is `place`, the rest is of `target`."""
    return _message(
        "POSITION_TARGET_GLOBAL_INT", time_boot_ms=1e3 * t, coordinate_frame=frame,
        type_mask=type_mask, **_at_place(target, place),
    )  # fmt: skip


def attitude_target(t: float, type_mask: int, q_EB: Quat, w_B: Vec3, thrust: float) -> Packed:
    """ATTITUDE_TARGET.  thrust : 0 to 1, on the scale of SET_ATTITUDE_TARGET."""
    return _message(
        "ATTITUDE_TARGET", time_boot_ms=1e3 * t, type_mask=type_mask,
        thrust=min(max(thrust, 0.0), 1.0), **_attitude_fields(q_EB, w_B),
    )  # fmt: skip


def echo(t: float, message: SetpointMessage | AttitudeSetpointMessage) -> Packed:
    """An accepted setpoint, as it came: what its sender waits for."""
    m = message
    if isinstance(m, AttitudeSetpointMessage):
        return attitude_target(t, m.type_mask, m.q_EB, m.w_B, m.thrust)
    if m.geodetic is not None:
        return position_target_global(t, m.frame, m.type_mask, m.geodetic, m.target)
    return position_target(t, m.frame, m.type_mask, m.target)


class PositionTarget(NamedTuple):
    """POSITION_TARGET_LOCAL_NED: the setpoint the controller has accepted."""

    source: Source
    time_boot_ms: int
    type_mask: int
    frame: int
    target: Target

    def echoes(self, sent: Packed) -> bool:
        """Whether it repeats the setpoint of a packed message, to the bit."""
        return _ELEVEN.pack(*self.target) == sent.payload[_AS_SENT]


def _position_target(f: Fields, source: Source) -> PositionTarget:
    target = _target(f, "x", "y", "z")
    return PositionTarget(source, f["time_boot_ms"], f["type_mask"], f["coordinate_frame"], target)


Message = SetpointMessage | AttitudeSetpointMessage | PositionTarget
READERS: dict[str, Callable[[Fields, Source], Message]] = {
    "SET_POSITION_TARGET_LOCAL_NED": _set_position_target,
    "SET_POSITION_TARGET_GLOBAL_INT": _set_position_target_global,
    "SET_ATTITUDE_TARGET": _set_attitude_target,
    "POSITION_TARGET_LOCAL_NED": _position_target,
}
