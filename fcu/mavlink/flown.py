"""The setpoints in force, as MAVLink messages: those that came, echoed, and those made on board.

Arguments are in the frames inside; `t` is simulation time, s. No number raises.
"""

from __future__ import annotations

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Quat, Vec3
from fcu.mavlink.enums import GLOBAL_FRAMES, Frame
from fcu.mavlink.fields import NUMBERS, attitude, body, setpoint_numbers
from fcu.mavlink.framing import Packed
from fcu.mavlink.geodesy import Geodetic
from fcu.mavlink.ground_messages import AttitudeSetpointMessage, SetpointMessage
from fcu.mavlink.kinds import message as _message


def position_target(t: float, frame: int, type_mask: int, numbers: bytes) -> Packed:
    """POSITION_TARGET_LOCAL_NED of eleven float32 fields as they came, equal to the bit."""
    x, y, z, vx, vy, vz, ax, ay, az, yaw, yaw_rate = NUMBERS.unpack(numbers)
    return _message(
        "POSITION_TARGET_LOCAL_NED", time_boot_ms=1e3 * t, coordinate_frame=frame,
        type_mask=type_mask, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz, afx=ax, afy=ay, afz=az,
        yaw=yaw, yaw_rate=yaw_rate,
    )  # fmt: skip


def position_target_global(
    t: float, frame: int, type_mask: int, place: Geodetic, numbers: bytes
) -> Packed:
    """POSITION_TARGET_GLOBAL_INT; the position is `place`, the rest is of `numbers`."""
    _, _, _, vx, vy, vz, ax, ay, az, yaw, yaw_rate = NUMBERS.unpack(numbers)
    return _message(
        "POSITION_TARGET_GLOBAL_INT", time_boot_ms=1e3 * t, coordinate_frame=frame,
        type_mask=type_mask, lat_int=1e7 * place.lat_deg, lon_int=1e7 * place.lon_deg,
        alt=place.alt_m, vx=vx, vy=vy, vz=vz, afx=ax, afy=ay, afz=az, yaw=yaw, yaw_rate=yaw_rate,
    )  # fmt: skip


def position_target_flown(t: float, setpoint: Setpoint) -> Packed:
    """POSITION_TARGET_LOCAL_NED of a setpoint made on board."""
    return position_target(t, Frame.LOCAL_NED, 0, setpoint_numbers(setpoint))


def position_target_global_flown(t: float, place: Geodetic, setpoint: Setpoint) -> Packed:
    """POSITION_TARGET_GLOBAL_INT of a setpoint made on board."""
    return position_target_global(t, Frame.GLOBAL_INT, 0, place, setpoint_numbers(setpoint))


def attitude_target(t: float, type_mask: int, q_EB: Quat, w_B: Vec3, thrust: float) -> Packed:
    """ATTITUDE_TARGET; `thrust` is the commanded total over full thrust, 0 to 1."""
    q, w = attitude(q_EB), body(w_B)
    return _message(
        "ATTITUDE_TARGET", time_boot_ms=1e3 * t, type_mask=type_mask, q=(q.w, q.x, q.y, q.z),
        body_roll_rate=w.x, body_pitch_rate=w.y, body_yaw_rate=w.z,
        thrust=min(max(thrust, 0.0), 1.0),
    )  # fmt: skip


def echo(t: float, message: SetpointMessage | AttitudeSetpointMessage) -> Packed:
    """An accepted setpoint, as it came: what its sender waits for."""
    if isinstance(message, AttitudeSetpointMessage):
        m = message
        return attitude_target(t, m.type_mask, m.q_EB, m.w_B, m.thrust)
    if message.frame in GLOBAL_FRAMES and message.geodetic is not None:
        return position_target_global(
            t, message.frame, message.type_mask, message.geodetic, message.numbers
        )
    return position_target(t, message.frame, message.type_mask, message.numbers)
