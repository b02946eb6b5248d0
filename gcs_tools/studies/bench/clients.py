"""Two listeners for `make bench`: a ground station and a second script, as processes of their own.

    python -m gcs_tools.studies.bench.clients INSTANCE

Each sends heartbeats and reads what the vehicle streams. Prints one line when both do, vehicle or
not, and the number of datagrams each has read when its standard input closes.
"""

from __future__ import annotations

import select
import socket
import sys
import time

from fcu.interface.link import HOST
from fcu.interface.ports import ports
from fcu.mavlink.ground_link import GroundCodec
from fcu.mavlink.telemetry import ground_heartbeat

BEAT_S = 0.02  # wall: to be heard as soon as the vehicle is there


def main(instance: int) -> None:
    """Listen until nobody wants it any more."""
    at = ports(instance)
    vehicle = {}
    for system, port in ((254, at.fcu_station), (253, at.fcu_script)):
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        link.bind((HOST, 0))
        vehicle[link] = (GroundCodec(system, 190), (HOST, port))
    heard = dict.fromkeys(vehicle, 0)
    due = 0.0
    print("listening", flush=True)
    while True:
        now = time.monotonic()
        if now >= due:
            due = now + BEAT_S
            for link, (codec, address) in vehicle.items():
                link.sendto(codec.framed(ground_heartbeat()), address)
        ready = select.select([*vehicle, sys.stdin], [], [], 0.1)[0]
        if sys.stdin in ready:
            break
        for link in heard:
            if link in ready:
                link.recv(65535)
                heard[link] += 1
    print(*heard.values(), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
