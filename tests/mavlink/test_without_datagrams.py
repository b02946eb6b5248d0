"""What a value becomes on the plant link, worked out without a datagram: the same bits, the same refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fcu.interface.messages import RotorCommand, VehicleState
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.buffers import from_buffer, size, to_buffer
from fcu.mavlink.plant_link import (
    LONGEST,
    PlantCodec,
    controls_received,
    desk,
    fault_in_words,
    pack_controls,
    pack_state,
    parse_controls,
    parse_state,
    state_received,
)
from tests.mavlink.plant_datagrams import SPIN, SYSTEM, untouched
from tests.mavlink.strategies import states

QUAD = Rotors(1.0, -1.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0)
STILL = VehicleState(
    Vec3(1.0, -0.0, 3.0), Vec3(0.0, -0.0, 0.0), Quat(-0.6, 0.0, 0.0, 0.8), Vec3(-0.0, 5e-324, 1e300),
    Rotors(*[300.0] * 8),
)  # fmt: skip
any_number = st.floats()


def by_datagram(state, spin):
    """(float64[size(VehicleState)], fault) of a state that is packed and parsed."""
    n = sum(each != 0.0 for each in spin)
    end, datagram, told = desk(n), np.zeros(LONGEST, dtype=np.uint8), np.zeros(3, dtype=np.int64)
    battery, out = np.zeros(5), untouched(size(VehicleState))
    length = pack_state(
        end, SYSTEM, 2000, to_buffer(state), np.array(spin), battery, False, datagram
    )
    fault = parse_state(desk(n), SYSTEM, datagram, length, out, battery, told)
    return out, fault


@given(states, st.sampled_from([SPIN, QUAD]))
@example(STILL, SPIN)
@example(STILL, QUAD)
@example(STILL._replace(q_EB=Quat(0.6, 0.0, 0.0, 0.85)), QUAD)
def test_a_state_without_a_datagram_has_the_bits_of_one_with_it(state, spin):
    read, fault = by_datagram(state, spin)
    found, said = state_received(state, spin)
    assert said == fault
    if not fault:
        assert to_buffer(found).tobytes() == read.tobytes()


@pytest.mark.parametrize("i", range(size(VehicleState)))
def test_a_state_that_is_refused(i):
    row = to_buffer(STILL)
    row[i] = math.nan
    state = from_buffer(VehicleState, row)
    _, said = state_received(state, SPIN)
    assert said == by_datagram(state, SPIN)[1] != 0
    assert "finite" in fault_in_words(said)


@given(st.builds(RotorCommand, st.builds(Rotors, *[any_number] * 8)))
@example(RotorCommand(Rotors(math.nan, -0.0, 1.0, 1.0 + 1e-9, 1e-310, math.inf, -math.inf, 0.3)))
def test_a_command_of_which_a_rotor_that_is_not_a_number_stands(command):
    codec, datagram = PlantCodec(SYSTEM, SPIN), np.zeros(LONGEST, dtype=np.uint8)
    length = pack_controls(codec.desk, SYSTEM, 2000, to_buffer(command), True, True, True, datagram)
    read, told = untouched(size(RotorCommand)), np.zeros(3, dtype=np.int64)
    assert parse_controls(codec.desk, SYSTEM, datagram, length, read, told) == 0
    assert to_buffer(controls_received(command)).tobytes() == read.tobytes()
