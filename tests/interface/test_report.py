"""A Report is the same whether its Ticks are completed one at a time or many."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.interface.airframe import read
from fcu.interface.diagnostics import fcu_row
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import RecorderPipe
from fcu.kernel.rows import column, slice_of
from fcu.laws import loader
from fcu.parameters import Parameters
from fcu.process.configuration import read_settings
from fcu.process.reporting import Reporter, row_width
from fcu.vehicle.state_machine import StateMachine

LAW = loader.load()
ROW = fcu_row(LAW.ticks.Tick)
TICKS = 12


@pytest.fixture
def flown():
    """Ticks that have been flown, level and with a disturbance; and their times."""
    rows, times = np.zeros((TICKS, row_width(LAW))), np.random.default_rng(1).random((TICKS, 3))
    column(ROW, rows, "measured.q_EB.w")[:] = 1.0
    column(ROW, rows, "state.estimates.s_v_hat.x")[:] = np.linspace(-1.0, 1.0, TICKS)
    column(ROW, rows, "state.estimates.m_hat")[:] = 10.0
    column(ROW, rows, "engaged")[2:] = 2.0
    return rows, times


class Full(PublisherFeed):
    """One of two rows has no room."""

    def __init__(self):
        super().__init__(None, "fcu")
        self._socket, self.asked = object(), 0

    def send(self, row):
        self.asked += 1
        self.dropped += self.asked % 2


def reported(flown, together: int, feed=None):
    """Them with their Reports, so many at a time."""
    rows, times = (each.copy() for each in flown)
    params = Parameters(read_settings(LAW, None, 500.0), 1, None)
    reporter = Reporter(
        LAW, RecorderPipe(row_width(LAW)), feed or PublisherFeed(None, "fcu"), read().drag
    )
    for k in range(0, TICKS, together):
        part = slice(k, k + together)
        reporter.report(rows[part], times[part], StateMachine(params), 0.25, 3, 4)
    assert reporter.cycle_max_s == times[:, 1].max()
    return rows


def test_ticks_are_reported_one_at_a_time_or_many(flown):
    one, many = reported(flown, 1), reported(flown, 4)
    published = slice_of(ROW, "timing.published")
    one[:, published] = many[:, published] = 0.0  # of a wall clock that goes on
    assert one.tobytes() == many.tobytes()


def test_what_is_told_of_ticks(flown):
    rows, times = reported(flown, 5), flown[1]
    ticks = slice_of(ROW, "wind").start
    assert rows[:, :ticks].tobytes() == flown[0][:, :ticks].tobytes()
    assert column(ROW, rows, "timing.sequence").tolist() == list(range(TICKS))
    assert column(ROW, rows, "timing.cycle").tolist() == times[:, 1].tolist()
    longest = np.maximum.accumulate(times[:, 1])
    assert column(ROW, rows, "timing.cycle_max").tolist() == longest.tolist()
    assert column(ROW, rows, "timing.load").tolist() == times[:, 2].tolist()
    assert np.ptp(column(ROW, rows, "timing.published") - times[:, 0]) < 1.0
    assert set(column(ROW, rows, "timing.resent")) == {3.0}
    assert set(column(ROW, rows, "timing.refused")) == {4.0}
    assert set(column(ROW, rows, "status.position_off")) == {0.25}
    air = column(ROW, rows, "wind.v_air_E.x")
    assert np.isnan(air).tolist() == [True, True] + [False] * (TICKS - 2)
    assert (np.diff(air[2:]) > 0.0).all()  # who is pushed east feels a wind to the east


@pytest.mark.parametrize("together", [1, 4])
def test_each_tick_tells_what_was_dropped_before_it(flown, together):
    rows = reported(flown, together, Full())
    dropped = [(k + 1) // 2 for k in range(TICKS)]
    assert column(ROW, rows, "timing.unpublished").tolist() == dropped
