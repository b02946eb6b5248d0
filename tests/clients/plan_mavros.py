"""A node for MAVROS that pushes, flies, pulls and clears a plan, a fence and a rally point, as its `mav` tools do."""

from __future__ import annotations

import time

import rospy
from mavros_msgs.msg import State, Waypoint, WaypointReached
from mavros_msgs.srv import (
    CommandBool,
    SetMode,
    WaypointClear,
    WaypointPull,
    WaypointPush,
    WaypointSetCurrent,
)
from plan_places import FENCE, ITEMS, JUMP_TO, RALLY, RELATIVE

state, reached = State(), set()


def heard(said):
    """Keep the state."""
    global state
    state = said


def wait(condition, what, seconds=200.0):
    """Ask again and again, at 20 Hz."""
    until, rate = time.monotonic() + seconds, rospy.Rate(20)
    while not condition():
        assert time.monotonic() < until, f"{what}: not within {seconds} s"
        rate.sleep()


def waypoint(frame, command, place, z, first=0.0):
    lat, lon = place
    return Waypoint(
        frame=frame, command=command, is_current=False, autocontinue=True, param1=first, x_lat=lat, y_long=lon, z_alt=z
    )  # fmt: skip


rospy.init_node("plan")
rospy.Subscriber("mavros/state", State, heard)
rospy.Subscriber("mavros/mission/reached", WaypointReached, lambda m: reached.add(m.wp_seq))
wait(lambda: state.connected, "MAVROS")


def service(name, kind):
    return rospy.ServiceProxy(f"mavros/{name}", kind)


def mode(name):
    assert service("set_mode", SetMode)(base_mode=0, custom_mode=name).mode_sent
    wait(lambda: state.mode == name, name, 20.0)


push = service("mission/push", WaypointPush)
items = [waypoint(RELATIVE, command, place, z) for command, place, z in ITEMS]
answer = push(start_index=0, waypoints=items)
assert answer.success, answer
assert answer.wp_transfered == len(items), answer
print("upload", flush=True)
assert service("mission/pull", WaypointPull)().wp_received == len(items)
print("download", flush=True)
corners = [waypoint(0, 5001, corner, 0.0, float(len(FENCE))) for corner in FENCE]
assert service("geofence/push", WaypointPush)(start_index=0, waypoints=corners).success
assert service("geofence/pull", WaypointPull)().wp_received == len(corners)
print("fence", flush=True)
points = [waypoint(RELATIVE, 5100, RALLY, 0.0)]
assert service("rallypoint/push", WaypointPush)(start_index=0, waypoints=points).success
print("rally", flush=True)
mode("AUTO.MISSION")
assert service("cmd/arming", CommandBool)(True).success
wait(lambda: 0 in reached, "the first item")
print("fly", flush=True)
mode("AUTO.LOITER")
print("pause", flush=True)
mode("AUTO.MISSION")
print("resume", flush=True)
assert service("mission/set_current", WaypointSetCurrent)(wp_seq=JUMP_TO).success
print("jump", flush=True)
wait(lambda: JUMP_TO in reached and not state.armed, "the end")
assert service("mission/clear", WaypointClear)().success
assert service("mission/pull", WaypointPull)().wp_received == 0
print("clear", flush=True)
