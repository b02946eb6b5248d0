"""The simulator's loop on sockets of its own: grants of time, bursts, and how it is paced."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest
from click.testing import CliRunner

import sitl_plant.__main__ as program
import sitl_plant.loop
from fcu.interface.handover import GRANT, grant
from fcu.interface.messages import VehicleState
from fcu.interface.ports import ANY_PORTS
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import Tape
from fcu.kernel.rows import column_of
from sitl_plant import burst
from sitl_plant.burst import WIDTH, PlantRow
from sitl_plant.loop import Server
from sitl_plant.pacing import Pacer
from sitl_plant.physics.world import world
from sitl_plant.simulator import LONGEST, Simulator


@pytest.fixture
def serve():
    """`serve(control)`: a simulator at full speed, whose controller is not there."""
    made = []

    def one(control=None, burst_ticks=8):
        made.append(
            Server(
                ANY_PORTS, world(), Tape(WIDTH, 64, lambda rows: None), PublisherFeed(None, "plant"),
                Pacer(0.002, None), control, burst_ticks=burst_ticks, write=lambda event: None,
            )
        )  # fmt: skip
        return made[-1]

    yield one
    for server in made:
        server._link.close()


def test_time_is_held_until_it_is_granted_and_ends_with_whoever_grants_it(serve):
    reading, writing = os.pipe()
    os.set_blocking(reading, False)
    server = serve(reading)
    server._read_grants()  # nothing has come
    assert server._is_held and not server.stopping
    os.write(writing, grant(300))
    server._read_grants()
    assert not server._is_held and server._granted == 300
    os.write(writing, grant(900, flight=1))  # of a flight after a reset, and there was none
    server._read_grants()
    assert server._granted == 300
    os.write(writing, b"".join(grant(300 + n) for n in range(100)) + GRANT.pack(400))
    server._read_grants()
    server._read_grants()
    assert server._granted == 400
    assert not server.stopping
    os.close(writing)
    server._read_grants()
    assert server.stopping
    os.close(reading)


def test_a_burst_that_nobody_answers_stops_in_its_first_tick(serve):
    """The state of the first tick is prepared, its row written, and nothing flown without a command."""
    server = serve()
    before = server._plant.state.copy()
    server._simulator.draw_noise()
    flown = server._serve()
    assert flown.why in (burst.NOT_SENT, burst.SILENT)
    assert (flown.rows, server._simulator.tick) == (1, 0)
    assert flown.length > 0
    assert np.array_equal(server._plant.state, before)
    z = column_of(PlantRow, "state.r_E.z")
    assert server._tape.row()[z] == world().start.r_E.z


@pytest.mark.parametrize(("rate", "speed"), [(500.0, "1"), (1000.0, "1"), (500.0, "4")])
def test_a_tick_lasts_for_the_period_of_the_rate_over_the_speed(monkeypatch, rate, speed):
    """500 Hz in real time are 2 ms of the wall, and at four times real time 0.5 ms."""
    paced = []

    class Standing:
        """A server that ends before it has flown."""

        figures = sitl_plant.loop.Figures()

        def __init__(self, ports, world, tape, feed, pacer, *others, **options):
            paced.append(pacer)

        def warm_up(self):
            """Compile nothing."""

        def run(self):
            return 0

    monkeypatch.setattr(sitl_plant.loop, "Server", Standing)
    monkeypatch.setattr(program, "occupy_standard_streams", lambda: None)
    monkeypatch.setattr(signal, "signal", lambda number, act: None)
    said = CliRunner().invoke(program.main, ["--rate", str(rate), "--speed", speed])
    assert said.exit_code == 0, said.output
    assert paced[0]._period == pytest.approx(1.0 / (rate * float(speed)), rel=1e-12)


def test_the_program_ends_with_the_codes_that_its_help_tells():
    """A usage error is click's own 2. An end for another reason is told apart from it."""
    assert (sitl_plant.loop.OK, sitl_plant.loop.INFRASTRUCTURE) == (0, 3)
    assert "0 stopped" in program.main.epilog and "3 controller link" in program.main.epilog


@pytest.mark.parametrize("ticks", [0, 3])
def test_a_state_that_is_reported_late_is_the_one_of_so_many_ticks_before(ticks):
    simulator = Simulator(world()._replace(delay_ticks=float(ticks)), 1)
    simulator.draw_noise()
    plant, row, outbox = simulator.plant, np.zeros(WIDTH), np.zeros(LONGEST, dtype=np.uint8)
    x, at = column_of(VehicleState, "r_E.x"), burst.SEQUENCE
    reported = []
    for k in range(8):
        plant.progress[at], plant.state[x] = k, 1.0 + k
        burst.begin(plant, row, outbox)
        reported.append(plant.reported[x])
    assert reported == [1.0 + max(k - ticks, 0) for k in range(8)]
