"""A position that jumps is flown through on the velocity; a state that is stuck is told."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fcu.interface.messages import VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.buffers import from_buffer, size, to_buffer
from fcu.vehicle.position_filter import JUMP, PositionFilter

H = 0.002


def state(x, v=5.0):
    return to_buffer(
        VehicleState(
            Vec3(x, -2.0, 30.0), Vec3(v, 0.0, 0.0), Quat(1.0, 0.0, 0.0, 0.0), Vec3(0.1, 0.2, 0.3),
            Rotors(*[400.0] * 8),
        )
    )  # fmt: skip


@pytest.fixture
def position_filter():
    position_filter = PositionFilter()
    position_filter.take(state(0.0))
    return position_filter


def test_what_can_be_passes_to_the_bit(position_filter):
    random = np.random.default_rng(3)
    for k in range(1, 200):
        received = state(k * H * 5.0) + 0.1 * random.standard_normal(size(VehicleState))
        assert not position_filter.pass_on(received, H, k * 2000)
        assert np.array_equal(position_filter.flown, received)


@pytest.mark.parametrize("jump", [1000.0, -1.01, 1e12])
def test_a_jump_is_flown_by_velocity_until_the_position_is_back(position_filter, jump):
    said = []
    for k in range(1, 501):
        said += position_filter.pass_on(state(k * H * 5.0 + jump), H, k * 2000)
        assert position_filter.flown[0] == pytest.approx(k * H * 5.0)
        assert np.array_equal(position_filter.flown[1:], state(0.0)[1:])
    assert said == [Told(Code.POSITION_JUMPED, (pytest.approx(abs(jump)),))]
    assert position_filter.off == pytest.approx(abs(jump))
    back = position_filter.pass_on(state(501 * H * 5.0), H, 502_000)
    assert back == [Told(Code.POSITION_BACK)]
    assert position_filter.off == 0.0


def test_a_step_just_below_the_jump_limit_passes(position_filter):
    assert not position_filter.pass_on(state(5.0 * H + 0.999 * JUMP), H, 2000)


def test_a_state_that_does_not_change_for_a_second_is_told_once(position_filter):
    said = [(k, position_filter.pass_on(state(0.0, v=0.0), H, k * 2000)) for k in range(1, 2000)]
    told = [(k, *each) for k, each in said if each]
    assert [each for _, each in told] == [Told(Code.STATE_STUCK)]
    assert 500 <= told[0][0] <= 511


def test_a_state_that_has_failed_is_gone_on_from_and_the_next_valid_one_believed():
    """At its velocity and body rate. After LOST_US that is told, once."""
    passes, start = PositionFilter(), VehicleState(
        r_E=Vec3(1.0, 2.0, 3.0), v_E=Vec3(0.5, 0.0, -0.25), q_EB=Quat(1.0, 0.0, 0.0, 0.0),
        w_B=Vec3(0.0, 0.0, 0.2), Omega=Rotors(*[300.0] * 8),
    )  # fmt: skip
    passes.take(to_buffer(start))
    told = [each for k in range(1, 501) for each in passes.fail(0.002, 2000 * k, True)]
    assert [each.code for each in told] == [Code.STATE_FAILED, Code.STATE_LOST]
    flown = from_buffer(VehicleState, passes.flown)
    assert flown.r_E == pytest.approx((1.5, 2.0, 2.75))
    assert 2.0 * math.atan2(flown.q_EB.z, flown.q_EB.w) == pytest.approx(0.2, rel=1e-4)
    assert passes.has_failed
    assert [each.code for each in passes.mend(to_buffer(start))] == [Code.STATE_BACK]
    assert from_buffer(VehicleState, passes.flown) == start
    assert not passes.has_failed and passes.off == 0.0


def test_a_lost_state_is_told_once_the_vehicle_is_armed():
    passes = PositionFilter()
    passes.take(state(0.0))
    told = [[each.code for each in passes.fail(H, 2000 * k, k > 500)] for k in range(1, 600)]
    assert [(k, codes) for k, codes in enumerate(told, 1) if codes] == [
        (1, [Code.STATE_FAILED]), (501, [Code.STATE_LOST]),
    ]  # fmt: skip
