"""Plans in numbers: the time that a look along one takes, and repeats of one flight.

    python -m gcs_tools.studies.plans looks       times of a look, ms, by the wall
    python -m gcs_tools.studies.plans repeats     a plan with a fence and a return, 20 times over the wire and 20 in process
    python -m gcs_tools.studies.plans ticks       the time of a tick with a plan and without one, in process
    python -m gcs_tools.studies.plans ticks --beside FOLDER     and a flight without one by another checkout, in turns

`repeats` ends with 1 unless all flights are one to the bit. `ticks` prints medians of the processor's time.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.airframe import believed
from fcu.interface.messages import VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns, size
from fcu.parameters import Parameters
from fcu.process.settings import settings
from fcu.vehicle.mission import Do, Step
from fcu.vehicle.state_machine import StateMachine
from gcs_tools import fly
from gcs_tools.missions.mission import folder
from gcs_tools.missions.plan_file import RETURN

ITEMS = (10, 100, 2000)
SEED = 1
OVER = object()
# an item script and a plan of the same kind, and a flight that every checkout has
WITHOUT, WITH, ALIKE = "square_and_land", "plan_square", "paper_nominal"
# the processor's time of a second flight: other programs take none of it
ONE_FLIGHT = """
import sys, tempfile, time
from gcs_tools import fly
settings = ["flight.duration_s=120"] if sys.argv[1] == "paper_nominal" else []
for _ in range(2):
    began = time.process_time()
    with tempfile.TemporaryDirectory() as out:
        flown = fly(sys.argv[1], in_process=True, out=out + "/run", figure="never", record="none", settings=settings)
    took = time.process_time() - began
print(1e6 * took / flown.ticks)
"""


def sampled_plan(items: int) -> tuple[Step, ...]:
    """A plan of so many items, of places up to 200 m away."""
    rng = random.Random(SEED)
    up = Step(Do.TAKE_OFF, Vec3(0.0, 0.0, 5.0))

    def place() -> Vec3:
        return Vec3(rng.uniform(-200.0, 200.0), rng.uniform(-200.0, 200.0), rng.uniform(5.0, 60.0))

    return (up, *(Step(Do.GO_TO, place()) for _ in range(items - 2)), Step(Do.LAND))


def looks() -> int:
    """Print how long looks along plans take, in all and at a time."""
    params = Parameters(settings(*believed(), 500.0), 1)
    params.set("MR_GUARD", 0.0, False)
    vehicle = StateMachine(params)
    state = np.zeros(size(VehicleState))
    state[columns(VehicleState).index("q_EB.w")] = 1.0
    vehicle.warm_up()
    vehicle.observe(state, 0, 0.0)
    print("items    looks    median, ms    99 %, ms    longest, ms    in all, ms")
    for items in ITEMS:
        steps, times = sampled_plan(items), []
        look = vehicle.look_along(steps)
        while True:
            began = time.perf_counter()
            if next(look, OVER) is OVER:
                break
            times.append(1e3 * (time.perf_counter() - began))
        median, most = np.median(times), np.quantile(times, 0.99)
        print(f"{items:5d} {len(times):8d} {median:13.2f} {most:11.2f} {max(times):14.2f} {sum(times):13.1f}")  # fmt: skip
    return 0


def _returning() -> dict[str, Any]:
    """missions/square.plan with a return in place of its landing."""
    tables: dict[str, Any] = json.loads((folder() / "square.plan").read_text())
    tables["mission"]["items"][-1].update(command=RETURN, frame=2, params=[0, 0, 0, 0, 0, 0, 0])
    return tables


def repeats(times: int) -> int:
    """Fly one plan again and again, over the wire and in process. Print how many flights there were."""
    found: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory() as place:
        plan = Path(place) / "return.plan"
        plan.write_text(json.dumps(_returning()))
        for k in range(times):
            for in_process in (False, True):
                out = Path(place) / f"{in_process}{k}"
                flown = fly(str(plan), in_process=in_process, out=out, figure="never", record="none")  # fmt: skip
                found["in process" if in_process else "over the wire", flown.trajectory_sha256] += 1
    for (how, trajectory), many in sorted(found.items()):
        print(f"{many:3d} {how:14s} {trajectory}")
    return 0 if len({trajectory for _, trajectory in found}) == 1 else 1


def ticks(times: int, beside: Path | None) -> int:
    """Print how long a tick takes, and how much longer than without a plan, or than in another checkout."""
    here = Path(__file__).resolve().parents[2]
    flights = [(WITHOUT, here), (WITH, here), *([(ALIKE, here), (ALIKE, beside)] if beside else [])]
    took: dict[tuple[str, Path], list[float]] = {flight: [] for flight in flights}
    for k in range(times + 1):
        for mission, checkout in flights:
            told = subprocess.run(
                [sys.executable, "-c", ONE_FLIGHT, mission], env={**os.environ, "PYTHONPATH": str(checkout)},
                cwd=checkout, check=True, capture_output=True, text=True,
            ).stdout  # fmt: skip
            if k:  # the first compiles
                took[mission, checkout].append(float(told.split()[-1]))
    medians = {flight: float(np.median(each)) for flight, each in took.items()}
    for (mission, checkout), median in medians.items():
        print(f"{mission:18s} {median:8.3f} us a tick{'' if checkout == here else '  beside'}")
    print(f"with a plan: {medians[WITH, here] / medians[WITHOUT, here]:.3f} times without")
    if beside:
        print(f"without, here: {medians[ALIKE, here] / medians[ALIKE, beside]:.3f} times beside")
    return 0


def main() -> int:
    """Run one of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("looks", "repeats", "ticks"))
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--beside", type=Path, help="another checkout, with its kernels compiled")
    asked = parser.parse_args()
    if asked.what == "ticks":
        return ticks(asked.times, asked.beside and asked.beside.absolute())
    return looks() if asked.what == "looks" else repeats(asked.times)


if __name__ == "__main__":
    sys.exit(main())
