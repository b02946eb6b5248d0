"""The cost of layers of wind: a plant's step with each, and fields of 500 x 500 x 500 cells and 60 times.

    python -m gcs_tools.studies.wind_cost            a table of times, ratios and memory

Each flight is the law alone, 40 s at 500 Hz, on one core: with a layer and without one in turn, five of each.
The ratio is of the medians. The field's file has holes where it was never written, which read as still air: 90 GB of
values take no room on disk, but as much of memory as they are read.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np

from gcs_tools.flight import law_alone, law_flights
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.missions.mission import load
from sitl_plant.physics.wind.packed_field import FORMAT

CELLS, TIMES, CELL_M = 500, 60, 2.0
TRIALS, LANES = 5, 8
MISSION = """title = "The vehicle flies to and fro in layers of wind."
[flight]
duration_s = 40.0
ground_z_m = -40.0
arena_m = 1000.0
setpoints = [[0.0, 60.0, 20.0, 20.0], [10.0, -60.0, 0.0, 0.0], [20.0, 60.0, -20.0, 10.0], [30.0, -60.0, 0.0, 20.0]]
[wind]
steady_m_s = [4.0, 2.0, 0.0]
"""
FIELD = 'field = { file = "large", origin_m = [500.0, 500.0, 100.0], after = "repeat" }\n'
LAYERS = {
    "shear": 'shear = "log"\n',
    "gusts": "gusts = [{ at_s = 5.0, velocity_m_s = [0.0, 5.0, 0.0], rise_s = 1.0 }]\n",
    "dryden": 'turbulence = "dryden"\nturbulence_w20_m_s = 7.7\n',
    "von_karman": 'turbulence = "von_karman"\nturbulence_w20_m_s = 7.7\n',
    "field 500³ × 60": FIELD,
}


def large(path: Path) -> None:
    """Write a packed field of still air, full of holes."""
    path.mkdir()
    shape, edges = (TIMES, CELLS, CELLS, CELLS), np.arange(CELLS) * CELL_M
    axes = {
        "t": np.arange(TIMES, dtype=np.float64),
        "bounds": np.array([0.0, edges[-1]] * 3),
        "top_x": np.array([0.0, edges[-1]]),
        "top_y": np.array([0.0, edges[-1]]),
        "top": np.zeros((1, 1), np.float32),
    }
    for name in "uvw":
        np.lib.format.open_memmap(path / f"{name}.npy", mode="w+", dtype=np.float32, shape=shape)
        axes |= {f"{name}_{axis}": edges for axis in "xyz"}
    np.savez(path / "axes.npz", **axes)  # type: ignore[arg-type]  # arrays by name
    (path / "about.json").write_text(json.dumps({"format": FORMAT, "notes": []}))


def scene(folder: Path, wind: str) -> Scenario:
    """The flight in this wind."""
    (folder / "m.toml").write_text(MISSION + wind)
    return scenario(load(folder / "m.toml"))


def seconds(fly: Callable[[], object]) -> float:
    """Processor time of a call."""
    begun = time.process_time()
    fly()
    return time.process_time() - begun


def compared(without: Callable[[], object], with_it: Callable[[], object]) -> tuple[float, float]:
    """Median times (s) of two flights that are flown in turn, and compiled before."""
    pairs = [(seconds(without), seconds(with_it)) for _ in range(TRIALS)]
    return median(a for a, _ in pairs), median(b for _, b in pairs)


def lanes(of: Scenario) -> Callable[[], object]:
    """Flights of several vehicles side by side, each with a seed of its own."""
    scenes: Sequence[Scenario] = [
        replace(of, layers=None if of.layers is None else of.layers._replace(seed=n))
        for n in range(LANES)
    ]
    return lambda: law_flights.fly(scenes, in_all=1e9)


def main() -> None:
    """Print the table."""
    with TemporaryDirectory(dir=sys.argv[1] if len(sys.argv) > 1 else None) as name:
        folder = Path(name)
        large(folder / "large")
        calm = scene(folder, "")
        law_alone.fly(calm)
        print(f"{'':18}{'alone':>10}{'speed':>8}{'in lanes':>12}{'speed':>8}")
        in_calm = lanes(calm)
        in_calm()
        for layer, wind in LAYERS.items():
            begun = time.perf_counter()
            windy = scene(folder, wind)
            opened = time.perf_counter() - begun
            law_alone.fly(windy)
            in_wind = lanes(windy)
            in_wind()
            a, b = compared(lambda: law_alone.fly(calm), lambda windy=windy: law_alone.fly(windy))  # type: ignore[misc]
            c, d = compared(in_calm, in_wind)
            ticks = calm.ticks
            print(
                f"{layer:18}{1e9 * (b - a) / ticks:7.0f} ns{a / b:8.0%}"
                f"{1e9 * (d - c) / ticks / LANES:9.0f} ns{c / d:8.0%}   opened in {opened:.2f} s",
                flush=True,
            )
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        print(f"memory at most {peak:.0f} MiB")


if __name__ == "__main__":
    main()
