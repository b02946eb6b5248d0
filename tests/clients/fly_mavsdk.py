"""A whole flight by mavsdk 4, the library without a server: argument 1 is the UDP port to listen on."""

from __future__ import annotations

import math
import sys
import threading

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.offboard import Offboard, PositionNedYaw, VelocityNedYaw
from mavsdk.plugins.param import Param, ParamError
from mavsdk.plugins.telemetry import Telemetry


def until(subscribe, unsubscribe, condition, what):
    """Wait for the first value of a subscription that meets a condition."""
    met = threading.Event()
    seen = []

    def on_value(value, _user):
        seen.append(value)
        if condition(value):
            met.set()

    handle = subscribe(on_value)
    assert met.wait(60.0), f"{what}: last seen {seen[-1] if seen else None}"
    unsubscribe(handle)
    return seen[-1]


def main(port):
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    system = mavsdk.first_autopilot(10.0)
    assert system is not None, "no autopilot within 10 s"
    telemetry, action, offboard, param = (
        Telemetry(system), Action(system), Offboard(system), Param(system)
    )  # fmt: skip

    def wait(name, condition):
        subscribe = getattr(telemetry, f"subscribe_{name}")
        unsubscribe = getattr(telemetry, f"unsubscribe_{name}")
        return until(subscribe, unsubscribe, condition, name)

    wait("health_all_ok", bool)
    param.set_param_float("MIS_TAKEOFF_ALT", 4.0)
    assert param.get_param_float("MIS_TAKEOFF_ALT") == 4.0
    param.set_param_int("COM_OBL_RC_ACT", 4)
    assert param.get_param_int("COM_OBL_RC_ACT") == 4
    assert param.get_param_int("MAV_SYS_ID") > 0
    gamma, refused = param.get_param_float("MR_GAMMA"), ""
    try:
        param.set_param_float("MR_GAMMA", -5.0)
    except ParamError as error:
        refused = str(error)
    assert "RANGE" in refused.upper(), refused
    # MAVSDK sends a set again after a while, which is refused again: behind this answer nothing is on its way
    assert param.get_param_float("MIS_TAKEOFF_ALT") == 4.0
    assert param.get_param_float("MR_GAMMA") == gamma > 0.0

    action.set_takeoff_altitude(3.0)
    action.arm()
    action.takeoff()
    wait("position", lambda p: p.relative_altitude_m > 2.8)
    wait("in_air", bool)
    print("took off", flush=True)

    offboard.set_position_ned(PositionNedYaw(4.0, -3.0, -5.0, 90.0))
    offboard.start()
    wait(
        "position_velocity_ned",
        lambda s: math.dist(
            (s.position.north_m, s.position.east_m, s.position.down_m), (4.0, -3.0, -5.0)
        ) < 0.2 and abs(s.velocity.north_m_s) < 0.1,
    )  # fmt: skip
    print("there", flush=True)

    offboard.set_velocity_ned(VelocityNedYaw(0.0, 2.0, 0.0, 90.0))
    wait("velocity_ned", lambda v: abs(v.east_m_s - 2.0) < 0.05)
    offboard.stop()
    print("2 m/s east", flush=True)

    home = telemetry.home()
    lat, lon = home.latitude_deg + 5e-5, home.longitude_deg
    action.goto_location(lat, lon, home.absolute_altitude_m + 6.0, 0.0)
    wait(
        "position",
        lambda p: abs(p.latitude_deg - lat) < 3e-6 and abs(p.relative_altitude_m - 6.0) < 0.3,
    )
    print("at the place", flush=True)

    action.return_to_launch()
    wait("armed", lambda armed: not armed)
    print("landed at home", flush=True)


main(int(sys.argv[1]))
