"""The limit of lockstep over UDP on this machine: the bare loop, and the datagrams alone.

The bare loop has what cannot be left out: law, plant, MAVLink's bytes with their checksums, and a
datagram each way between two processes on one core that block until it comes. It polls nothing,
reads no clock, holds no time, records nothing.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from fcu.interface.link import UdpLink
from fcu.interface.ports import ports
from fcu.kernel import system
from fcu.kernel.buffers import size
from fcu.kernel.compile import kernel
from fcu.mavlink.plant_link import LONGEST
from fcu.process import burst as controller
from gcs_tools.flight import law_alone
from gcs_tools.flight.processes import claimed
from sitl_plant.burst import WIDTH, begin, finish
from sitl_plant.simulator import Simulator

if TYPE_CHECKING:
    from gcs_tools.flight.scenario import Scenario

TICKS = 20_000
PATIENCE_S = 5.0  # wall: who waits longer has been left
STATE_BYTES, ANSWER_BYTES = 249, 93


@kernel
def plant_side(plant, fd, outbox, inbox, row, ticks):
    """The plant's half of so many ticks; how many were flown."""
    for k in range(ticks):
        length, _ = begin(plant, row, outbox)
        system.send(fd, outbox, length)
        received = system.receive(fd, inbox, True)
        if received < 0 or finish(plant, inbox, received) != 0:
            return k
    return ticks


@kernel
def law_side(flight, law, fd, inbox, row, ticks):
    """The controller's half."""
    for k in range(ticks):
        received = system.receive(fd, inbox, True)
        if received < 0:
            return k
        system.send(fd, flight.answer, controller.tick(flight, law, inbox, received, row, -1))
    return ticks


@kernel
def there_and_back(fd, datagram, length, first, ticks):
    """A datagram out and one in, or the other way round; how often."""
    for k in range(ticks):
        if first:
            system.send(fd, datagram, length)
        if system.receive(fd, datagram, True) < 0:
            return k
        if not first:
            system.send(fd, datagram, length)
    return ticks


def rates(scene: Scenario, repeats: int) -> dict[str, float]:
    """Ticks a second of the bare loop, and round trips of two datagrams of 249 and 93 bytes."""
    found: dict[str, list[float]] = {"bare": [], "datagrams": []}
    for _ in range(repeats):
        found["bare"].append(_timed(*_loop(scene)))
        found["datagrams"].append(_timed(*_datagrams()))
    return {name: statistics.median(each) for name, each in found.items()}


Half = Callable[[int, int], int]  # of a descriptor, and of how many ticks: how many were flown


def _loop(scene: Scenario) -> tuple[Half, Half]:
    simulator = Simulator(scene.world, law_alone.SYSTEM)
    simulator.plant.noise[:] = 0.0
    row, inbox, outbox = np.zeros(WIDTH), _datagram(), _datagram()
    flight, law = law_alone.flight(scene)
    controller_row, state = np.zeros(size(scene.flown.ticks.Tick)), _datagram()

    def plant(fd: int, ticks: int) -> int:
        flown = 0
        while True:  # a block of noise at a time
            simulator.draw_noise()
            some = min(ticks - flown, len(simulator.plant.noise))
            done: int = plant_side(simulator.plant, fd, outbox, inbox, row, some)
            flown += done
            if done < some or flown == ticks:
                return flown

    def answer(fd: int, ticks: int) -> int:
        done: int = law_side(flight, law.address, fd, state, controller_row, ticks)
        return done

    return plant, answer


def _datagrams() -> tuple[Half, Half]:
    def half(first: bool, length: int) -> Half:
        return lambda fd, ticks: int(there_and_back(fd, _datagram(), length, first, ticks))

    return half(True, STATE_BYTES), half(False, ANSWER_BYTES)


def _datagram() -> Any:
    return np.zeros(LONGEST, dtype=np.uint8)


def _timed(here: Half, there: Half) -> float:
    """Ticks a second, one half in a process of its own on the same core. Raises RuntimeError."""
    with claimed(None, "plant", "fcu_plant") as instance:
        at = ports(instance)
        ends = UdpLink(at.plant, at.fcu_plant), UdpLink(at.fcu_plant, at.plant)
        for half, end in zip((here, there), ends, strict=True):
            end.let_wait(PATIENCE_S)
            half(end.fileno(), 0)  # compiled before the fork
        cores = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {min(cores)})
        child = os.fork()
        if child == 0:
            os._exit(0 if there(ends[1].fileno(), TICKS) == TICKS else 1)
        try:
            began = time.perf_counter()
            flown = here(ends[0].fileno(), TICKS)
            wall = time.perf_counter() - began
        finally:
            _, status = os.waitpid(child, 0)
            os.sched_setaffinity(0, cores)
            for end in ends:
                end.close()
    if flown != TICKS or status:
        raise RuntimeError(f"{flown} of {TICKS} ticks")
    return TICKS / wall
