"""Each process alone, the other end of its link played by the test."""

from __future__ import annotations

import json
import math
import signal
import socket
import time

import numpy as np
import pytest

from fcu.interface.airframe import believed
from fcu.interface.messages import RotorCommand, VehicleState
from fcu.interface.ports import ports
from fcu.interface.wire import PlantCodec, WireError
from fcu.kernel.buffers import columns, size

ANSWER_S = 5.0
MS = 2000  # us: one tick at 500 Hz


@pytest.fixture
def standing():
    """A VehicleState at rest at the origin."""
    state = np.zeros(size(VehicleState))
    state[columns(VehicleState).index("q_EB.w")] = 1.0
    return state


@pytest.fixture
def states(instance):
    return PlantCodec(instance + 1, believed()[0].spin)


@pytest.fixture
def fcu(start, instance):
    program = start("fcu", "--instance", instance)
    program.says('"ready"')
    assert "waiting for the plant on 127.0.0.1" in program.text()
    return program


def answer(link, codec):
    """The time (us) that the flight controller's next datagram answers."""
    assert link.wait(ANSWER_S), "no answer"
    datagram = link.receive()
    return codec.parse_controls(datagram, np.zeros(size(RotorCommand)))[0]


def silent(link):
    """Nothing has come, and nothing is on its way: what is sent later is answered first."""
    return link.receive() is None


def ended(program, key="ended"):
    return next(json.loads(x) for x in program.out.read_text().splitlines() if key in x)


def test_garbage_and_nan_on_the_plant_link_are_counted_and_no_more(
    fcu, bound, states, standing, instance
):
    link = bound("plant", "fcu_plant")
    link.send(states.pack_state(0, standing))
    assert answer(link, states) == 0
    nan, unit = standing.copy(), standing.copy()
    nan[0], unit[6] = math.nan, 3.0
    good = states.pack_state(MS, standing)
    bad = [
        b"", b"\xfd", b"garbage" * 40, good[:-1], good[:50], good + b"\0", bytes(4000),
        states.pack_state(MS, nan), states.pack_state(MS, unit),
        PlantCodec(instance + 2, believed()[0].spin).pack_state(MS, standing),
    ]  # fmt: skip
    for datagram in bad:
        link.send(datagram)
    link.send(good)
    assert answer(link, states) == MS
    link.send(good)  # as if the answer was lost
    assert answer(link, states) == MS
    assert fcu.interrupted() == 0
    said = ended(fcu)
    assert (said["ticks"], said["refused"], said["resent"]) == (2, len(bad), 1)


def test_strangers_are_not_heard(fcu, bound, states, standing, instance):
    link = bound("plant", "fcu_plant")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(
            states.pack_state(5 * MS, standing), ("127.0.0.1", ports(instance).fcu_plant)
        )
    link.send(states.pack_state(0, standing))
    assert answer(link, states) == 0
    assert silent(link)
    assert fcu.interrupted() == 0
    assert ended(fcu)["ticks"] == 1


def test_time_that_runs_back_ends_it(fcu, bound, states, standing):
    link = bound("plant", "fcu_plant")
    for time_us in (0, MS):
        link.send(states.pack_state(time_us, standing))
        assert answer(link, states) == time_us
    link.send(states.pack_state(0, standing))
    assert fcu.wait(ANSWER_S) == 3
    assert "time ran back from 0.002000 s" in fcu.text()


def test_a_plant_that_falls_silent_ends_it(fcu, bound, states, standing):
    link = bound("plant", "fcu_plant")
    link.send(states.pack_state(0, standing))
    assert answer(link, states) == 0
    assert fcu.wait(10.0) == 3
    assert "warning fcu  the plant has been silent for 1 s" in fcu.text()
    assert "error   fcu  the plant has been silent for 5 s" in fcu.text()


def test_the_plant_asks_again_and_counts_what_is_no_answer(start, bound, instance, states):
    plant = start("sitl_plant", "--instance", instance)
    plant.says('"ready"')
    assert f"expected on 127.0.0.1:{ports(instance).fcu_plant}" in plant.text()
    link, state = bound("fcu_plant", "plant"), np.zeros(size(VehicleState))
    command = np.zeros(size(RotorCommand))

    def asked():
        while True:
            assert link.wait(ANSWER_S), "not asked"
            if (datagram := link.receive()) is not None:
                return states.parse_state(datagram, state)

    assert [asked(), asked()] == [0, 0]
    full, nan = command.copy(), command.copy()
    full[0], nan[0] = 2.0, math.nan
    bad = [b"", b"garbage" * 20, states.pack_controls(0, nan, True, True)]
    for datagram in bad:
        link.send(datagram)
    link.send(states.pack_controls(7 * MS, command, True, True))  # of another state
    assert asked() == 0
    link.send(states.pack_controls(0, command, True, True))
    while (time_us := asked()) == 0:
        pass
    assert time_us == MS
    assert plant.interrupted() == 0
    said = ended(plant)
    assert (said["ticks"], said["refused"]) == (1, len(bad))
    assert said["resent"] >= 2


def test_a_controller_that_never_comes_is_waited_for_and_named(start, instance):
    plant = start("sitl_plant", "--instance", instance)
    plant.says("waiting for the flight controller")
    plant.signal(signal.SIGTERM)
    assert plant.wait(ANSWER_S) == 0


@pytest.mark.parametrize("first", ["fcu", "sitl_plant"])
def test_either_may_start_first(start, instance, first):
    second = "sitl_plant" if first == "fcu" else "fcu"
    one = start(first, "--instance", instance)
    one.says('"ready"')
    other = start(second, "--instance", instance)
    fcu, plant = (one, other) if first == "fcu" else (other, one)
    fcu.says("the plant is there")
    began = time.monotonic()
    assert fcu.interrupted() == 0
    plant.says("the flight controller has been silent for 1 s")
    assert plant.wait(10.0) == 3
    assert time.monotonic() - began > 4.0
    assert "error   plant the flight controller has been silent for 5 s" in plant.text()


def test_a_plant_that_is_started_again_ends_the_flight(start, instance):
    fcu = start("fcu", "--instance", instance)
    plant = start("sitl_plant", "--instance", instance)
    fcu.says("the plant is there")
    plant.says('"ready"')
    plant.kill()
    start("sitl_plant", "--instance", instance)
    assert fcu.wait(10.0) == 3
    assert "time ran back" in fcu.text()


def test_a_wire_error_is_what_a_bad_answer_raises(states):
    with pytest.raises(WireError):
        states.parse_controls(b"", np.zeros(size(RotorCommand)))
