"""What the plant link refuses: by its fields, by its frame, and whatever is thrown at it."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pymavlink.dialects.v20.common as mavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.interface.messages import Battery, VehicleState
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.mavlink import frames
from fcu.mavlink.plant_link import PlantCodec, WireError
from tests.mavlink.plant_datagrams import (
    SPIN,
    SYSTEM,
    TIME,
    controls_by_pymavlink,
    odometry_by_pymavlink,
    pymavlink_at,
    rotors_by_pymavlink,
    state_by_pymavlink,
    untouched,
)

CODEC = PlantCodec(SYSTEM, SPIN)
FLYING = VehicleState(
    Vec3(10.0, 20.0, 30.0),
    Vec3(2.0, 0.0, 0.0),
    Quat(0.6, 0.0, 0.0, 0.8),
    Vec3(0.25, 0.5, 0.75),
    Rotors(301.0, 302.0, 303.0, 304.0, 305.0, 306.0, 307.0, 308.0),
)

FULL = Battery(25.2, 0.0, 0.0, 1.0, 0.0)


def battery_by_pymavlink(system=SYSTEM, **differs):
    fields = {
        "id": 0, "battery_function": 1, "type": 1, "temperature": 2**15 - 1,
        "voltages": [25200] + [65535] * 9, "current_battery": 0, "current_consumed": 0,
        "energy_consumed": 0, "battery_remaining": 100,
    }  # fmt: skip
    message = mavlink.MAVLink_battery_status_message(**{**fields, **differs})
    return message.pack(pymavlink_at(2, system))


def on_wire_with(**fields):
    return frames.state_to_wire(FLYING)._replace(**fields)


def refused_states():
    good, link = on_wire_with(), pymavlink_at

    def state(on_wire=good, system=SYSTEM, component=1, **odometry):
        return state_by_pymavlink(
            link(0, system, component),
            odometry_by_pymavlink(on_wire, **odometry),
            rotors_by_pymavlink(on_wire),
        )

    yield "finite", state(on_wire_with(r_N=Vec3(math.nan, 0.0, 0.0)))
    yield "finite", state(on_wire_with(Omega=Rotors(math.inf, *[1.0] * 7)))
    yield "unit quaternion", state(on_wire_with(q_NF=Quat(0.0, 0.0, 0.0, 0.0)))
    yield "unit quaternion", state(on_wire_with(q_NF=Quat(2.0, 0.0, 0.0, 0.0)))
    yield "LOCAL_NED", state(frame=7)
    yield "BODY_FRD", state(child=1)
    yield "different times", state(time=TIME + 1)
    yield "system 4", state(system=4)
    yield "component 2", state(component=2)
    rotors = rotors_by_pymavlink(good)
    yield "ODOMETRY was expected", rotors.pack(link(0))
    six = rotors_by_pymavlink(good, active=0x3F)
    yield "6 rotors.* has 8", state_by_pymavlink(link(0), odometry_by_pymavlink(good), six)
    yield "no ACTUATOR_OUTPUT_STATUS", odometry_by_pymavlink(good).pack(link(0))
    yield "no BATTERY_STATUS", state() + b"\0"
    yield "BATTERY_STATUS was expected", state() + rotors.pack(link(2))
    yield "1 bytes after", state() + battery_by_pymavlink() + b"\0"
    yield "system 4", state() + battery_by_pymavlink(system=4)
    yield "wrong checksum", state() + battery_by_pymavlink()[:-1] + b"\0"
    yield "out of range", state() + battery_by_pymavlink(battery_remaining=-1)
    yield "out of range", state() + battery_by_pymavlink(battery_remaining=101)
    yield "out of range", state() + battery_by_pymavlink(voltages=[65535] * 10)
    for name in ("current_consumed", "energy_consumed", "current_battery"):
        yield "out of range", state() + battery_by_pymavlink(**{name: -1})
    nan = state(on_wire_with(v_F=Vec3(0.0, 0.0, math.nan)))
    yield "finite", nan + battery_by_pymavlink()
    yield "MAVLink 2", b"\xfe" + state()[1:]
    yield "unsigned", state()[:2] + b"\x01" + state()[3:]
    yield "no ODOMETRY", b""


@pytest.mark.parametrize(("reason", "datagram"), list(refused_states()))
def test_a_bad_state_is_refused_and_changes_nothing(reason, datagram):
    received, codec = untouched(21), PlantCodec(SYSTEM)
    codec.battery = FULL
    with pytest.raises(WireError, match=reason):
        codec.parse_state(datagram, received)
    assert (received == untouched(21)).all()
    assert codec.battery == FULL


@pytest.mark.parametrize(
    ("reason", "u"),
    [
        ("finite", [math.nan] + [0.5] * 7),
        ("finite", [0.5] * 7 + [math.inf]),
        ("between 0 and 1", [0.5] * 7 + [1.25]),
        ("between 0 and 1", [-0.25] + [0.5] * 7),
    ],
)
def test_a_bad_command_is_refused_and_changes_nothing(reason, u):
    received = untouched(8)
    with pytest.raises(WireError, match=reason):
        CODEC.parse_controls(controls_by_pymavlink(u), received)
    assert (received == untouched(8)).all()


def test_nan_is_sent_and_refused_at_the_other_end():
    diverged = to_buffer(FLYING)
    diverged[0] = math.nan
    with pytest.raises(WireError, match="finite"):
        CODEC.parse_state(CODEC.pack_state(TIME, diverged), untouched(21))


@pytest.mark.parametrize("field", Battery._fields)
@pytest.mark.parametrize("value", [math.nan, -math.inf])
def test_a_battery_that_is_not_a_number_or_below_0_is_refused_at_the_other_end(field, value):
    datagram = CODEC.pack_state(TIME, to_buffer(FLYING), FULL._replace(**{field: value}))
    if field == "voltage" and value < 0.0:  # unsigned: saturated
        assert CODEC.parse_state(datagram, untouched(21)) == TIME
        assert CODEC.battery is not None
        assert CODEC.battery.voltage == 0.0
        return
    with pytest.raises(WireError, match="out of range"):
        CODEC.parse_state(datagram, untouched(21))


SAMPLES = {
    "state": CODEC.pack_state(TIME, to_buffer(FLYING)),
    "state and battery": CODEC.pack_state(TIME, to_buffer(FLYING), FULL),
    "hold": CODEC.pack_hold(TIME, to_buffer(FLYING), FULL),
    "controls": CODEC.pack_controls(TIME, np.full(8, 0.5), True, True),
}


def assert_refused(datagram):
    state, command = untouched(21), untouched(8)
    with pytest.raises(WireError):
        CODEC.parse_state(datagram, state)
    with pytest.raises(WireError):
        CODEC.parse_controls(datagram, command)
    assert (state == untouched(21)).all()
    assert (command == untouched(8)).all()


@pytest.mark.parametrize("name", SAMPLES)
def test_every_truncation_is_refused(name):
    battery = len(battery_by_pymavlink()) if name in ("state and battery", "hold") else 0
    for length in range(len(SAMPLES[name])):
        if battery and length == len(SAMPLES[name]) - battery:  # whole, without its battery
            assert CODEC.parse_state(SAMPLES[name][:length], untouched(21)) == TIME
        else:
            assert_refused(SAMPLES[name][:length])


@pytest.mark.parametrize("name", SAMPLES)
def test_every_flipped_bit_is_refused(name):
    for bit in range(8 * len(SAMPLES[name])):
        damaged = bytearray(SAMPLES[name])
        damaged[bit // 8] ^= 1 << bit % 8
        assert_refused(bytes(damaged))


@given(st.binary(max_size=600))
def test_random_bytes_are_refused(datagram):
    assert_refused(datagram)


@given(st.sampled_from(sorted(SAMPLES)), st.binary(max_size=60), st.integers(0, 320))
def test_overwritten_bytes_never_raise_anything_else(name, junk, at):
    damaged = SAMPLES[name][:at] + junk + SAMPLES[name][at + len(junk) :]
    for parse, size in ((CODEC.parse_state, 21), (CODEC.parse_controls, 8)):
        with contextlib.suppress(WireError):
            parse(damaged, untouched(size))
