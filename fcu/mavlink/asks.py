"""What a ground station or script asks of the vehicle, as MAVLink messages."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Quat, Vec3
from fcu.mavlink.answers import REAL32
from fcu.mavlink.enums import GLOBAL_FRAMES, Frame
from fcu.mavlink.fields import NUMBERS, attitude, body, setpoint_numbers
from fcu.mavlink.framing import Packed
from fcu.mavlink.geodesy import Geodetic
from fcu.mavlink.ground_messages import Source
from fcu.mavlink.kinds import message as _message

GCS, NO_AUTOPILOT, ACTIVE = 6, 8, 4
_UNSET = 2**31 - 1


def _to(to: Source) -> dict[str, int]:
    return {"target_system": to.system, "target_component": to.component}


def ground_heartbeat() -> Packed:
    """HEARTBEAT of a ground station."""
    return _message(
        "HEARTBEAT", type=GCS, autopilot=NO_AUTOPILOT, system_status=ACTIVE, mavlink_version=3
    )


def command_long(
    to: Source, command: int, params: Sequence[float] = (), confirmation: int = 0
) -> Packed:
    """COMMAND_LONG; parameters not given are 0. Raises ValueError for more than seven."""
    if len(params) > 7:
        raise ValueError(f"a command has seven parameters, not {len(params)}")
    seven = {f"param{n}": float(p) for n, p in enumerate(params, start=1)}
    return _message("COMMAND_LONG", command=command, confirmation=confirmation, **seven, **_to(to))


def command_int(to: Source, command: int, frame: int, params: Sequence[float]) -> Packed:
    """COMMAND_INT of seven parameters; 5 and 6 in degrees (global frames) or m, NaN: unset."""
    scale = 1e7 if frame in GLOBAL_FRAMES else 1e4
    x, y = (_UNSET if math.isnan(p) else scale * p for p in params[4:6])
    four = {f"param{n}": float(p) for n, p in enumerate(params[:4], start=1)}
    return _message(
        "COMMAND_INT", command=command, frame=frame, x=x, y=y, z=params[6], **four, **_to(to)
    )


def setpoint(to: Source, t: float, wanted: Setpoint, type_mask: int = 0) -> Packed:
    """SET_POSITION_TARGET_LOCAL_NED; `type_mask` as in `ground_numbers`, 0 uses all."""
    x, y, z, vx, vy, vz, ax, ay, az, yaw, yaw_rate = NUMBERS.unpack(setpoint_numbers(wanted))
    return _message(
        "SET_POSITION_TARGET_LOCAL_NED", time_boot_ms=1e3 * t, coordinate_frame=Frame.LOCAL_NED,
        type_mask=type_mask, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz, afx=ax, afy=ay, afz=az,
        yaw=yaw, yaw_rate=yaw_rate, **_to(to),
    )  # fmt: skip


def setpoint_global(
    to: Source, t: float, frame: int, place: Geodetic, wanted: Setpoint, type_mask: int = 0
) -> Packed:
    """SET_POSITION_TARGET_GLOBAL_INT: to `place`, its height as `frame` has it; else of `wanted`."""
    _, _, _, vx, vy, vz, ax, ay, az, yaw, yaw_rate = NUMBERS.unpack(setpoint_numbers(wanted))
    return _message(
        "SET_POSITION_TARGET_GLOBAL_INT", time_boot_ms=1e3 * t, coordinate_frame=frame,
        type_mask=type_mask, lat_int=1e7 * place.lat_deg, lon_int=1e7 * place.lon_deg,
        alt=place.alt_m, vx=vx, vy=vy, vz=vz, afx=ax, afy=ay, afz=az, yaw=yaw, yaw_rate=yaw_rate,
        **_to(to),
    )  # fmt: skip


def attitude_setpoint(
    to: Source, t: float, q_EB: Quat, w_B: Vec3, thrust: float, type_mask: int = 0
) -> Packed:
    """SET_ATTITUDE_TARGET; thrust 0 to 1."""
    q, w = attitude(q_EB), body(w_B)
    return _message(
        "SET_ATTITUDE_TARGET", time_boot_ms=1e3 * t, type_mask=type_mask, q=(q.w, q.x, q.y, q.z),
        body_roll_rate=w.x, body_pitch_rate=w.y, body_yaw_rate=w.z, thrust=thrust, **_to(to),
    )  # fmt: skip


def param_set(to: Source, name: str, value: float) -> Packed:
    """PARAM_SET of a REAL32."""
    return _message(
        "PARAM_SET", param_id=name.encode(), param_value=value, param_type=REAL32, **_to(to)
    )


def param_request_read(to: Source, name: str) -> Packed:
    """PARAM_REQUEST_READ by name."""
    return _message("PARAM_REQUEST_READ", param_id=name.encode(), param_index=-1, **_to(to))


def param_request_list(to: Source) -> Packed:
    """PARAM_REQUEST_LIST."""
    return _message("PARAM_REQUEST_LIST", **_to(to))
