"""How fast the packages that users compare with fly a quadrotor in closed loop, if they are installed.

    pip install '.[peers]'  # in a checkout

Crazyflow: first principles, Euler at 500 Hz in float32, its own cascade of controllers, a thousand
vehicles at once on all cores (JAX). RotorPy: one vehicle, adaptive Runge-Kutta, its controller on SE(3)
at 500 Hz, in Python. Ours, beside them: Runge-Kutta of fourth order and law at 500 Hz in float64. A
vehicle that does not arrive is no measurement: RuntimeError.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np

from gcs_tools.studies.bench.figure import Figure

VEHICLES = 1000  # of Crazyflow, at once
STEPS = 500  # of each
RATE_HZ = 500
GOAL_M = (0.5, 0.0, 0.5)


def figures(repeats: int) -> Iterator[Figure]:
    """Of those that are there, each in a process of its own. Raises RuntimeError."""
    for name, label in (
        ("crazyflow", f"Crazyflow, {VEHICLES} vehicles on all cores (ticks/s)"),
        ("rotorpy", "RotorPy, a vehicle on a core (ticks/s)"),
    ):
        if find_spec(name) is not None:
            yield Figure(f"{name}_ticks_s", label, _apart(name, repeats))


def _apart(name: str, repeats: int) -> float:
    """Ticks a second. Crazyflow has to be there before SciPy, and its threads beside nothing of ours."""
    command = [sys.executable, "-m", __spec__.name, name, str(repeats)]
    flown = subprocess.run(command, capture_output=True, text=True, check=False)
    if flown.returncode:
        raise RuntimeError(f"{name}: {flown.stderr.strip().rpartition(chr(10))[2]}")
    return float(flown.stdout.split()[-1])


def crazyflow(repeats: int) -> float:
    """Ticks a second, of all vehicles together; median. Raises RuntimeError."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own dependencies
        from crazyflow.sim import Sim

        simulator: Any = Sim(n_worlds=VEHICLES, control="state", freq=RATE_HZ)
    command = np.zeros((VEHICLES, 1, 16))
    command[..., :3], command[..., 12] = GOAL_M, 1.0  # position; the quaternion's scalar
    rates = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        simulator.state_control(command)
        simulator.step(STEPS)
        simulator.data.states.pos.block_until_ready()
        rates.append(VEHICLES * STEPS / (time.perf_counter() - began))
    _arrived(np.asarray(simulator.data.states.pos)[:, 0])
    return statistics.median(rates[1:])  # the first compiles


def rotorpy(repeats: int) -> float:
    """Ticks a second of one vehicle; median. Raises RuntimeError."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from rotorpy.controllers.quadrotor_control import SE3Control
        from rotorpy.environments import Environment
        from rotorpy.trajectories.hover_traj import HoverTraj
        from rotorpy.vehicles.crazyflie_params import quad_params
        from rotorpy.vehicles.multirotor import Multirotor

    rates = []
    for _ in range(repeats):
        world: Any = Environment(
            vehicle=Multirotor(quad_params), controller=SE3Control(quad_params),
            trajectory=HoverTraj(x0=np.array(GOAL_M)), sim_rate=RATE_HZ, safety_margin=None,
        )  # fmt: skip
        began = time.perf_counter()
        flown = world.run(t_final=3.0, terminate=False, plot=False)
        rates.append(3.0 * RATE_HZ / (time.perf_counter() - began))
        _arrived(flown["state"]["x"][-1:])
    return statistics.median(rates)


def _arrived(places: np.ndarray[Any, np.dtype[Any]]) -> None:
    """Raise RuntimeError unless all are within 0.2 m of where they were sent, which both controllers reach."""
    if not (np.abs(places - np.array(GOAL_M)) < 0.2).all():
        raise RuntimeError(f"expected {GOAL_M}, arrived at {places[0].tolist()}")


if __name__ == "__main__":
    print({"crazyflow": crazyflow, "rotorpy": rotorpy}[sys.argv[1]](int(sys.argv[2])))
