"""The times of a plant's states that an autopilot follows, and those that it does not."""

from __future__ import annotations

import click
import numpy as np
import pytest

import fcu.__main__ as program
from fcu.interface.airframe import believed
from fcu.interface.link import MemoryNetwork
from fcu.interface.messages import VehicleState
from fcu.interface.ports import ports
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import Tape
from fcu.interface.status_texts import Code, Told
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns, size
from fcu.laws import loader
from fcu.mavlink.definitions import Autopilot as ShownAs
from fcu.mavlink.geodesy import Origin
from fcu.mavlink.plant_link import PlantCodec
from fcu.parameters import Parameters
from fcu.process import loop
from fcu.process.autopilot import JUMPS, LATEST_US, Autopilot, Lost
from fcu.process.reporting import Reporter, row_width
from fcu.process.settings import settings
from fcu.services.view import Identity

PERIOD_US = 2000
SPIN = (1.0, -1.0) * 4


@pytest.fixture
def pilot():
    """An autopilot without a law: of a tick there is its time, and no more."""
    law, no_drag = loader.load(), Vec3(0.0, 0.0, 0.0)
    tape = Tape(row_width(law), 64, lambda rows: None)
    return Autopilot(
        ports(0), Identity(1, ShownAs.PX4, Origin(47.4, 8.5, 488.0), no_drag),
        Parameters(settings(*believed(), 500.0), 1),
        Reporter(law, tape, PublisherFeed(None, "fcu"), no_drag),
        bind=MemoryNetwork().socket, write=lambda event: None,
        fly_decided=lambda time_us, row: True,
    )  # fmt: skip


def hear(pilot, time_us, quality=0):
    """Hand a state of this time to the autopilot, and tell if it was flown."""
    state = np.zeros(size(VehicleState))
    state[columns(VehicleState).index("q_EB.w")] = 1.0
    codec = PlantCodec(1, SPIN)
    codec.desk.quality[0] = quality
    answer = pilot.decide(codec.pack_state(time_us, state), False, 1.0)
    assert (answer is None) == (pilot.time_us != time_us)
    return answer is not None


@pytest.mark.parametrize("first_us", [0, 12_345, LATEST_US])
def test_time_begins_where_the_plant_says_and_goes_on_by_ticks(pilot, first_us):
    assert hear(pilot, first_us)
    assert hear(pilot, first_us + PERIOD_US)
    assert pilot.figures.refused == 0


def test_time_that_begins_too_late_is_none(pilot):
    with pytest.raises(Lost, match="time begins at 10000000 s"):
        hear(pilot, LATEST_US + 1)


@pytest.mark.parametrize("last_us", [0, PERIOD_US, 10 * PERIOD_US])
def test_a_state_that_is_no_tick_later_is_refused_also_after_the_first(pilot, last_us):
    """A plant that comes back in step is followed, and one that goes on out of step is lost."""
    assert hear(pilot, last_us)
    for late_us in (2 * PERIOD_US, PERIOD_US + 1, PERIOD_US - 1):
        assert not hear(pilot, last_us + late_us)
    assert pilot.figures.refused == 3
    assert hear(pilot, last_us + PERIOD_US)
    for _ in range(JUMPS - 1):
        assert not hear(pilot, last_us + 7 * PERIOD_US)
    with pytest.raises(Lost):
        hear(pilot, last_us + 7 * PERIOD_US)


@pytest.mark.parametrize("origin", ["47.4,8.5,488", "90,180,10000", "-90,-180,-10000"])
def test_an_origin_on_earth_is_taken(origin):
    context = program.main.make_context("fcu", ["--origin", origin])
    assert context.params["origin"] == tuple(map(float, origin.split(",")))


@pytest.mark.parametrize(
    "origin", ["90.1,0,0", "0,180.1,0", "0,-180.1,0", "0,0,10001", "0,0", "north,0,0", "nan,0,0"]
)
def test_an_origin_that_is_not_on_earth_is_a_usage_error(origin):
    with pytest.raises(click.BadParameter, match="-180 to 180 degrees"):
        program.main.make_context("fcu", ["--origin", origin])


def test_the_program_ends_with_the_codes_that_its_help_tells():
    """A usage error is click's own 2. An end for another reason is told apart from it."""
    assert (loop.OK, loop.INFRASTRUCTURE) == (0, 3)
    assert "0 stopped" in program.main.epilog and "3 plant link" in program.main.epilog


def test_a_vehicle_whose_state_has_failed_does_not_arm_until_one_is_valid(pilot):
    hear(pilot, 0)
    arms = []
    for k, quality in ((1, -1), (2, -1), (3, 0)):
        assert hear(pilot, k * PERIOD_US, quality)
        arms.append(pilot.vehicle.why_not_arm(k * PERIOD_US, 1.0))
    assert arms == [Told(Code.HAS_NO_VALID_STATE), Told(Code.HAS_NO_VALID_STATE), None]
