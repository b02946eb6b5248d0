"""`gcs setpoint`: arm, take off and fly to a position, as a ground script would."""

from __future__ import annotations

import math
from collections.abc import Callable

from fcu.interface.ground_messages import LocalPosition
from fcu.interface.ground_numbers import (
    IGNORE_ACCELERATION,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    IGNORE_YAW_RATE,
)
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from gcs_tools.vehicle import Vehicle, VehicleError

TAKEOFF_M = 2.5
CLOSE_M, SLOW_M_S = 0.3, 0.3
TIMEOUT_S = 60.0  # simulation time
NOTHING = Vec3(0.0, 0.0, 0.0)


def distance(a: Vec3, b: Vec3) -> float:
    """Between two points, m."""
    return math.dist(a, b)


def fly_to(
    vehicle: Vehicle, target: Vec3, yaw_deg: float | None, tell: Callable[[str], None]
) -> LocalPosition:
    """Arm and take off if need be, fly to `target` (m, ENU) and return where it arrived.

    Raises VehicleError when the vehicle refuses, falls silent, or is not there in a minute
    of simulation time.
    """
    vehicle.wait_ready()
    told: set[str] = set()

    def hear(text: str) -> None:
        if text not in told:  # what is wrong with a stream is said again and again
            told.add(text)
            tell(f"  vehicle: {text}")

    vehicle.on_text = hear
    if not vehicle.heartbeat().armed:
        start = vehicle.position()
        vehicle.arm()
        vehicle.take_off(TAKEOFF_M)
        tell(f"armed, taking off to {TAKEOFF_M} m")
        goal = start.r_E + Vec3(0.0, 0.0, TAKEOFF_M)
        _wait_until_at(vehicle, goal)
    psi = 0.0 if yaw_deg is None else math.radians(yaw_deg)
    mask = IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW_RATE
    if yaw_deg is None:
        mask |= IGNORE_YAW

    def stream() -> None:  # a vehicle that hears no setpoint for a second takes it for lost
        vehicle.set_setpoint(Setpoint(target, NOTHING, NOTHING, psi, 0.0), 0.0, mask)

    stream()
    stream()
    vehicle.offboard()
    tell(f"flying to ({target.x:g}, {target.y:g}, {target.z:g}) m")
    there = _wait_until_at(vehicle, target, stream)
    vehicle.hold()
    return there


def _wait_until_at(
    vehicle: Vehicle, goal: Vec3, stream: Callable[[], None] = lambda: None
) -> LocalPosition:
    began = vehicle.position()
    while True:
        stream()
        here = vehicle.position()
        away = distance(here.r_E, goal)
        if away < CLOSE_M and distance(here.v_E, NOTHING) < SLOW_M_S:
            return here
        if here.time_boot_ms - began.time_boot_ms > TIMEOUT_S * 1000:
            raise VehicleError(f"not there after {TIMEOUT_S:.0f} s: still {away:.1f} m away")
