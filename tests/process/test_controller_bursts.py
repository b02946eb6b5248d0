"""The controller's loop flies the same flight, however many ticks compiled code flies at once."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest

from fcu.interface.airframe import read
from fcu.interface.handover import GRANT
from fcu.interface.messages import Setpoint
from fcu.interface.ports import ports
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import RecorderPipe
from fcu.kernel import system
from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import slice_of
from fcu.laws import loader
from fcu.mavlink.definitions import Autopilot, CommandId
from fcu.mavlink.geodesy import Origin
from fcu.parameters import Parameters
from fcu.process.configuration import read_settings
from fcu.process.loop import Loop
from fcu.process.reporting import Reporter, row_width
from fcu.services.view import Identity
from gcs_tools.flight.ground_script import Vehicle, VehicleError
from gcs_tools.recording.schema import Kinds
from sitl_plant.burst import WIDTH
from sitl_plant.loop import Server
from sitl_plant.pacing import Pacer
from sitl_plant.physics.world import world
from tests.patience import PATIENCE_S

RATE_HZ = 500
WORLD = world(
    rate_hz=RATE_HZ,
    plant={"noise": {"position_m": 0.002, "rate_rad_s": 0.01}},
    start={"position_m": [0.0, 0.0, 4.0], "on_ground": False},
)
STILL = Vec3(0.0, 0.0, 0.0)


def to(x, y, z):
    return Setpoint(Vec3(x, y, z), STILL, STILL, 0.3, 0.0)


def script(vehicle, until):
    """Setpoints, one of them refused, a command refused, a lost stream, and down to the ground."""
    vehicle.wait_ready()
    for _ in range(2):
        vehicle.set_setpoint(to(0.0, 0.0, 4.0))
    vehicle.offboard()
    vehicle.arm()
    until(203)
    vehicle.set_setpoint(to(1.0, 0.5, 4.5))
    until(500)
    with pytest.raises(VehicleError):
        vehicle.command(CommandId.CHANGE_SPEED, 1.0, -5.0)
    vehicle.set_setpoint(to(1.0, 0.5, -3.0))  # into the ground: above it, and then down
    until(2400)  # the stream is lost on the way
    vehicle.command(CommandId.LAND)
    until(6000)


@pytest.fixture
def flown(instance, tmp_path, capfd):
    """`flown(ticks at once)`: what was recorded of every tick, and what was said, with its time."""
    law = loader.load()
    row = Kinds.of(law).fcu_row

    def fly(burst_ticks):
        fcu_rows, plant_rows = tmp_path / "fcu", tmp_path / "plant"
        reading, writing = os.pipe()
        at = ports(instance)
        identity = Identity(at.system_id, Autopilot.PX4, Origin(0.0, 0.0, 0.0), read().drag)
        params = Parameters(read_settings(law, None, RATE_HZ), at.system_id, None, law)
        capfd.readouterr()
        with fcu_rows.open("wb") as fcu_out, plant_rows.open("wb") as plant_out:
            feed = PublisherFeed(instance, "fcu", law.identity)
            tape = RecorderPipe(row_width(law), fcu_out.fileno(), batch=256)
            loop = Loop(
                at, identity, params, Reporter(law, tape, feed, identity.drag), None, True, None,
                burst_ticks,
            )  # fmt: skip
            server = Server(
                at, WORLD, RecorderPipe(WIDTH, plant_out.fileno()),
                PublisherFeed(instance, "plant"), Pacer(1.0 / RATE_HZ, None), reading,
            )  # fmt: skip
            loop.warm_up()
            server.warm_up()
            threads = [threading.Thread(target=each.run) for each in (loop, server)]
            vehicle = Vehicle(instance)

            def until(tick):
                os.write(writing, GRANT.pack(tick))
                deadline = threading.Event()
                for _ in range(round(100 * PATIENCE_S)):
                    if loop.figures.ticks >= tick:
                        return
                    deadline.wait(0.01)
                raise AssertionError(f"{loop.figures.ticks} ticks of {tick}")

            try:
                for thread in threads:
                    thread.start()
                script(vehicle, until)
            finally:
                vehicle.close()
                os.close(writing)
                server.stopping = loop.stopping = True
                for thread in threads:
                    thread.join(PATIENCE_S)
                os.close(reading)
        rows = np.fromfile(fcu_rows).reshape(-1, row_width(law))
        rows[:, slice_of(row, "timing")] = 0.0  # by the wall
        said = [line for line in capfd.readouterr().err.splitlines() if " fcu " in line]
        return rows, said

    return fly


def test_bursts_of_any_length_fly_and_say_the_same(flown, monkeypatch):
    rows, said = flown(1)
    assert len(rows) == 6000
    words = "\n".join(said)
    for heard in ("Armed", "lost", "Land", "Disarmed"):
        assert heard in words, words
    for ticks in (7, 64, 4096):
        again, heard = flown(ticks)
        assert again.tobytes() == rows.tobytes(), ticks
        assert heard == said, ticks
    monkeypatch.setattr(system, "HAS_LIBC", False)
    again, heard = flown(None)
    assert again.tobytes() == rows.tobytes()
    assert heard == said
