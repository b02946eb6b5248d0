"""Flying missions: prepared, flown one way or the other, judged, and left on file.

from gcs_tools import fly
result = fly("paper_nominal", settings=["law.f_m=1.4"])
assert result.passed
"""

from __future__ import annotations

import json
import os
import platform
import shlex
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from fcu.interface.airframe import AirframeError, AirframeFile
from fcu.interface.files.input_file import written
from fcu.interface.link import PortBusy
from fcu.interface.parameter import ParameterError
from fcu.interface.ports import NoFreeInstance
from fcu.kernel.buffers import columns, to_buffer
from fcu.kernel.compile import is_cached
from fcu.laws.loader import LawError
from gcs_tools.exit_codes import INFRASTRUCTURE, INTERRUPTED, OK, USAGE
from gcs_tools.flight.arrival import UntilArrival, arrival
from gcs_tools.flight.compiling import Compiled, Compiling
from gcs_tools.flight.display import Display
from gcs_tools.flight.foreign_flight import (
    OPENS_S,
    ForeignFlight,
    command,
    names_instance,
)
from gcs_tools.flight.forking import can_fork, load
from gcs_tools.flight.held_flight import HeldFlight
from gcs_tools.flight.interrupts import interrupts_wait
from gcs_tools.flight.memory_flight import MemoryFlight, is_compiled
from gcs_tools.flight.processes import PORTS, InfrastructureError, Misused, Take, claimed
from gcs_tools.flight.publisher_process import Zenoh
from gcs_tools.flight.run_folder import (
    LOGS,
    RECORDING,
    RESULT,
    RUNS,
    Kept,
    UsageError,
    alone_in,
    emptied,
    left_by_script,
    new_folder,
)
from gcs_tools.flight.scenario import Scenario, refuse_link_faults, scenario
from gcs_tools.flight.script_flight import ScriptFlight, only_first
from gcs_tools.flight.scripted_flight import Flown
from gcs_tools.flight.side_by_side import cores, fly_side_by_side
from gcs_tools.flight.user_command import CommandError
from gcs_tools.flight.wire_flight import WireFlight
from gcs_tools.judging import result
from gcs_tools.judging.belief_check import unbelieved
from gcs_tools.judging.expectations import LIMITED, untold
from gcs_tools.judging.metrics import OF_THE_TRUTH
from gcs_tools.judging.preflight_check import refusal, refused_gains
from gcs_tools.judging.result import Result, judge
from gcs_tools.judging.script_check import DIED, ScriptFlown
from gcs_tools.missions import mission as mission_file
from gcs_tools.missions.mission import (
    Mission,
    MissionError,
    once,
    override,
    with_airframe,
    with_controller,
    with_law,
    with_parameter,
)
from gcs_tools.missions.other_file import meant
from gcs_tools.recording import retention
from gcs_tools.recording.events import logged
from gcs_tools.recording.reader import (
    AIRFRAME,
    AIRFRAME_FILE,
    AIRFRAME_SHA256,
    CONTROLLER,
    LAW,
    LAW_SOURCES,
    VALUES,
    RecordingError,
    flies_with,
)
from gcs_tools.recording.table import Rows, Table
from gcs_tools.wind_fields.buildings import BUILDINGS, Box, boxes
from sitl_plant.physics.truth import truth
from sitl_plant.physics.wind.packed_field import opened

ALWAYS, FAILED, NEVER = FIGURES = ("always", "failed", "never")
FREE_S, FREE_LOOK_S = 120.0, 0.2  # wall: for an instance to be free, and between two looks for one
COMPILING = "compiling law and plant, once for this version (up to a minute)"


def prepared(
    asked: str | Mission,
    settings: Sequence[str] = (),
    seed: int | None = None,
    rate_hz: float | None = None,
    law: str | None = None,
    airframe: str | None = None,
    controller: tuple[str, ...] = (),
    params: Sequence[str] = (),
) -> tuple[Mission, Scenario]:
    """A mission with its changes, and what it flies. Raises UsageError.

    `asked`: the mission, or its name or file.
    `law`: a name or FILE.py, flown in place of the mission's own; `settings` are of that.
    `airframe`: a name or FILE.toml, in place of the mission's own.
    `controller`: the command of a process in place of fcu.
    `params`: NAME=VALUE each, of the vehicle's parameters.
    """
    name = _name(asked)
    try:
        mission = mission_file.load(asked) if isinstance(asked, str) else asked
        if law is not None:
            mission = with_law(mission, law)
        if airframe is not None:
            mission = with_airframe(mission, airframe)
        for given in once(params, "--param"):  # first: a setting may expect what they bring about
            mission = with_parameter(mission, given)
        for setting in once(settings, params=params):
            mission = override(mission, setting)
        if seed is not None:
            mission = override(mission, f"flight.seed={seed}", "--seed")
        if rate_hz is not None:
            mission = override(mission, f"flight.rate_hz={rate_hz:g}", "--rate")
        if controller:
            mission = with_controller(mission, controller)
            _judged_by_the_truth(mission)
        return mission, scenario(mission)
    except MissionError as error:
        raise UsageError((isinstance(asked, str) and meant(name)) or str(error)) from error
    except ParameterError as error:
        raise UsageError(f"{name}: [law] {error}") from error
    except AirframeError as error:
        raise UsageError(f"{name}: {error}") from error


def _name(asked: str | Mission) -> str:
    return asked if isinstance(asked, str) else asked.name


def _judged_by_the_truth(mission: Mission) -> None:
    """Raises MissionError where a mission expects what only a controller of ours tells."""
    expected = [mission.expectations(), *(item["expect"] for item in mission.items())]
    if names := [name for expect in expected for name in untold(expect)]:
        raise MissionError(
            f"{mission.source}: [expect] {', '.join(names)}: cannot be judged, since a controller of"
            " your own tells nothing of itself. Expect what the truth tells: ended, reached,"
            f" {', '.join(sorted(OF_THE_TRUTH))}"
        )


def fly_missions(
    missions: Sequence[str | Mission],
    *,
    speed: float | None = None,
    seed: int | Sequence[int] | None = None,
    rate_hz: float | None = None,
    out: Path | None = None,
    law: str | None = None,
    airframe: str | None = None,
    settings: Sequence[str] = (),
    params: Sequence[str] = (),
    in_process: bool = False,
    instance: int | None = None,
    display: Display | None = None,
    zenoh: Zenoh | None = None,
    jobs: int | None = None,
    figure: str | None = None,
    record: str = retention.FULL,
    controller: str | None = None,
    controller_timeout_s: float = OPENS_S,
    overwrite: bool = False,
    allow_commands: bool = False,
) -> list[Result]:
    """Fly each mission; stops early when interrupted.

    Of several missions, one that cannot be flown does not keep the others from flying: its result
    is `ended` "rejected", exit code 2, and says why. Raises UsageError before any has flown, also
    if none can be.

    `seed`: of the noise; of several, each mission is flown with each.  `law`: a name or FILE.py, in place of each mission's own.
    `airframe`: a name or FILE.toml, in place of each mission's own.  `params`: NAME=VALUE each, of the
    vehicle's parameters by their MAVLink names.  `zenoh`: how it is published; None:
    not.  `controller`: the command of a process that flies in place of fcu; `controller_timeout_s`:
    wall time within which it opens its port.  `jobs`: flights at a time; None: as many as there are cores, but one at a time at a speed
    or published.  `figure`: one of FIGURES: of which flights flight.png is drawn; None: of a single
    flight always, of several of those that failed.  `record`: full, light (100 ticks a second) or
    none; hash and verdict are of all ticks in any case.  `overwrite`: `out` may hold the results of an
    earlier run, which are removed.  `allow_commands`: run the command of a mission that names one.
    """
    for name, given, allowed in (("figure", figure, FIGURES), ("record", record, retention.MODES)):
        if given is not None and given not in allowed:
            raise UsageError(f"{name} {given!r}: expected one of {', '.join(allowed)}")
    if in_process:
        for option, chosen in (("speed", speed), ("instance", instance), ("publish", zenoh)):
            if chosen is not None:
                raise UsageError(
                    f"{option}: a flight in process has none; leave out one of the two"
                )
    words = _command(controller, law, in_process, zenoh)
    if words and not names_instance(words):
        instance = instance or 0  # of which it knows nothing
    display = display or Display()
    began = time.monotonic()
    seeds = [seed] if seed is None or isinstance(seed, int) else list(seed)
    asked = [(name, each) for name in missions for each in seeds]
    ready, rejected = _admitted(
        asked, settings, rate_hz, law, airframe, words, in_process, allow_commands, instance, params
    )
    many = len(asked) > 1
    for why in dict.fromkeys(each.error for each in rejected.values()):
        display.note(f"Error: {why}")
    for name, doubt in dict.fromkeys((m.name, unbelieved(m)) for m, _ in ready):
        if doubt:
            display.note(f"{name}: {doubt}")
    if len(seeds) > 1:
        for same in sorted({m.name for m, scene in ready if not scene.world.noise_scale.any()}):
            display.note(
                f"{same}: nothing is drawn from the seed (no [plant.noise]): its {len(seeds)} flights"
                " are the same"
            )
    if jobs is None:
        in_turn = speed is not None or zenoh is not None or instance is not None
        jobs = 1 if in_turn else cores()
    elif instance is not None and jobs > 1:
        raise UsageError("an instance is one vehicle: it flies one mission at a time")
    names: list[str] = []
    runs = []
    for mission, scene in ready:
        name = mission.name if len(seeds) == 1 else f"{mission.name}-seed-{mission.flight.seed}"
        nth = names.count(name)
        names.append(name)
        own = out and out / (f"{name}-{nth}" if nth else name)
        runs.append(
            _Run(
                name, mission, scene, own if many else out, speed, in_process, instance, zenoh,
                figure or (FAILED if many else ALWAYS), many and jobs > 1, record,
                controller_timeout_s,
            )
        )  # fmt: skip
    with alone_in(out):
        if out is not None and overwrite:
            emptied(out)
        if out is not None and many:
            new_folder(out, "")
        if many and can_fork():
            results = fly_side_by_side(runs, jobs, display)
        else:
            results = _fly_in_turn(runs, display)
    if many:
        passed = sum(each.passed for each in results)
        flown = [(run.name, each) for run, each in zip(runs, results, strict=False)]
        cut = [name for name, each in flown if each.exit_code == INTERRUPTED]
        failed = [name for name, each in flown if not each.passed and name not in cut]
        left = [run.name for run in runs[len(results) :]]
        left += dict.fromkeys(each.mission for each in rejected.values())
        display.closing(passed, len(asked), time.monotonic() - began, failed, cut, left)
    for place, each in rejected.items():  # ascending: those before it are in already
        results.insert(place, each)
    return results


def _admitted(
    asked: Sequence[tuple[str | Mission, int | None]], settings: Sequence[str], rate_hz: float | None,
    law: str | None, airframe: str | None, controller: tuple[str, ...], in_process: bool,
    allow_commands: bool, instance: int | None, params: Sequence[str] = (),
) -> tuple[list[tuple[Mission, Scenario]], dict[int, Result]]:  # fmt: skip
    """Missions, each with a seed, that a vehicle would fly; the others' results, by their places.

    Raises UsageError if all are rejected, or a single one.
    """
    ready: dict[int, tuple[Mission, Scenario]] = {}
    why_not: dict[int, str] = {}
    with interrupts_wait() as interrupts:
        for place, (name, seed) in enumerate(asked):
            interrupts.look()
            try:
                made = prepared(name, settings, seed, rate_hz, law, airframe, controller, params)
                _runs_commands(made[0], in_process, allow_commands)
                _has_a_link(made[0], in_process)
                _flies_as(made, instance)
                with interrupts.at_once():
                    _compiles(made[0])
                ready[place] = made
            except UsageError as error:
                why_not[place] = str(error)
        with nullcontext() if is_cached("admission.ahead") else interrupts.at_once():
            ours = {} if controller else ready  # of another's guard nothing is known
            for place, (mission, scene) in list(ours.items()):
                why = refused_gains(mission, scene)
                asks = not scene.script  # else what it asks for is not known before
                if (not why and asks) and (
                    lack := refusal(scene, mission.expectations().get(LIMITED) is True)
                ):
                    why = f'{mission.name}: {lack} (law.guard = "refuse")'
                if why:
                    why_not[place] = why
                    del ready[place]
    if not ready:
        of = {mission_file.called(_name(asked[place][0])): why for place, why in why_not.items()}
        raise UsageError("\n".join(dict.fromkeys(why_not[i] for i in sorted(why_not))), of)
    rejected = {
        place: result.rejected(
            mission_file.called(_name(asked[place][0])), why_not[place], versions()
        )
        for place in sorted(why_not)
    }
    return list(ready.values()), rejected


def _compiles(mission: Mission) -> None:
    """Raises UsageError for a law of a user's own that does not compile."""
    if not mission.controller:
        try:
            mission.flown.check_compiles()
        except LawError as error:
            raise UsageError(str(error)) from error


def _runs_commands(mission: Mission, in_process: bool, allowed: bool) -> None:
    """Raises UsageError for a mission with a script that cannot be run, or that nobody has allowed."""
    if mission.flight.script is None:
        return
    try:
        mission_file.allowed(mission, allowed)
    except MissionError as error:
        raise UsageError(str(error)) from error
    if in_process:
        raise UsageError(
            f"{mission.source}: [flight] script: the vehicle needs its sockets (leave out --in-process)"
        )


def _has_a_link(mission: Mission, in_process: bool) -> None:
    """Raises UsageError for a fault of the link in a flight that has none."""
    if in_process:
        try:
            refuse_link_faults(mission)
        except MissionError as error:
            raise UsageError(str(error)) from error


def _flies_as(made: tuple[Mission, Scenario], instance: int | None) -> None:
    """Raises UsageError for a script that is told no instance, and is to fly another than the first."""
    mission, scene = made
    if instance and scene.script and only_first(scene.script):
        raise UsageError(
            f"{mission.source}: [flight] script: instance {instance} was asked for, and the command has"
            " no {url} or other word that tells it: it can only fly instance 0"
        )


def _command(
    text: str | None, law: str | None, in_process: bool, zenoh: Zenoh | None
) -> tuple[str, ...]:
    """The words of a controller's command; none without one. Raises UsageError."""
    if text is None:
        return ()
    for option, chosen in (("law", law), ("in-process", in_process), ("publish", zenoh)):
        if chosen:
            raise UsageError(f"--{option}: not with --controller, which flies in place of fcu")
    try:
        return command(text)
    except CommandError as error:
        raise UsageError(f"--controller: {error}") from error


def _fly_in_turn(runs: Sequence[_Run], display: Display) -> list[Result]:
    """Fly, tell the verdict, draw; and the next."""
    results: list[Result] = []
    with interrupts_wait():
        for run in runs:
            run.make_folder()
            with display.flight(run.name, run.duration_s) as progress:
                flown = run.fly(display.note, progress, display.compiling)
            display.verdict(flown, str(run.folder))
            drawn = run.draw(flown)
            if drawn.error != flown.error:
                display.note(f"{run.name}: {drawn.error}")
            results.append(drawn)
            if drawn.exit_code == INTERRUPTED:
                break
    return results


def fly(
    mission: str,
    *,
    settings: Sequence[str] = (),
    params: Sequence[str] = (),
    seed: int | None = None,
    rate_hz: float | None = None,
    law: str | None = None,
    airframe: str | None = None,
    in_process: bool = False,
    speed: float | None = None,
    instance: int | None = None,
    out: Path | str | None = None,
    record: Literal["full", "light", "none"] = "full",
    figure: Literal["always", "failed", "never"] = "always",
    display: Display | None = None,
    zenoh: Zenoh | None = None,
    controller: str | None = None,
    controller_timeout_s: float = OPENS_S,
    overwrite: bool = False,
    allow_commands: bool = False,
) -> Result:
    """Fly one mission and judge it, as `gcs fly MISSION` does.

    mission : the name of a shipped mission, or a file.
    settings : TABLE.KEY=VALUE each, as `--set` takes them: "law.f_m=1.4".
    params : NAME=VALUE each, of the vehicle's parameters by their MAVLink names: "NAV_DLL_ACT=3".
    seed, rate_hz : of the noise; control ticks a second. None: the mission's.
    law : a name or FILE.py, flown in place of the mission's own (it is executed).
    airframe : a name or FILE.toml, flown in place of the mission's own.
    in_process : fly controller and simulator in this process, without sockets: the same flight.
    speed : simulated seconds per second; None: as fast as it goes. Not in process.
    instance : whose ports to use; None: the first that is free. Not in process.
    out : an empty or new folder for the run; None: a new one in runs/.
    record : the ticks in flight.mcap: all, 100 a second, or no file.
    figure : whether flight.png is drawn.
    display : told of progress and verdict; None: nobody is.
    zenoh : how every tick is published; None: not. Not in process.
    controller : the command of a process that flies in place of fcu (it is executed).
    controller_timeout_s : wall time within which it opens its port.
    overwrite : `out` may hold the results of an earlier run, which are removed.
    allow_commands : run the command of a mission that names one ([flight] script).

    Returns the Result: `passed`, `metrics` (name -> number or None), `expectations`, `warnings`,
    `causes`, `trajectory_sha256`, `folder` and all else that result.json holds. Raises UsageError for a
    mission, a setting or a folder that cannot be used; what goes wrong in flight is in the Result
    (`exit_code`, `error`).
    """
    given = (
        [settings] if isinstance(settings, str) else settings
    )  # a text is a sequence of texts, too
    (result,) = fly_missions(
        [mission], settings=given, params=[params] if isinstance(params, str) else params, seed=seed, rate_hz=rate_hz, law=law, airframe=airframe,
        in_process=in_process, speed=speed, instance=instance, out=None if out is None else Path(out), record=record,
        figure=figure, display=display, zenoh=zenoh, controller=controller,
        controller_timeout_s=controller_timeout_s, overwrite=overwrite, allow_commands=allow_commands,
    )  # fmt: skip
    return result


def fly_script(mission: Mission, scene: Scenario) -> Flown:
    """Fly a mission's script without a folder of its own, on an instance that is free.

    Raises InfrastructureError, also where no instance is free for a while.
    """
    first = 0 if only_first(scene.script) else None
    until = time.monotonic() + FREE_S
    while True:
        try:
            with TemporaryDirectory(prefix="m-mrac-") as folder, claimed(first, *PORTS) as instance:
                flight = _by_script(scene.pace)(
                    scene, Path(folder), instance, scene.pace, (_drop, _drop), lambda time_s: None,
                    None, flies(mission, scene, scene.airframe), lambda text: None, lambda: None,
                )  # fmt: skip
                return replace(flight.fly(), told=tuple(logged(Path(folder))))
        except (PortBusy, NoFreeInstance) as error:
            if time.monotonic() > until:
                raise InfrastructureError(str(error.strerror or error)) from error
            time.sleep(FREE_LOOK_S)


class _Run:
    """One mission, one folder."""

    def __init__(
        self, name: str, mission: Mission, scene: Scenario, out: Path | None, speed: float | None,
        in_process: bool, instance: int | None, zenoh: Zenoh | None, figure: str, beside: bool,
        record: str, controller_timeout_s: float,
    ) -> None:  # fmt: skip
        """`name`: of its folder; `out`: that; None: a new one in runs/.  `beside`: others fly too."""
        self.name = name
        self.duration_s = scene.ticks / scene.rate_hz
        self.folder = out or RUNS
        self._mission = mission
        self._scene = scene
        self._law = scene.flown
        self._out = out
        self._speed = speed
        self._in_process = in_process
        self._instance = instance
        self._zenoh = zenoh
        self._figure = figure
        self._beside = beside
        self._record = record
        self._opens_s = controller_timeout_s
        self._left = _nothing()
        self._is_spoilt = False  # its folder, by a script: nothing more is written there
        self._note: Callable[[str], None] = lambda text: None
        self._progress: Callable[[float], None] = lambda time_s: None
        self._compiling: Compiling | None = None  # if it is cold

    def make_folder(self) -> None:
        """Make its folder, before it flies. Raises UsageError."""
        self.folder = new_folder(self._out, self.name)

    @property
    def is_cold(self) -> bool:
        """Whether it compiles before it flies."""
        if self._in_process:
            return not is_compiled(self._law)
        if self._scene.controller:
            return not is_cached("begin")
        return not (self._law.is_cached() and is_cached("begin"))

    @property
    def needs_first(self) -> bool:
        """True if its script is told no instance, so that it flies the first."""
        return bool(self._scene.script) and only_first(self._scene.script)

    def load(self) -> None:
        """Load here what it flies by, for processes forked later; of one that is cold, nothing."""
        if self._figure == ALWAYS:
            import gcs_tools.pictures.plot.overview  # noqa: F401
        if self._scene.controller:
            return
        if not self._in_process:
            load(self._law)
        elif not self.is_cold:
            with suppress(LawError), ExitStack() as stack:  # as it says when it flies
                MemoryFlight(self._scene, None, (_drop, _drop)).begin(stack)

    def fly(
        self, note: Callable[[str], None], progress: Callable[[float], None],
        compiling: Compiled = lambda done, of, wall_s: None,
    ) -> Result:  # fmt: skip
        """Fly, judge, and write everything down; never raises for what a flight can do.

        `note` is told what a person waits for, `progress` the simulation time flown, s,
        `compiling` how far that has come.
        """
        self._note, self._progress = note, progress
        if self.is_cold:
            self._note(COMPILING)
            self._compiling = Compiling(self._law.package, compiling)
        with interrupts_wait() as interrupts:
            with result.reserved(self.folder), Kept(self.folder) as kept:
                self._left, exit_code, error = self._recorded(kept)
                has_run = self._left.script is not None
                if self._scene.script and (
                    why := kept.spoilt(LOGS if has_run else ()) or kept.changed()
                ):
                    self._is_spoilt = True
                    exit_code, error = max(exit_code, INFRASTRUCTURE), why
                if self._scene.script:
                    kept.remove(RESULT)  # one of the script's own
            judged = self._written(self._judged(exit_code, error))
            return self.interrupted(judged) if interrupts.take() else judged

    def draw(self, judged: Result) -> Result:
        """Draw what was flown, if it is to be; the result, spoilt if that could not be done.

        It takes a second or two and is not interrupted: callbacks of matplotlib would lose that.
        """
        with interrupts_wait() as interrupts:
            drawn = self._drawn(judged)
            return self.interrupted(drawn) if interrupts.take() else drawn

    def _drawn(self, judged: Result) -> Result:
        failed = not judged.passed and judged.exit_code != INTERRUPTED
        wanted = self._figure == ALWAYS or (self._figure == FAILED and failed)
        flown = self._left
        if not wanted or len(flown.fcu) <= 1 or self._is_spoilt:
            return judged
        try:
            from gcs_tools.pictures.plot.overview import flight_figure

            kinds, params = self._scene.kinds, {}
            if kinds.tells:
                settings = to_buffer(self._scene.settings).tolist()
                params = dict(zip(columns(kinds.params), settings, strict=True))
            flight_figure(
                Table.of(kinds.record, flown.plant), Table.of(kinds.tick, flown.fcu), params,
                heading(self._mission), self.folder / "flight.png",
            )  # fmt: skip
        except OSError as failed:
            why = f"flight.png: {failed.strerror or failed}"
            return self._written(_spoilt(judged, INFRASTRUCTURE, why))
        return judged

    def interrupted(self, judged: Result) -> Result:
        """The result of a flight that was interrupted after it was judged."""
        return self._written(_spoilt(judged, INTERRUPTED, "interrupted"))

    def lost(self, why: str, exit_code: int = INFRASTRUCTURE) -> Result:
        """The result of a flight whose runner is gone."""
        return self._written(self._judged(exit_code, why))

    def _judged(self, exit_code: int, error: str | None) -> Result:
        flown = self._left
        return judge(
            self._mission, float(self._scene.rate_hz), flown.plant, flown.fcu, ended=flown.ended,
            exit_code=exit_code, error=error, said=() if self._is_spoilt else logged(self.folder), folder=str(self.folder),
            begun=flown.begun, refusal=flown.refusal, script=self._script(flown), wall_time_s=flown.wall_time_s,
            startup_s=flown.startup_s, slips=int(flown.said.get("plant", {}).get("slips", 0)),
            versions=_flown_versions(self._mission),
        )  # fmt: skip

    def _script(self, flown: Flown) -> ScriptFlown | None:
        """The end of the script, with the files that it left in the folder."""
        if flown.script is None or self._is_spoilt:
            return flown.script
        return replace(flown.script, files=left_by_script(self.folder))

    def _written(self, judged: Result) -> Result:
        if self._is_spoilt:
            return judged
        try:
            judged.write(self.folder / RESULT)
        except (OSError, result.ResultError) as failed:
            return _spoilt(judged, INFRASTRUCTURE, str(failed))
        return judged

    def _recorded(self, kept: Kept) -> tuple[Flown, int, str | None]:
        """What was flown, on file too; an exit code and an error if it was cut short.

        `kept`: holds the files that a script might remove.
        """
        flown, exit_code, error = _nothing(), OK, None
        try:
            with retention.recorder(
                self._record, self.folder / RECORDING, self._metadata(), self._scene.kinds,
                self._scene.rate_hz,
            ) as recorder:  # fmt: skip
                kept.hold(RECORDING, lambda: recorder.written)
                if self._scene.kinds.tells:
                    recorder.set_params(to_buffer(self._scene.settings))
                until = UntilArrival(self._scene, (recorder.add_plant, recorder.add_fcu))
                try:
                    flown = self._flown((until.add_plant, until.add_fcu))
                except _Cut as cut:
                    flown, exit_code, error = cut.flown, cut.exit_code, cut.error
                until.finish()
                for each in flown.begun:
                    recorder.event(each.event(self._mission.flight))
                is_whole = not (self._scene.script and kept.spoilt(()))
                for event in logged(self.folder) if is_whole else ():
                    recorder.event(event)
        except RecordingError as failed:
            exit_code, error = max(INFRASTRUCTURE, exit_code), error or f"recording: {failed}"
        except KeyboardInterrupt:
            exit_code, error = INTERRUPTED, "interrupted"
        return flown, exit_code, error

    def _flown(self, on_rows: tuple[Take, Take]) -> Flown:
        if self._in_process:
            with nullcontext() if self._compiling is None else self._compiling.here():
                return self._in_memory(on_rows)
        return self._over_the_wire(on_rows)

    def _in_memory(self, on_rows: tuple[Take, Take]) -> Flown:
        flight = MemoryFlight(self._scene, self.folder, on_rows, self._progress)
        try:
            return self._cut_at_arrival(flight.fly())
        except LawError as error:
            raise _Cut(flight.flown(), USAGE, str(error)) from error
        except InfrastructureError as error:
            raise _cut(self._cut_at_arrival(flight.flown()), str(error)) from error
        except KeyboardInterrupt as error:
            raise _Cut(self._cut_at_arrival(flight.flown()), INTERRUPTED, "interrupted") from error

    def _over_the_wire(self, on_rows: tuple[Take, Take]) -> Flown:
        try:
            with claimed(0 if self.needs_first else self._instance, *PORTS) as instance:
                if self._instance is None and instance and not self._beside:
                    self._note(f"instance {instance}: those before it are in use")
                return self._fly_pair(instance, on_rows)
        except OSError as error:
            raise _cut(_nothing(), str(error.strerror or error)) from error

    def _fly_pair(self, instance: int, on_rows: tuple[Take, Take]) -> Flown:
        if self._zenoh is not None:
            self._note(f"published as instance {instance} (gcs monitor --instance {instance})")
        flight: WireFlight
        if self._scene.controller:
            flight = ForeignFlight(
                self._scene, self._opens_s, self.folder, instance, self._speed, on_rows,
                self._progress,
            )  # fmt: skip
        elif self._scene.script:
            speed = self._speed or self._scene.pace
            flight = _by_script(speed)(
                self._scene, self.folder, instance, speed, on_rows,
                self._progress, self._zenoh, flies(self._mission, self._scene, self._scene.airframe),
                self._note, (lambda: None) if self._compiling is None else self._compiling.look,
            )  # fmt: skip
        else:
            flight = WireFlight(
                self._scene, self.folder, instance, self._speed, on_rows, self._progress, self._zenoh,
                flies(self._mission, self._scene, self._scene.airframe), self._note,
                (lambda: None) if self._compiling is None else self._compiling.look,
            )  # fmt: skip
        try:
            flown = self._cut_at_arrival(flight.fly())
            if flown.script is not None and flown.script.failure in DIED:
                raise _Cut(flown, INFRASTRUCTURE, flown.script.text)
            return flown
        except Misused as error:
            raise _Cut(flight.flown(), USAGE, str(error)) from error
        except InfrastructureError as error:
            raise _cut(self._cut_at_arrival(flight.flown()), str(error)) from error
        except KeyboardInterrupt as error:
            raise _Cut(self._cut_at_arrival(flight.flown()), INTERRUPTED, "interrupted") from error

    def _cut_at_arrival(self, flown: Flown) -> Flown:
        arrived_s = arrival(self._scene, flown.plant, flown.fcu)
        if arrived_s is None:
            return flown
        plant, fcu = (rows[rows[:, 0] <= arrived_s] for rows in (flown.plant, flown.fcu))
        return replace(flown, plant=plant, fcu=fcu, arrived=True)

    def _metadata(self) -> dict[str, str]:
        mission = self._mission
        flown = {LAW: self._law.name, LAW_SOURCES: self._law.digest}
        if mission.controller:
            command = shlex.join(mission.controller)
            flown = {CONTROLLER: command, AIRFRAME_FILE: mission.airframe.text}
        return {
            **flown,
            "mission": mission.name,
            "title": mission.title,
            "seed": str(mission.flight.seed),
            "rate_hz": str(self._scene.rate_hz),
            **{f"version.{k}": v for k, v in versions().items()},
            VALUES: json.dumps(_values(mission)),
            AIRFRAME: mission.airframe.name,  # not where it is
            AIRFRAME_SHA256: mission.airframe.sha256,
            "believed_drag": str(list(mission.airframe.drag)),
            **({BUILDINGS: json.dumps(found)} if (found := _buildings(self._scene)) else {}),
        }


def flies(
    mission: Mission | None, scene: Scenario | None, airframe: AirframeFile
) -> dict[str, Any]:
    """What a vehicle that is published says of what it flies."""
    vehicle = flies_with(airframe)
    if mission is None or scene is None:
        return {"mission": None, **vehicle, "versions": versions()}
    return {
        **vehicle,
        "mission": mission.name,
        "title": mission.title,
        "seed": mission.flight.seed,
        "rate_hz": scene.rate_hz,
        VALUES: _values(mission),
        **({BUILDINGS: found} if (found := _buildings(scene)) else {}),
        "versions": versions(),
    }


def _buildings(scene: Scenario) -> list[Box]:
    """The buildings that a flight has about it."""
    layer = None if scene.layers is None else scene.layers.field
    return [] if layer is None else boxes(opened(Path(layer.path)).field, layer.origin_m)


def _values(mission: Mission) -> dict[str, Any]:
    """Dotted key -> value in force and where it came from."""
    return {name: asdict(value) for name, value in mission.values_in_force().items()}


def heading(mission: Mission) -> str:
    """The title, and what was changed from the command line: of a law's or an airframe's file the name."""
    changes = mission.changes()
    for whole in (mission.given.get("law", {}).get("module"), mission.given.get("airframe")):
        if isinstance(whole, str):
            name = written(Path(whole).name)
            changes = [
                change.replace(f" = {written(whole)} (", f" = {name} (") for change in changes
            ]
    return f"{mission.title} ({', '.join(changes)})" if changes else mission.title


def _by_script(speed: float | None) -> type[ScriptFlight]:
    """How a script flies at that pace. None: time stands until it has answered."""
    return HeldFlight if speed is None else ScriptFlight


def _drop(_rows: Rows) -> None:
    """Of a flight that nobody wants."""


class _Cut(Exception):
    """A flight that could not be brought to its end; what was flown of it."""

    def __init__(self, flown: Flown, exit_code: int, error: str) -> None:
        super().__init__(error)
        self.flown, self.exit_code, self.error = flown, exit_code, error


def _cut(flown: Flown, why: str) -> _Cut:
    """Cut short by what flies it."""
    at = flown.plant[-1, 0] if len(flown.plant) else 0.0
    return _Cut(flown, INFRASTRUCTURE, f"{why} (last simulation time {at:.3f} s)")


def _nothing() -> Flown:
    return Flown(np.zeros((0, 0)), np.zeros((0, 0)))


def _spoilt(judged: Result, exit_code: int, error: str) -> Result:
    """A result of which something could not be kept; what went wrong first stays its error."""
    worst = max(exit_code, judged.exit_code)
    return replace(judged, passed=False, exit_code=worst, error=judged.error or error)


def _flown_versions(mission: Mission) -> dict[str, str]:
    """`versions`, and of law, airframe and truth; of a controller of somebody else's nothing is known."""
    law = {} if mission.controller else {"law": mission.flown.identity}
    own = {**law, "airframe": mission.airframe.identity}
    return {**versions(), **own, "truth": truth(mission.airframe).identity}


def versions() -> dict[str, str]:
    """What flew: the package, and what its numbers depend on."""
    names = ("m-mrac", "numpy", "numba", "pymavlink", "mcap", "protobuf")
    found = {name: version(name) for name in names}
    return {**found, "python": platform.python_version(), "machine": platform.machine(),
            "system": os.uname().sysname if hasattr(os, "uname") else platform.system()}  # fmt: skip
