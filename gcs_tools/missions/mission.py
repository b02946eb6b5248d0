"""Missions: a TOML file read, checked, and changed from the command line.

    mission = override(load("paper_nominal"), "law.f_m=1.4")

What is wrong with a file is said with its line, its key and what was expected there.
"""

from __future__ import annotations

import copy
import difflib
import json
import math
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import files
from os.path import exists, isdir, isfile
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from fcu.interface import input_file
from fcu.interface.airframe import AirframeFile
from fcu.interface.input_file import TomlError
from fcu.interface.toml_lines import KeyPath, lines, nearest
from fcu.laws import loader
from fcu.laws.loader import Law, LawError
from fcu.parameters import GivenError, chosen
from fcu.process.configuration import ConfigurationError, read_airframe
from gcs_tools.judging.metrics import RENAMED
from gcs_tools.missions import items, plan_file
from gcs_tools.missions.fields import Table
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.plan_file import PlanError
from gcs_tools.missions.tables import Document, Plant, Vehicle, Wind, document
from gcs_tools.missions.trajectory import last_change_s, setpoint_at, setpoint_times

__all__ = [
    "Mission", "MissionError", "Value", "as_toml", "folder", "from_tables", "is_foreseen", "last_change_s", "load",
    "override", "refuse_script", "setpoint_at", "setpoint_times", "with_airframe", "with_controller", "with_law",
    "written",
]  # fmt: skip


MOST_BYTES = 2 * input_file.MIB  # of a file: room for some 40,000 setpoints
TOLD = 20  # problems of a file at most, each a line


class MissionError(ValueError):
    """A mission that cannot be flown: file, line, key and what was expected, one line each."""


@dataclass(frozen=True)
class Value:
    """A value in force, and where it came from (an airframe file, mission, --set)."""

    value: Any
    origin: str


@dataclass(frozen=True)
class Mission:
    """A mission file that may be flown."""

    name: str
    source: str  # the file, as messages name it
    folder: Path  # where relative names in it begin
    title: str
    flown: Law  # the law that it flies
    airframe: AirframeFile  # the vehicle that it flies with, as believed; with what it pins
    flight: Flight
    law: Any  # the table of the law's parameters
    wind: Wind
    plant: Plant
    vehicle: Vehicle
    expect: Table
    given: Mapping[str, Any]  # the tables as written, with what was changed since
    changed: Mapping[KeyPath, str]  # key -> the option that changed it
    controller: tuple[
        str, ...
    ] = ()  # command of a process in place of fcu; empty: fcu flies `flown`
    lines: Mapping[KeyPath, int] = field(default_factory=dict)  # of the keys of the file
    parameters: Mapping[str, float] = field(default_factory=dict)  # the vehicle's, as it keeps them

    def placed(self, key: str, origin: str) -> str:
        """The origin of the value of a dotted key, with the line where a file sets it."""
        path: KeyPath = tuple(key.split("."))
        line = None
        if origin == "mission":
            line = self.lines.get(path)
        elif origin == self.airframe.path.name:
            line = self.airframe.lines.get(("law", self.flown.name, *path[1:]))
        return origin if line is None else f"{origin}:{line}"

    def expectations(self) -> dict[str, Any]:
        """[expect] as plain values: metric -> { limit or at_least, from, to }, ended -> a word."""
        return self.expect.model_dump(by_alias=True, exclude_none=True)

    def items(self) -> list[dict[str, Any]]:
        """[[flight.items]] as plain values, each with its `expect`."""
        return [item.model_dump(by_alias=True, exclude_none=True) for item in self.flight.items]

    def changes(self) -> list[str]:
        """What was changed from the command line: `law.f_m = 1.5 (--set)`."""
        found = []
        for path, option in self.changed.items():
            value: Any = self.given
            for key in path:
                value = value[key]
            found.append(f"{'.'.join(map(str, path))} = {written(value)} ({option})")
        return found

    def values_in_force(self) -> dict[str, Value]:
        """Dotted key -> value and origin, for all that the flight depends on.

        Origins: default, the airframe's file, that of its truth, mission, or the option that changed it.
        """
        from gcs_tools.missions.values import values_in_force

        return values_in_force(self)


# --- finding


def folder() -> Path:
    """Where the shipped missions are: in the package, or in the checkout it is used from."""
    package = Path(str(files("gcs_tools")))
    shipped = package / "missions" / "shipped"
    return shipped if shipped.is_dir() else package.parent / "missions"


CAMPAIGNS = "campaigns"  # the folder beside the missions that has none


def shipped(of: str = "") -> list[str]:
    """Names of the shipped missions, or of those in a folder of them: benchmark/steps."""
    return [f"{of}/{p.stem}" if of else p.stem for p in sorted((folder() / of).glob("*.toml"))]


def members(name: str) -> list[str]:
    """The shipped missions of a folder that is named like a mission (benchmark). Else the name alone."""
    if name != CAMPAIGNS and "/" not in name and not exists(name) and shipped(name):
        return shipped(name)
    return [name]


def _path(name: str) -> Path:
    path, of = folder() / f"{name}.toml", name.rpartition("/")[0]
    # of os.path: of a name that no file can have these are false, where those of Path raise
    if isfile(path) and not isfile(name) and of != CAMPAIGNS:
        return path  # also of a folder of them: benchmark/steps
    ours = not of or ((folder() / of).parent == folder() and isdir(folder() / of))
    if (
        name.endswith((".toml", *plan_file.SUFFIXES))
        or exists(name)
        or of in (".", "..")
        or not ours
    ):
        return Path(name)
    known = shipped(of)
    folders = [each.name for each in sorted(folder().iterdir()) if shipped(each.name)]
    folders.remove(CAMPAIGNS)
    if of == CAMPAIGNS:
        raise MissionError(f"{name}: expected a mission; campaigns are flown by gcs campaign")
    if name in folders:
        raise MissionError(
            f"{name}: expected a mission, got a folder of them: {', '.join(shipped(name))}"
        )
    inside = [path for each in folders for path in shipped(each)]
    meant = [path for path in inside if path.rpartition("/")[2] == name]
    hint = f" (did you mean {meant[0]}?)" if meant else _meant(name, [*known, *inside, *folders])
    also = "" if of else "".join(f", {each}/..." for each in folders)
    raise MissionError(f"{name}: no such mission{hint}; there are {', '.join(known)}{also}")


def _shown(path: Path) -> str:
    """`path` from the working directory, where it lies below it."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except (ValueError, RuntimeError, OSError):  # or it is a link to itself
        return str(path)


def _meant(word: str, known: list[str]) -> str:
    close = difflib.get_close_matches(word, known, n=1)
    return f" (did you mean {close[0]}?)" if close else ""


# --- checking


def load(name_or_path: str | Path, settings: Iterable[str] = ()) -> Mission:
    """A shipped mission by its name, or any by its file; `settings` as for `override`.

    Raises MissionError.
    """
    path = _path(str(name_or_path))
    source = _shown(path)
    if plan_file.is_plan(path):
        mission = _of_plan(path, source)
        for setting in settings:
            mission = override(mission, setting)
        return mission
    try:
        text = input_file.text(path, MOST_BYTES)
        given = input_file.toml(text)
    except OSError as error:
        raise MissionError(f"{source}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise MissionError(f"{source}: expected UTF-8 text ({error.reason})") from error
    except TomlError as error:
        if plan_file.looks_like_one(text):
            ends = " or ".join(plan_file.SUFFIXES)
            raise MissionError(f"{source}: a plan: its name has to end in {ends}") from error
        if path.suffix != ".toml":
            ends = ", ".join((".toml", *plan_file.SUFFIXES))
            raise MissionError(
                f"{source}: expected a mission or a plan, a file whose name ends in one of {ends}"
            ) from error
        where = source if error.line is None else f"{source}:{error.line}"
        raise MissionError(f"{where}: {error}") from error
    mission = _checked(path.stem, source, path.parent, given, {}, text)
    for setting in settings:
        mission = override(mission, setting)
    return mission


def _of_plan(path: Path, source: str) -> Mission:
    """The mission that a plan file is by itself: from the ground, in still air, until it is complete."""
    try:
        plan = plan_file.read(path)
        reach, most = plan.reach_m, plan.most_s
    except PlanError as error:
        raise MissionError(str(error)) from error
    flight = {
        "duration_s": min(math.ceil(most), 3600), "ground_z_m": 0.0,
        "start": {"on_ground": True}, "arena_m": max(100.0, math.ceil(2.0 * reach + 100.0)),
        "plan": path.name,
    }  # fmt: skip
    given = {"title": f"The vehicle flies the plan {path.name}.", "flight": flight}
    return _checked(path.stem, source, path.parent, given, {})


def called(name_or_path: str) -> str:
    """The name of the mission of a name or a file, whether it can be read or not."""
    return Path(name_or_path).name.removesuffix(".toml")


def from_tables(name: str, given: Mapping[str, Any]) -> Mission:
    """A mission from tables that a program has made. Raises MissionError."""
    return _checked(name, name, Path(), dict(given), {})


def as_toml(given: Mapping[str, Any], said: str) -> str:
    """A mission's tables as the text of a file, each value in full.  said : a comment, its first line."""
    plain = [f"{k} = {written(v)}" for k, v in given.items() if not isinstance(v, Mapping)]
    lines = [f"# {said}", *plain]
    for name, table in given.items():
        if isinstance(table, Mapping):
            lines += [
                "",
                f"[{name}]",
                *(f"{key} = {written(value)}" for key, value in table.items()),
            ]
    return "\n".join(lines) + "\n"


def override(mission: Mission, setting: str, option: str = "--set") -> Mission:
    """`mission` with TABLE.KEY=VALUE changed. A VALUE of one word needs no quotes.

    `option` is the origin that the value is reported with. Raises MissionError.
    """
    key, value, written = parsed_setting(setting, option)
    said = setting if option == "--set" else written  # an option of its own has its value alone
    return with_values(mission, {key: value}, option, _short(said))


def with_parameter(mission: Mission, written: str) -> Mission:
    """`mission` with NAME=VALUE of a parameter of the vehicle (--param). Raises MissionError."""
    name, _, value = (part.strip() for part in written.partition("="))
    try:
        if not re.fullmatch(r"\w+", name):
            raise ValueError
        number = float(value)
    except ValueError:
        said = f"--param {_short(written)}: expected NAME=VALUE with a number"
        raise MissionError(said) from None
    return with_values(mission, {f"vehicle.params.{name}": number}, "--param", _short(written))


def parsed_setting(setting: str, option: str = "--set") -> tuple[str, Any, str]:
    """Key, value and written value of TABLE.KEY=VALUE. Raises MissionError."""
    key, equals, written = (part.strip() for part in setting.partition("="))
    if not equals or not re.fullmatch(r"[\w-]+(\.[\w-]+)*", key) or not written:
        raise MissionError(f"{option} {setting}: expected TABLE.KEY=VALUE")
    try:
        value = input_file.toml(f"value = {written}")["value"]
    except TomlError as error:
        if not re.fullmatch(r"[A-Za-z_][\w-]*", written):
            quoted = f"{key}=" + json.dumps(written)
            raise MissionError(
                f"{option} {_short(setting)}: expected a TOML value, got {_short(written)} (a text"
                f" stands in quotes: {_short(shlex.quote(quoted))})"
            ) from error
        value = written
    if key.count(".") >= input_file.DEEPEST:
        raise MissionError(f"{option} {_short(setting)}: expected TABLE.KEY=VALUE")
    return key, value, written


def with_values(
    mission: Mission, values: Mapping[str, Any], option: str, said: str = ""
) -> Mission:
    """`mission` with the values of dotted keys changed, of the origin `option`. Raises MissionError.

    said : what messages name beside the option.
    """
    source = f"{option} {said}".rstrip()
    given: dict[str, Any] = copy.deepcopy(dict(mission.given))
    changed = dict(mission.changed)
    for key, value in values.items():
        *tables, last = names = key.split(".")
        table: Any = given
        for name in tables:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise MissionError(f"{source}: {name} is not a table")
        table[last] = value
        changed[tuple(names)] = option
    is_same_law = ("law", "module") not in {tuple(key.split(".")[:2]) for key in values}
    flown = mission.flown if is_same_law and "law" not in values else None
    same = flown is not None and "airframe" not in values
    made = _checked(
        mission.name, source, mission.folder, given, changed, flown=flown,
        airframe=mission.airframe if same else None,
    )  # fmt: skip
    return replace(made, source=mission.source, lines=mission.lines)


def with_law(mission: Mission, law: str, where: str = "") -> Mission:
    """`mission` flown by another law: a name, or a FILE.py from the working directory.

    where : what messages name in place of the option. The [law] values of the mission are those of
    its own law, and left out. Raises MissionError.
    """
    given = {**mission.given, "law": {"module": str(Path(law).absolute()) if "." in law else law}}
    changed = {path: option for path, option in mission.changed.items() if path[0] != "law"}
    changed["law", "module"] = "--law"
    made = _checked(mission.name, where or f"--law {law}", mission.folder, given, changed)
    return (
        mission
        if made.flown is mission.flown
        else replace(made, source=mission.source, lines=mission.lines)
    )


def with_airframe(mission: Mission, airframe: str, where: str = "") -> Mission:
    """`mission` flown with another vehicle: a name, or a FILE.toml from the working directory.

    where : what messages name in place of the option. Raises MissionError.
    """
    found = str(Path(airframe).absolute()) if airframe.endswith(".toml") else airframe
    given = {**mission.given, "airframe": found}
    changed = {**mission.changed, ("airframe",): "--airframe"}
    said = where or f"--airframe {airframe}"
    made = _checked(mission.name, said, mission.folder, given, changed, flown=mission.flown)
    return replace(made, source=mission.source, lines=mission.lines)


def allowed(mission: Mission, commands: bool) -> None:
    """Raise MissionError for a mission with a script, unless commands are allowed."""
    if (script := mission.flight.script) is not None and not commands:
        raise MissionError(
            f"{mission.source}: [flight] script: this mission runs a command of its own,"
            f" {script!r}. Read it, and allow it with --allow-commands (allow_commands=True)"
        )


def refuse_script(mission: Mission, what: str) -> None:
    """Raise MissionError for a mission with a script, which `what` cannot use."""
    if mission.flight.script is not None:
        raise MissionError(
            f"{mission.source}: [flight] script: {what} does not run scripts, and what a script asks"
            " for is not known. Fly this mission with gcs fly --allow-commands"
        )


def is_foreseen(mission: Mission) -> bool:
    """Tell whether the setpoints are known before the flight: not those of scripts and plans."""
    planned = any(isinstance(item, items.Plan) for item in mission.flight.items)
    return mission.flight.script is None and not planned


def with_controller(mission: Mission, command: tuple[str, ...]) -> Mission:
    """`mission` flown by a process of somebody else's in place of fcu: its command.

    Its [law] is that of fcu, and left out. Raises MissionError for one that is set from the command
    line, and for items that only an autopilot does.
    """
    for path, option in mission.changed.items():
        if path[0] == "law":
            key = ".".join(map(str, path))
            raise MissionError(
                f"{option} {key}: a controller of your own has no [law] (leave it out)"
            )
    if mission.flight.script is not None:
        raise MissionError(
            f"{mission.source}: [flight] script: a controller of your own is sent setpoints, and no"
            " commands (leave out --controller)"
        )
    if mission.parameters:
        raise MissionError(
            f"{mission.source}: [vehicle.params] {next(iter(mission.parameters))}: a controller of your"
            " own has no such parameters (leave them out)"
        )
    for i, item in enumerate(mission.flight.items):
        if item.kind in items.OF_AN_AUTOPILOT:
            raise MissionError(
                f"{mission.source}: [flight] items[{i}]: {item.kind} is done by an autopilot; a"
                f" controller of your own is sent setpoints (go_to, follow, hold)"
            )
    given = {name: table for name, table in mission.given.items() if name != "law"}
    made = _checked(mission.name, mission.source, mission.folder, given, mission.changed)
    return replace(made, controller=command, lines=mission.lines)


def _check_fence(
    parameters: Mapping[str, float], flight: Flight, source: str, found: dict[KeyPath, int]
) -> None:
    """Raise MissionError where no breach of a fence would be told, whatever is flown."""
    has_own = flight.script is not None or any(item.kind == "plan" for item in flight.items)
    limits = ("GF_MAX_HOR_DIST", "GF_MAX_VER_DIST")
    if parameters.get("GF_ACTION") == 0.0:
        why = "with GF_ACTION 0 a vehicle watches no fence"
    elif has_own or any(parameters.get(name, 0.0) > 0.0 for name in limits):
        return
    else:
        why = f"the flight has no fence (a plan's, or [vehicle.params] {' or '.join(limits)})"
    line = nearest(found, ("expect", "fence_breached"))
    where = source if line is None else f"{source}:{line}"
    raise MissionError(f"{where}: [expect] fence_breached: {why}")


def _checked(
    name: str, source: str, folder: Path, given: dict[str, Any], changed: Mapping[KeyPath, str],
    text: str = "", flown: Law | None = None, airframe: AirframeFile | None = None,
) -> Mission:  # fmt: skip
    """Checked tables. `flown`, `airframe`: if they are read already: a mission flies what it was read with."""
    found = lines(text)
    module = given["law"].get("module") if isinstance(given.get("law"), dict) else None
    try:
        if flown is None:
            flown = loader.load(module if isinstance(module, str) else loader.DEFAULT, folder)
        kind = document(flown)
        tables = kind.model_validate(given, context={items.FOLDER: folder})
        airframe = airframe or read_airframe(flown, tables.airframe, folder)
        for table in ("rotor_loss", "faults"):
            for i, loss in enumerate(getattr(tables.plant, table)):
                if (loss.rotor or 0) > airframe.rotors.n:
                    line = nearest(found, ("plant", table, i, "rotor"))
                    where = source if line is None else f"{source}:{line}"
                    raise MissionError(
                        f"{where}: [plant] {table}[{i}].rotor: expected 1 to {airframe.rotors.n}, the"
                        f" rotors of {airframe.name}, got {loss.rotor}"
                    )
        for i, each in enumerate(tables.plant.faults):
            if (late := each.delay_s) is not None and round(late * tables.flight.rate_hz) == 0:
                line = nearest(found, ("plant", "faults", i, "delay_s"))
                where = source if line is None else f"{source}:{line}"
                raise MissionError(
                    f"{where}: [plant] faults[{i}].delay_s: a delay of {late:g} s changes nothing: expected a"
                    f" tick or more ({1.0 / tables.flight.rate_hz:g} s)"
                )
        parameters = chosen(tables.vehicle.params, flown, airframe.tables)
        if tables.expect.fence_breached is not None:  # type: ignore[attr-defined]
            _check_fence(parameters, tables.flight, source, found)
    except GivenError as error:
        line = nearest(found, ("vehicle", "params", error.name))
        where = source if line is None else f"{source}:{line}"
        raise MissionError(f"{where}: [vehicle.params] {error}") from error
    except OSError as error:  # of a law whose name no file can have
        line = nearest(found, ("law", "module"))
        where = source if line is None else f"{source}:{line}"
        raise MissionError(f"{where}: [law] module: {error.filename}: {error.strerror}") from error
    except ConfigurationError as error:
        line = nearest(found, ("airframe",))
        where = source if line is None else f"{source}:{line}"
        raise MissionError(f"{where}: airframe: {error}") from error
    except LawError as error:
        line = nearest(found, ("law", "module"))
        where = source if line is None else f"{source}:{line}"
        raise MissionError(f"{where}: [law] module: {error}") from error
    except ValidationError as error:
        told = list(_problems(error, kind, source, found))
        if more := len(told) - TOLD:
            told[TOLD:] = [f"{source}: and {more} more"] if more > 0 else []
        raise MissionError("\n".join(told)) from error
    return Mission(
        name=name,
        source=source,
        folder=folder,
        title=tables.title,
        flown=flown,
        airframe=airframe,
        flight=tables.flight,
        law=tables.law,
        wind=tables.wind,
        plant=tables.plant,
        vehicle=tables.vehicle,
        expect=tables.expect,
        given=given,
        changed=changed,
        lines=found,
        parameters=parameters,
    )


# --- what is wrong, in words

_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "finite_number": "a finite number",
    "string_type": "a text",
    "bool_type": "true or false",
    "model_type": "a table",
    "tuple_type": "an array",
    "greater_than": "a number > {gt:g}",
    "greater_than_equal": "a number >= {ge:g}",
    "less_than": "a number < {lt:g}",
    "less_than_equal": "a number <= {le:g}",
    "literal_error": "{expected}",
    "too_short": "{min_length} elements or more",
    "mission": "{expected}",
}
_NOTHING = object()


def _problems(
    error: ValidationError, kind_of: type[Document], source: str, found: dict[KeyPath, int]
) -> Iterator[str]:
    """One line for each problem, in the order of the file. `kind_of`: what it should have been."""
    placed = []
    problems = error.errors(include_url=False)
    lacking: dict[KeyPath, int] = {}  # by array: the last index that it lacks
    for problem in problems:
        if problem["type"] == "missing" and isinstance(last := problem["loc"][-1], int):
            array = problem["loc"][:-1]
            lacking[array] = max(last, lacking.get(array, 0))
    for problem in problems:
        path: KeyPath = problem["loc"]
        path = path[:-1] if path[-1:] == ("[key]",) else path
        context, got = problem.get("ctx", {}), problem["input"]
        kind = problem["type"]
        if kind in ("mission", "because"):
            path, got = (*path, *context["key"]), context.get("got")
            got = _NOTHING if got is None else got
        if kind == "extra_forbidden":
            if path[0] == "expect" and (now := RENAMED.get(str(path[-1]))) is not None:
                said = f"this metric is called {now} now (docs/missions.md)"
            else:
                known = _known(path[:-1], kind_of)
                said = f"no such key{_elsewhere(path, kind_of) or _meant(str(path[-1]), known)}"
        elif kind == "missing":
            said = "is missing"
            if isinstance(path[-1], int):  # one such problem for each number
                if len(got) < path[-1]:
                    continue
                path = path[:-1]
                said = f"expected {lacking[path] + 1} numbers, got {_written(got)}"
        elif kind == "too_long":
            what = "numbers" if context["max_length"] <= 10 else "elements at most"
            said = f"expected {context['max_length']} {what}, got {_written(got)}"
        elif kind == "because":
            said = context["why"]
        else:
            expected = _EXPECTED.get(kind, problem["msg"]).format(**context)
            said = f"expected {expected}"
            said += "" if got is _NOTHING else f", got {_written(got)}"
        path = _as_written(_untagged(path), found)
        line = nearest(found, path)
        where = source if line is None else f"{source}:{line}"
        placed.append((line or 0, f"{where}: {_key(path, got)}: {said}"))
    return (text for _, text in sorted(placed, key=lambda item: item[0]))


def _as_written(path: KeyPath, found: dict[KeyPath, int]) -> KeyPath:
    """The key that a file has for one that is derived of it: `plan` is short for an item."""
    is_short = path[:3] == ("flight", "items", 0) and ("flight", "plan") in found
    return ("flight", "plan") if is_short else path


def _key(path: KeyPath, got: Any) -> str:
    """`[flight] setpoints[0].at_s`; `title` and tables themselves stand alone."""
    text = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path[1:]).removeprefix(".")
    if text:
        return f"[{path[0]}] {text}"
    known = Document.model_fields.get(str(path[0]))
    is_table = isinstance(got, dict) if known is None else any(_models(known.annotation))
    return f"[{path[0]}]" if is_table else str(path[0])


def _elsewhere(path: KeyPath, kind: type[Document]) -> str:
    """Where a key is that was given without its table."""
    if len(path) == 1:
        for name, field in kind.model_fields.items():
            for model in _models(field.annotation):
                if path[0] in model.model_fields:
                    return f" (did you mean {field.alias or name}.{path[0]}?)"
    return ""


def _known(path: KeyPath, kind: type[Document]) -> list[str]:
    """The keys of the table at `path`."""
    model: Any = kind
    several: list[Any] = []
    for name in path:
        if isinstance(name, str) and not name.isdecimal():  # the number of an item of a plan
            tagged = [each for each in several if name in _kinds(each)]
            if tagged:
                model = tagged[0]
                continue
            several = list(_models(model.model_fields[name].annotation))
            model = several[0]
    return [field.alias or name for name, field in model.model_fields.items()]


def _kinds(model: Any) -> tuple[str, ...]:
    """The kinds of a table that is one of several."""
    kind = model.model_fields.get("kind")
    return () if kind is None else getattr(kind.annotation, "__args__", ())


def _untagged(path: KeyPath) -> KeyPath:
    """A path without the kind that stands between an item and its key."""
    tagged = len(path) > 3 and path[:2] == ("flight", "items") and path[3] in items.KINDS
    return (*path[:3], *path[4:]) if tagged else path


def _models(kind: Any) -> Iterator[type[BaseModel]]:
    """The tables in an annotation: of `X | None`, of `tuple[X, ...]`, annotated or not."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield kind
    for part in getattr(kind, "__args__", ()):
        yield from _models(part)


def written(value: Any) -> str:
    """A value as TOML has it on one line; a table inside braces."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {written(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(written, value)) + "]"
    try:
        return json.dumps(value, ensure_ascii=False)
    except TypeError:
        return str(value)


def _written(value: Any) -> str:
    """The same, cut where it is long."""
    return _short(written(value))


def _short(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."
