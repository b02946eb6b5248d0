"""Sticks by mavsdk_grpc: argument 1 is the address to connect by. Takes off, flies and lands by its sticks alone."""

from __future__ import annotations

import asyncio
import math
import sys

from mavsdk_grpc import System
from mavsdk_grpc.telemetry import FlightMode

EVERY_S = 0.02  # between two messages: sticks are lost after COM_RC_LOSS_T


class Hand:
    """A hand on the sticks, which it holds until it moves them."""

    def __init__(self, manual):
        self._manual = manual
        self.sticks = 0.0, 0.0, 0.5, 0.0  # forward, right, throttle, clockwise

    async def holds(self):
        """Send the sticks, again and again."""
        while True:
            await self._manual.set_manual_control_input(*self.sticks)
            await asyncio.sleep(EVERY_S)

    async def until(self, stream, condition, x=0.0, y=0.0, z=0.5, r=0.0):
        """Hold the sticks so until a value of the telemetry meets a condition: the value."""
        self.sticks = x, y, z, r
        async for value in stream:
            if condition(value):
                self.sticks = 0.0, 0.0, 0.5, 0.0
                return value
        raise AssertionError("the stream ended")


async def fly(address):
    port = int(address.rpartition(":")[2])
    # of its own server: the default is one for all, and those above 32768 are given to anybody
    drone = System(port=20051 + port % 100)
    await drone.connect(system_address=address)
    hand, telemetry, manual = Hand(drone.manual_control), drone.telemetry, drone.manual_control
    await hand.until(drone.core.connection_state(), lambda s: s.is_connected)
    await hand.until(telemetry.health_all_ok(), bool)
    await drone.param.set_param_float("COM_RC_LOSS_T", 10.0)  # however busy this machine is
    await manual.set_manual_control_input(*hand.sticks)  # MAVSDK starts no mode without
    holds = asyncio.ensure_future(hand.holds())
    await manual.start_position_control()
    await drone.action.arm()
    await hand.until(telemetry.flight_mode(), lambda mode: mode is FlightMode.POSCTL)
    print("Position")
    await hand.until(telemetry.position_velocity_ned(), lambda s: s.position.down_m < -4.0, z=1.0)
    await hand.until(telemetry.velocity_ned(), lambda v: abs(v.down_m_s) < 0.1)
    print("took off")
    await hand.until(
        telemetry.velocity_ned(), lambda v: v.east_m_s > 1.5 and abs(v.north_m_s) < 0.3, x=0.8
    )
    await hand.until(telemetry.velocity_ned(), lambda v: abs(v.east_m_s) < 0.1)
    print("forward")  # it has begun with its nose to the east
    await hand.until(telemetry.heading(), lambda h: 120.0 < h.heading_deg < 240.0, r=0.3)
    await hand.until(telemetry.attitude_angular_velocity_body(), lambda w: abs(w.yaw_rad_s) < 0.01)
    heading = math.radians((await hand.until(telemetry.heading(), lambda h: True)).heading_deg)
    print("turned clockwise")
    await manual.start_altitude_control()
    await hand.until(telemetry.flight_mode(), lambda mode: mode is FlightMode.ALTCTL)
    print("Altitude")
    before = await hand.until(telemetry.position_velocity_ned(), lambda s: True)

    def to_the_right(s):
        v = s.velocity
        return math.cos(heading) * v.east_m_s - math.sin(heading) * v.north_m_s > 1.0

    after = await hand.until(telemetry.position_velocity_ned(), to_the_right, y=0.4)
    assert abs(after.position.down_m - before.position.down_m) < 0.7, (before, after)
    print("right")
    await manual.start_position_control()
    await hand.until(
        telemetry.velocity_ned(), lambda v: max(abs(v.north_m_s), abs(v.east_m_s)) < 0.2
    )
    await hand.until(telemetry.armed(), lambda armed: not armed, z=0.0)
    print("landed")
    holds.cancel()


asyncio.run(asyncio.wait_for(fly(sys.argv[1]), 100.0))
