"""The maps between the frames inside (ENU, FLU) and the wire's (NED, FRD)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fcu.interface.messages import RotorCommand, VehicleState
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import from_euler
from fcu.mavlink import frames
from tests.mavlink.strategies import anything, commands, quaternions, speeds, states, vectors

ENU_TO_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FLU_TO_FRD = np.diag([1.0, -1.0, -1.0])

NORTH, EAST, WEST = 90.0, 0.0, 180.0  # yaw inside, degrees
HUGE = 1e300  # far outside float32


def bits(value):
    """The bytes of a value's float64 leaves: equal only if every bit is."""
    if isinstance(value, float):
        return np.float64(value).tobytes()
    if hasattr(value, "_fields"):
        return to_buffer(value).tobytes()
    return b"".join(bits(each) for each in value)


def attitude(yaw_deg, roll_deg=0.0, pitch_deg=0.0):
    return from_euler(*(math.radians(a) for a in (roll_deg, pitch_deg, yaw_deg)))


NOSE_NORTH = attitude(NORTH)


def state(r=(0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0), q=NOSE_NORTH, w=(0.0, 0.0, 0.0)):
    return VehicleState(Vec3(*r), Vec3(*v), q, Vec3(*w), Rotors(*[300.0] * 8))


def aeronautical_deg(q_NF):
    """Yaw, pitch and roll in degrees of an FRD to NED quaternion, by SciPy."""
    return Rotation.from_quat([q_NF.x, q_NF.y, q_NF.z, q_NF.w]).as_euler("ZYX", degrees=True)


@pytest.mark.parametrize(
    ("inside", "yaw_pitch_roll_deg"),
    [
        (attitude(NORTH), (0.0, 0.0, 0.0)),
        (attitude(EAST), (90.0, 0.0, 0.0)),
        (attitude(WEST), (-90.0, 0.0, 0.0)),
        # about an axis to the left, a positive turn pitches the nose down
        (attitude(NORTH, pitch_deg=-20.0), (0.0, 20.0, 0.0)),
        # about forward, a positive turn lifts the left side: the right side goes down
        (attitude(NORTH, roll_deg=30.0), (0.0, 0.0, 30.0)),
        (attitude(EAST, roll_deg=30.0, pitch_deg=-20.0), (90.0, 20.0, 30.0)),
    ],
    ids=["nose north", "nose east", "nose west", "nose up", "right side down", "all three"],
)
def test_attitudes_mean_the_same_on_the_wire(inside, yaw_pitch_roll_deg):
    assert aeronautical_deg(frames.attitude_enu_ned(inside)) == pytest.approx(
        yaw_pitch_roll_deg, abs=1e-9
    )


def test_nose_north_and_level_is_the_identity_on_the_wire():
    assert frames.attitude_enu_ned(attitude(NORTH)) == pytest.approx((1.0, 0.0, 0.0, 0.0))


@given(quaternions)
def test_attitude_is_the_product_of_the_three_rotations(q_EB):
    q = frames.attitude_enu_ned(q_EB)
    R_EB = Rotation.from_quat([q_EB.x, q_EB.y, q_EB.z, q_EB.w]).as_matrix()
    R_NF = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    assert np.abs(R_NF - ENU_TO_NED @ R_EB @ FLU_TO_FRD).max() < 1e-14
    assert q.w >= 0.0


@given(quaternions)
def test_attitude_there_and_back_is_the_same_rotation(q_EB):
    back = frames.attitude_enu_ned(frames.attitude_enu_ned(q_EB))
    overlap = sum(a * b for a, b in zip(back, q_EB, strict=True))
    assert abs(overlap) == pytest.approx(1.0, abs=1e-15)
    assert back.w >= 0.0


def test_vectors_change_their_axes_as_the_words_say():
    east, north, up = Vec3(1.0, 0.0, 0.0), Vec3(0.0, 1.0, 0.0), Vec3(0.0, 0.0, 1.0)
    assert frames.enu_ned(north) == (1.0, 0.0, 0.0)
    assert frames.enu_ned(east) == (0.0, 1.0, 0.0)
    assert frames.enu_ned(up) == (0.0, 0.0, -1.0)
    forward, left, top = Vec3(1.0, 0.0, 0.0), Vec3(0.0, 1.0, 0.0), Vec3(0.0, 0.0, 1.0)
    assert frames.flu_frd(forward) == (1.0, 0.0, 0.0)
    assert frames.flu_frd(left) == (0.0, -1.0, 0.0)
    assert frames.flu_frd(top) == (0.0, 0.0, -1.0)


@given(vectors, st.floats(-HUGE, HUGE))
def test_plain_python_exchanges_axes_as_the_kernels_do(v, psi):
    assert bits(frames.earth(v)) == bits(frames.enu_ned(v))
    assert bits(frames.body(v)) == bits(frames.flu_frd(v))
    assert bits(frames.heading(psi)) == bits(frames.yaw_enu_ned(psi))


@pytest.mark.parametrize(
    ("east_ccw_deg", "north_cw_deg"),
    [(90.0, 0.0), (0.0, 90.0), (45.0, 45.0), (-90.0, -180.0), (180.0, -90.0), (450.0, 0.0)],
)
def test_yaw_from_east_to_north(east_ccw_deg, north_cw_deg):
    yaw = frames.yaw_enu_ned(math.radians(east_ccw_deg))
    assert math.degrees(yaw) == pytest.approx(north_cw_deg, abs=1e-12)


def test_velocity_is_sent_along_the_body():
    eastward = frames.state_to_wire(state(v=(2.0, 0.0, 0.0), q=attitude(NORTH)))
    assert eastward.v_F == pytest.approx((0.0, 2.0, 0.0), abs=1e-7)  # to the right of the nose
    climbing = frames.state_to_wire(state(v=(0.0, 0.0, 3.0)))
    assert climbing.v_F == pytest.approx((0.0, 0.0, -3.0), abs=1e-7)  # not downwards
    nose_up = frames.state_to_wire(state(v=(0.0, 0.0, 3.0), q=attitude(NORTH, pitch_deg=-90.0)))
    assert nose_up.v_F == pytest.approx((3.0, 0.0, 0.0), abs=1e-7)  # along the nose


def test_rates_are_aeronautical_on_the_wire():
    on_wire = frames.state_to_wire(state(w=(0.25, 0.5, 0.75)))
    # right side going down; nose going down; turning left
    assert on_wire.w_F == (0.25, -0.5, -0.75)


def test_position_error_of_the_wire_is_that_of_float32():
    there = frames.through_the_wire(state(r=(100.1, -50.2, 10.3), v=(5.1, -6.2, 0.3)))
    assert there.r_E == pytest.approx((100.1, -50.2, 10.3), rel=6e-8)
    assert there.v_E == pytest.approx((5.1, -6.2, 0.3), abs=2e-6)


@given(states)
def test_any_state_arrives_finite_with_a_unit_attitude(sent):
    received = frames.through_the_wire(sent)
    assert np.isfinite(to_buffer(received)).all()
    assert math.hypot(*received.q_EB) == pytest.approx(1.0, abs=1e-15)
    assert min(received.Omega) >= 0.0


def test_values_outside_float32_are_saturated():
    received = frames.through_the_wire(state(r=(HUGE, -math.inf, 1.0), w=(0.0, HUGE, 0.0)))
    assert received.r_E == (frames.FLOAT32_MAX, -frames.FLOAT32_MAX, 1.0)
    assert received.w_B.y == frames.FLOAT32_MAX


def test_nan_stays_nan():
    assert math.isnan(frames.through_the_wire(state(r=(math.nan, 0.0, 0.0))).r_E.x)
    command = RotorCommand(Rotors(math.nan, *[0.5] * 7))
    assert math.isnan(frames.command_through_the_wire(command).u.r1)


def test_commands_are_held_between_zero_and_one():
    sent = RotorCommand(Rotors(-0.5, 0.0, 0.25, 1.0, 1.5, math.inf, -math.inf, 0.1))
    assert frames.command_through_the_wire(sent).u == (
        0.0, 0.0, 0.25, 1.0, 1.0, 1.0, 0.0, float(np.float32(0.1)),
    )  # fmt: skip


SAME_BITS = [
    (frames.single, anything.map(lambda x: (x,))),
    (frames.single3, vectors.map(lambda v: (v,))),
    (frames.single4, quaternions.map(lambda q: (q,))),
    (frames.single8, speeds.map(lambda s: (s,))),
    (frames.magnitude8, speeds.map(lambda s: (s,))),
    (frames.limited, st.tuples(anything, st.just(-2.0), st.just(3.0))),
    (frames.enu_ned, vectors.map(lambda v: (v,))),
    (frames.flu_frd, vectors.map(lambda v: (v,))),
    (frames.canonical, quaternions.map(lambda q: (q,))),
    (frames.attitude_enu_ned, quaternions.map(lambda q: (q,))),
    (frames.yaw_enu_ned, st.floats(-HUGE, HUGE).map(lambda x: (x,))),
    (frames.state_to_wire, states.map(lambda s: (s,))),
    (frames.state_from_wire, states.map(lambda s: (frames.state_to_wire(s),))),
    (frames.through_the_wire, states.map(lambda s: (s,))),
    (frames.command_through_the_wire, commands.map(lambda c: (c,))),
]


@pytest.mark.parametrize(
    ("kernel", "arguments"), SAME_BITS, ids=lambda k: getattr(k, "__name__", "")
)
@given(data=st.data())
@pytest.mark.computes
def test_python_and_compiled_code_give_the_same_bits(kernel, arguments, data):
    given_arguments = data.draw(arguments)
    plain, compiled = kernel.py_func(*given_arguments), kernel(*given_arguments)
    assert bits((plain,)) == bits((compiled,))
