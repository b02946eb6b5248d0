"""A ground script that greets a vehicle in the air and ends: argument 1 is the address."""

from __future__ import annotations

import sys

from pymavlink import mavutil

link = mavutil.mavlink_connection(sys.argv[1], source_system=255)
link.wait_heartbeat()
link.mav.heartbeat_send(
    mavutil.mavlink.MAV_TYPE_GCS, mavutil.mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0
)
link.recv_match(type="LOCAL_POSITION_NED", blocking=True)
