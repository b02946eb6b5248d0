"""A plan, a fence and rally points by mavsdk 4: argument 1 is the UDP port to listen on."""

from __future__ import annotations

import math
import sys
import threading

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.geofence import Circle, FenceType, Geofence, GeofenceData, Point, Polygon
from mavsdk.plugins.mission import Mission, MissionError, MissionItem, MissionPlan
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw
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
    assert met.wait(120.0), f"{what}: last seen {seen[-1] if seen else None}"
    unsubscribe(handle)
    return seen[-1]


def main(port):
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    system = mavsdk.first_autopilot(10.0)
    assert system is not None, "no autopilot within 10 s"
    telemetry, action, mission = Telemetry(system), Action(system), Mission(system)
    raw, geofence = MissionRaw(system), Geofence(system)

    def wait(name, condition):
        subscribe = getattr(telemetry, f"subscribe_{name}")
        return until(subscribe, getattr(telemetry, f"unsubscribe_{name}"), condition, name)

    def progress(condition):
        subscribe, unsubscribe = mission.subscribe_mission_progress, mission.unsubscribe_mission_progress  # fmt: skip
        return until(subscribe, unsubscribe, condition, "progress")

    wait("health_all_ok", bool)
    here = wait("position", lambda p: math.isfinite(p.latitude_deg))

    def at(north, east):
        lat = here.latitude_deg + math.degrees(north / 6_371_000.0)
        lon = here.longitude_deg + math.degrees(
            east / (6_371_000.0 * math.cos(math.radians(here.latitude_deg)))
        )
        return lat, lon

    def item(north, east, through=True):
        lat, lon = at(north, east)
        return MissionItem(
            latitude_deg=lat, longitude_deg=lon, relative_altitude_m=8.0, speed_m_s=5.0,
            is_fly_through=through,
        )  # fmt: skip

    places = [(15.0, 0.0), (15.0, 15.0), (0.0, 15.0), (-5.0, 5.0)]
    plan = MissionPlan([item(*place) for place in places])
    mission.set_return_to_launch_after_mission(True)
    mission.upload_mission(plan)
    given = mission.download_mission().mission_items
    for place, each in zip(places, given, strict=True):
        assert math.isclose(each.latitude_deg, at(*place)[0], abs_tol=1e-6)
        assert (each.speed_m_s, each.is_fly_through) == (5.0, True)
    print("given back", flush=True)

    corners = [Point(*at(north, east)) for north, east in ((-40, -40), (-40, 40), (40, 40), (40, -40))]  # fmt: skip
    inside = Polygon(corners, FenceType.INCLUSION)
    post = Circle(Point(*at(15.0, 8.0)), 3.0, FenceType.EXCLUSION)
    mission.clear_mission()
    geofence.upload_geofence(GeofenceData([inside], [post]))
    try:
        mission.upload_mission(plan)
        raise AssertionError("a plan through a fence was taken")
    except MissionError as error:
        print(f"refused: {error}", flush=True)
    geofence.clear_geofence()
    geofence.upload_geofence(GeofenceData([inside], []))
    mission.upload_mission(plan)
    print("fenced", flush=True)
    lat, lon = at(-8.0, 8.0)
    rally = RawItem(
        seq=0, frame=6, command=5100, current=1, autocontinue=1, param1=0.0, param2=0.0, param3=0.0,
        param4=0.0, x=round(lat * 1e7), y=round(lon * 1e7), z=0.0, mission_type=2,
    )  # fmt: skip
    raw.upload_rally_points([rally])
    assert len(raw.download_rallypoints()) == 1
    assert len(raw.download_geofence()) == 4
    print("rally", flush=True)

    action.arm()
    mission.start_mission()
    progress(lambda p: p.current >= 1)
    print("started", flush=True)
    mission.pause_mission()
    wait("flight_mode", lambda mode: mode == Telemetry_HOLD)
    print("paused", flush=True)
    mission.set_current_mission_item(2)
    mission.start_mission()
    progress(lambda p: p.current == p.total == 4)
    print("all", flush=True)
    wait("armed", lambda armed: not armed)
    landed = wait("position", lambda p: math.isfinite(p.latitude_deg))
    north = math.radians(landed.latitude_deg - here.latitude_deg) * 6_371_000.0
    east = math.radians(landed.longitude_deg - here.longitude_deg) * 6_371_000.0
    east *= math.cos(math.radians(here.latitude_deg))
    # the rally point is nearer to the last item than home
    assert math.hypot(north + 8.0, east - 8.0) < 1.0, (north, east)
    raw.clear_mission()
    assert raw.download_mission() == []
    print("cleared", flush=True)


if __name__ == "__main__":
    from mavsdk.plugins.telemetry import FlightMode

    Telemetry_HOLD = FlightMode.HOLD
    main(int(sys.argv[1]))
