"""A whole flight by mavsdk_grpc, the asynchronous MAVSDK: argument 1 is the address to connect by."""

from __future__ import annotations

import asyncio
import math
import sys

from mavsdk_grpc import System
from mavsdk_grpc.offboard import PositionNedYaw, VelocityNedYaw
from mavsdk_grpc.param import ParamError
from mavsdk_grpc.telemetry import FlightMode


async def until(stream, condition):
    """The first value of a stream that meets a condition."""
    async for value in stream:
        if condition(value):
            return value
    raise AssertionError("the stream ended")


async def fly(address):
    port = int(address.rpartition(":")[2])
    # of its own server: the default is one for all, and those above 32768 are given to anybody
    drone = System(port=20051 + port % 100)
    await drone.connect(system_address=address)
    await until(drone.core.connection_state(), lambda s: s.is_connected)
    await until(drone.telemetry.health_all_ok(), bool)
    telemetry, action, offboard, param = drone.telemetry, drone.action, drone.offboard, drone.param

    await param.set_param_float("MIS_TAKEOFF_ALT", 4.0)
    assert await param.get_param_float("MIS_TAKEOFF_ALT") == 4.0
    gamma, refused = await param.get_param_float("MR_GAMMA"), ""
    try:
        await param.set_param_float("MR_GAMMA", -5.0)
    except ParamError as error:
        refused = str(error)
    assert "OUT_OF_RANGE" in refused, refused
    # MAVSDK sends a set again after a while, which is refused again: behind this answer nothing is on its way
    assert await param.get_param_float("MIS_TAKEOFF_ALT") == 4.0
    assert await param.get_param_float("MR_GAMMA") == gamma > 0.0
    every = await param.get_all_params()
    assert len(every.float_params) > 50, len(every.float_params)

    await action.set_takeoff_altitude(3.0)
    await action.arm()
    await action.takeoff()
    await until(telemetry.position(), lambda p: p.relative_altitude_m > 2.8)
    await until(telemetry.in_air(), bool)
    print("took off", flush=True)

    await offboard.set_position_ned(PositionNedYaw(4.0, -3.0, -5.0, 90.0))
    await offboard.start()
    assert await offboard.is_active()
    await until(
        telemetry.position_velocity_ned(),
        lambda s: math.dist(
            (s.position.north_m, s.position.east_m, s.position.down_m), (4.0, -3.0, -5.0)
        ) < 0.2 and abs(s.velocity.north_m_s) < 0.1,
    )  # fmt: skip
    await until(telemetry.heading(), lambda h: abs(h.heading_deg - 90.0) < 3.0)
    print("there", flush=True)

    await offboard.set_velocity_ned(VelocityNedYaw(0.0, 2.0, 0.0, 90.0))
    await until(telemetry.velocity_ned(), lambda v: abs(v.east_m_s - 2.0) < 0.05)
    await offboard.stop()
    await until(telemetry.flight_mode(), lambda mode: mode is FlightMode.HOLD)
    print("2 m/s east", flush=True)

    home = await until(telemetry.home(), lambda h: True)
    lat, lon = home.latitude_deg + 5e-5, home.longitude_deg
    await action.goto_location(lat, lon, home.absolute_altitude_m + 6.0, 0.0)
    await until(
        telemetry.position(),
        lambda p: abs(p.latitude_deg - lat) < 3e-6 and abs(p.longitude_deg - lon) < 5e-6
        and abs(p.relative_altitude_m - 6.0) < 0.3,
    )  # fmt: skip
    print("at the place", flush=True)

    await action.return_to_launch()
    await until(telemetry.armed(), lambda armed: not armed)
    here = await until(telemetry.position_velocity_ned(), lambda s: True)
    assert math.hypot(here.position.north_m, here.position.east_m) < 0.5, here
    await until(telemetry.in_air(), lambda up: not up)
    print("landed at home", flush=True)


asyncio.run(asyncio.wait_for(fly(sys.argv[1]), 100.0))
