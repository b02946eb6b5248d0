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


def test_13_is_shown_with_a_lambda_hat_that_is_one_number_learnt_within_its_set(monkeypatch):
    """The first fiftieth of a second, in which the prediction error has hardly begun to grow."""
    runs = []

    def begun(loop, start, duration, h, every):
        assert (duration, loop.laws.Lambda.gamma) == (1.0, 100.0)
        runs.append(simulate(loop, start, 0.02, h, every=every))
        return runs[-1]

    simulate = counterexamples.simulate
    monkeypatch.setattr(counterexamples, "simulate", begun)
    found = counterexamples.moving_lambda()
    Lambda_hat = runs[0].states.estimates.Lambda
    assert Lambda_hat[0].item() == 1.0
    assert 0.9 < Lambda_hat[-1].item() < 1.0
    assert 0.0 < found.measured < found.printed < found.repaired


@pytest.mark.parametrize("name", ["command_over_lambda", "limit_of_channels"])
@pytest.mark.computes
def test_conditions_that_hold_while_the_control_saturates(name):
    found = getattr(counterexamples, name)()
    assert found.printed_margin > 0.0
    assert found.saturated
    assert found.repaired_margin < 0.0


@pytest.mark.parametrize("name", ["ball_of_the_theorem", "tracking_error_left_out"])
@pytest.mark.computes
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
