"""The cost of layers of wind: a plant's step with each, and fields of 500 x 500 x 500 cells and 60 times.

    python -m gcs_tools.studies.wind_cost                          a table of times and ratios
    python -m gcs_tools.studies.wind_cost --once 'field, 10 m/s'   memory and time of a first flight in lanes

Each flight is the law alone, 40 s at 500 Hz, on one core: with a layer and without one in turn, twelve of each.
The ratio is of the least processor times, since medians scatter on a busy machine. In the field vehicles hover, then fly through it at 10 m/s, each at a place of its own. The field's file has holes where it was never written, which read as still air: 90 GB of
values take no room on disk, but as much of memory as they are read.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gcs_tools.flight import law_alone, law_flights
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.missions.mission import load
from sitl_plant.physics.wind.packed_field import FORMAT

CELLS, TIMES, CELL_M = 500, 60, 2.0
TRIALS, LANES = 12, 8
HOVER = "[[0.0, 0.0, 0.0, 0.0]]"
THROUGH = str([[float(t), 10.0 * t, 1.0 * t, 0.5 * t] for t in range(40)])
MISSION = """title = "The vehicle hovers, or flies through layers of wind."
[flight]
duration_s = 40.0
ground_z_m = -40.0
arena_m = 1000.0
setpoints = SETPOINTS
[wind]
steady_m_s = [4.0, 2.0, 0.0]
"""
FIELD = 'field = { file = "large", origin_m = [300.0, 300.0, 100.0], after = "repeat" }\n'
LAYERS = {
    "field, hover": (HOVER, FIELD),
    "field, 10 m/s": (THROUGH, FIELD),
    "shear": (HOVER, 'shear = "log"\n'),
    "gusts": (HOVER, "gusts = [{ at_s = 5.0, velocity_m_s = [0.0, 5.0, 0.0], rise_s = 1.0 }]\n"),
    "dryden": (HOVER, 'turbulence = "dryden"\nturbulence_w20_m_s = 7.7\n'),
    "von_karman": (HOVER, 'turbulence = "von_karman"\nturbulence_w20_m_s = 7.7\n'),
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


def scene(folder: Path, setpoints: str, wind: str) -> Scenario:
    """The flight in this wind."""
    (folder / "m.toml").write_text(MISSION.replace("SETPOINTS", setpoints) + wind)
    return scenario(load(folder / "m.toml"))


def seconds(fly: Callable[[], object]) -> float:
    """Processor time of a call."""
    begun = time.process_time()
    fly()
    return time.process_time() - begun


def compared(without: Callable[[], object], with_it: Callable[[], object]) -> tuple[float, float]:
    """Least times (s) of two flights that are flown in turn, and compiled before."""
    pairs = [(seconds(without), seconds(with_it)) for _ in range(TRIALS)]
    return min(a for a, _ in pairs), min(b for _, b in pairs)


def lanes(of: Scenario) -> Callable[[], object]:
    """Flights of several vehicles side by side, each with a seed and a place in the field of its own."""
    scenes: list[Scenario] = []
    for n in range(LANES):
        layers = of.layers and of.layers._replace(seed=n)
        if layers and layers.field:
            x, y, z = layers.field.origin_m
            there = x + 13.7 * n, y - 31.3 * n, z + 5.1 * n
            layers = layers._replace(field=layers.field._replace(origin_m=there))
        scenes.append(replace(of, layers=layers))
    return lambda: law_flights.fly(scenes, in_all=1e9)


def once(folder: Path, setpoints: str, wind: str) -> None:
    """Open the wind, fly eight vehicles once, and print time and memory: of the process, so nothing else was flown."""
    begun = time.perf_counter()
    lanes(scene(folder, setpoints, wind))()
    flown = time.perf_counter() - begun
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"opened and flown in {flown:.2f} s, memory at most {peak:.0f} MiB")


def compare(folder: Path, layer: str, setpoints: str, wind: str) -> None:
    """Print the row of a layer."""
    calm, windy = scene(folder, setpoints, ""), scene(folder, setpoints, wind)
    in_calm, in_wind = lanes(calm), lanes(windy)
    alone = partial(law_alone.fly, calm), partial(law_alone.fly, windy)
    for fly in (*alone, in_calm, in_wind):  # compiles
        fly()
    a, b = compared(*alone)
    c, d = compared(in_calm, in_wind)
    each = 1e9 / calm.ticks
    print(
        f"{layer:18}{each * (b - a):7.0f} ns{a / b:8.0%}{each * (d - c) / LANES:9.0f} ns{c / d:8.0%}",
        flush=True,
    )


def main() -> None:
    """Print the table, or what one flight takes."""
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--once", choices=(*LAYERS, "none"), help="fly in this wind once, after a first run has compiled")  # fmt: skip
    words.add_argument("--folder", help="where the field's file lies meanwhile (default: the system's)")  # fmt: skip
    given = words.parse_args()
    with TemporaryDirectory(dir=given.folder) as name:
        folder = Path(name)
        large(folder / "large")
        if given.once:
            once(folder, *(LAYERS | {"none": (THROUGH, "")})[given.once])
            return
        print(f"{'':18}{'alone':>10}{'speed':>8}{'in lanes':>12}{'speed':>8}")
        for layer, (setpoints, wind) in LAYERS.items():
            compare(folder, layer, setpoints, wind)


if __name__ == "__main__":
    main()
