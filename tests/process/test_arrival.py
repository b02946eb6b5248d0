"""A mission that ends by arrival: verdict and recording end with one tick, however late rows come."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import gcs_tools
from fcu.kernel.buffers import size
from fcu.kernel.rows import column
from fcu.laws.face import FLYING, IDLE, SharedTick
from gcs_tools.flight.arrival import UntilArrival, arrival
from gcs_tools.flight.processes import Collector
from gcs_tools.flight.run import _Run, prepared
from gcs_tools.flight.wire_flight import WireFlight
from gcs_tools.recording.reader import read
from sitl_plant.physics.types import PlantRecord

SOON = ["flight.arrive.within_m=0.5", "flight.arrive.for_s=1.0"]
LATE_FROM_S = 7.0  # simulation time: arrival is looked for from the last setpoint on, at 8 s


@pytest.fixture
def flight(tmp_path, monkeypatch):
    """Fly `take_off`: its result, its recording, and how many ticks were flown until somebody looked."""
    cut, lengths = _Run._cut_at_arrival, []
    monkeypatch.setattr(
        _Run, "_cut_at_arrival", lambda run, flown: (lengths.append(len(flown.plant)), cut(run, flown))[1]
    )  # fmt: skip

    def fly(record="full", settings=(), **options):
        out = tmp_path / f"{len(lengths)}"
        result = gcs_tools.fly(
            "take_off",
            settings=[*SOON, *settings],
            out=out,
            figure="never",
            record=record,
            **options,
        )
        assert result.error is None and result.ended == "arrived"
        recording = None if record == "none" else read(out / "flight.mcap")
        return result, recording, lengths[-1]

    return fly


@pytest.mark.slow
def test_the_controllers_rows_are_waited_for(flight, monkeypatch):
    """At each look they are held back until somebody is found waiting for rows of both."""
    wanted, _, flown = flight(in_process=True)
    take, wait, wait_for_rows = Collector._take, Collector.wait_for, WireFlight._wait_for_rows
    held, waiting, one_at_a_time = [], threading.Event(), threading.Lock()

    def hold_back(self, fd, data):
        width, kept, _ = self._sources[fd]
        of_fcu = width == max(width for width, *_ in self._sources.values())
        with one_at_a_time:
            late = len(kept) and kept.last[-1, 0] > LATE_FROM_S
            if of_fcu and late and not (waiting.is_set() and not held):
                held.append((self, fd, data))
            else:
                take(self, fd, data)

    def look(self, tick):
        waiting.set()
        wait_for_rows(self, tick)
        waiting.clear()

    def let_go(self, done, timeout_s):
        if waiting.is_set() and not done():
            with one_at_a_time:
                while held:
                    take(*held.pop(0))
        return wait(self, done, timeout_s)

    monkeypatch.setattr(Collector, "_take", hold_back)
    monkeypatch.setattr(Collector, "wait_for", let_go)
    monkeypatch.setattr(WireFlight, "_wait_for_rows", look)
    result, recording, until = flight()
    assert until == flown
    assert result.trajectory_sha256 == wanted.trajectory_sha256
    assert len(recording.plant) == len(recording.fcu) == result.ticks == wanted.ticks


@pytest.mark.parametrize("record", ["full", "light", "none"])
def test_the_recording_ends_with_the_tick_of_arrival(flight, record):
    result, recording, flown = flight(record, in_process=True)
    assert result.ticks < flown
    if recording is not None:
        assert recording.plant["t"][-1] == recording.fcu["t"][-1] == result.sim_time_s
    if record == "full":
        assert len(recording.plant) == len(recording.fcu) == result.ticks


def test_a_yaw_that_moves_keeps_no_vehicle_from_arriving(flight):
    plain, *_ = flight("none", in_process=True)
    swing = ["flight.yaw={amplitude_rad=0.1, frequency_rad_s=0.5}"]
    swings, *_ = flight("none", swing, in_process=True)
    assert swings.sim_time_s == pytest.approx(plain.sim_time_s, abs=0.2)


def test_arrival_is_at_the_setpoint_of_the_mission(tmp_path):
    """One in the ground is flown to above it first, and then landed on: it is reached by neither."""
    result = gcs_tools.fly(
        "take_off", out=tmp_path, figure="never", record="none", in_process=True,
        settings=[*SOON, "flight.setpoints=[[0,0,0,2],[4,2,0,-5]]", "flight.duration_s=20"],
    )  # fmt: skip
    assert result.ended == "time"


def test_a_vehicle_that_has_landed_does_not_arrive(scene):
    plant, fcu = flown(scene)
    column(SharedTick, fcu, "engaged")[NEAR + HELD - 2 :] = IDLE
    assert arrival(scene, plant, fcu) is None


# --- rows as they come

HELD, LAST, NEAR = 50, 100, 180  # ticks: how long it has to stay; the last setpoint; from then near


@pytest.fixture
def scene():
    settings = [
        'flight.setpoints=[{at_s=0.0, position_m=[5, 0, 0]}, {at_s=0.2, position_m=[0, 0, 0]}]',
        "flight.duration_s=1", "flight.arrive.within_m=0.5", f"flight.arrive.for_s={HELD / 500}",
    ]  # fmt: skip
    return prepared("take_off", settings)[1]


def flown(scene, n=400, near=NEAR):
    """Rows of a vehicle that is at its setpoint at first, and again from tick `near` on."""
    plant, fcu = np.zeros((n, size(PlantRecord))), np.zeros((n, size(SharedTick)))
    plant[:, 0] = fcu[:, 0] = np.arange(n) / scene.rate_hz
    column(PlantRecord, plant, "state.r_E")[LAST - HELD // 2 : near] = 9.0
    column(SharedTick, fcu, "engaged")[:] = FLYING
    return plant, fcu


def recorded(scene, plant, fcu, seed):
    """What is recorded of rows that come in batches of any size, one side before the other."""
    took = [], []
    until = UntilArrival(scene, (took[0].append, took[1].append))
    rng, left = np.random.default_rng(seed), [plant, fcu]
    while len(left[0]) or len(left[1]):
        which, n = rng.integers(2), rng.integers(1, 90)
        (until.add_plant, until.add_fcu)[which](left[which][:n])
        left[which] = left[which][n:]
    until.finish()
    return [np.concatenate(rows) for rows in took]


@pytest.mark.parametrize("seed", range(20))
def test_however_they_come_they_end_with_the_tick_of_arrival(scene, seed):
    plant, fcu = flown(scene)
    arrived_s = arrival(scene, plant, fcu)
    assert round(arrived_s * scene.rate_hz) + 1 == NEAR + HELD
    for whole, kept in zip((plant, fcu), recorded(scene, plant, fcu, seed), strict=True):
        assert (kept == whole[: NEAR + HELD]).all()


@pytest.mark.parametrize("seed", range(5))
def test_of_a_vehicle_that_does_not_arrive_all_is_kept(scene, seed):
    plant, fcu = flown(scene, near=400)
    plant_kept, fcu_kept = recorded(scene, plant, fcu[:390], seed)
    assert (plant_kept == plant).all() and (fcu_kept == fcu[:390]).all()


def test_of_ticks_that_one_side_has_dropped_nothing_is_known(scene):
    plant, fcu = flown(scene)
    dropped = np.delete(plant, np.arange(NEAR, NEAR + 9), axis=0)
    assert round(arrival(scene, dropped, fcu) * scene.rate_hz) + 1 == NEAR + 9 + HELD
