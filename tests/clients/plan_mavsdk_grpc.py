"""A plan, a fence and rally points by the asynchronous MAVSDK: `mavsdk_grpc`, or `mavsdk` 3 and older.

Argument 1 is the address to connect by, argument 2 the name of the package.
"""

from __future__ import annotations

import asyncio
import math
import sys
from importlib import import_module

from plan_places import FENCE, HEIGHT, ITEMS, JUMP_TO, RALLY


async def until(stream, condition):
    """The first value of a stream that meets a condition."""
    async for value in stream:
        if condition(value):
            return value
    raise AssertionError("the stream ended")


async def fly(address, package):
    fence_of, mission_of = import_module(f"{package}.geofence"), import_module(f"{package}.mission")
    raw_of, telemetry_of = import_module(f"{package}.mission_raw"), import_module(f"{package}.telemetry")  # fmt: skip
    drone = import_module(package).System(port=20051 + int(address.rpartition(":")[2]) % 100)
    await drone.connect(system_address=address)
    await until(drone.core.connection_state(), lambda s: s.is_connected)
    telemetry, mission, raw = drone.telemetry, drone.mission, drone.mission_raw
    await until(telemetry.health_all_ok(), bool)

    nan = math.nan
    items = [
        mission_of.MissionItem(
            *place, HEIGHT, 5.0, True, nan, nan, mission_of.MissionItem.CameraAction.NONE, nan, nan, nan, nan, nan,
            mission_of.MissionItem.VehicleAction.NONE,
        )
        for command, place, _ in ITEMS if command == 16
    ]  # fmt: skip
    await mission.set_return_to_launch_after_mission(True)
    await mission.upload_mission(mission_of.MissionPlan(items))
    print("upload", flush=True)
    given = (await mission.download_mission()).mission_items
    assert [(round(each.latitude_deg, 6), each.speed_m_s) for each in given] == [
        (round(each.latitude_deg, 6), 5.0) for each in items
    ]
    print("download", flush=True)
    corners = [fence_of.Point(*corner) for corner in FENCE]
    inside = fence_of.Polygon(corners, fence_of.FenceType.INCLUSION)
    await drone.geofence.upload_geofence(fence_of.GeofenceData([inside], []))
    print("fence", flush=True)
    rally = raw_of.MissionItem(
        0, 6, 5100, 1, 1, 0.0, 0.0, 0.0, 0.0, round(RALLY[0] * 1e7), round(RALLY[1] * 1e7), 0.0, 2
    )
    await raw.upload_rally_points([rally])
    print("rally", flush=True)

    await drone.action.arm()
    await mission.start_mission()
    await until(telemetry.position(), lambda p: p.relative_altitude_m > 5.0)
    print("fly", flush=True)
    await mission.pause_mission()
    mode = telemetry_of.FlightMode
    await until(telemetry.flight_mode(), lambda m: m is mode.HOLD)
    print("pause", flush=True)
    await mission.start_mission()
    await until(telemetry.flight_mode(), lambda m: m is mode.MISSION)
    print("resume", flush=True)
    last = JUMP_TO - 1  # without the take-off, MAVSDK's own items count from the first place
    await mission.set_current_mission_item(last)
    await until(mission.mission_progress(), lambda p: p.current >= last)
    print("jump", flush=True)
    await until(telemetry.armed(), lambda armed: not armed)
    await mission.clear_mission()
    assert not (await mission.download_mission()).mission_items
    print("clear", flush=True)


asyncio.run(asyncio.wait_for(fly(*sys.argv[1:]), 300.0))
