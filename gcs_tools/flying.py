"""Flying missions: prepared, flown one way or the other, judged, and left on file.

from gcs_tools import fly
result = fly("paper_nominal", settings=["law.f_m=1.4"])
assert result.passed
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.airframe import AirframeError
from fcu.interface.ports import busy, first_free_instance
from fcu.kernel.buffers import to_buffer
from fcu.law.parameters import ParameterError
from gcs_tools import expect, metrics, result, rollout
from gcs_tools.mission import Mission, MissionError, load, override
from gcs_tools.present import Quiet, Show
from gcs_tools.processes import InfrastructureError
from gcs_tools.record import Recorder
from gcs_tools.recording import RecordingError
from gcs_tools.result import Result
from gcs_tools.scenario import Scenario, arrival, scenario
from gcs_tools.trajectory import last_change_s
from gcs_tools.wire_flight import R_C, Flown, WireFlight
from sitl_plant.physics import dynamics

OK, MISSED, INFRASTRUCTURE, INTERRUPTED = 0, 1, 3, 130
RUNS = Path("runs")


class UsageError(ValueError):
    """A mission, a setting or a folder that cannot be used: which, and what was expected."""


def prepared(
    name: str,
    settings: Sequence[str] = (),
    seed: int | None = None,
    rate_hz: float | None = None,
) -> tuple[Mission, Scenario]:
    """A mission with its changes, and what it flies. Raises UsageError."""
    try:
        mission = load(name)
        for setting in settings:
            mission = override(mission, setting)
        if seed is not None:
            mission = override(mission, f"flight.seed={seed}", "--seed")
        if rate_hz is not None:
            mission = override(mission, f"flight.rate_hz={rate_hz:g}", "--rate")
        return mission, scenario(mission)
    except MissionError as error:
        raise UsageError(str(error)) from error
    except (ParameterError, AirframeError) as error:
        raise UsageError(f"{name}: [law] {error}") from error


def new_folder(out: Path | None, name: str) -> Path:
    """An empty folder for a run: `out`, or a new one in runs/. Raises UsageError."""
    try:
        if out is None:
            stamp = time.strftime("%Y%m%d-%H%M%S")
            for n in range(1000):
                folder = RUNS / f"{stamp}-{name}{f'-{n}' if n else ''}"
                try:
                    folder.mkdir(parents=True)
                    return folder
                except FileExistsError:
                    continue
        assert out is not None
        out.mkdir(parents=True, exist_ok=True)
        if any(out.iterdir()):
            raise UsageError(f"--out {out}: the folder is not empty")
        return out
    except OSError as error:
        where = RUNS if out is None else out
        raise UsageError(f"{where}: cannot make the run's folder: {error.strerror}") from error


def fly_missions(
    missions: Sequence[str],
    *,
    speed: float | None = None,
    seed: int | None = None,
    rate_hz: float | None = None,
    out: Path | None = None,
    settings: Sequence[str] = (),
    in_process: bool = False,
    instance: int | None = None,
    show: Show | None = None,
) -> list[Result]:
    """Fly each mission; stops early when interrupted. Raises UsageError before any has flown."""
    show = show or Quiet()
    ready = [prepared(name, settings, seed, rate_hz) for name in missions]
    if out is not None and len(ready) > 1:
        new_folder(out, "")
    results = []
    for mission, scene in ready:
        many = out is not None and len(ready) > 1
        folder = new_folder(out / mission.name if many and out else out, mission.name)
        flown = _Run(mission, scene, folder, speed, in_process, instance, show).fly()
        show.verdict(flown, str(folder))
        results.append(flown)
        if flown.exit_code == INTERRUPTED:
            break
    return results


def fly(mission: str, **options: Any) -> Result:
    """Fly one mission; options as for `fly_missions`. Raises UsageError."""
    return fly_missions([mission], **options)[0]


class _Run:
    """One mission, one folder."""

    def __init__(
        self, mission: Mission, scene: Scenario, folder: Path, speed: float | None,
        in_process: bool, instance: int | None, show: Show,
    ) -> None:  # fmt: skip
        self._mission = mission
        self._scene = scene
        self._folder = folder
        self._speed = speed
        self._in_process = in_process
        self._instance = instance
        self._show = show

    def fly(self) -> Result:
        """Fly, judge, and write everything down; never raises for what a flight can do."""
        exit_code, error = OK, None
        flown = Flown(np.zeros((0, 0)), np.zeros((0, 0)))
        try:
            with Recorder(self._folder / "flight.mcap", self._metadata()) as recorder:
                recorder.set_params(to_buffer(self._scene.law))
                try:
                    flown = self._flown(recorder)
                except _Cut as cut:
                    flown, exit_code, error = cut.flown, cut.exit_code, cut.error
        except RecordingError as failed:
            exit_code, error = INFRASTRUCTURE, f"recording: {failed}"
        judged = self._judge(flown, exit_code, error)
        try:
            if len(flown.fcu) > 1:
                from gcs_tools.plot import flight_figure

                flight_figure(
                    flown.plant, flown.fcu, to_buffer(self._scene.law),
                    self._mission.title, self._folder / "flight.png",
                )  # fmt: skip
            judged.write(self._folder / "result.json")
        except (OSError, result.ResultError) as failed:
            judged = replace(
                judged, passed=False, exit_code=max(INFRASTRUCTURE, judged.exit_code),
                error=judged.error or str(failed),
            )  # fmt: skip
        return judged

    def _flown(self, recorder: Recorder) -> Flown:
        duration = self._scene.ticks / self._scene.rate_hz
        with self._show.flight(self._mission.name, duration) as progress:
            if self._in_process:
                return self._by_rollout(recorder, progress)
            return self._over_the_wire(recorder, progress)

    def _by_rollout(self, recorder: Recorder, progress: Callable[[float], None]) -> Flown:
        from fcu.kernel.compile import is_cached

        if not is_cached("rollout"):
            self._show.note("compiling law and plant, once for this version (about 20 s)")
        began = time.monotonic()
        rollout.warm_up(self._scene)
        first = time.monotonic()
        plant, fcu = rollout.fly(self._scene)
        wall = time.monotonic() - first
        progress(len(plant) / self._scene.rate_hz)
        flown = self._cut_at_arrival(Flown(plant, fcu, False, first - began, wall))
        recorder.add_plant(flown.plant)
        recorder.add_fcu(flown.fcu)
        return flown

    def _over_the_wire(self, recorder: Recorder, progress: Callable[[float], None]) -> Flown:
        from fcu.kernel.compile import is_cached

        if not (is_cached("tick") and is_cached("advance")):
            self._show.note("compiling law and plant, once for this version (about 20 s)")
        try:
            if self._instance is None:
                self._instance = first_free_instance(
                    "plant", "fcu_plant", "fcu_script", "fcu_station", "script"
                )
                if self._instance:
                    self._show.note(f"instance {self._instance}: those before it are in use")
            elif taken := busy(
                self._instance, "plant", "fcu_plant", "fcu_script", "fcu_station", "script"
            ):
                raise taken[0]
        except OSError as error:
            raise _Cut(_nothing(), INFRASTRUCTURE, str(error.strerror or error)) from error
        flight = WireFlight(
            self._scene, self._folder, self._instance, self._speed,
            (recorder.add_plant, recorder.add_fcu), progress,
        )  # fmt: skip
        try:
            return self._cut_at_arrival(flight.fly())
        except InfrastructureError as error:
            flown = flight.flown()
            at = flown.plant[-1, 0] if len(flown.plant) else 0.0
            text = f"{error} (last simulation time {at:.3f} s)"
            raise _Cut(flown, INFRASTRUCTURE, text) from error
        except KeyboardInterrupt as error:
            raise _Cut(flight.flown(), INTERRUPTED, "interrupted") from error

    def _cut_at_arrival(self, flown: Flown) -> Flown:
        n = arrival(self._scene, flown.plant, flown.fcu, R_C)
        if n is None:
            return flown
        return replace(flown, plant=flown.plant[:n], fcu=flown.fcu[:n], arrived=True)

    # --- the verdict

    def _judge(self, flown: Flown, exit_code: int, error: str | None) -> Result:
        scene, mission = self._scene, self._mission
        expectations: list[expect.Expectation] = []
        measured: dict[str, float | None] = {}
        ended = "aborted"
        if len(flown.plant) and len(flown.fcu):
            settle = last_change_s(mission.flight) + metrics.SETTLE_S
            flight = metrics.Flight.of(flown.plant, flown.fcu, settle)
            measured = flight.metrics()
            if exit_code == OK:
                ended = self._ended(flown)
                expectations = expect.judge(mission.expectations(), flight.metric, ended)
        passed = exit_code == OK and all(e.passed for e in expectations)
        if exit_code == OK and not passed:
            exit_code = MISSED
        sim_time = float(flown.plant[-1, 0]) if len(flown.plant) else 0.0
        said = flown.said.get("plant", {})
        return Result(
            mission=mission.name,
            title=mission.title,
            passed=passed,
            exit_code=exit_code,
            ended=ended,
            seed=mission.flight.seed,
            rate_hz=float(scene.rate_hz),
            sim_time_s=sim_time,
            wall_time_s=flown.wall_time_s,
            real_time_factor=sim_time / flown.wall_time_s if flown.wall_time_s else 0.0,
            startup_s=flown.startup_s,
            ticks=len(flown.fcu),
            slips=int(said.get("slips", 0)),
            trajectory_sha256=result.trajectory_sha256(flown.plant) if len(flown.plant) else "",
            versions=versions(),
            values={
                k: result.InForce(v.value, v.origin) for k, v in mission.values_in_force().items()
            },
            expectations=expectations,
            metrics=measured,
            error=error,
        )

    def _ended(self, flown: Flown) -> str:
        if flown.arrived:
            return "arrived"
        return {
            dynamics.FLYING: "time", dynamics.DIVERGED: "diverged", dynamics.CRASHED: "crashed"
        }[float(flown.plant[-1, -1])]  # fmt: skip

    def _metadata(self) -> dict[str, str]:
        mission = self._mission
        return {
            "mission": mission.name,
            "title": mission.title,
            "seed": str(mission.flight.seed),
            "rate_hz": str(self._scene.rate_hz),
            **{f"version.{k}": v for k, v in versions().items()},
            **{k: f"{v.value} ({v.origin})" for k, v in mission.values_in_force().items()},
        }


class _Cut(Exception):
    """A flight that could not be brought to its end; what was flown of it."""

    def __init__(self, flown: Flown, exit_code: int, error: str) -> None:
        super().__init__(error)
        self.flown, self.exit_code, self.error = flown, exit_code, error


def _nothing() -> Flown:
    return Flown(np.zeros((0, 0)), np.zeros((0, 0)))


def versions() -> dict[str, str]:
    """What flew: the package, and what its numbers depend on."""
    names = ("m-mrac", "numpy", "numba", "pymavlink", "mcap", "protobuf")
    found = {name: version(name) for name in names}
    return {**found, "python": platform.python_version(), "machine": platform.machine(),
            "system": os.uname().sysname if hasattr(os, "uname") else platform.system()}  # fmt: skip
