"""Frames in compiled code against the framer in Python."""

from __future__ import annotations

import numpy as np
from fastcrc.crc16 import mcrf4xx
from hypothesis import given
from hypothesis import strategies as st

from fcu.mavlink.frame_kernels import checksum


@given(st.binary(max_size=300), st.integers(0, 40), st.integers(0, 255))
def test_the_checksum_is_that_of_another_implementation(data, first, extra):
    first = min(first, len(data))
    buffer = np.frombuffer(data, dtype=np.uint8).copy()
    for end in range(max(first, len(data) - 9), len(data) + 1):
        assert checksum(buffer, first, end, extra) == mcrf4xx(data[first:end] + bytes([extra]))
