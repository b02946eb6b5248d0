"""Plans in numbers: the time that a look along one takes, and repeats of one flight.

    python -m gcs_tools.studies.plans looks       times of a look, ms, by the wall
    python -m gcs_tools.studies.plans repeats     a plan with a fence and a return, 20 times over the wire and 20 in process

`repeats` ends with 1 unless all flights are one to the bit.
"""

from __future__ import annotations

import argparse
import json
import random
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


def drawn(items: int) -> tuple[Step, ...]:
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
        steps, times = drawn(items), []
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


def main() -> int:
    """Run one of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("looks", "repeats"))
    parser.add_argument("--times", type=int, default=20)
    asked = parser.parse_args()
    return looks() if asked.what == "looks" else repeats(asked.times)


if __name__ == "__main__":
    sys.exit(main())
