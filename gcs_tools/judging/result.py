"""The verdict on one flight, as result.json, and on several, as JUnit XML.

A result is written whole or not at all, holds finite numbers only, and says which version of
its form it has; a reader refuses another one.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shlex
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from fcu.interface.event_log import Event
from fcu.interface.faults import fault, hears
from fcu.interface.files import input_file, whole_file
from gcs_tools.exit_codes import MISSED, OK, USAGE
from gcs_tools.judging import junit_report
from gcs_tools.judging.causes import causes
from gcs_tools.judging.expectations import ITEMS, LOST_ENDINGS, REACHED, Expectation, judge_each
from gcs_tools.judging.failsafes import Failsafe, VehicleTold, judge_vehicle, vehicle_told
from gcs_tools.judging.fault_check import judge_faults
from gcs_tools.judging.item_checks import (
    ItemFlown,
    good_endings,
    items_flown,
    judge_items,
    slowed,
    unfinished,
)
from gcs_tools.judging.junit_report import Case
from gcs_tools.judging.metrics import SETTLE_S, EngagedTicks, NotFinite, blocks
from gcs_tools.judging.script_check import ScriptFlown
from gcs_tools.judging.setpoint_checks import Standing, accepted, changed, standing
from gcs_tools.judging.vehicle_warnings import Warned, warnings
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.mission import Mission, Value
from gcs_tools.missions.timeline import Begun, legs, timeline
from gcs_tools.recording import notebook
from gcs_tools.recording.plans import PlanHistory
from gcs_tools.recording.schema import UNTOLD
from gcs_tools.recording.table import Rows, Table
from sitl_plant.physics.types import PlantRecord

DONE = ("landed", "done")  # how a flight ends whose items are all done
SCHEMA_VERSION = 2  # 1: metrics position_* and command_*; no warnings
ROOM_BYTES = 1 << 18  # for a result and what its folder takes; one has some 15 kB
MOST_BYTES = input_file.MIB  # of a result that is read


class ResultError(Exception):
    """A result that cannot be written or read: names the file, or the value, and the reason."""


@dataclass(frozen=True)
class Result:
    """Everything that result.json says; its keys are these names."""

    mission: str
    title: str
    passed: bool
    exit_code: int
    ended: str  # time, arrived, landed, done, script, refused, diverged, crashed, aborted; rejected: it never flew
    seed: int
    rate_hz: float
    sim_time_s: float  # first to last tick
    wall_time_s: float  # first to last tick
    real_time_factor: float
    startup_s: float  # from the command to the first tick
    ticks: int
    slips: int
    trajectory_sha256: str
    versions: dict[str, str]
    values: dict[str, Value]  # dotted name -> value in force
    expectations: list[Expectation]
    metrics: dict[str, float | None]  # None: without a value
    items: list[ItemFlown] = field(default_factory=list)  # of a mission that has items
    settle_s: float = SETTLE_S  # from where metrics are settled, and setpoints are to be reached
    folder: str = ""  # of the run, as it was named when it was flown
    changes: list[str] = field(default_factory=list)  # of the mission, from the command line
    causes: list[str] = field(default_factory=list)  # why it saturated or ended early: sentences
    not_finite: NotFinite | None = None  # what the law computed first that was no number
    warnings: list[Warned] = field(default_factory=list)  # what the vehicle warned of
    mode: str = ""  # of the vehicle, at the end
    failsafes: list[Failsafe] = field(default_factory=list)  # that acted
    controller: str = ""  # command of a controller in place of fcu, judged by the truth alone
    script: ScriptFlown | None = None  # of a mission with a script: what became of that
    error: str | None = None  # what ended the flight when the exit code is 2, 3 or 130
    schema_version: int = field(default=SCHEMA_VERSION)

    @property
    def name(self) -> str:
        """The mission, and the seed where one was asked for."""
        chosen = self.values.get("flight.seed")
        seed = f" seed {self.seed}" if chosen is not None and chosen.origin == "--seed" else ""
        return f"{self.mission}{seed}"

    def _repr_html_(self) -> str:
        """Verdict, expectations, metrics and figure, for a notebook."""
        judged = [
            (each.text, each.value, {True: "met", False: "missed", None: "left"}[each.passed])
            for each in self.expectations
        ]
        metrics = [(name, f"{v:.4g}") for name, v in self.metrics.items() if v is not None]
        verdict = "passed" if self.passed else f"failed{f': {self.error}' if self.error else ''}"
        return (
            notebook.table(f"{self.name}, {verdict}", ("expected", "measured", ""), judged)
            + notebook.table("Metrics", ("metric", "value"), metrics)
            + notebook.picture(Path(self.folder) / "flight.png")
        )

    def write(self, path: Path) -> None:
        """Replace `path` by this result, atomically and durably.

        Raises ResultError naming the first value that is not finite, or why writing failed.
        """
        content = asdict(self)
        for name, value in _numbers("", content):
            if not math.isfinite(value):
                raise ResultError(f"{path}: {name} is {value}, results are finite")
        _write(path, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


class Judged(NamedTuple):
    """What a flight has done of what was expected."""

    expectations: list[Expectation]
    metrics: dict[str, float | None]  # None: without a value
    items: list[ItemFlown]
    passed: bool
    flight: EngagedTicks
    missed: Standing | None  # the setpoint that was missed by most
    vehicle: VehicleTold  # its mode and failsafes

    @staticmethod
    def of(
        mission: Mission, rate_hz: float, plant: Rows, fcu: Rows, ended: str, begun: tuple[Begun, ...] = (),
        whole: bool = True, script: ScriptFlown | None = None, said: Iterable[Event] = (),
    ) -> Judged:  # fmt: skip
        """Measure a flight, and judge one that is `whole`. The others: as for `judge`."""
        said = list(said)
        judged: list[Expectation] = []
        missed: Standing | None = None
        tick = UNTOLD.tick if mission.controller else mission.flown.ticks.Tick
        told = Table.of(PlantRecord, plant), Table.of(tick, fcu)
        wanted = timeline(mission.flight, begun)
        scripted = (
            mission.flight.script is not None
        )  # which is held against what the vehicle accepted
        flight = (
            EngagedTicks.of(*told)
            if scripted
            else EngagedTicks.of(*told, wanted.last_change_s + SETTLE_S, wanted.positions_at)
        )
        sim_time = float(plant[-1, 0]) if len(plant) else 0.0
        items = items_flown(
            mission.flight, begun, (round(sim_time * rate_hz) + 1) / rate_hz, ended in DONE
        )
        told_of = vehicle_told(said, sim_time)
        if whole:
            faults = [fault(each.model_dump()) for each in mission.plant.faults]
            period_us = round(1e6 / rate_hz)

            def heard(tick: int) -> bool:
                return hears(faults, tick * period_us)

            stood = (
                accepted(mission.flight, *told)
                if scripted
                else standing(wanted, told[0], ended in LOST_ENDINGS)
            )
            judged = judge_each(
                mission.expectations(), flight.metric, ended, flight.why_no_value, stood,
                () if scripted else changed(wanted, told[1], heard), good_endings(mission.flight), flight.law_has,
                kept_s=math.inf if told_of.keeper is None else told_of.keeper.time_s,
            )  # fmt: skip
            judged += judge_vehicle(mission.expectations(), told_of)
            judged += judge_faults(mission.plant.faults, sim_time)
            judged += [] if script is None else script.judged()
            if any(each.name == REACHED and each.is_missed for each in judged) and stood:
                missed = max(stood, key=lambda each: each.away_m)
            of_items = [item["expect"] for item in mission.items()]
            if (numbered := mission.expectations().get(ITEMS)) is not None:  # of the one plan
                at = [item.kind for item in mission.flight.items].index("plan")
                of_items[at] = {**of_items[at], ITEMS: {**of_items[at].get(ITEMS, {}), **numbered}}
            followed = mission.expectations().get(REACHED) is not False
            judged += judge_items(
                mission.flight, of_items, items, flight, told[0], begun, followed, PlanHistory(said)
            )
        passed = whole and not any(each.is_missed for each in judged)
        return Judged(judged, flight.metrics(), items, passed, flight, missed, told_of)


def judge(
    mission: Mission, rate_hz: float, plant: Rows, fcu: Rows, *, ended: str, exit_code: int,
    error: str | None, said: Iterable[Event] = (), begun: tuple[Begun, ...] = (), refusal: str = "",
    script: ScriptFlown | None = None, **about: Any,
) -> Result:  # fmt: skip
    """The result of a flight. Of one that was cut short (an `exit_code` not OK) it judges nothing.

    plant, fcu : rows that begin with a PlantRecord, a Tick.  ended : how the flight ended, if it was not cut short.
    error : what cut it short, in words.  said : what both processes logged.  begun : the legs of its
    items.  refusal : which of them the vehicle would not do, in words.  script : what became of it, of a mission that has one.  about : wall times, slips and versions of the Result.
    """
    sim_time = float(plant[-1, 0]) if len(plant) else 0.0
    whole = exit_code == OK
    found: Judged | None = None
    if whole or (len(plant) and len(fcu)):
        said = list(said)
        found = Judged.of(mission, rate_hz, plant, fcu, ended, begun, whole, script, said)
    values = mission.values_in_force()
    passed = found is not None and found.passed
    why: list[str] = []
    if whole and found is not None:
        keeper = None if passed else found.vehicle.keeper
        why = slowed(found.items, found.expectations, found.flight)
        why += causes(mission, found.flight, ended, passed, values, found.missed, keeper)
        if mission.flight.items and ended not in DONE:
            why.insert(0, _not_done(mission.flight, begun, Table.of(PlantRecord, plant), refusal))
    wall_time = about["wall_time_s"]
    return Result(
        mission=mission.name,
        title=mission.title,
        passed=passed,
        exit_code=MISSED if exit_code == OK and not passed else exit_code,
        ended=ended if whole else "aborted",
        seed=mission.flight.seed,
        rate_hz=rate_hz,
        sim_time_s=sim_time,
        real_time_factor=sim_time / wall_time if wall_time else 0.0,
        ticks=len(fcu),
        trajectory_sha256=trajectory_sha256(plant) if len(plant) else "",
        values=values,
        expectations=[] if found is None else found.expectations,
        metrics={} if found is None else found.metrics,
        changes=mission.changes(),
        items=[] if found is None else found.items,
        causes=why,
        mode="" if found is None else found.vehicle.mode,
        failsafes=[] if found is None else list(found.vehicle.failsafes),
        not_finite=None if found is None else found.flight.first_not_finite(),
        warnings=warnings(said, sim_time),
        controller=shlex.join(mission.controller),
        script=script,
        error=error,
        **about,
    )


def _not_done(flight: Flight, begun: tuple[Begun, ...], plant: Table, refusal: str) -> str:
    """Which item it is that was not done, and why."""
    if not refusal:
        return unfinished(flight, begun, plant)
    item = legs(flight)[begun[-1].leg].item
    return f"Item {item + 1} of {len(flight.items)} ({flight.items[item].kind}): {refusal}."


def rejected(mission: str, why: str, versions: dict[str, str]) -> Result:
    """The result of a mission that cannot be flown. `mission`: its name."""
    return Result(
        mission=mission, title="", passed=False, exit_code=USAGE, ended="rejected", seed=0,
        rate_hz=0.0, sim_time_s=0.0, wall_time_s=0.0, real_time_factor=0.0, startup_s=0.0, ticks=0,
        slips=0, trajectory_sha256="", versions=versions, values={}, expectations=[], metrics={},
        error=why,
    )  # fmt: skip


def _numbers(name: str, content: Any) -> Iterable[tuple[str, float]]:
    """Every float in nested dicts and lists, with its dotted name."""
    if isinstance(content, float):
        yield name, content
    elif isinstance(content, dict):
        for key, value in content.items():
            yield from _numbers(f"{name}.{key}".lstrip("."), value)
    elif isinstance(content, list | tuple):
        for i, value in enumerate(content):
            yield from _numbers(f"{name}[{i}]", value)


@contextmanager
def reserved(folder: Path) -> Iterator[None]:
    """Room on disk for a result, held within the block: whatever else fills the disk meanwhile.

    Nobody else sees it, and it is given back however the block, or the process, ends. Where no room
    can be held (a full disk, another system) none is.
    """
    with ExitStack() as stack:
        with suppress(OSError, AttributeError):
            file = stack.enter_context(tempfile.TemporaryFile(dir=folder))
            os.posix_fallocate(file.fileno(), 0, ROOM_BYTES)
        yield


def _write(path: Path, text: str) -> None:
    """Write a file so that `path` is always either the old one or the whole new one."""
    try:
        whole_file.write(path, text.encode())
    except OSError as error:
        raise ResultError(f"{path}: {error.strerror}") from error


def read(path: Path) -> Result:
    """The result at `path`.

    Raises ResultError if it cannot be read, is no result, or is of another version.
    """
    try:
        content = json.loads(input_file.text(path, MOST_BYTES))
    except OSError as error:
        raise ResultError(f"{path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise ResultError(f"{path}: not JSON ({error})") from error
    version = content.get("schema_version") if isinstance(content, dict) else None
    if not isinstance(version, int):
        raise ResultError(f"{path}: not a result (no schema_version)")
    if version > SCHEMA_VERSION:
        raise ResultError(
            f"{path}: a result of version {version}; this program reads version {SCHEMA_VERSION}"
        )
    if version < SCHEMA_VERSION:  # its setpoint metrics were to what the vehicle made of a setpoint
        raise ResultError(
            f"{path}: a result of version {version}, with metrics that are measured otherwise now; "
            f"this program reads version {SCHEMA_VERSION} (fly the mission again, or give its recording)"
        )
    try:
        known = {f.name for f in fields(Result)}
        values = {name: Value(**entry) for name, entry in content.pop("values").items()}
        expectations = [Expectation(**entry) for entry in content.pop("expectations")]
        warned = [Warned(**entry) for entry in content.pop("warnings")]
        failsafes = [Failsafe(**entry) for entry in content.pop("failsafes", [])]
        items = [ItemFlown(**entry) for entry in content.pop("items", [])]
        broken = content.pop("not_finite", None)
        script = content.pop("script", None)
        given = {name: value for name, value in content.items() if name in known}
        found = Result(
            values=values, expectations=expectations, warnings=warned, items=items,
            failsafes=failsafes,
            not_finite=None if broken is None else NotFinite(**broken),
            script=None if script is None else ScriptFlown(**script), **given,
        )  # fmt: skip
    except (KeyError, TypeError, AttributeError) as error:
        raise ResultError(f"{path}: not a result ({error})") from error
    for name, hint in get_type_hints(Result).items():
        if not _fits(getattr(found, name), hint):
            raise ResultError(f"{path}: not a result (the value of {name} is of another type)")
    return found


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value is what a field is declared as; numbers are finite."""
    if hint is Any:
        return True
    if is_dataclass(hint):
        hints = get_type_hints(hint).items()
        return type(value) is hint and all(_fits(getattr(value, n), each) for n, each in hints)
    of = get_args(hint)
    match get_origin(hint):
        case None if hint is float:
            return type(value) in (int, float) and abs(value) <= sys.float_info.max
        case None:
            return type(value) is hint
        case kind if kind is UnionType:
            return any(_fits(value, each) for each in of)
        case kind if kind is list:
            return type(value) is list and all(_fits(each, of[0]) for each in value)
        case _:
            return type(value) is dict and all(_fits(each, of[1]) for each in value.values())


def trajectory_sha256(plant: Rows) -> str:
    """SHA-256 of t, r, v, q, w and rotor speeds of every row of the plant, little-endian float64.

    plant : float64 (n, size(PlantRecord)).
    """
    digest = hashlib.sha256()
    for block in blocks(len(plant)):
        told = Table.of(PlantRecord, plant[block])
        t, state = told["t"], told["state"]
        joined = np.column_stack([t, state]).astype("<f8", order="C", copy=False)
        digest.update(joined.data)
    return digest.hexdigest()


def junit(results: Iterable[Result], path: Path, are_scripts: bool = False) -> None:
    """Write JUnit XML: a test case a mission, a failure with each expectation missed.

    are_scripts : of `gcs test`, so that a script and a mission of one name are two test cases.
    Raises ResultError if it cannot be written.
    """
    command, kind = ("gcs test", "scripts") if are_scripts else ("gcs fly", "missions")
    _write(path, junit_report.document(command, (_case(each, kind) for each in results)))


def _case(result: Result, kind: str) -> Case:
    missed = [str(e) for e in result.expectations if e.is_missed]
    left = [str(e) for e in result.expectations if e.passed is None]
    failed = result.exit_code >= USAGE
    told = [result.title, *result.changes, *(f"[expect] {line}" for line in missed), *result.causes]
    return Case(
        kind,
        result.name,
        result.startup_s + result.wall_time_s,
        failure="" if failed or result.passed else "; ".join(missed) or result.ended,
        error=(result.error or result.ended) if failed else "",
        text="\n".join(told),
        out="\n".join(f"[expect] {line}" for line in left),
    )
