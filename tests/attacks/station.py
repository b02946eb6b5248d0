"""`python -m tests.attacks.station INSTANCE`: a ground station that sends heartbeats, and reads telemetry."""

from __future__ import annotations

import select
import socket
import sys
import time

import pymavlink.dialects.v20.common as mavlink

from fcu.interface.ports import ports

BEAT_S = 1.0


def main(instance: int) -> None:
    """Send a heartbeat a second, until a signal ends it."""
    codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    beat = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        due = time.monotonic()
        while True:
            if time.monotonic() >= due:
                link.sendto(beat.pack(codec), ("127.0.0.1", ports(instance).fcu_station))
                due += BEAT_S
            if select.select([link], [], [], max(0.0, due - time.monotonic()))[0]:
                link.recv(4096)


if __name__ == "__main__":
    main(int(sys.argv[1]))
