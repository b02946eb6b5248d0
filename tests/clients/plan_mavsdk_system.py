"""MAVSDK's own system tests of missions and fences, against this vehicle: argument 1 is the UDP port to listen on.

The names are those of cpp/src/system_tests, with what each of them asks for.
"""

from __future__ import annotations

import math
import sys
import threading

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.geofence import Circle, FenceType, Geofence, GeofenceData, Point, Polygon
from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan, MissionResult
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawError

LAT, LON = 47.398170, 8.545649
LONG = 1000  # items, so that a transfer takes long enough to be cancelled
WAIT_S = 30.0


def raw_items():
    """Waypoint and speed in turns, as mission_changed has them."""
    items = []
    for n, (north, height, speed) in enumerate(((0.0, 5.0, 4.0), (5e-6, 7.5, 5.0))):
        common = {"current": int(n == 0), "autocontinue": 1, "param3": 1.0, "mission_type": 0}
        items.append(RawItem(seq=2 * n, frame=6, command=16, param1=1.0, param2=1.0, param4=math.nan,
                             x=round((LAT + north) * 1e7), y=round((LON + north) * 1e7), z=height, **common))  # fmt: skip
        items.append(RawItem(seq=2 * n + 1, frame=2, command=178, param1=1.0, param2=speed,
                             param4=0.0, x=0, y=0, z=math.nan, **{**common, "current": 0, "param3": -1.0}))  # fmt: skip
    return items


def mission_changed(system):
    raw, changed = MissionRaw(system), threading.Event()
    handle = raw.subscribe_mission_changed(lambda _told, _user: changed.set())
    assert not changed.wait(0.5), "told of a change before there was one"
    raw.upload_mission(raw_items())
    assert changed.wait(2.0), "not told of a change"
    raw.unsubscribe_mission_changed(handle)
    for sent, given in zip(raw_items(), raw.download_mission(), strict=True):
        assert (sent.command, sent.x, sent.y, sent.param2) == (given.command, given.x, given.y, given.param2)  # fmt: skip


def mission_raw_upload(system):
    raw = MissionRaw(system)
    raw.upload_mission(raw_items())
    assert len(raw.download_mission()) == len(raw_items())


def mission_raw_upload_empty(system):
    raw = MissionRaw(system)
    raw.upload_mission(raw_items())
    try:
        raw.upload_mission([])
        said = "sent"
    except MissionRawError as error:  # MAVSDK's own answer: nothing reaches the vehicle
        said = str(error)
    assert "NO_MISSION_AVAILABLE" in said, said
    assert len(raw.download_mission()) == len(raw_items())


def long_plan():
    item = MissionItem(latitude_deg=LAT, longitude_deg=LON, relative_altitude_m=20.0, speed_m_s=3.0, is_fly_through=True)  # fmt: skip
    return MissionPlan(LONG * [item])


def mission_upload_cancellation(system):
    mission, raw = Mission(system), MissionRaw(system)
    raw.upload_mission(raw_items())
    ended, found = threading.Event(), []
    cancel = threading.Event()

    def on_progress(result, _data, _user):
        if result == MissionResult.NEXT:
            cancel.set()
        else:
            found.append(result)
            ended.set()

    mission.upload_mission_with_progress_async(long_plan(), on_progress)
    assert cancel.wait(WAIT_S)
    mission.cancel_mission_upload()
    assert ended.wait(WAIT_S)
    assert found == [MissionResult.TRANSFER_CANCELLED], found
    assert len(raw.download_mission()) == len(raw_items()), "half a plan"


def mission_download_cancellation(system):
    mission = Mission(system)
    mission.upload_mission(long_plan())
    ended, found, cancel = threading.Event(), [], threading.Event()

    def on_progress(result, data, _user):
        if result == MissionResult.NEXT:
            if data.has_progress:
                cancel.set()
        else:
            found.append(result)
            ended.set()

    mission.download_mission_with_progress_async(on_progress)
    assert cancel.wait(WAIT_S)
    mission.cancel_mission_download()
    assert ended.wait(WAIT_S)
    assert found == [MissionResult.TRANSFER_CANCELLED], found
    # by another plugin: this one is busy with its own end a little longer
    assert len(MissionRaw(system).download_mission()) >= LONG


def geofence_download(system):
    geofence = Geofence(system)
    MissionRaw(system).clear_mission()
    points = [Point(LAT + a, LON + b) for a, b in ((-1e-3, -1e-3), (-1e-3, 1e-3), (1e-3, 1e-3), (1e-3, -1e-3))]  # fmt: skip
    sent = GeofenceData([Polygon(points, FenceType.INCLUSION)], [Circle(Point(LAT + 5e-4, LON), 7.0, FenceType.EXCLUSION)])  # fmt: skip
    geofence.upload_geofence(sent)
    given = geofence.download_geofence()
    (polygon,), (circle,) = given.polygons, given.circles
    assert polygon.fence_type == FenceType.INCLUSION
    assert circle.fence_type == FenceType.EXCLUSION
    assert circle.radius == 7.0
    for a, b in zip(points, polygon.points, strict=True):
        assert math.isclose(a.latitude_deg, b.latitude_deg, abs_tol=1e-7)
        assert math.isclose(a.longitude_deg, b.longitude_deg, abs_tol=1e-7)
    geofence.clear_geofence()
    assert MissionRaw(system).download_geofence() == []


TESTS = (
    mission_changed, mission_raw_upload, mission_raw_upload_empty, mission_upload_cancellation,
    mission_download_cancellation, geofence_download,
)  # fmt: skip


def main(port):
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    system = mavsdk.first_autopilot(10.0)
    assert system is not None, "no autopilot within 10 s"
    for test in TESTS:
        test(system)
        print(test.__name__, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
