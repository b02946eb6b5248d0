"""The simulator's loop flies the same flight, however many ticks compiled code flies at once."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest

from fcu.interface import publisher_feed
from fcu.interface.handover import GRANT
from fcu.interface.link import UdpLink
from fcu.interface.messages import RotorCommand, VehicleState
from fcu.interface.ports import ports
from fcu.interface.publisher_feed import PublisherFeed
from fcu.interface.recorder_pipe import RecorderPipe
from fcu.kernel import system
from fcu.kernel.buffers import size
from fcu.kernel.rows import column, column_of
from fcu.mavlink.plant_link import PlantCodec
from sitl_plant import burst
from sitl_plant.burst import WIDTH, PlantRow
from sitl_plant.loop import Server
from sitl_plant.pacing import Pacer
from sitl_plant.physics.world import world
from tests.patience import PATIENCE_S

TICKS = 300
BLOCK = 70  # rows of noise drawn at once, so that several blocks are used up
PERIOD_US = 2000
WALL = [column_of(PlantRow, f"timing.{name}") for name in ("published", "late")]
WORLD = world(
    plant={"delay_s": 0.006, "noise": {"position_m": 0.01, "rate_rad_s": 0.02}},
    start={"position_m": [0.0, 0.0, 30.0], "on_ground": False},
)
GARBAGE, TWICE, EARLY, SILENT = 40, 90, 130, 200  # ticks at which the controller misbehaves


class Controller(threading.Thread):
    """Answers every state, and ends the flight when all ticks have been flown."""

    def __init__(self, number, grants, misbehaves):
        super().__init__(daemon=True)
        at = ports(number)
        self.link = UdpLink(at.fcu_plant, at.plant)
        self.codec = PlantCodec(at.system_id)
        self.grants = grants
        self.misbehaves = misbehaves
        self.heard = []  # what the states said, and those sent again
        self.again = 0

    def run(self):
        state, command = np.zeros(size(VehicleState)), np.zeros(size(RotorCommand))
        last = -1
        while self.link.wait(PATIENCE_S):
            datagram = self.link.receive()
            if datagram is None:
                continue
            time_us = self.codec.parse_state(datagram, state)
            if self.codec.is_hold(datagram):
                if time_us == TICKS * PERIOD_US:
                    break
                continue
            battery = self.codec.battery
            k = time_us // PERIOD_US
            if k == last:
                self.again += 1
            else:
                self.heard.append((time_us, state.tobytes(), battery))
            command[:] = 0.4 + 0.01 * np.clip(30.0 - state[2], -1.0, 1.0)
            command[k % 8] += 0.01
            if self.misbehaves:
                if k == GARBAGE:
                    self.link.send(b"")
                    self.link.send(b"garbage")
                if k == EARLY:
                    self.link.send(self.codec.pack_controls(time_us + 7, command, True, True))
                if k == SILENT and k != last:
                    last = k
                    continue
            answer = self.codec.pack_controls(time_us, command, True, True)
            self.link.send(answer)
            if self.misbehaves and k == TWICE:
                self.link.send(answer)
            last = k
        os.close(self.grants)
        self.link.close()


@pytest.fixture
def flown(instance, tmp_path, monkeypatch):
    """`flown(ticks at once)`: rows, states as heard, counters."""
    monkeypatch.setattr(burst, "NOISE_BLOCK", BLOCK)

    def fly(burst_ticks, batch=64, misbehaves=False):
        reading, writing = os.pipe()
        os.write(writing, GRANT.pack(TICKS))
        file = tmp_path / "rows"
        with file.open("wb") as out:
            tape = RecorderPipe(WIDTH, out.fileno(), batch=batch)
            server = Server(
                ports(instance), WORLD, tape, PublisherFeed(instance, "plant"),
                Pacer(0.002, None), reading, burst_ticks=burst_ticks,
            )  # fmt: skip
            server.warm_up()
            controller = Controller(instance, writing, misbehaves)
            controller.start()
            assert server.run() == 0
            controller.join()
        os.close(reading)
        rows = np.fromfile(file).reshape(-1, WIDTH)
        assert np.isfinite(column(PlantRow, rows, "timing.published")).all()
        rows[:, WALL] = 0.0
        return rows, controller.heard, server.figures

    return fly


def same(one, other):
    assert one[0].tobytes() == other[0].tobytes()
    assert one[1:] == other[1:]


def counters(figures):
    return figures.ticks, figures.refused, figures.stale, figures.unpublished


def test_ticks_at_once_and_the_recorders_batch_change_no_bit(flown):
    one = flown(1)
    rows, heard, figures = one
    assert (len(rows), len(heard), figures.ticks) == (TICKS, TICKS, TICKS)
    assert column(PlantRow, rows, "timing.sequence").tolist() == list(range(TICKS))
    assert column(PlantRow, rows, "state.r_E").std(axis=0).all()  # it moves
    for arguments in ((64,), (4096,), (4096, 1024), (7, 10)):
        same(one, flown(*arguments))


def test_without_libc_it_is_flown_in_python(flown, monkeypatch):
    compiled = flown(64)
    monkeypatch.setattr(system, "HAS_LIBC", False)
    monkeypatch.setattr(burst, "serve", None)
    same(compiled, flown(64))


@pytest.mark.parametrize("libc", [True, False])
def test_what_is_no_answer_is_counted_and_changes_no_bit(flown, monkeypatch, libc):
    quiet = flown(64)
    # on a busy machine a quiet flight may have asked again, too
    column(PlantRow, quiet[0], "timing.resent")[:] = 0.0
    monkeypatch.setattr(system, "HAS_LIBC", libc)
    for ticks in (1, 4096):
        rows, heard, figures = flown(ticks, misbehaves=True)
        assert counters(figures) == (TICKS, 2, 2, 0)
        assert figures.resent >= 1
        told = column(PlantRow, rows, "timing.resent")
        assert told[SILENT] < told[SILENT + 1]
        told[:] = 0.0
        assert rows.tobytes() == quiet[0].tobytes()
        assert heard == quiet[1]


def test_rows_that_nobody_publishes_are_counted_and_keep_no_tick_from_a_burst(
    flown, instance, monkeypatch
):
    quiet = flown(4096)
    monkeypatch.setattr(publisher_feed, "ROOM_BYTES", 1 << 14)
    serve, bursts = burst.serve, []
    monkeypatch.setattr(burst, "serve", lambda *a: bursts.append(serve(*a)) or bursts[-1])
    counted = set()
    for ticks in (1, 64, 4096):
        listener = publisher_feed.listen(instance)  # and never reads
        rows, heard, figures = flown(ticks)
        listener.close()
        counted.add(figures.unpublished)
        told = column(PlantRow, rows, "timing.unpublished")
        lost = np.maximum(np.arange(TICKS) - (TICKS - figures.unpublished), 0)
        assert told.tolist() == lost.tolist()
        told[:] = 0.0
        assert rows.tobytes() == quiet[0].tobytes()
        assert heard == quiet[1]
    [unpublished] = counted
    assert 0 < unpublished < TICKS
    assert max(one.unpublished for one in bursts) > 1
