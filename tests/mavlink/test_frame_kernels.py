"""Frames in compiled code against the framer in Python."""

from __future__ import annotations

import numpy as np
import pytest
from fastcrc.crc16 import mcrf4xx
from hypothesis import given
from hypothesis import strategies as st

from fcu.mavlink.frame_kernels import checksum, get, get_signed, put


@given(st.binary(max_size=300), st.integers(0, 40), st.integers(0, 255))
def test_the_checksum_is_that_of_another_implementation(data, first, extra):
    first = min(first, len(data))
    buffer = np.frombuffer(data, dtype=np.uint8).copy()
    for end in range(max(first, len(data) - 9), len(data) + 1):
        assert checksum(buffer, first, end, extra) == mcrf4xx(data[first:end] + bytes([extra]))


@pytest.mark.parametrize("size", [1, 2, 4])
def test_a_number_with_a_sign_comes_back_from_its_bytes(size):
    buffer = np.zeros(size + 2, dtype=np.uint8)
    half = 1 << (8 * size - 1)
    for number in (0, 1, half - 1, -1, -2, -half):
        put(buffer, 1, number, size)
        assert get_signed(buffer, 1, size) == number
        assert get(buffer, 1, size) == number % (2 * half)  # without its sign
    assert (buffer[0], buffer[-1]) == (0, 0)
