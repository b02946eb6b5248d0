"""`make bench`: what a step costs, and how fast a flight goes, on this machine.

Everything is measured in one run, so that figures can be compared: on a machine that does
other work too, ratios hold better than figures. Medians of several, unless it says else.
"""

from __future__ import annotations

import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_tools.studies.bench import bus as bench_bus
from gcs_tools.studies.bench import peers
from gcs_tools.studies.bench.figure import Figure

if TYPE_CHECKING:
    from gcs_tools.flight.scenario import Scenario
    from gcs_tools.flight.scripted_flight import Flown

SCHEMA = 1  # of --json: raised when a key changes its meaning or goes
MISSION = "paper_nominal"
RATE_HZ = 500.0
STEPS = 10_000  # of a compiled loop, at most
CALLS = 20_000  # from Python
WANTED_OF_LIMIT = {"constant": "0.5, aim 0.6", "streamed": "0.3, aim 0.4"}


def per_call_s(run: Callable[[], Any], calls: int, repeats: int) -> float:
    """Median of the seconds that each of `calls` takes, where one `run()` makes them all."""
    run()
    taken = []
    for _ in range(repeats):
        began = time.perf_counter()
        run()
        taken.append((time.perf_counter() - began) / calls)
    return statistics.median(taken)


def streamed(duration_s: float) -> Scenario:
    """The paper's flight, its moving yaw sent 20 times a second of simulation time."""
    from gcs_tools.flight.run import prepared

    settings = [f"flight.duration_s={duration_s:g}"]
    return prepared(MISSION, settings, rate_hz=RATE_HZ)[1]


def constant(scene: Scenario) -> Scenario:
    """The same with a constant yaw: one setpoint, so time is never held under way."""
    only = scene.sent[0]._replace(psi_dot_c=0.0)
    return replace(scene, sent_at=scene.sent_at[:1], sent=(only,))


# --- in this process


def compiled(scene: Scenario, repeats: int) -> Iterator[Figure]:
    """Steps inside compiled code, a tick called from Python, whole flights of the law alone."""
    import numpy as np

    from fcu.guard.admission import Look, way_to
    from fcu.guard.parameters import GOVERN
    from fcu.guard.stability import unstable
    from fcu.interface.messages import Setpoint
    from fcu.kernel.algebra import Vec3
    from fcu.kernel.buffers import size, to_buffer
    from fcu.kernel.rows import column, slice_of
    from fcu.process.steps import law_steps
    from fcu.process.tick import FLYING, Remembered, Tick, tick
    from gcs_tools.flight import law_alone
    from gcs_tools.judging.envelope import with_guard
    from gcs_tools.studies.bench.loops import margin_steps, plant_steps

    n, settings, world = scene.ticks, to_buffer(scene.settings), scene.world
    plant, start = to_buffer(world.params), to_buffer(world.start)
    law_alone.warm_up(scene)
    flight = per_call_s(lambda: law_alone.fly(scene), n, 3 * repeats)
    plant_rows, fcu_rows = law_alone.fly(scene)
    row = fcu_rows[n // 2]
    setpoint, out, remembered = scene.setpoints[0], row.copy(), np.zeros(size(Remembered))
    remembered[slice_of(Remembered, "law")] = column(Tick, row, "state")
    remembered[slice_of(Remembered, "guard")] = column(Tick, row, "guard_state")
    command = column(Tick, row, "command").copy()

    rows = column(Tick, fcu_rows[n // 2 + 1 :][:STEPS], "measured").copy()
    kept = np.zeros((len(rows), size(Tick)))
    measured = rows[0]

    def ticks() -> None:
        at = remembered.copy()
        for _ in range(CALLS):
            tick(1.0, FLYING, at, settings, setpoint, 0.0, measured, out)

    step = per_call_s(
        lambda: law_steps(settings, remembered, setpoint, rows, kept), len(rows), repeats
    )
    yield Figure("law_step_ns", "law, one step, compiled (ns)", step * 1e9)
    step = per_call_s(lambda: margin_steps(settings, remembered, rows), len(rows), repeats)
    yield Figure("margin_ns", "of which its margins (ns)", step * 1e9)
    governing = to_buffer(with_guard(scene.settings, policy=GOVERN))
    far = setpoint.copy()
    far[:3] += 100.0
    step = per_call_s(lambda: law_steps(governing, remembered, far, rows, kept), len(rows), repeats)
    yield Figure("law_governing_ns", "law, one step, its guard governing (ns)", step * 1e9)
    yield from laws(repeats)
    step = per_call_s(lambda: plant_steps(STEPS, plant, start, command), STEPS, repeats)
    yield Figure("plant_step_ns", "plant, one step of 1 ms, compiled (ns)", step * 1e9)
    step = per_call_s(ticks, CALLS, repeats)
    yield Figure("tick_call_us", "tick(buffers) from Python (us)", step * 1e6)
    zero = Vec3(0.0, 0.0, 0.0)
    look = Look(scene.guard, scene.law)
    way = way_to(Setpoint(Vec3(4.0, 7.0, 18.0), zero, zero, 0.0, 0.0))
    step = per_call_s(lambda: look.short(way, np.zeros(9)), 1, 50 * repeats)
    yield Figure("look_us", "a look along the way to a setpoint (us)", step * 1e6)
    step = per_call_s(lambda: unstable(scene.law, scene.guard), 1, 20 * repeats)
    yield Figure("stability_rule_ms", "the rule on gains, asked once (ms)", step * 1e3)
    label = f"the law alone, one core, {world.steps} plant steps a tick (million ticks/s)"
    yield Figure("law_alone_mticks_s", label, 1e-6 / flight, "0.7, aim 1")
    yield from beside(scene, repeats, 1e-6 / flight)
    yield from recorder(plant_rows, fcu_rows, settings, repeats)


def beside(scene: Scenario, repeats: int, alone: float) -> Iterator[Figure]:
    """Flights of the law alone, eight at a time, each of another mass and noise.

    alone : million ticks a second of one at a time.
    """
    from concurrent.futures import ThreadPoolExecutor
    from functools import partial

    from fcu.kernel.lanes import WIDTH
    from gcs_tools.flight import law_flights

    def varied(i: int) -> Scenario:
        world = scene.world
        params = world.params._replace(m=world.params.m + 0.05 * i)
        return replace(scene, world=world._replace(params=params, seed=float(i)))

    fly = partial(law_flights.fly, in_all=law_flights.ALWAYS)
    scenes, nothing = [varied(i) for i in range(WIDTH)], law_flights.Keep(plant=(), law=())
    hashed = law_flights.Keep(law=())  # what a trajectory hash takes, and a verdict by the truth
    n = len(scenes) * scene.ticks
    label = f"the same, {WIDTH} flights beside each other, "
    lanes = 1e-6 / per_call_s(lambda: fly(scenes, nothing), n, repeats)
    goal = f"4 times one at a time: {4.0 * alone:.2g}"
    yield Figure("lanes_mticks_s", f"{label}no rows kept (million ticks/s)", lanes, goal)
    for key, words, keep in (
        ("lanes_plant_rows_mticks_s", "the simulator's rows kept", hashed),
        ("lanes_all_rows_mticks_s", "all rows kept", law_flights.EVERYTHING),
    ):
        taken = per_call_s(partial(fly, scenes, keep), n, repeats)
        yield Figure(key, f"{label}{words} (million ticks/s)", 1e-6 / taken)
    with ThreadPoolExecutor(2) as pool:
        two = per_call_s(
            lambda: list(pool.map(lambda each: fly(each, nothing), [scenes, scenes])),
            2 * n, repeats,
        )  # fmt: skip
    yield Figure("lanes_two_cores_mticks_s", f"{label}two cores (million ticks/s)", 1e-6 / two)
    for key, words, keep in (
        ("flight_mb", "memory of a flight, all rows kept (MB)", law_flights.EVERYTHING),
        ("flight_plant_rows_mb", "of which the simulator's (MB)", hashed),
    ):
        flown = fly(scenes[:2], keep)[0]
        yield Figure(key, words, (flown.plant.nbytes + flown.law.nbytes) * 1e-6)


def laws(repeats: int) -> Iterator[Figure]:
    """One step of every other law that is shipped, compiled, in the second half of the same flight."""
    import numpy as np

    from fcu.kernel.buffers import size, to_buffer
    from fcu.kernel.rows import column, slice_of
    from fcu.laws import loader
    from gcs_tools.flight import law_alone
    from gcs_tools.flight.run import prepared

    for name in sorted(set(loader.SHIPPED) - {loader.DEFAULT}):
        scene = prepared(MISSION, law=name, rate_hz=RATE_HZ)[1]
        ticks, loop = scene.flown.ticks, scene.flown.module("steps")
        rows = law_alone.fly(scene)[1]
        row, settings = rows[len(rows) // 2], to_buffer(scene.settings)
        remembered = np.zeros(size(ticks.Remembered))
        remembered[slice_of(ticks.Remembered, "law")] = column(ticks.Tick, row, "state")
        later = rows[len(rows) // 2 + 1 :][:STEPS]
        measured, kept = column(ticks.Tick, later, "measured").copy(), np.zeros_like(later)
        setpoint = scene.setpoints[0]

        def steps(
            loop: Any = loop, kept: Any = kept, measured: Any = measured, settings: Any = settings,
            remembered: Any = remembered, setpoint: Any = setpoint,
        ) -> None:  # fmt: skip
            loop.law_steps(settings, remembered, setpoint, measured, kept)

        step = per_call_s(steps, len(later), repeats)
        yield Figure(f"law_{name}_step_ns", f"law {name}, one step, compiled (ns)", step * 1e9)


def recorder(plant_rows: Any, fcu_rows: Any, settings: Any, repeats: int) -> Iterator[Figure]:
    """What recording costs a tick, fed in batches as a flight feeds it."""
    from fcu.interface.recorder_pipe import BATCH
    from gcs_tools.recording.writer import RecordingWriter

    taken = []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as folder:
            began = time.perf_counter()
            with RecordingWriter(Path(folder) / "flight.mcap", {}) as recording:
                recording.set_params(settings)
                for i in range(0, len(plant_rows), BATCH):
                    recording.add_plant(plant_rows[i : i + BATCH])
                    recording.add_fcu(fcu_rows[i : i + BATCH])
            taken.append((time.perf_counter() - began) / len(plant_rows))
    yield Figure("recorder_tick_us", "recorder, one tick (us)", statistics.median(taken) * 1e6)


def in_memory(scene: Scenario, repeats: int) -> Iterator[Figure]:
    """The whole vehicle in this process: as many kinds of flight as over the wire."""
    from fcu.kernel.buffers import to_buffer
    from gcs_tools.flight.memory_flight import MemoryFlight
    from gcs_tools.recording.retention import FULL, NONE, recorder
    from gcs_tools.recording.schema import OURS

    def fly(flight: Scenario, mode: str) -> float:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            file = recorder(mode, folder / "flight.mcap", {}, OURS, flight.rate_hz)
            with file as recording:
                recording.set_params(to_buffer(flight.settings))
                takers = (recording.add_plant, recording.add_fcu)
                return MemoryFlight(flight, folder, takers).fly().wall_time_s

    kinds = {"constant": constant(scene), "streamed": scene}
    for (kind, flight), mode in product(kinds.items(), (NONE, FULL)):
        fly(flight, mode)
        wall = statistics.median(fly(flight, mode) for _ in range(repeats))
        how = "recorded" if mode == FULL else "unrecorded"
        wanted = "500" if (kind, mode) == ("constant", NONE) else ""
        label = f"in process, whole vehicle, {how}, {kind} yaw (x real time)"
        yield Figure(f"in_process_{kind}_{how}", label, scene.ticks / scene.rate_hz / wall, wanted)


# --- over the wire


@contextmanager
def listeners(instance: int, wanted: bool) -> Iterator[None]:
    """Two clients that the vehicle streams telemetry to, if wanted."""
    if not wanted:
        yield
        return
    arguments = [sys.executable, "-m", "gcs_tools.studies.bench.clients", str(instance)]
    pipe = subprocess.PIPE
    with subprocess.Popen(arguments, stdin=pipe, stdout=pipe, text=True) as clients:
        assert clients.stdout is not None
        clients.stdout.readline()  # they listen: a flight is shorter than a start of Python
        yield
        heard, _ = clients.communicate()
    if "0" in heard.split()[-2:]:
        raise RuntimeError(f"a client heard nothing: {heard}")


def flown(scene: Scenario, speed: float | None = None, clients: bool = False) -> Flown:
    """One flight over UDP, with both processes and recording. Raises InfrastructureError.

    `clients`: with two that the vehicle streams telemetry to.
    """
    from fcu.kernel.buffers import to_buffer
    from gcs_tools.flight.processes import PORTS, claimed
    from gcs_tools.flight.wire_flight import WireFlight
    from gcs_tools.recording.writer import RecordingWriter

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = RecordingWriter(folder / "flight.mcap", {})
        with recording, claimed(None, *PORTS) as instance:
            recording.set_params(to_buffer(scene.settings))
            takers = (recording.add_plant, recording.add_fcu)
            with listeners(instance, clients):
                return WireFlight(scene, folder, instance, speed, takers, lambda _t: None).fly()


def lockstep(scene: Scenario, repeats: int) -> Iterator[Figure]:
    """As fast as it goes: each kind of flight in turn, so that they meet the same machine."""
    kinds = {"constant": constant(scene), "streamed": scene, "clients": constant(scene)}
    walls: dict[str, list[float]] = {kind: [] for kind in kinds}
    for _ in range(repeats):
        for kind, flight in kinds.items():
            walls[kind].append(flown(flight, clients=kind == "clients").wall_time_s)
    from gcs_tools.studies.bench.limit import rates

    limit = rates(constant(scene), repeats)
    label = "the limit over UDP: two datagrams of 249 and 93 bytes, there and back"
    yield Figure("limit_datagrams_ticks_s", f"{label} (a second)", limit["datagrams"])
    label = "the limit over UDP: bare loop, two processes on one core"
    yield Figure("limit_bare_ticks_s", f"{label} (ticks/s)", limit["bare"])
    ratio = statistics.median(walls["constant"]) / statistics.median(walls["clients"])
    label = "lockstep over UDP, with telemetry to two clients over without"
    yield Figure("lockstep_clients_ratio", label, ratio, "0.9")
    for kind in ("constant", "streamed"):
        wall = statistics.median(walls[kind])
        label = f"lockstep over UDP, recorded, {kind} yaw"
        yield Figure(f"lockstep_{kind}_ticks_s", f"{label} (ticks/s)", scene.ticks / wall)
        factor = scene.ticks / scene.rate_hz / wall
        yield Figure(f"lockstep_{kind}_real_time_factor", f"{label} (x real time)", factor)
        of_limit, wanted = scene.ticks / wall / limit["bare"], WANTED_OF_LIMIT[kind]
        yield Figure(f"lockstep_{kind}_of_limit", f"{label} (of the bare loop)", of_limit, wanted)


def real_time(scene: Scenario) -> Iterator[Figure]:
    """Paced by the wall clock: how late ticks start. One flight."""
    said = flown(scene, 1.0).said["plant"]
    for key in ("p50", "p99", "max"):
        label = f"real time, lateness of a tick, {key} (us)"
        yield Figure(f"lateness_{key}_us", label, said["lateness"][f"{key}_us"])
    yield Figure("slips", f"real time, slips in {scene.ticks} ticks", said["slips"])


# --- the commands


def commands(repeats: int) -> Iterator[Figure]:
    """How long a person waits for `gcs --help`, and for the first tick of a warm `gcs fly`."""
    gcs = [sys.executable, "-m", "gcs_tools"]
    devnull = subprocess.DEVNULL

    def ask() -> None:
        subprocess.run([*gcs, "--help"], stdout=devnull, check=True)

    yield Figure("help_s", "gcs --help (s)", per_call_s(ask, 1, repeats))
    waits = []
    for _ in range(3):
        with tempfile.TemporaryDirectory() as name:
            began, settings = time.time(), ["--set", "flight.duration_s=0.1"]
            fly = [*gcs, "fly", MISSION, *settings, "--out", name]
            subprocess.run(fly, stdout=devnull, stderr=devnull, check=False)
            # the processes are started when the world has been written for them
            started = (Path(name) / "world.json").stat().st_mtime - began
            result = json.loads((Path(name) / "result.json").read_text())
            waits.append(started + result["startup_s"])
    label = "gcs fly, warm, from the command to the first tick (s)"
    yield Figure("first_tick_s", label, statistics.median(waits))


def machine() -> dict[str, str]:
    """What it was measured on."""
    from gcs_tools.flight.run import versions

    model = platform.processor() or platform.machine()
    about = Path("/proc/cpuinfo")
    if about.exists():
        lines = about.read_text().splitlines()
        named = [line.partition(":")[2].strip() for line in lines if "model name" in line]
        model = named[0] if named else model
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return {"cpu": model, "cores": str(os.cpu_count()), "load_before": load, **versions()}


def measured(repeats: int, duration_s: float) -> Iterator[Figure]:
    """Every figure, each as soon as it is known."""
    scene = streamed(duration_s)
    yield from compiled(scene, repeats)
    yield from peers.figures(repeats)
    yield from in_memory(scene, repeats)
    yield from lockstep(scene, repeats)
    yield from real_time(streamed(10.0))
    yield from bench_bus.figures()
    yield from commands(repeats)


@click.command()
@click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output.")
@click.option("--repeats", default=5, show_default=True, type=click.IntRange(1), help="Medians of so many.")  # fmt: skip
@click.option("--duration", "duration_s", default=60.0, show_default=True, type=click.FloatRange(1.0), help="Simulated seconds of a flight.")  # fmt: skip
def main(as_json: bool, repeats: int, duration_s: float) -> None:
    """Measure what a step costs and how fast a flight goes, in two or three minutes."""
    from rich.console import Console
    from rich.table import Table

    about, log = machine(), Console(stderr=True, highlight=False)
    figures = []
    for figure in measured(repeats, duration_s):
        figures.append(figure)
        if log.is_terminal:
            log.print(f"[dim]{figure.label}: {figure.value:.4g}[/]")
    if as_json:
        values = {figure.key: figure.value for figure in figures}
        print(json.dumps({"schema": SCHEMA, "machine": about, "figures": values}, indent=2))
        return
    title = f"{RATE_HZ:g} Hz, flights of {duration_s:g} s, medians of {repeats}"
    table = Table(title=title, title_justify="left", box=None)
    for column in ("measured", "value", "wanted"):
        table.add_column(column, justify="right" if column == "value" else "left")
    for figure in figures:
        table.add_row(figure.label, f"{figure.value:,.4g}", figure.wanted)
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 120)
    out.print(table)
    out.print("; ".join(f"{name} {value}" for name, value in about.items()), soft_wrap=True)


if __name__ == "__main__":
    main()
