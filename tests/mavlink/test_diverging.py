"""A flight that diverges does not crash its telemetry, whatever its numbers."""

from __future__ import annotations

import inspect
import math

import pymavlink.dialects.v20.all as mavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.mavlink import setpoints
from fcu.mavlink import telemetry as tm
from fcu.mavlink.definitions import FLOAT32_MAX
from fcu.mavlink.framing import Source, framed
from fcu.mavlink.geodesy import Geodetic
from fcu.mavlink.setpoints import Target


def read(message):
    """The message, by pymavlink."""
    (m,) = mavlink.MAVLink(None).parse_buffer(bytearray(framed(*message, 0, 3, 1)))
    return m


def fields(m, *names):
    return tuple(getattr(m, name) for name in names)


wild = st.floats() | st.sampled_from([1e39, -1.0, math.nan, math.inf, -math.inf, 5e-324])
wild_vectors = st.builds(Vec3, wild, wild, wild)
VALUES = {
    "float": wild,
    "int": st.integers(-5, 300),
    "bool": st.booleans(),
    "str": st.just("m_hat"),
    "Source": st.builds(Source, st.integers(0, 255), st.integers(0, 255)),
    "Target": st.builds(Target, *[wild] * 11),
    "Vec3": wild_vectors,
    "Quat": st.builds(Quat, wild, wild, wild, wild),
    "Geodetic": st.builds(Geodetic, wild, wild, wild),
    "Rotors": st.builds(Rotors, *[wild] * 8),
    "Setpoint": st.builds(Setpoint, wild_vectors, wild_vectors, wild_vectors, wild, wild),
    "Sequence[float]": st.lists(wild, min_size=8, max_size=8),
}
BUILDERS = [
    function
    for module in (tm, setpoints)
    for name, function in vars(module).items()
    if inspect.isfunction(function)
    and function.__module__ == module.__name__
    and not name.startswith("_")
    and inspect.signature(function).return_annotation == "Packed"
    and name != "echo"  # of what was received: with the setpoints
]


@pytest.mark.parametrize("build", BUILDERS, ids=lambda b: b.__name__)
@given(st.data())
@pytest.mark.computes
def test_a_diverging_flight_does_not_crash_its_telemetry(build, data):
    parameters = inspect.signature(build).parameters.values()
    message = build(*[data.draw(VALUES[p.annotation]) for p in parameters])
    assert len(framed(*message, 0, 3, 1)) <= len(message.payload) + 12


def test_values_outside_a_field_are_saturated():
    m = read(tm.local_position(1e12, Vec3(1e300, -math.inf, 0.0), Vec3(0.0, 0.0, 0.0)))
    assert fields(m, "time_boot_ms", "y", "x") == (2**32 - 1, FLOAT32_MAX, -FLOAT32_MAX)
    m = read(
        tm.global_position(-1.0, Geodetic(1e9, math.nan, -1e39), 0.0, Vec3(0.0, 0.0, 0.0), 0.0)
    )
    assert fields(m, "time_boot_ms", "lat", "lon", "alt") == (0, 2**31 - 1, 0, -(2**31))
