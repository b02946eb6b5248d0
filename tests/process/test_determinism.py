"""One seed, one trajectory: over the wire, on a busy machine, and without sockets."""

from __future__ import annotations

import os

import pytest

import gcs_tools

RUNS, BUSY = 4, 2  # flights over the wire: alone, and with busy neighbours

NOMINAL = ("paper_nominal", "flight.duration_s=4")
NOISY = ("noisy_state", "flight.duration_s=4")
STREAMED = ("figure_eight", "flight.duration_s=4")
GROUND = ("take_off", "flight.duration_s=9")  # two setpoints
# all that it is sent is looked at, and none refused
CALM = ('law.guard="refuse"', "law.guard_wind_m_s=6.0", "law.f_m=1.0")
REFUSING = ("figure_eight", *CALM, "flight.duration_s=4")
REFUSING_STEPS = ("take_off", *CALM, "flight.duration_s=9")
LATE = ("noisy_state", "flight.duration_s=3", "plant.delay_s=0.02")


@pytest.fixture
def sha256(tmp_path):
    """`sha256(NOMINAL)`: the hash of a flight over the wire, or `in_process`."""
    flights = iter(range(1000))

    def fly(flight, **options):
        mission, *settings = flight
        out = tmp_path / f"{next(flights)}"
        flown = gcs_tools.fly(mission, settings=settings, out=out, figure="never", **options)
        assert flown.error is None
        return flown.trajectory_sha256

    return fly


def test_runs_over_the_wire_and_in_process_are_one(sha256):
    flown = {sha256(NOMINAL) for _ in range(RUNS)}
    assert flown == {sha256(NOMINAL, in_process=True)}


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs processes bound to cores")
def test_a_busy_machine_changes_nothing(sha256, busy_neighbours):
    flown = {sha256(NOMINAL) for _ in range(BUSY)}
    assert flown == {sha256(NOMINAL, in_process=True)}


@pytest.mark.parametrize(
    "flight",
    [NOISY, STREAMED, GROUND, LATE, REFUSING, REFUSING_STEPS],
    ids=lambda f: "-".join(f),
)
def test_noise_and_a_moving_setpoint_are_part_of_it(sha256, flight):
    assert sha256(flight) == sha256(flight, in_process=True)


def test_a_wind_from_a_file_is_part_of_it(sha256, tmp_path):
    """The plant's process reads it in a file of its own, and it is not the flight in still air."""
    lines = ["t_s,x_m_s,y_m_s,z_m_s", *(f"{0.3 * k},{k % 3},{-k / 7},{k / 9}" for k in range(9))]
    (tmp_path / "gust.csv").write_text("\n".join(lines))
    blown = (*NOMINAL, f'wind.file="{tmp_path / "gust.csv"}"')
    assert sha256(blown) == sha256(blown, in_process=True) != sha256(NOMINAL, in_process=True)


def test_another_seed_is_another_flight(sha256):
    flown = {sha256(NOISY, in_process=True, seed=seed) for seed in (1, 2)}
    assert len(flown) == 2
