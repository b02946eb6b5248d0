"""A plan by DroneKit: argument 1 is where to connect. Its fence and rally points go by its message factory."""

from __future__ import annotations

import sys
import threading
import time

from dronekit import Command, VehicleMode, connect
from plan_places import FENCE, ITEMS, JUMP_TO, RALLY, RELATIVE

HEARD = (
    threading.Condition()
)  # told at each message: DroneKit has no other way to wait for most of what it knows


def wait(condition, what, seconds=200.0):
    """Wait until a condition is met, and look at each message."""
    until = time.monotonic() + seconds
    with HEARD:
        while not condition():
            left = until - time.monotonic()
            assert left > 0.0, f"{what}: not within {seconds} s"
            HEARD.wait(left)


def store(vehicle, kind, items):
    """A fence (1) or rally points (2), which DroneKit has no commands for: command, parameter 1, place of each."""
    answers = []

    @vehicle.on_message("MISSION_ACK")
    def acknowledged(_vehicle, _name, message):
        if getattr(message, "mission_type", 0) == kind:
            answers.append(message.type)

    @vehicle.on_message(["MISSION_REQUEST", "MISSION_REQUEST_INT"])
    def asked(_vehicle, _name, message):
        if getattr(message, "mission_type", 0) == kind:
            command, first, (lat, lon) = items[message.seq]
            vehicle.send_mavlink(
                vehicle.message_factory.mission_item_int_encode(
                    0, 0, message.seq, 0, command, 0, 1, first, 0, 0, 0, round(lat * 1e7), round(lon * 1e7), 0, kind
                )
            )  # fmt: skip

    vehicle.send_mavlink(vehicle.message_factory.mission_count_encode(0, 0, len(items), kind))
    wait(lambda: answers, f"kind {kind}", 20.0)
    assert answers == [0]
    vehicle.remove_message_listener("MISSION_ACK", acknowledged)
    vehicle.remove_message_listener("MISSION_REQUEST", asked)


def main(address):
    vehicle = connect(address, heartbeat_timeout=60, source_system=245)
    reached = set()

    @vehicle.on_message("*")
    def heard(_vehicle, _name, _message):
        with HEARD:
            HEARD.notify_all()

    vehicle.on_message("MISSION_ITEM_REACHED")(lambda _vehicle, _name, m: reached.add(m.seq))
    commands = vehicle.commands
    commands.clear()
    for command, (lat, lon), z in ITEMS:
        commands.add(Command(0, 0, 0, RELATIVE, command, 0, 1, 0, 0, 0, 0, lat, lon, z))
    commands.upload(timeout=20)
    print("upload", flush=True)
    commands.download()
    commands.wait_ready(timeout=30)
    # its own numbers leave out item 0, which is home for ArduPilot
    assert [each.command for each in commands] == [command for command, _, _ in ITEMS[1:]]
    print("download", flush=True)
    store(vehicle, 1, [(5001, float(len(FENCE)), corner) for corner in FENCE])
    print("fence", flush=True)
    store(vehicle, 2, [(5100, 0.0, RALLY)])
    print("rally", flush=True)

    def mode(name):
        # by its name: pymavlink knows the numbers of PX4's modes, and DroneKit hands the name on
        vehicle.mode = VehicleMode(name)
        wait(lambda: vehicle.mode.name == name, name, 20.0)

    mode("MISSION")
    vehicle.armed = True
    wait(lambda: 0 in reached, "the first item")
    print("fly", flush=True)
    mode("LOITER")
    print("pause", flush=True)
    mode("MISSION")
    print("resume", flush=True)
    commands.next = JUMP_TO
    wait(lambda: commands.next == JUMP_TO, "jump", 20.0)
    print("jump", flush=True)
    wait(lambda: JUMP_TO in reached and not vehicle.armed, "the end")
    commands.clear()
    # clear() leaves item 0, as ArduPilot's home, so the message is sent by itself
    cleared = []
    vehicle.on_message("MISSION_ACK")(lambda _vehicle, _name, m: cleared.append(m.type))
    vehicle.send_mavlink(vehicle.message_factory.mission_clear_all_encode(0, 0))
    wait(lambda: cleared, "clear", 20.0)
    assert cleared == [0]
    print("clear", flush=True)
    vehicle.close()


if __name__ == "__main__":
    main(sys.argv[1])
