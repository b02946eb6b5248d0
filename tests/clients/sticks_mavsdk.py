"""Sticks by mavsdk 4: argument 1 is the UDP port to listen on. Takes off, flies and lands by its sticks alone."""

from __future__ import annotations

import math
import sys
import threading
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.manual_control import ManualControl
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import FlightMode, Telemetry

EVERY_S = 0.02  # between two messages: sticks are lost after COM_RC_LOSS_T


def main(port):
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    system = mavsdk.first_autopilot(10.0)
    assert system is not None, "no autopilot within 10 s"
    telemetry, action, manual = Telemetry(system), Action(system), ManualControl(system)

    def hold(name, condition, x=0.0, y=0.0, z=0.5, r=0.0):
        """Hold the sticks until a value of the telemetry meets a condition: the value."""
        met, seen = threading.Event(), []

        def on_value(value, _user):
            seen.append(value)
            if condition(value):
                met.set()

        handle = getattr(telemetry, f"subscribe_{name}")(on_value)
        until = time.monotonic() + 60.0
        while not met.wait(EVERY_S):
            assert time.monotonic() < until, f"{name}: last seen {seen[-1] if seen else None}"
            manual.set_manual_control_input(x, y, z, r)
        getattr(telemetry, f"unsubscribe_{name}")(handle)
        return seen[-1]

    hold("health_all_ok", bool)
    Param(system).set_param_float("COM_RC_LOSS_T", 10.0)  # however busy this machine is
    action.arm()
    manual.start_position_control()
    hold("flight_mode", lambda mode: mode == FlightMode.POSCTL)
    print("Position")
    hold("position_velocity_ned", lambda s: s.position.down_m < -4.0, z=1.0)
    hold("velocity_ned", lambda v: abs(v.down_m_s) < 0.1)
    print("took off")
    hold("velocity_ned", lambda v: v.east_m_s > 1.5 and abs(v.north_m_s) < 0.3, x=0.8)
    hold("velocity_ned", lambda v: abs(v.east_m_s) < 0.1)
    print("forward")  # it has begun with its nose to the east
    hold("heading", lambda h: 120.0 < h.heading_deg < 240.0, r=0.3)
    hold("attitude_angular_velocity_body", lambda w: abs(w.yaw_rad_s) < 0.01)
    heading = math.radians(hold("heading", lambda h: True).heading_deg)
    print("turned clockwise")
    manual.start_altitude_control()
    hold("flight_mode", lambda mode: mode == FlightMode.ALTCTL)
    print("Altitude")
    before = hold("position_velocity_ned", lambda s: True).position.down_m

    def to_the_right(s):
        v = s.velocity
        return math.cos(heading) * v.east_m_s - math.sin(heading) * v.north_m_s > 1.0

    after = hold("position_velocity_ned", to_the_right, y=0.4).position.down_m
    assert abs(after - before) < 0.7, (before, after)
    print("right")
    manual.start_position_control()
    hold("velocity_ned", lambda v: max(abs(v.north_m_s), abs(v.east_m_s)) < 0.2)
    hold("armed", lambda armed: not armed, z=0.0)
    print("landed")


if __name__ == "__main__":
    main(int(sys.argv[1]))
