"""Missions: a TOML file read, checked, and changed from the command line.

    mission = override(load("paper_nominal"), "law.f_m=1.4")

What is wrong with a file is said with its line, its key and what was expected there.
"""

from __future__ import annotations

import copy
import json
import math
import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import files
from os.path import exists, isdir, isfile
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import ValidationError

from fcu.interface.airframe import AirframeFile
from fcu.interface.files import input_file, toml_file
from fcu.interface.files.input_file import TomlError, plain, shortened, written
from fcu.interface.files.spelling import suggestion
from fcu.interface.files.toml_file import FileError, place
from fcu.interface.files.toml_lines import KeyPath
from fcu.laws import loader
from fcu.laws.loader import Law, LawError
from fcu.parameters import GivenError, chosen
from fcu.process.configuration import ConfigurationError, read_airframe
from gcs_tools.missions import items, plan_file, problems
from gcs_tools.missions.fields import Table
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.plan_file import PlanError
from gcs_tools.missions.tables import Plant, Vehicle, Wind, document
from gcs_tools.missions.trajectory import last_change_s, setpoint_at, setpoint_times

__all__ = [
    "Mission", "MissionError", "Value", "as_toml", "folder", "from_tables", "is_foreseen", "last_change_s", "load",
    "override", "refuse_script", "setpoint_at", "setpoint_times", "with_airframe", "with_controller", "with_law",
]  # fmt: skip


MOST_BYTES = 2 * input_file.MIB  # of a file: room for some 40,000 setpoints


class MissionError(input_file.PlainError):
    """A mission that cannot be flown: file, line, key and what was expected, one line each."""

    KEPT = "\n"


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
    hint = (
        f" (did you mean {meant[0]}?)" if meant else suggestion(name, [*known, *inside, *folders])
    )
    also = "" if of else "".join(f", {each}/..." for each in folders)
    raise MissionError(f"{plain(name)}: no such mission{hint}; there are {', '.join(known)}{also}")


def _shown(path: Path) -> str:
    """`path` for a message, from the working directory where it lies below it."""
    try:
        return plain(str(path.resolve().relative_to(Path.cwd())))
    except (ValueError, RuntimeError, OSError):  # or it is a link to itself
        return plain(str(path))


# --- checking


def load(name_or_path: str | Path, settings: Iterable[str] = ()) -> Mission:
    """A shipped mission by its name, or any by its file; `settings` as for `override`.

    Raises MissionError.
    """
    path = _path(str(name_or_path))
    source = _shown(path)
    if plan_file.is_plan(path):
        mission = _of_plan(path, source)
        for setting in once(settings):
            mission = override(mission, setting)
        return mission
    text = ""
    try:
        text = toml_file.text_of(path, MOST_BYTES, source)
        file = toml_file.parsed(text, source)
    except FileError as error:
        if not text:
            raise MissionError(str(error)) from error
        if plan_file.looks_like_one(text):
            ends = " or ".join(plan_file.SUFFIXES)
            raise MissionError(f"{source}: a plan: its name has to end in {ends}") from error
        if path.suffix != ".toml":
            ends = ", ".join((".toml", *plan_file.SUFFIXES))
            raise MissionError(
                f"{source}: expected a mission or a plan, a file whose name ends in one of {ends}"
            ) from error
        raise MissionError(str(error)) from error
    mission = _checked(path.stem, source, path.parent, file.tables, {}, file.lines)
    for setting in once(settings):
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


def once(
    settings: Iterable[str], option: str = "--set", params: Iterable[str] = ()
) -> list[str]:  # fmt: skip
    """Settings of the form KEY=VALUE, each of another key. Raises MissionError for a key that is given twice.

    A table after a key in it gives that key twice, since the table replaces all of its keys. Before it, it may stand.
    params : NAME=VALUE each, parameters of the vehicle that are set beside them (--param).
    """
    given = [(f"vehicle.params.{_key(each)}", f"--param {shortened(each)}") for each in params]
    given += ((_key(each), shortened(each)) for each in settings)
    found: dict[str, str] = {}
    for key, said in given:
        for other, before in found.items():
            if key == other:
                both = f"given twice, as {before} and {said}: expected it once"
                raise MissionError(f"{option} {shortened(key)}: {both}")
            if other.startswith(f"{key}."):
                table = shortened(key)
                both = f"given twice, as {before} and {said}"
                raise MissionError(
                    f"{option} {table}: {both}: expected the table {table} first, or without them"
                )
        found[key] = said
    return list(settings)


def _key(setting: str) -> str:
    """The key of KEY=VALUE."""
    return setting.partition("=")[0].strip()


def override(mission: Mission, setting: str, option: str = "--set") -> Mission:
    """`mission` with TABLE.KEY=VALUE changed. A VALUE of one word needs no quotes.

    `option` is the origin that the value is reported with. Raises MissionError.
    """
    key, value, written = parsed_setting(setting, option)
    said = setting if option == "--set" else written  # an option of its own has its value alone
    return with_values(mission, {key: value}, option, shortened(said))


def with_parameter(mission: Mission, written: str) -> Mission:
    """`mission` with NAME=VALUE of a parameter of the vehicle (--param). Raises MissionError."""
    name, _, value = (part.strip() for part in written.partition("="))
    try:
        if not re.fullmatch(r"\w+", name):
            raise ValueError
        number = float(value)
    except ValueError:
        said = f"--param {shortened(written)}: expected NAME=VALUE with a number"
        raise MissionError(said) from None
    return with_values(mission, {f"vehicle.params.{name}": number}, "--param", shortened(written))


def parsed_setting(setting: str, option: str = "--set") -> tuple[str, Any, str]:
    """Key, value and written value of TABLE.KEY=VALUE. Raises MissionError."""
    key, equals, written = (part.strip() for part in setting.partition("="))
    if not equals or not re.fullmatch(r"[\w-]+(\.[\w-]+)*", key) or not written:
        wrong = ""
        if equals and written and (odd := re.search(r"[^\w.-]", key)):
            wrong = f", a key of letters, digits, _ and -, got {odd[0]!r} in it"
        raise MissionError(f"{option} {plain(shortened(setting))}: expected TABLE.KEY=VALUE{wrong}")
    try:
        value = input_file.toml(f"value = {written}")["value"]
    except TomlError as error:
        if not re.fullmatch(r"[A-Za-z_][\w-]*", written):
            quoted = f"{key}=" + json.dumps(written)
            raise MissionError(
                f"{option} {shortened(setting)}: expected a TOML value, got {shortened(written)} (a text"
                f" stands in quotes: {shortened(shlex.quote(quoted))})"
            ) from error
        value = written
    if key.count(".") >= input_file.DEEPEST:
        raise MissionError(f"{option} {shortened(setting)}: expected TABLE.KEY=VALUE")
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
    made = _checked(mission.name, where or f"--law {plain(law)}", mission.folder, given, changed)
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
    said = where or f"--airframe {plain(airframe)}"
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
    parameters: Mapping[str, float], flight: Flight, source: str, found: Mapping[KeyPath, int]
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
    at = place(source, found, ("expect", "fence_breached"))
    raise MissionError(f"{at}: [expect] fence_breached: {why}")


def _checked(
    name: str, source: str, folder: Path, given: dict[str, Any], changed: Mapping[KeyPath, str],
    found: Mapping[KeyPath, int] = MappingProxyType({}), flown: Law | None = None, airframe: AirframeFile | None = None,
) -> Mission:  # fmt: skip
    """Check tables, whose keys stand on the lines `found`.

    flown, airframe : if they are read already: a mission flies what it was read with.
    """

    def where(*path: str | int) -> str:
        return place(source, found, path)

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
                    raise MissionError(
                        f"{where('plant', table, i, 'rotor')}: [plant] {table}[{i}].rotor: expected 1 to {airframe.rotors.n}, the"
                        f" rotors of {airframe.name}, got {loss.rotor}"
                    )
        for i, each in enumerate(tables.plant.faults):
            if (late := each.delay_s) is not None and round(late * tables.flight.rate_hz) == 0:
                raise MissionError(
                    f"{where('plant', 'faults', i, 'delay_s')}: [plant] faults[{i}].delay_s: a delay of {late:g} s changes nothing: expected a"
                    f" tick or more ({1.0 / tables.flight.rate_hz:g} s)"
                )
        parameters = chosen(tables.vehicle.params, flown, airframe.tables)
        if tables.expect.fence_breached is not None:  # type: ignore[attr-defined]
            _check_fence(parameters, tables.flight, source, found)
    except GivenError as error:
        at = where("vehicle", "params", error.name)
        raise MissionError(f"{at}: [vehicle.params] {error}") from error
    except OSError as error:  # of a law whose name no file can have
        at = where("law", "module")
        name = plain(str(error.filename))
        raise MissionError(f"{at}: [law] module: {name}: {error.strerror}") from error
    except ConfigurationError as error:
        raise MissionError(f"{where('airframe')}: airframe: {error}") from error
    except LawError as error:
        raise MissionError(f"{where('law', 'module')}: [law] module: {error}") from error
    except ValidationError as error:
        raise MissionError(problems.told(error, kind, source, found)) from error
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
