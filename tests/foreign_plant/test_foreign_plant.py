"""A simulator of somebody else's, in C, flies `fcu`: in lockstep, judged by its own truth."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.foreign_plant.fly import POSITION, Flight, compile_plant, vehicle_lines
from tests.process.conftest import claimed_instance

AIRFRAME = Path(__file__).parent / "quad.toml"
TURNING = {"wind": "turn", "wind-max": 5.0, "wind-period": 8.0, "wind-rate": 5.0}


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_plant(tmp_path_factory.mktemp("plant"))


@pytest.fixture
def begin(program: Path, tmp_path: Path) -> Iterator[Callable[..., Flight]]:
    """Return a function that starts a flight. It ends with the test."""
    flights: list[Flight] = []
    with claimed_instance() as instance:

        def start(lines: str = "", **options: object) -> Flight:
            vehicle = vehicle_lines(AIRFRAME) + lines
            flights.append(
                Flight(program, str(AIRFRAME), vehicle, tmp_path, instance, dict(options))
            )
            return flights[-1]

        yield start
        for flight in flights:
            flight.close()


def test_a_foreign_plant_flies_to_a_point_in_turning_wind_and_lands(
    begin: Callable[..., Flight],
) -> None:
    flight = begin(**TURNING)
    flight.go(0.5)
    assert flight.take_off(5.0)
    goal = (4.0, 3.0, -5.0)
    flight.line("goal 4 3 -5 0.3")
    assert flight.offboard(lambda _: (POSITION, *goal)) == 0
    flight.stream(8.0, lambda _: (POSITION, *goal))
    assert flight.truth["arrived_s"] is not None
    assert flight.truth["off_most_m"] < 0.31
    assert flight.truth["at"] == pytest.approx(goal, abs=0.02)
    flight.line("no goal")
    assert flight.command_mode("land") == 0
    flight.go_until(lambda: not flight.armed, 30.0)
    verdict = flight.close()
    assert verdict["lost"] == ""
    assert verdict["thrust_at_limit_fraction"] == verdict["tilt_at_limit_fraction"] == 0.0
    assert 0.0 < verdict["touchdown_m_s"] < 0.8
    assert verdict["wind_most_m_s"] == pytest.approx(5.0, abs=0.01)
    assert (verdict["fcu_exit"], verdict["plant_exit"]) == (0, 0)


@pytest.mark.parametrize("slope_deg", [-8.0, 8.0])
def test_a_vehicle_lands_on_a_slope_that_nobody_has_told_it_of(
    begin: Callable[..., Flight], slope_deg: float
) -> None:
    """Some feet of the gear hang in the air, and the rotors hold the vehicle level there."""
    flight = begin(**{"ground-slope": slope_deg})
    flight.go(0.5)
    flight.take_off(5.0)
    goal = (9.0, 0.0, -5.0)
    assert flight.offboard(lambda _: (POSITION, *goal)) == 0
    flight.stream(8.0, lambda _: (POSITION, *goal))
    assert flight.command_mode("land") == 0
    flight.go_until(lambda: not flight.armed, 30.0)
    verdict = flight.close()
    assert verdict["lost"] == ""
    assert verdict["disarmed_s"] < 4.0
    assert verdict["cut_m"] == 0.0


def test_a_foreign_plant_flies_the_same_bits_after_a_reset(begin: Callable[..., Flight]) -> None:
    flight = begin(wind="gust", seed=3, **{"wind-max": 4.0, "wind-period": 1.0})
    truths = []
    for _ in range(2):
        flight.go(0.5)
        assert flight.take_off(3.0, 6.0)
        truths.append(json.dumps({key: flight.truth[key] for key in ("at", "velocity", "q")}))
        flight.reset(force=True)
    assert truths[0] == truths[1]


def test_a_crash_is_told_by_the_simulator_and_ended_by_a_reset(
    begin: Callable[..., Flight],
) -> None:
    flight = begin()
    flight.go(0.5)
    assert flight.take_off(10.0)
    assert flight.command(185, 1) == 0  # DO_FLIGHTTERMINATION
    flight.go(3.0)
    assert flight.truth["lost"] == "impact"
    flight.wait(lambda: flight.status == 6)  # MAV_STATE_EMERGENCY
    assert not flight.armed
    flight.reset()
    flight.go(0.5)
    assert flight.take_off(3.0, 6.0)
    assert flight.close()["cut_m"] == 0.0  # nobody told it to land


def test_a_stream_that_ends_is_lost_after_a_second(begin: Callable[..., Flight]) -> None:
    flight = begin()
    flight.go(0.5)
    assert flight.take_off(3.0, 6.0)
    assert flight.offboard(lambda _: (POSITION, 1.0, 0.0, -3.0)) == 0
    flight.go(0.98)
    assert flight.mode >> 16 & 255 == 6  # Offboard
    flight.go(0.04)
    flight.wait(lambda: flight.mode >> 16 & 255 == 3)  # Position


def test_a_simulator_of_another_number_of_rotors_ends_the_controller(
    program: Path, tmp_path: Path
) -> None:
    vehicle = vehicle_lines(AIRFRAME) + "rotor 0.1 0 1 1e-5 900\nrotor -0.1 0 -1 1e-5 900\n"
    with claimed_instance() as instance, pytest.raises(RuntimeError, match="fcu ended with 3"):
        Flight(program, str(AIRFRAME), vehicle, tmp_path, instance)


def test_samples_of_wind_blow_again_and_again(begin: Callable[..., Flight], tmp_path: Path) -> None:
    """Turned by the axis: North becomes East."""
    (tmp_path / "wind.txt").write_text("0 0 0 0\n1 2 0 -1\n2 0 0 0\n")
    options = {"wind": "series", "wind-series": tmp_path / "wind.txt", "wind-axis": 90}
    flight = begin(**options, **{"wind-max": 9.0})
    for t, blows in ((0.5, 0.5), (1.0, 1.0), (2.5, 0.5), (3.0, 1.0)):
        flight.go(round(t - flight.t, 6))
        assert flight.truth["wind"] == pytest.approx([0.0, 2.0 * blows, -blows], abs=0.01)


@pytest.mark.parametrize(
    ("text", "why"),
    [("0 0 0 0\n", "two are needed"), ("0 0 0 0\n0 1 1 1\n", "line 2"), ("0 0 0 0\n1 0 x 0\n", "line 2")],
)  # fmt: skip
def test_samples_of_wind_that_are_none_are_refused_with_their_line(
    program: Path, tmp_path: Path, text: str, why: str
) -> None:
    (tmp_path / "wind.txt").write_text(text)
    (tmp_path / "quad.txt").write_text(vehicle_lines(AIRFRAME))
    words = ["--vehicle", tmp_path / "quad.txt", "--wind", "series", "--wind-max", "1"]
    done = subprocess.run(
        [program, *words, "--wind-series", tmp_path / "wind.txt"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert why in done.stderr


def test_a_compiler_that_is_missing_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(SystemExit, match="no-such-compiler"):
        compile_plant(tmp_path)
