"""`gcs setpoint`: arm, take off and fly to a position, as a ground script would."""

from __future__ import annotations

import math
from collections.abc import Callable

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.mavlink.definitions import (
    IGNORE_ACCELERATION,
    IGNORE_VELOCITY,
    IGNORE_YAW,
    IGNORE_YAW_RATE,
    LandedState,
)
from fcu.mavlink.ground_link import GroundMessage
from fcu.mavlink.px4_modes import MainMode
from fcu.mavlink.telemetry import ExtendedState, Heartbeat, LocalPosition
from gcs_tools.flight.ground_script import Vehicle, VehicleError

TAKEOFF_M = 2.5
CLOSE_M, SLOW_M_S = 0.3, 0.3
TIMEOUT_S = 60.0  # simulation time
HOLD_TRIES = 2  # half a second each, for somebody who waits for the prompt
NOTHING = Vec3(0.0, 0.0, 0.0)


def distance(a: Vec3, b: Vec3) -> float:
    """Between two points, m."""
    return math.dist(a, b)


class Watch:
    """Why a vehicle that was sent somewhere does not go there any more."""

    def __init__(self) -> None:
        self.why = ""  # what it has done instead; empty: it goes on
        self.offboard = False  # whether it was told to fly setpoints
        self._has_flown = False

    def see(self, message: GroundMessage) -> None:
        """Whatever the vehicle sends, once it is armed."""
        if isinstance(message, ExtendedState):
            on_ground = message.landed_state == LandedState.ON_GROUND
            self._has_flown |= not on_ground
            if on_ground and self._has_flown:
                self.why = self.why or "has landed"
        elif isinstance(message, Heartbeat):
            if not message.armed:
                self.why = self.why or "has disarmed"
            elif self.offboard and message.main_mode != MainMode.OFFBOARD:
                self.why = self.why or "is in another mode by now"


def fly_to(
    vehicle: Vehicle, target: Vec3, yaw_deg: float | None, tell: Callable[[str], None]
) -> LocalPosition:
    """Arm and take off if need be, fly to `target` (m, ENU) and return where it arrived.

    Raises VehicleError when the vehicle refuses, falls silent, lands, or is not there in a
    minute of simulation time. Interrupted, it has the vehicle hold, and goes on with that.
    """
    vehicle.wait_ready()
    told: set[str] = set()

    def hear(text: str) -> None:
        if text not in told:  # what is wrong with a stream is said again and again
            told.add(text)
            tell(f"  vehicle: {text}")

    vehicle.on_text = hear
    try:
        return _fly_to(vehicle, target, yaw_deg, tell)
    except KeyboardInterrupt:
        try:
            vehicle.hold(HOLD_TRIES)
        except VehicleError as error:
            tell(f"interrupted, and the vehicle may not hold: {error}")
        else:
            tell("interrupted: the vehicle holds where it is")
        raise


def _fly_to(
    vehicle: Vehicle, target: Vec3, yaw_deg: float | None, tell: Callable[[str], None]
) -> LocalPosition:
    watch = Watch()
    start = vehicle.position()
    armed = vehicle.heartbeat().armed
    if not armed:
        vehicle.arm()
    vehicle.on_message = watch.see
    if not armed:
        vehicle.take_off(TAKEOFF_M)
        _wait_until_at(vehicle, start.r_E + Vec3(0.0, 0.0, TAKEOFF_M), watch)
    psi = 0.0 if yaw_deg is None else math.radians(yaw_deg)
    mask = IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW_RATE
    if yaw_deg is None:
        mask |= IGNORE_YAW

    def stream() -> None:  # a vehicle that hears no setpoint for a second takes it for lost
        vehicle.set_setpoint(Setpoint(target, NOTHING, NOTHING, psi, 0.0), 0.0, mask)

    stream()
    stream()
    vehicle.offboard()
    watch.offboard = True
    tell(f"flying to ({target.x:g}, {target.y:g}, {target.z:g}) m")
    there = _wait_until_at(vehicle, target, watch, stream)
    watch.offboard = False
    vehicle.hold()
    return there


def _wait_until_at(
    vehicle: Vehicle, goal: Vec3, watch: Watch, stream: Callable[[], None] = lambda: None
) -> LocalPosition:
    began = vehicle.position()
    while True:
        stream()
        here = vehicle.position()
        away = distance(here.r_E, goal)
        if away < CLOSE_M and distance(here.v_E, NOTHING) < SLOW_M_S:
            return here
        if watch.why:
            raise VehicleError(f"not there: the vehicle {watch.why}, {away:.1f} m away")
        if here.time_boot_ms - began.time_boot_ms > TIMEOUT_S * 1000:
            raise VehicleError(f"not there after {TIMEOUT_S:.0f} s: still {away:.1f} m away")
