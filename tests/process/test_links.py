"""Each process alone, the other end of its link played by the test."""

from __future__ import annotations

import json
import math
import re
import signal
import socket

import numpy as np
import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.airframe import believed
from fcu.interface.messages import RotorCommand, VehicleState
from fcu.interface.ports import ports
from fcu.kernel.buffers import columns, size
from fcu.mavlink.plant_link import PlantCodec, WireError
from fcu.process.autopilot import JUMPS, OVERTAKEN
from tests.patience import PATIENCE_S, until

MS = 2000  # us: one tick at 500 Hz
NONE, FULL = np.zeros(size(RotorCommand)), np.ones(size(RotorCommand))
ROTORS = slice(columns(VehicleState).index("Omega.r1"), None)


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
    assert f"127.0.0.1:{ports(instance).fcu_plant}" in program.text()
    return program


def answer(link, codec):
    """The time (us) that the flight controller's next datagram answers."""
    assert link.wait(PATIENCE_S), "no answer"
    datagram = link.receive()
    return codec.parse_controls(datagram, np.zeros(size(RotorCommand)))[0]


def silent(link):
    """Nothing has come, and nothing is on its way: what is sent later is answered first."""
    return link.receive() is None


@pytest.fixture
def plant(start, instance):
    program = start("sitl_plant", "--instance", instance)
    program.says('"ready"')
    return program


@pytest.fixture
def asked(states):
    """`asked(link, after=0)`: time (us) and VehicleState of the plant's next datagram.

    after : what was sent before is skipped, up to and with this time.
    """

    def ask(link, after=-1):
        state = np.zeros(size(VehicleState))
        while True:
            assert link.wait(PATIENCE_S), "not asked"
            datagram = link.receive()
            if datagram is not None and (time_us := states.parse_state(datagram, state)) > after:
                return time_us, state

    return ask


def unflyable(datagram, u):
    """An answer whose first rotor's command is `u`, its checksum right."""
    message = mavlink.MAVLink(None).parse_buffer(bytearray(datagram))[0]
    message.controls = [u, *message.controls[1:]]
    fields = {name: getattr(message, name) for name in message.fieldnames}
    link = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
    return mavlink.MAVLink_hil_actuator_controls_message(**fields).pack(link)


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
    said = ended(fcu)
    assert (said["ticks"], said["strangers"]) == (1, 1)


def test_answers_of_strangers_do_not_fly_the_plant(plant, bound, asked, states, instance):
    link = bound("fcu_plant", "plant")
    assert asked(link)[0] == 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for _ in range(3):
            stranger.sendto(
                states.pack_controls(0, FULL, True, True), ("127.0.0.1", ports(instance).plant)
            )
    assert asked(link)[0] == 0  # asked again: time stands
    link.send(states.pack_controls(0, NONE, True, True))
    time_us, state = asked(link, after=0)
    assert time_us == MS
    assert (state[ROTORS] == 0.0).all()
    assert plant.interrupted() == 0
    said = ended(plant)
    assert (said["ticks"], said["strangers"], said["refused"], said["stale"]) == (1, 3, 0, 0)


def test_a_plant_that_sends_a_state_twice_is_answered_twice_and_flown_once(
    fcu, bound, states, standing
):
    link = bound("plant", "fcu_plant")
    answers = []
    moved = standing.copy()
    moved[0] = 1000.0  # another state of the same time: not flown
    for state in (standing, standing, moved):
        link.send(states.pack_state(MS, state))
        assert link.wait(PATIENCE_S)
        answers.append(link.receive())
    assert answers[1:] == answers[:1] * 2  # the answer as it was first sent, to the byte
    assert fcu.interrupted() == 0
    said = ended(fcu)
    assert (said["ticks"], said["resent"], said["refused"]) == (1, 2, 0)


def test_time_that_runs_back_ends_it(fcu, bound, states, standing):
    link, last = bound("plant", "fcu_plant"), OVERTAKEN * MS + MS
    for time_us in range(0, last + 1, MS):
        link.send(states.pack_state(time_us, standing))
        assert answer(link, states) == time_us
    link.send(states.pack_state(0, standing))
    assert fcu.wait() == 3
    assert fcu.logged("error", f"{last * 1e-6:.6f} s")


def test_a_state_that_was_overtaken_is_not_flown_and_time_goes_on(fcu, bound, states, standing):
    """Until there are so many that the plant must have begun again."""
    link = bound("plant", "fcu_plant")
    for time_us, overtaken in ((0, 0), (MS, 3), (2 * MS, 9), (3 * MS, 0)):
        link.send(states.pack_state(time_us, standing))
        assert answer(link, states) == time_us
        for _ in range(overtaken):
            link.send(states.pack_state(0, standing))
    for _ in range(JUMPS):
        link.send(states.pack_state(0, standing))
    assert fcu.wait() == 3
    assert fcu.logged("error", "0.006000 s")
    assert ended(fcu)["refused"] == 12 + JUMPS


def test_a_state_of_a_time_that_is_not_the_next_is_not_flown(fcu, bound, states, standing):
    link = bound("plant", "fcu_plant")
    for time_us in (0, MS, 2 * MS):
        link.send(states.pack_state(time_us, standing))
        assert answer(link, states) == time_us
        for _ in range(9):
            link.send(states.pack_state(time_us + 10_000_000, standing))
    link.send(states.pack_state(3 * MS, standing))
    assert answer(link, states) == 3 * MS  # whatever was sent before has been read
    assert silent(link)
    assert fcu.interrupted() == 0
    said = ended(fcu)
    assert (said["ticks"], said["refused"]) == (4, 27)


def test_time_that_jumps_and_stays_there_ends_it(fcu, bound, states, standing):
    link = bound("plant", "fcu_plant")
    link.send(states.pack_state(0, standing))
    assert answer(link, states) == 0
    for k in range(10):
        link.send(states.pack_state(10_000_000 + k * MS, standing))
    assert fcu.wait() == 3
    assert fcu.logged("error", "0.000000 s")


@pytest.mark.parametrize("lost", [1, 7])
def test_states_that_were_lost_are_no_jump_of_time(fcu, bound, states, standing, lost):
    link = bound("plant", "fcu_plant")
    link.send(states.pack_state(0, standing))
    assert answer(link, states) == 0
    for k in range(10):  # of a plant that does not wait for answers
        link.send(states.pack_state((1 + lost + k) * MS, standing))
    assert fcu.wait() == 3
    assert fcu.logged("error", "lost", "0.000000 s", "until it is answered")
    assert not fcu.logged("error", "jumped")


@pytest.mark.parametrize("first", [1, MS - 1, 123_456_789, 10**13])
def test_the_first_time_may_be_any_that_fits(fcu, bound, states, standing, first):
    link, script = bound("plant", "fcu_plant"), bound("script", "fcu_script")
    for k in range(2000):  # long enough for all telemetry
        link.send(states.pack_state(first + k * MS, standing))
        assert answer(link, states) == first + k * MS
    assert script.wait(PATIENCE_S)
    assert fcu.interrupted() == 0
    assert fcu.logged("info", "the plant is there")
    assert (ended(fcu)["ticks"], ended(fcu)["refused"]) == (2000, 0)


@pytest.mark.parametrize("first", [10**13 + 1, 2**53, 2**63, 2**64 - 1])
def test_a_first_time_that_does_not_fit_is_named(fcu, bound, states, standing, first):
    bound("plant", "fcu_plant").send(states.pack_state(first, standing))
    assert fcu.wait() == 3
    assert fcu.logged("error", "time begins at", "expected 0 to 1e+07 s")
    assert "Traceback" not in fcu.text()


def test_a_plant_that_falls_silent_ends_it_and_ground_stations_are_told(
    fcu, bound, states, standing
):
    link, script = bound("plant", "fcu_plant"), bound("script", "fcu_script")
    link.send(states.pack_state(0, standing))
    assert answer(link, states) == 0
    parser, heard = mavlink.MAVLink(None), []
    while fcu.process.poll() is None:
        if script.wait(0.1):
            heard += parser.parse_buffer(script.receive() or b"") or []
    assert fcu.wait() == 3
    said = [m for m in heard if m.get_type() == "STATUSTEXT"]
    assert {m.severity for m in said} == {mavlink.MAV_SEVERITY_CRITICAL}
    assert [re.findall(r"(\d+) s", m.text) for m in said] == [["1"], ["5"]]
    assert fcu.logged("warning", "1 s")
    assert fcu.logged("error", "5 s")


def test_the_plant_asks_again_and_counts_what_is_no_answer(plant, bound, asked, instance, states):
    assert f"127.0.0.1:{ports(instance).fcu_plant}" in plant.text()
    link = bound("fcu_plant", "plant")
    time_us, state = asked(link)
    assert time_us == 0
    nan = NONE.copy()
    nan[0] = math.nan
    bad = [b"", b"garbage" * 20, states.pack_controls(0, nan, True, True)]
    for datagram in bad:
        link.send(datagram)
    link.send(states.pack_controls(7 * MS, FULL, True, True))  # of another state
    time_us, again = asked(link)
    assert (time_us, again.tobytes()) == (0, state.tobytes())
    link.send(states.pack_controls(0, NONE, True, True))
    assert asked(link, after=0)[0] == MS
    assert plant.interrupted() == 0
    said = ended(plant)
    assert (said["ticks"], said["refused"], said["stale"]) == (1, len(bad), 1)
    assert said["resent"] >= 1


def test_a_controller_that_answers_twice_is_flown_once(plant, bound, asked, states):
    """The second answer to a state comes when the next one is asked about, and is not of it."""
    link = bound("fcu_plant", "plant")
    assert asked(link)[0] == 0
    link.send(states.pack_controls(0, NONE, True, True))
    assert asked(link, after=0)[0] == MS
    for _ in range(2):
        link.send(states.pack_controls(0, FULL, True, True))
    time_us, state = asked(link)  # asked again
    assert time_us == MS
    assert (state[ROTORS] == 0.0).all()
    link.send(states.pack_controls(MS, NONE, True, True))
    time_us, state = asked(link, after=MS)
    assert time_us == 2 * MS
    assert (state[ROTORS] == 0.0).all()  # full speed was never integrated
    assert plant.interrupted() == 0
    said = ended(plant)
    assert (said["ticks"], said["stale"], said["refused"]) == (2, 2, 0)


@pytest.mark.parametrize(("which", "reason"), [(math.nan, "finite"), (1.25, "0 and 1")])
def test_a_command_that_cannot_be_flown_is_refused_and_ends_the_flight(
    plant, bound, asked, states, which, reason
):
    link = bound("fcu_plant", "plant")
    assert asked(link)[0] == 0
    link.send(states.pack_controls(0, NONE, True, True))
    time_us, state = asked(link, after=0)
    bad = unflyable(states.pack_controls(time_us, NONE, True, True), which)
    link.send(bad)
    sent = 1
    while plant.process.poll() is None:
        if link.wait(0.2) and (datagram := link.receive()) is not None:
            again = np.zeros(size(VehicleState))
            assert states.parse_state(datagram, again) == MS
            assert again.tobytes() == state.tobytes()  # time stands, nothing is integrated
            link.send(bad)
            sent += 1
    assert plant.wait() == 3
    said = ended(plant)
    assert (said["ticks"], said["exit_code"]) == (1, 3)
    assert said["refused"] in (sent, sent - 1)  # it asks once more as it gives up
    assert plant.logged("warning", reason)
    assert plant.logged("error", "5 s", reason)


def test_a_controller_that_never_comes_is_waited_for_and_named(start, instance):
    plant = start("sitl_plant", "--instance", instance)
    until(lambda: plant.logged("info", "waiting"), "a word")
    plant.signal(signal.SIGTERM)
    assert plant.wait() == 0


@pytest.mark.parametrize("first", ["fcu", "sitl_plant"])
def test_either_may_start_first(start, instance, first):
    second = "sitl_plant" if first == "fcu" else "fcu"
    one = start(first, "--instance", instance)
    one.says('"ready"')
    other = start(second, "--instance", instance)
    fcu, plant = (one, other) if first == "fcu" else (other, one)
    until(lambda: fcu.logged("info", "the plant is there"), "the plant")
    assert fcu.interrupted() == 0
    until(lambda: plant.logged("warning", "1 s"), "a warning")
    assert plant.wait() == 3
    assert plant.logged("error", "5 s")


def test_a_plant_that_is_started_again_ends_the_flight(start, instance, script):
    fcu = start("fcu", "--instance", instance)
    plant = start("sitl_plant", "--instance", instance)
    script.first("LOCAL_POSITION_NED", lambda m: m.time_boot_ms > 0)  # time has gone on
    plant.kill()
    start("sitl_plant", "--instance", instance)
    assert fcu.wait() == 3
    assert fcu.logged("error", "time")


def test_a_wire_error_is_what_a_bad_answer_raises(states):
    with pytest.raises(WireError):
        states.parse_controls(b"", np.zeros(size(RotorCommand)))
