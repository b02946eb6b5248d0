"""The arrays of a simulator, what of a flight is reported, and why a burst of ticks ends."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fcu.interface.messages import VehicleState
from fcu.kernel.buffers import size
from fcu.kernel.rows import column_of
from sitl_plant import burst
from sitl_plant.burst import WIDTH
from sitl_plant.physics import dynamics, tick
from sitl_plant.physics.world import world

DELAY = 3  # ticks
TICKS = 40
_X = column_of(VehicleState, "r_E.x")


@pytest.fixture
def late():
    """A simulator that reports what was DELAY ticks ago."""
    made = burst.plant(world(plant={"delay_s": DELAY * 0.002}), 1)
    burst.draw_noise(made, np.random.default_rng(0), np.zeros(tick.NOISE))
    return made


def test_the_ring_holds_whole_states_and_the_block_whole_rows_of_noise(late):
    assert late.past.shape == (DELAY + 1, size(VehicleState))
    assert late.noise.shape == (burst.NOISE_BLOCK, tick.NOISE)


def test_a_state_is_reported_as_late_as_the_sensors_are(late):
    """Until the delay has passed it is the first state that is reported."""
    reported = []
    for now in range(TICKS):
        late.state[_X] = float(now)  # a metre a tick
        assert burst.observe(late, np.zeros(WIDTH)) == (now, now % 50 == 0, dynamics.FLYING)
        reported.append(late.reported[_X])
        late.progress[burst.SEQUENCE] += 1.0
    assert reported == [float(max(now - DELAY, 0)) for now in range(TICKS)]


def test_noise_lasts_for_its_block_and_no_longer(late):
    late.progress[burst.NOISE_AT] = burst.NOISE_BLOCK - 1
    row = np.zeros(WIDTH)
    assert burst.observe(late, row)[2] == dynamics.FLYING
    assert burst.observe(late, row)[2] == burst.NO_NOISE
    burst.draw_noise(late, np.random.default_rng(0), np.zeros(tick.NOISE))
    assert burst.observe(late, row)[2] == dynamics.FLYING


# --- serve


@pytest.mark.parametrize(("waits", "why"), [(0, burst.TICKS), (1, burst.OTHERS)])
def test_a_burst_ends_when_something_else_waits_to_be_read(late, monkeypatch, waits, why):
    """The descriptors are looked at before a tick is begun: no state is left without an answer."""
    begun = []
    quiet = SimpleNamespace(
        ready=lambda others, timeout_ms: waits, since_1970=lambda clock: 0.0,
        monotonic=lambda clock: 0.0, send=lambda fd, datagram, length: length,
        receive=lambda fd, datagram, wait: 70, send_row=lambda fd, row: 0,
    )  # fmt: skip
    monkeypatch.setattr(burst, "system", quiet)
    monkeypatch.setattr(
        burst, "begin", lambda *a: begun.append(1) or (300, np.int64(dynamics.FLYING))
    )
    monkeypatch.setattr(burst, "finish", lambda *a: burst.FLOWN)
    wire = SimpleNamespace(
        link=-1, feed=-1, others=np.zeros(1, dtype=np.int64), outbox=None, inbox=None, clock=None
    )
    python = getattr(burst.serve, "py_func", burst.serve)
    flown = python(late, wire, np.zeros((TICKS, WIDTH)), TICKS)
    assert flown.why == why
    assert flown.rows == len(begun) == (0 if waits else TICKS)
