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
    if len(sys.argv) > 2:  # MAVLink 1 has no kinds of items
        corners = [(-5e-4, -5e-4), (-5e-4, 5e-4), (8e-4, 5e-4), (8e-4, -5e-4)]
        assert store(link, 1, [(5001, 4.0, lat + a, lon + b) for a, b in corners]) == 0
        print("fenced", flush=True)
        assert store(link, 2, [(5100, 0.0, lat + 3e-4, lon)]) == 0
        print("rally", flush=True)

    def command(number, *params):
        link.mav.command_long_send(
            link.target_system, 1, number, 0, *params, *(7 - len(params)) * [0]
        )

    def wait(what, condition):
        until = time.monotonic() + 120.0
        while time.monotonic() < until:
            link.mav.heartbeat_send(6, 8, 0, 0, 0)
            message = link.recv_match(
                type=["MISSION_ITEM_REACHED", "MISSION_CURRENT", "HEARTBEAT"], blocking=True, timeout=2.0
            )  # fmt: skip
            if message is not None and message.get_type() == "MISSION_ITEM_REACHED":
                reached.add(message.seq)
            if message is not None and condition(message):
                print(what, flush=True)
                return
        raise AssertionError(f"{what}: not within 120 s, reached {sorted(reached)}")

    def is_mode(sub):
        return lambda m: (
            m.get_type() == "HEARTBEAT" and (m.custom_mode >> 16) & 0xFFFF == 4 | sub << 8
        )

    reached = set()
    # DO_SET_MODE's numbers of AUTO.MISSION, then arm: it begins
    command(176, 1, 4, 4)
    command(400, 1)
    wait("started", lambda _: 0 in reached)
    command(193, 0)  # DO_PAUSE_CONTINUE
    wait("paused", is_mode(3))
    command(193, 1)
    wait("resumed", is_mode(4))
    link.mav.mission_set_current_send(link.target_system, 1, 2)
    wait("jumped", lambda m: m.get_type() == "MISSION_CURRENT" and m.seq == 2)
    wait(
        "landed",
        lambda m: m.get_type() == "HEARTBEAT" and reached >= {2, 3} and not m.base_mode & 128,
    )
    link.mav.mission_clear_all_send(link.target_system, 1)
    assert link.recv_match(type="MISSION_ACK", blocking=True, timeout=5.0).type == 0
    assert download(link) == []
    print("cleared", flush=True)


def store(link, kind, items):
    """A fence (1) or rally points (2): command, parameter 1, latitude and longitude of each."""
    link.mav.mission_count_send(link.target_system, 1, len(items), kind)
    while True:
        asked = link.recv_match(type=TYPES, blocking=True, timeout=5.0)
        assert asked is not None, "nobody asks"
        if asked.get_type() == "MISSION_ACK":
            return asked.type
        command, first, lat, lon = items[asked.seq]
        link.mav.mission_item_int_send(
            link.target_system, 1, asked.seq, 0, command, 0, 1, first, 0, 0, 0, round(lat * 1e7),
            round(lon * 1e7), 0, kind,
        )  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1])
