"""Each printed form that fails, failing; and its repair, which does not."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.theory import counterexamples


@pytest.mark.slow
def test_13_without_the_rate_of_lambda_is_exceeded():
    found = counterexamples.moving_lambda()
    assert found.measured > 1.3 * found.printed
    assert found.measured < found.repaired


@pytest.mark.parametrize("name", ["command_over_lambda", "limit_of_channels"])
def test_conditions_that_hold_while_the_control_saturates(name):
    found = getattr(counterexamples, name)()
    assert found.printed_margin > 0.0
    assert found.saturated
    assert found.repaired_margin < 0.0


@pytest.mark.parametrize("name", ["ball_of_the_theorem", "tracking_error_left_out"])
def test_conditions_that_hold_while_the_state_leaves_for_good(name):
    found = getattr(counterexamples, name)()
    assert found.printed_margin > -1e-9
    assert found.saturated
    assert abs(found.run.states.x[-1, 0]) > 1e6
    assert found.repaired_margin < 0.0


def test_a_ball_lets_v_grow_where_lambda_is_diagonal_and_a_box_does_not():
    found = counterexamples.ball_and_diagonal()
    assert found.ball > 1.5 * found.start
    assert found.box == pytest.approx(found.start)


def test_the_setpoint_of_section_viii_saturates_at_f_m_1(law):
    found = counterexamples.setpoint_of_section_viii(law())
    assert found.printed_margin > 0.0  # sqrt(3) 200 N
    assert found.repaired_margin == pytest.approx(200.0 - 231.6, abs=0.1)
    assert found.saturated
    assert np.linalg.norm(found.run.signals.u, axis=-1).max() <= 200.0 + 1e-9
