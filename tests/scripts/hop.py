"""A ground script by pymavlink: take off, fly a little, land. Argument 1 is the address, 2 a misbehaviour."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

from pymavlink import mavutil

MAV = mavutil.mavlink
URL, HOW = sys.argv[1], (sys.argv[2] if len(sys.argv) > 2 else "well")


def misbehave(at: str) -> None:
    """Do what the second argument asks for at this place."""
    if at != "begin" and HOW == "fails":
        sys.exit("nothing to fly today")
    if at != "begin" and HOW == "crashes":
        os.kill(os.getpid(), signal.SIGSEGV)
    if at != "begin" and HOW == "hangs":
        signal.pause()
    if at == "begin" and HOW == "mute":
        sys.exit(0)
    if at == "begin" and HOW == "deaf":
        signal.pause()
    if at == "begin" and HOW == "leaves":
        child = subprocess.Popen(["sleep", "600"], start_new_session=True)
        print("child", child.pid, flush=True)


misbehave("begin")
link = mavutil.mavlink_connection(URL, source_system=255)
link.wait_heartbeat()
link.mav.heartbeat_send(MAV.MAV_TYPE_GCS, MAV.MAV_AUTOPILOT_INVALID, 0, 0, 0)
misbehave("connected")


def command(number: int, *parameters: float) -> None:
    """Ask again until the vehicle accepts it."""
    numbers = [*parameters, *[0.0] * (7 - len(parameters))]
    while True:
        link.mav.command_long_send(link.target_system, 1, number, 0, *numbers)
        ack = link.recv_match(type="COMMAND_ACK", blocking=True, timeout=1.0)
        if ack is not None and ack.command == number and ack.result == MAV.MAV_RESULT_ACCEPTED:
            return


def upload(*items: tuple[int, float, float]) -> None:
    """Have a plan of items in place of the vehicle's: command, first parameter, height over the home position."""
    at = link.recv_match(type="GLOBAL_POSITION_INT", blocking=True)
    link.mav.mission_count_send(link.target_system, 1, len(items))
    while True:
        asked = link.recv_match(
            type=["MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK"], blocking=True
        )
        if asked.get_type() == "MISSION_ACK":
            assert asked.type == MAV.MAV_MISSION_ACCEPTED, asked
            return
        number, first, z = items[asked.seq]
        link.mav.mission_item_int_send(
            link.target_system, 1, asked.seq, MAV.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, number, 0, 1,
            first, 0.0, 0.0, float("nan"), at.lat, at.lon, z,
        )  # fmt: skip


def height() -> float:
    """Of the next position that the vehicle sends, m."""
    return -link.recv_match(type="LOCAL_POSITION_NED", blocking=True).z


def landed() -> None:
    """Wait until the rotors stand."""
    armed = MAV.MAV_MODE_FLAG_SAFETY_ARMED
    while link.recv_match(type="HEARTBEAT", blocking=True).base_mode & armed:
        pass
    print("landed", flush=True)


command(MAV.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
ground = height()
print("armed", flush=True)
if HOW == "sits":
    command(MAV.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
    sys.exit(0)
if HOW == "unguarded":
    link.mav.param_set_send(link.target_system, 1, b"MR_GUARD", 0.0, MAV.MAV_PARAM_TYPE_REAL32)
    while link.recv_match(type="PARAM_VALUE", blocking=True).param_id != "MR_GUARD":
        pass
if HOW == "plans":
    upload(
        (MAV.MAV_CMD_NAV_TAKEOFF, 0.0, 3.0),
        (MAV.MAV_CMD_NAV_LOITER_TIME, float(os.environ.get("HOP_S", "0")), 3.0),
        (MAV.MAV_CMD_NAV_LAND, 0.0, 0.0),
    )
    command(MAV.MAV_CMD_MISSION_START)
    print("plan", flush=True)
    landed()
    sys.exit(0)
command(MAV.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, float("nan"), float("nan"), float("nan"), 3.0)
if HOW == "stops":  # the rotors, where a fall harms nothing
    while height() < ground + 0.3:
        pass
    command(MAV.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0)
    sys.exit(0)
while height() < ground + 2.7:
    pass
until = time.monotonic() + float(os.environ.get("HOP_S", "0"))
while time.monotonic() < until:
    height()
print("up", flush=True)
if HOW == "floats":
    sys.exit(0)
command(MAV.MAV_CMD_NAV_LAND)
print("landing", flush=True)
landed()
