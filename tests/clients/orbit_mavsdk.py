"""An orbit by mavsdk 4: argument 1 is the UDP port to listen on. Prints the radius that is flown."""

from __future__ import annotations

import math
import sys
import threading

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action, OrbitYawBehavior
from mavsdk.plugins.telemetry import FlightMode, Telemetry

RADIUS_M, SPEED_M_S = 8.0, 2.0


def main(port):
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    system = mavsdk.first_autopilot(10.0)
    assert system is not None, "no autopilot within 10 s"
    telemetry, action = Telemetry(system), Action(system)

    def wait(name, condition):
        met, seen = threading.Event(), []

        def on_value(value, _user):
            seen.append(value)
            if condition(value):
                met.set()

        handle = getattr(telemetry, f"subscribe_{name}")(on_value)
        assert met.wait(60.0), f"{name}: last seen {seen[-1] if seen else None}"
        getattr(telemetry, f"unsubscribe_{name}")(handle)
        return seen[-1]

    wait("health_all_ok", bool)
    home = wait("home", lambda value: math.isfinite(value.latitude_deg))
    action.arm()
    action.takeoff()
    wait("flight_mode", lambda mode: mode == FlightMode.HOLD)
    height = home.absolute_altitude_m + 3.0
    where = home.latitude_deg, home.longitude_deg, height
    action.do_orbit(RADIUS_M, SPEED_M_S, OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER, *where)
    distances = []
    for quarter in ((-1, 0), (0, -1), (1, 0), (0, 1)):  # south, west, north and east of the centre
        at = wait(
            "position_velocity_ned",
            lambda value, q=quarter: (
                value.position.north_m * q[0] + value.position.east_m * q[1] > 0.9 * RADIUS_M
            ),
        )
        distances.append(math.hypot(at.position.north_m, at.position.east_m))
    print("radius", *(f"{each:.2f}" for each in distances))
    assert all(abs(each - RADIUS_M) < 0.1 for each in distances)
    action.hold()
    wait("flight_mode", lambda mode: mode == FlightMode.HOLD)
    action.land()
    wait("armed", lambda armed: not armed)


if __name__ == "__main__":
    main(int(sys.argv[1]))
