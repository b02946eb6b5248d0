"""A plan by pymavlink's mavwp, over MAVLink 2 or 1: argument 1 is where to connect."""

from __future__ import annotations

import sys
import time

from pymavlink import mavutil, mavwp

TYPES = ["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"]


def upload(link, loader):
    """As many scripts have it: answer each request with the loader's item."""
    link.mav.mission_count_send(link.target_system, link.target_component, loader.count())
    while True:
        asked = link.recv_match(type=TYPES, blocking=True, timeout=5.0)
        assert asked is not None, "nobody asks"
        if asked.get_type() == "MISSION_ACK":
            return asked.type
        link.mav.send(loader.wp(asked.seq))


def download(link):
    link.mav.mission_request_list_send(link.target_system, link.target_component)
    count = link.recv_match(type="MISSION_COUNT", blocking=True, timeout=5.0).count
    items = []
    while len(items) < count:
        link.mav.mission_request_send(link.target_system, link.target_component, len(items))
        items.append(link.recv_match(type="MISSION_ITEM", blocking=True, timeout=5.0))
    link.mav.mission_ack_send(link.target_system, link.target_component, 0)
    return items


def main(address):
    link = mavutil.mavlink_connection(address, source_system=245)
    link.mav.heartbeat_send(6, 8, 0, 0, 0)
    link.wait_heartbeat()
    here = link.recv_match(type="GLOBAL_POSITION_INT", blocking=True, timeout=10.0)
    lat, lon = here.lat * 1e-7, here.lon * 1e-7
    loader = mavwp.MAVWPLoader(link.target_system, link.target_component)
    frame = mavutil.mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    for command, hold, north, height in ((22, 0, 0, 6), (16, 0, 2e-4, 8), (16, 2, 4e-4, 8), (20, 0, 0, 0)):  # fmt: skip
        loader.add(
            mavutil.mavlink.MAVLink_mission_item_message(
                link.target_system, link.target_component, loader.count(), frame, command, 0, 1,
                hold, 0, 0, float("nan"), lat + north, lon, height,
            )
        )  # fmt: skip
    assert upload(link, loader) == 0
    items = download(link)
    assert [item.command for item in items] == [22, 16, 16, 20]
    assert abs(items[2].x - lat - 4e-4) < 1e-5
    print("given back", flush=True)
    # DO_SET_MODE's numbers of AUTO.MISSION, then arm: it begins
    link.mav.command_long_send(link.target_system, 1, 176, 0, 1, 4, 4, 0, 0, 0, 0)
    link.mav.command_long_send(link.target_system, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    reached, until = set(), time.monotonic() + 120.0
    while time.monotonic() < until:
        link.mav.heartbeat_send(6, 8, 0, 0, 0)
        message = link.recv_match(type=["MISSION_ITEM_REACHED", "HEARTBEAT"], blocking=True, timeout=2.0)  # fmt: skip
        if message is None:
            continue
        if message.get_type() == "MISSION_ITEM_REACHED":
            reached.add(message.seq)
        elif reached >= {0, 1, 2, 3} and not message.base_mode & 128:
            print("landed", flush=True)
            return
    raise AssertionError(f"reached {sorted(reached)}")


if __name__ == "__main__":
    main(sys.argv[1])
