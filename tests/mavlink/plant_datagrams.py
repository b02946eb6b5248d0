"""The plant link's datagrams as pymavlink packs them."""

from __future__ import annotations

import math

import numpy as np
import pymavlink.dialects.v20.common as mavlink

from fcu.kernel.algebra import Rotors

SYSTEM = 3
SPIN = Rotors(1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0)
TIME = 1_234_567_890_123


def untouched(size):
    return np.arange(size, dtype=np.float64) + 0.5


def pymavlink_at(sequence, system=SYSTEM, component=1):
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    link.seq = sequence
    return link


def odometry_by_pymavlink(on_wire, time=TIME, frame=1, child=12):
    unknown = [math.nan] + [0.0] * 20
    return mavlink.MAVLink_odometry_message(
        time, frame, child, *on_wire.r_N, on_wire.q_NF, *on_wire.v_F, *on_wire.w_F, unknown, unknown
    )


def rotors_by_pymavlink(on_wire, time=TIME, active=0xFF):
    signed = [o * s for o, s in zip(on_wire.Omega, SPIN, strict=True)]
    return mavlink.MAVLink_actuator_output_status_message(time, active, signed + [0.0] * 24)


def state_by_pymavlink(link, odometry, rotors):
    datagram = odometry.pack(link)
    link.seq = (link.seq + 1) % 256
    return datagram + rotors.pack(link)


def controls_by_pymavlink(u, sequence=0, mode=129, flags=1, time=TIME):
    message = mavlink.MAVLink_hil_actuator_controls_message(time, u + [0.0] * 8, mode, flags)
    return message.pack(pymavlink_at(sequence))
