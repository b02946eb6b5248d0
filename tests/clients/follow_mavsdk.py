"""Follow Me by mavsdk 4: argument 1 is the UDP port to listen on. Prints the distance that is kept."""

from __future__ import annotations

import math
import sys
import threading
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.follow_me import Config, FollowMe, TargetLocation
from mavsdk.plugins.telemetry import FlightMode, Telemetry

DISTANCE_M, HEIGHT_M, M_A_DEGREE = 10.0, 9.0, 111_194.9


def main(port):
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    system = mavsdk.first_autopilot(10.0)
    assert system is not None, "no autopilot within 10 s"
    telemetry, action, follow_me = Telemetry(system), Action(system), FollowMe(system)

    def wait(name, condition, meanwhile=lambda: None):
        met, seen = threading.Event(), []

        def on_value(value, _user):
            seen.append(value)
            if condition(value):
                met.set()

        handle = getattr(telemetry, f"subscribe_{name}")(on_value)
        until = time.monotonic() + 60.0
        while not met.wait(0.25):
            assert time.monotonic() < until, f"{name}: last seen {seen[-1] if seen else None}"
            meanwhile()
        getattr(telemetry, f"unsubscribe_{name}")(handle)
        return seen[-1]

    wait("health_all_ok", bool)
    home = wait("home", lambda value: math.isfinite(value.latitude_deg))
    action.arm()
    action.takeoff()
    wait("flight_mode", lambda mode: mode == FlightMode.HOLD)
    follow_me.set_config(
        Config(HEIGHT_M, DISTANCE_M, 0.1, Config.FollowAltitudeMode.CONSTANT, 5.0, 180.0)
    )
    north = 40.0

    def target():
        place = home.latitude_deg + north / M_A_DEGREE, home.longitude_deg
        follow_me.set_target_location(
            TargetLocation(*place, home.absolute_altitude_m, 0.0, 0.0, 0.0)
        )

    follow_me.start()
    target()  # at once: the mode is known from a heartbeat before the answer
    print("started")
    there = wait(
        "position_velocity_ned",
        lambda value: (
            abs(value.position.north_m - (north - DISTANCE_M)) < 0.3
            and abs(value.position.down_m + HEIGHT_M) < 0.3
        ),
        target,
    )
    print("beside", f"{north - there.position.north_m:.1f}", f"{-there.position.down_m:.1f}")
    follow_me.stop()
    wait("flight_mode", lambda mode: mode == FlightMode.HOLD)
    action.land()
    wait("armed", lambda armed: not armed)
    print("landed")


if __name__ == "__main__":
    main(int(sys.argv[1]))
