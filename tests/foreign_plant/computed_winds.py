"""The winds that are worst for each airframe, for the simulator in C: python -m tests.foreign_plant.computed_winds

They are those of `gcs_tools.studies.attack --computed`, a line of JSON each: about a manoeuvre that a law flies
alone, within what is believed, for the vehicle that they are worst for. What the vehicle flies over the wire is
another flight: so they are repeated in it, and meet it at any moment.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.files import input_file
from gcs_tools.gusts.limits import LIMITS
from gcs_tools.gusts.worst_wind import Worst

MOST_BYTES = 1 << 30  # of a file
BEFORE_S, AFTER_S = 4.0, 0.5  # of the moment at which a limit is nearest: what is repeated


@dataclass(frozen=True)
class Computed:
    """A wind, and the vehicle that it is worst for."""

    airframe: str
    policy: str
    manoeuvre: str
    limit: str  # of gcs_tools.gusts.limits.LIMITS
    room_n: float  # N, that is left of it in that manoeuvre
    vehicle: dict[str, Any]  # mass_kg, inertia_kg_m2, drag, lag_s
    samples: list[list[float]]  # s, and m/s North, East, Down


def of_worst(worst: Worst) -> list[list[float]]:
    """Return the samples about the worst moment, s and m/s North, East, Down."""
    first, last = max(worst.at_s - BEFORE_S, 0.0), worst.at_s + AFTER_S
    inside = [row for row in worst.samples.tolist() if first <= row[0] <= last]
    return [[round(x, 5) for x in (t, north, east, -up)] for t, east, north, up in inside]


class WindsError(ValueError):
    """A file that has no computed winds, and why."""


def read(path: Path) -> list[Computed]:
    """Return the winds of a file. Raises WindsError, OSError."""
    lines = input_file.content(path, MOST_BYTES).splitlines()
    if not lines:
        raise WindsError(f"{path}: it has no winds")
    found = []
    for number, line in enumerate(lines, start=1):
        try:
            one = Computed(**json.loads(line))
            rows = np.array(one.samples, dtype=np.float64)
            vehicle = one.vehicle.keys() >= {"mass_kg", "inertia_kg_m2", "drag", "lag_s"}
            is_one = vehicle and rows.ndim == 2 and rows.shape[1] == 4 and np.isfinite(rows).all()
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            raise WindsError(f"{path}: line {number} is no computed wind") from error
        if not is_one:
            raise WindsError(f"{path}: line {number} is no computed wind")
        found.append(one)
    return found


def main() -> int:
    """Compute them, a line of JSON each is added to a file."""
    from gcs_tools.studies.attack.computed import MANOEUVRES, spine
    from gcs_tools.studies.attack.draws import How
    from tests.foreign_plant.flights import AIRFRAMES

    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--airframe", choices=AIRFRAMES, action="append")
    words.add_argument("--manoeuvre", choices=tuple(MANOEUVRES), action="append")
    words.add_argument("--limit", choices=LIMITS, action="append", help="default: all of them")
    words.add_argument("--policy", choices=("govern", "refuse"), default="govern")
    words.add_argument("--out", type=Path, default=Path("winds.jsonl"), help="added to")
    given = words.parse_args()
    nearest = []
    with given.out.open("a", buffering=1) as out:
        for airframe in given.airframe or AIRFRAMES:
            for manoeuvre in given.manoeuvre or MANOEUVRES:
                how = How(policy=given.policy, settings={("airframe",): airframe})
                for each in spine(how, [manoeuvre], limits=given.limit or LIMITS):
                    worst, end = each.worst, each.worst.end
                    vehicle = {"mass_kg": end.mass_kg, "inertia_kg_m2": list(end.inertia_kg_m2)}
                    vehicle |= {"drag": list(end.drag), "lag_s": end.rotor_lag_s}
                    found = Computed(
                        airframe, given.policy, manoeuvre, worst.limit, round(worst.computed_n, 3), vehicle, of_worst(worst),
                    )  # fmt: skip
                    out.write(f"{json.dumps(asdict(found))}\n")
                    nearest.append(found.room_n)
                    said = "saturates" if each.verdict.saturated else ""
                    print(f"{airframe:6} {manoeuvre:9} {worst.limit:11} {found.room_n:8.2f} N {said}", flush=True)  # fmt: skip
    return any(room < 0.0 for room in nearest)


if __name__ == "__main__":
    sys.exit(main())
