"""The time that is stated for a way: it grows with all that makes it longer, and flights keep it."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.guard import admission, arrival, governor, margin, wrench
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rows import column
from fcu.process.tick import Tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.run import prepared
from gcs_tools.judging.envelope import arrives_s

STILL = "wind.amplitude_m_s=[0,0,0]"


def test_arrival_time_grows_with_way_speed_and_acceleration(settings_of):
    law, params = settings_of(f_m=2.0, gamma=2000.0)
    times = [
        float(arrival.at_most_s(params, law, *start, 0.0, 0.0))
        for start in (
            (1.0, 0.0, 0.0, 0.0),
            (10.0, 0.0, 0.0, 0.0),
            (10.0, 2.0, 0.0, 0.0),
            (10.0, 2.0, 2.0, 0.0),
            (10.0, 2.0, 2.0, 2.0),
        )
    ]
    assert times == sorted(times) and len(set(times)) == 5
    slower = law._replace(f_m=0.5 * law.f_m)
    assert arrival.at_most_s(params, slower, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0) > times[1]


def test_a_way_of_no_length_takes_the_settling_time_of_the_reference(settings_of):
    law, params = settings_of(f_m=2.0, gamma=2000.0)
    assert 0.0 < arrival.at_most_s(params, law, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) < 30.0


@pytest.mark.parametrize("steady", [[0, 0, 0], [0, 0, 11], [-11, 0, 0]])
@pytest.mark.parametrize("far", [0.5, 5.0, 30.0])
@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0)])
@pytest.mark.computes
def test_flights_keep_the_arrival_time(steady, far, way):
    to = [far * x for x in way]
    at = f"flight.setpoints=[{{at_s=0.0,position_m={to}}}]"
    room = ("flight.duration_s=40", "flight.ground_z_m=-100", "flight.arena_m=100")
    scene = prepared("urban_step", [STILL, f"wind.steady_m_s={steady}", at, *room])[1]
    stated = arrives_s(scene)
    _, rows = law_alone.fly(scene)
    assert len(rows) == scene.ticks
    off = column(Tick, rows, "measured.r_E") - np.array(to)
    outside = np.flatnonzero(np.linalg.norm(off, axis=1) >= arrival.ARRIVED_M)
    assert stated is not None and stated < 40.0
    assert rows[outside[-1], 0] < stated


def test_a_setpoint_that_is_not_caught_up_with_has_no_time(settings_of):
    """Shipped, in still air, 20 m ahead: at 3 m/s 22.7 s were flown, at 4.5 it was never reached."""
    law, params = settings_of(f_m=2.0, gamma=2000.0, c_angle=7.0, c_rate=14.0)
    assert 22.7 < arrival.at_most_s(params, law, 20.0, 3.0, 0.0, 3.0, 0.0, 0.0) < np.inf
    assert arrival.at_most_s(params, law, 20.0, 4.5, 0.0, 4.5, 0.0, 0.0) == np.inf


def test_nor_has_one_that_the_wind_keeps_the_vehicle_off(settings_of):
    """At f_m 0.4, zeta 0.6, gamma 500 a wind to and fro left 0.35 m; the bound says more."""
    law, params = settings_of(f_m=0.4, zeta_m=0.6, gamma=500.0)
    assert arrival.off_at_most(params, law) > 0.35
    assert arrival.at_most_s(params, law, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0) == np.inf


def test_without_a_guard_nothing_is_stated():
    assert arrives_s(prepared("urban_step", ['law.guard="warn"'])[1]) is None


FAST = {"gamma": 1795.0, "guard_wind_m_s": 0.2, "c_angle": 13.0, "c_rate": 24.4}


@pytest.mark.parametrize("way", [(0.0, 0.0, -48.9), (20.0, 0.0, 0.0), (0.0, 0.0, 10.0)])
@pytest.mark.parametrize(("f_m", "zeta_m"), [(3.0, 0.6), (3.0, 1.0), (2.0, 0.6), (2.0, 1.0)])
@pytest.mark.computes
def test_a_reference_stops_at_the_setpoint_and_in_time(settings_of, f_m, zeta_m, way):
    """Braking with all that (34) takes back, or more, passed it by 0.35 to 1.49 m."""
    law, params = settings_of(guard="govern", f_m=f_m, zeta_m=zeta_m, **FAST)
    _, brake = governor.speeds(margin.known(params, law))
    j = wrench.jerk(params, law, np.inf)
    c = law.f_m / (2.0 * law.zeta_m)
    assert c * brake > governor.PART_BRAKED * j  # the jerk is what bounds the braking
    to, still, reference = np.array(way), Vec3(0.0, 0.0, 0.0), np.zeros(9)
    setpoint = to_buffer(Setpoint(Vec3(*way), still, still, 0.0, 0.0))
    off, each_s = [], 0.1
    for _ in range(300):
        off.append(reference[:3] - to)
        admission.follow(
            to_buffer(params), to_buffer(law), setpoint, round(each_s / law.h), reference
        )
    far = float(np.linalg.norm(to))
    outside = np.flatnonzero(np.linalg.norm(off, axis=1) >= arrival.ARRIVED_M)
    stated = arrival.at_most_s(params, law, far, 0.0, 0.0, 0.0, max(-way[2], 0.0), 0.0)
    assert (outside[-1] + 1) * each_s < stated < 30.0
    assert (off @ to).max() / far < 0.25
