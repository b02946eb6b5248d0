"""The reasons for which the controller's burst of ticks ends, by the clock."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fcu.process import burst
from fcu.process.burst import Course

TICKS = 6
H = 0.002
ANSWER = 70  # bytes


@pytest.fixture
def flown(monkeypatch):
    """`flown(waits, due)`: how a burst ends, of ticks whose states are waited for so long (s)."""

    def fly(waits, due=np.inf, lasts=20e-6):
        clock = SimpleNamespace(at=100.0, waits=iter(waits), sent=0)

        def receive(fd, datagram, wait):
            pause = next(clock.waits, None)
            clock.at += pause or 0.0
            return -1 if pause is None else 300

        def tick(*others):
            clock.at += lasts
            return ANSWER

        def send(fd, answer, length):
            clock.sent += 1
            return length

        quiet = SimpleNamespace(
            monotonic=lambda scratch: clock.at, ready=lambda others, timeout_ms: 0,
            receive=receive, send=send,
        )  # fmt: skip
        monkeypatch.setattr(burst, "system", quiet)
        monkeypatch.setattr(burst, "tick", tick)
        course = np.zeros(len(Course._fields))
        course[Course._fields.index("h")] = H
        wire = SimpleNamespace(
            link=[-1], others=None, datagram=None, due=np.array([100.0 + due]), scratch=None
        )
        times = np.zeros((TICKS, 3))
        python = getattr(burst.serve, "py_func", burst.serve)
        flight = SimpleNamespace(course=course, answer=None)
        flown, why, length = python(flight, 0, wire, np.zeros((TICKS, 1)), times, -1)
        assert clock.sent == flown  # every tick has had its answer
        assert np.count_nonzero(times[:, 0]) == flown
        return flown, why, length

    return fly


def test_while_states_come_soon_it_fills_its_rows(flown):
    assert flown([0.1e-3] * TICKS) == (TICKS, burst.FULL, 0)


def test_a_burst_waits_once_for_a_slow_plant_and_then_leaves_it_to_python(flown):
    """The tick that was waited for is flown: it counts, and nothing after it."""
    slow = 1.1 * burst.SLOW_S
    assert flown([0.1e-3, 0.1e-3, slow, 0.1e-3]) == (3, burst.SLOW, 0)
    assert flown([0.9 * burst.SLOW_S] * TICKS) == (TICKS, burst.FULL, 0)


def test_a_burst_ends_when_telemetry_is_due(flown):
    """Telemetry that is due in 0.5 ms: the third tick of 0.2 ms is the last."""
    assert flown([0.2e-3 - 20e-6] * TICKS, due=0.5e-3) == (3, burst.DUE, 0)
    assert flown([0.2e-3 - 20e-6] * TICKS, due=-1.0) == (1, burst.DUE, 0)


def test_a_plant_that_falls_silent_ends_a_burst_between_two_ticks(flown):
    assert flown([0.1e-3] * 2) == (2, burst.SILENT, 0)
