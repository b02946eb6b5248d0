"""What contradicts a belief is told in flight, once, and not of the ground."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.interface.airframe import believed
from fcu.interface.status_texts import Code
from fcu.kernel.buffers import size
from fcu.kernel.rows import column_of
from fcu.laws import loader
from fcu.laws.face import FLYING, TAKE_OVER
from fcu.process.belief_watch import BeliefWatch
from fcu.process.settings import settings
from fcu.process.tick import Tick

SETTINGS = settings(*believed(), 500.0)
LIGHTER = column_of(Tick, "guard.contradicted.lighter")
ENGAGED = column_of(Tick, "engaged")


@pytest.fixture
def watch():
    return BeliefWatch(loader.load(loader.DEFAULT))


def rows(*times, up=True, engaged=FLYING):
    made = np.zeros((len(times), size(Tick)))
    made[:, 0], made[:, LIGHTER], made[:, ENGAGED] = times, up, engaged
    return made


def told(watch, ticks, airborne):
    found = list(watch.see(ticks, SETTINGS, airborne))
    assert all(what.code is Code.NOT_AS_BELIEVED for _, what in found)
    return [at_us for at_us, _ in found]


def test_a_contradicted_belief_is_told_once_in_flight(watch):
    assert told(watch, rows(1.0, up=False), True) == []
    assert told(watch, rows(2.0, 2.002), True) == [2_000_000]
    assert told(watch, rows(3.0), True) == []
    assert told(watch, rows(4.0, engaged=TAKE_OVER), True) == [4_000_000]  # another flight


def test_on_the_ground_and_just_after_it_nothing_is_told(watch):
    assert told(watch, rows(5.0, 6.0), False) == []
    assert told(watch, rows(7.0, 15.9), True) == []
    assert told(watch, rows(16.0, 16.1, 17.0), True) == [16_100_000]


def test_a_flight_that_begins_in_the_air_waits_for_no_ground_before_it(watch):
    """Nor after a reset, with which time begins again."""
    assert told(watch, rows(50.0), False) == []
    assert told(watch, rows(0.0, engaged=TAKE_OVER), True) == [0]
