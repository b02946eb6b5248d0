"""What can go wrong around a flight: the right exit code in time, nobody left, the run on file."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from fcu.interface.ports import ports
from gcs_tools.flight.ground_script import Vehicle, VehicleError
from gcs_tools.judging import result
from gcs_tools.recording import reader as recording
from sitl_plant.physics.types import PlantRecord

pytestmark = pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs Linux's /proc")

DRAWN = ("paper_nominal", "--set", "flight.duration_s=600")  # its yaw command is streamed
LONG = (*DRAWN, "--figure", "never")
UNTOLD = ("gust_step", *LONG[1:])  # one setpoint, and then none
MEGABYTE = 1 << 20


@pytest.fixture
def run(tmp_path):
    return tmp_path / "run"


@pytest.fixture
def in_flight(fly, run, until):
    """A flight of which some seconds are on file already."""

    def flight(mission=LONG):
        program = fly(*mission)
        program.pids = program.started()
        file = run / "flight.mcap"
        until(lambda: file.exists() and file.stat().st_size > MEGABYTE, "a recording")
        return program

    return flight


@pytest.fixture
def gone(until, alive):
    def check(program):
        until(lambda: not any(map(alive, program.pids.values())), "no orphan")

    return check


def flown(run):
    """The recording up to where it was cut: rows without gaps, of both sides."""
    found = recording.read(run / "flight.mcap")
    for rows in (found.plant, found.fcu):
        assert len(rows) > 500
        assert np.allclose(np.diff(rows["t"]), 0.002, atol=1e-9)
    assert found.params is not None
    return found


def aborted(run, exit_code, *words):
    left = result.read(run / "result.json")
    assert (left.exit_code, left.ended, left.passed) == (exit_code, "aborted", False)
    for word in words:
        assert word in left.error
    assert left.sim_time_s > 1.0
    assert left.trajectory_sha256 == result.trajectory_sha256(flown(run).plant.rows_of(PlantRecord))
    return left


@pytest.mark.parametrize(
    ("module", "name"), [("fcu", "flight controller"), ("sitl_plant", "plant")]
)
def test_a_killed_process_is_named(in_flight, gone, run, module, name):
    program = in_flight()
    os.kill(program.pids[module], signal.SIGKILL)
    assert program.wait() == 3
    gone(program)
    left = aborted(run, 3, name, "signal 9")
    assert f"{left.sim_time_s:.3f} s" in left.error
    assert left.error in " ".join(program.text().split())


@pytest.mark.parametrize(
    ("module", "name"), [("fcu", "flight controller"), ("sitl_plant", "plant")]
)
def test_a_process_that_falls_silent_is_named(in_flight, gone, run, module, name):
    program = in_flight(UNTOLD)
    os.kill(program.pids[module], signal.SIGSTOP)
    assert program.wait() == 3
    gone(program)
    aborted(run, 3, name, "5 s")
    other = "plant.log" if module == "fcu" else "fcu.log"
    if "echo" in program.text():
        return  # it fell silent while time was held, and the script was who waited for it
    lines = (run / other).read_text().splitlines()
    assert any("warning" in line.split()[:3] and "1 s" in line for line in lines)


def test_a_controller_that_falls_silent_in_a_streamed_flight_is_named(in_flight, gone, run):
    """It may be asked for an answer by the plant, or for an echo by the script."""
    program = in_flight()
    os.kill(program.pids["fcu"], signal.SIGSTOP)
    assert program.wait() == 3
    gone(program)
    aborted(run, 3, "flight controller", "5 s")


def test_a_controller_that_does_not_answer_a_script_is_named(instance):
    vehicle = Vehicle(instance)
    try:
        with pytest.raises(VehicleError, match=r"\b5 s\b"):
            vehicle.arm()
    finally:
        vehicle.close()


def test_a_killed_runner_leaves_nobody(in_flight, gone, run):
    program = in_flight()
    program.signal(signal.SIGKILL)
    program.wait()
    gone(program)
    left = flown(run)
    assert not left.complete
    assert not (run / "result.json").exists()
    done = subprocess.run(
        [sys.executable, "-m", "gcs_tools", "recover", run / "flight.mcap"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout
    assert flown(run).complete
    assert flown(run).fcu.rows.tobytes() == left.fcu.rows.tobytes()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_flight_is_kept(in_flight, gone, run, number):
    program = in_flight(DRAWN)
    program.signal(number)
    assert program.wait() == 130
    gone(program)
    aborted(run, 130)
    assert flown(run).complete
    assert (run / "flight.png").exists()
    assert "Traceback" not in program.text()


def test_an_interrupt_before_the_first_tick_stops_both(fly, gone, run, tmp_path):
    cold = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}  # both are compiling
    program = fly(*LONG, env=cold)
    program.pids = program.started()
    program.says("compiling")
    assert program.interrupted() == 130
    gone(program)
    assert result.read(run / "result.json").ticks == 0


def test_processes_that_compile_notice_that_their_runner_is_gone(fly, gone, run, until, tmp_path):
    cold = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    program = fly(*LONG, env=cold)
    program.pids = program.started()
    logs = [run / "fcu.log", run / "plant.log"]
    until(lambda: all("compiling" in log.read_text() for log in logs), "both compile")
    program.signal(signal.SIGKILL)
    program.wait()
    gone(program)


def test_real_time_does_not_wait_for_a_runner_that_was_suspended(fly, run, until):
    short = ("paper_nominal", "--set", "flight.duration_s=4", "--figure", "never")
    program = fly(*short, "--speed", "1", "--json")
    program.started()
    file = run / "flight.mcap"
    until(lambda: file.exists() and file.stat().st_size > MEGABYTE // 4, "a recording")
    program.signal(signal.SIGSTOP)
    time.sleep(2.0)  # for as long it is suspended
    program.signal(signal.SIGCONT)
    program.wait()
    left = result.read(run / "result.json")
    assert (left.ended, left.error) == ("time", None)
    assert left.sim_time_s == pytest.approx(3.998)
    assert left.ticks == len(recording.read(file).fcu)


@pytest.mark.parametrize("name", ["plant", "fcu_plant", "fcu_script", "script", "fcu_station"])
def test_a_busy_port_is_named(fly, run, instance, name):
    number = ports(instance)._asdict()[name]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", number))
        program = fly("paper_nominal", "--instance", instance)
        assert program.wait() == 3
    assert str(number) in program.text()
    assert str(number) in result.read(run / "result.json").error


def test_two_flights_that_start_at_once_take_two_instances(start, until):
    first = start("gcs_tools", "fly", *LONG)
    second = start("gcs_tools", "fly", *LONG)

    def number(program):
        logs = [log.read_text() for log in program.folder.glob("runs/*/fcu.log")]
        return next((found[1] for log in logs if (found := re.search(r"instance (\d)", log))), "")

    numbers = [until(lambda p=p: number(p), "an instance") for p in (first, second)]
    assert numbers[0] != numbers[1]
    later = first if numbers[0] > numbers[1] else second
    assert f"instance {max(numbers)}" in later.text()
    assert [first.interrupted(), second.interrupted()] == [130, 130]


def test_two_runs_at_once_do_not_disturb_each_other(start):
    short = ("paper_nominal", "--set", "flight.duration_s=2", "--figure", "never", "--json")
    both = [start("gcs_tools", "fly", *short) for _ in range(2)]
    assert {program.wait() for program in both} == {1}  # too short to have settled
    hashes = {json.loads(p.out.read_text())[0]["trajectory_sha256"] for p in both}
    assert len(hashes) == 1


def test_a_full_disk_ends_the_flight(fly, run, gone):
    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (3 * MEGABYTE, 3 * MEGABYTE))

    program = fly(*LONG, preexec_fn=small_disk)
    program.pids = program.started()
    assert program.wait() == 3
    gone(program)
    left = result.read(run / "result.json")
    assert left.ended == "aborted"
    assert "flight.mcap: File too large" in left.error
    assert len(flown(run).plant) > 1000
    assert "Traceback" not in program.text()


def test_a_full_disk_ends_a_flight_in_process(fly, run):
    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (MEGABYTE, MEGABYTE))

    program = fly("paper_nominal", "--in-process", preexec_fn=small_disk)
    assert program.wait() == 3
    assert "flight.mcap: File too large" in result.read(run / "result.json").error


@pytest.mark.parametrize("arguments", [(), ("--json",)])
def test_a_reader_who_has_seen_enough_does_not_change_the_exit_code(fly, arguments):
    read, write = os.pipe()
    os.close(read)
    program = fly("paper_nominal", "--in-process", *arguments, stdout=write)
    os.close(write)
    assert program.wait() == 0, program.text()
    assert program.text() == ""


def test_garbage_on_the_ground_ports_changes_nothing(fly, run, instance, until):
    at = ports(instance)
    short = ("paper_nominal", "--set", "flight.duration_s=10", "--figure", "never", "--json")
    program = fly(*short, "--instance", instance)
    random = np.random.default_rng(1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        sent = 0
        while program.process.poll() is None:
            for port in (at.plant, at.fcu_plant, at.fcu_script, at.fcu_station):
                length = int(random.integers(0, 400))
                garbage = b"\xfd" * (sent % 2) + random.bytes(length)
                other.sendto(garbage, ("127.0.0.1", port))
            sent += 1
            time.sleep(0.001)
    assert sent > 100
    over_the_wire = json.loads(program.out.read_text())[0]
    assert over_the_wire["error"] is None
    from gcs_tools import fly as fly_here

    alone = fly_here(
        "paper_nominal",
        settings=["flight.duration_s=10"],
        in_process=True,
        figure="never",
        out=run.parent / "quiet",
    )
    assert over_the_wire["trajectory_sha256"] == alone.trajectory_sha256
