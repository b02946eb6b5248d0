"""The topics of a recording and their Protobuf schemas, derived from NamedTuples or read from a file.

One message a topic; every message starts with `t`, the simulation time. The unit and frame
that stand as a comment beside a field in the source stand as its comment in the schema. A Topic
says all that its reader needs: whoever reads a file or listens to the bus needs no NamedTuple.
`python -m gcs_tools.recording.schema FOLDER` writes the schemas as .proto text.
"""

from __future__ import annotations

import ast
import inspect
import linecache
import sys
import textwrap
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.message import DecodeError

from fcu.interface.diagnostics import PlantReport, Report, fcu_row, params_row, plant_row
from fcu.interface.messages import Setpoint
from fcu.kernel import algebra
from fcu.kernel.buffers import fields, is_value
from fcu.laws.loader import Law
from fcu.process.settings import Settings
from fcu.process.tick import Tick
from gcs_tools.recording.layout import Layout, LayoutError, layout
from sitl_plant.physics.types import PlantRecord

PACKAGE = "m_mrac"
GEOMETRY = f"{PACKAGE}/geometry.proto"
_DOUBLE = FieldDescriptorProto.TYPE_DOUBLE
_MESSAGE = FieldDescriptorProto.TYPE_MESSAGE
TRUTH, PARAMS, TIMING, PLANT_TIMING, WIND, STATUS, ASKED = (
    "/plant/truth", "/fcu/params", "/fcu/timing", "/plant/timing", "/fcu/wind", "/fcu/status",
    "/mission/setpoint",
)  # fmt: skip
TICKS = "Ticks"  # what the name of a message of several ticks ends with
_FIXED64 = FieldDescriptorProto.TYPE_FIXED64
_OF_TICKS = (
    ("sequence", _FIXED64, "number of each tick, from 0; a gap is a loss"),
    ("time_ns", _FIXED64, "simulation time of each, ns"),
    ("tick", _MESSAGE, "each"),
)
_TIME_COMMENT = "simulation time, s"


class Topic(NamedTuple):
    """One topic as its messages describe themselves, and where in a row they belong."""

    name: str
    message: str  # full name of its Protobuf message
    schema: bytes  # a serialized FileDescriptorSet that holds it
    row: str  # ticks of topics with one name for it are parts of one row; "": of none
    own: tuple[str, ...]  # fields that are columns of the row by their own name
    prefix: str  # of the names that its other fields have as columns

    @property
    def layout(self) -> Layout:
        """Where its doubles stand. Raises LayoutError if it is not one of doubles alone."""
        return layout(self.schema, self.message)

    @property
    def has_layout(self) -> bool:
        """Whether its messages are of doubles alone."""
        try:
            layout(self.schema, self.message)
        except (LayoutError, DecodeError):
            return False
        return True

    @property
    def columns(self) -> list[str]:
        """The columns of its messages in their order: t first. Raises LayoutError."""
        return [name if name in self.own else self.prefix + name for name in self.layout.names]

    @property
    def comments(self) -> dict[str, str]:
        """Column -> what its schema says of it: meaning, unit, frame; of a Vec3 for each component."""
        return dict(zip(self.columns, _commented(self.schema, self.message), strict=True))

    @property
    def encoding(self) -> str:
        """What its samples on the bus say of themselves."""
        return f"application/protobuf;{self.message}{TICKS}"

    @property
    def metadata(self) -> dict[str, str]:
        """Of its channel in a file, beside its schema."""
        return {"row": self.row, "own": " ".join(self.own), "prefix": self.prefix}

    @classmethod
    def described(
        cls, name: str, message: str, schema: bytes, metadata: Mapping[str, str]
    ) -> Topic:
        """One as a file or a vehicle describes it."""
        own = tuple(metadata.get("own", "t").split())
        return cls(
            name, message, schema, metadata.get("row", ""), own, metadata.get("prefix", "")
        )  # fmt: skip


@cache
def _commented(schema: bytes, name: str) -> tuple[str, ...]:
    """The comment of each double of a message, in their order; else that of what it is part of."""
    found: dict[str, tuple[DescriptorProto, list[str]]] = {}

    def take(scope: str, message: DescriptorProto, path: tuple[int, ...]) -> None:
        full = f"{scope}.{message.name}"
        beside = [notes.get((*path, 2, i), "") for i in range(len(message.field))]
        found[full] = message, beside
        for i, nested in enumerate(message.nested_type):
            take(full, nested, (*path, 3, i))

    for file in FileDescriptorSet.FromString(schema).file:
        notes = {
            tuple(each.path): each.trailing_comments.strip()
            for each in file.source_code_info.location
        }
        for i, message in enumerate(file.message_type):
            take(f".{file.package}", message, (4, i))

    def leaves(name: str, outer: str) -> Iterator[str]:
        for field, comment in sorted(
            zip(*_fields(name), strict=True), key=lambda one: one[0].number
        ):
            if field.type == _MESSAGE:
                yield from leaves(field.type_name, comment or outer)
            else:
                yield comment or outer

    def _fields(name: str) -> tuple[list[FieldDescriptorProto], list[str]]:
        message, beside = found[name]
        return list(message.field), beside

    return tuple(leaves(f".{name}", ""))


class Declaration(NamedTuple):
    """A topic of ours: the NamedTuple whose fields its messages have, and the rest of a Topic."""

    name: str
    title: str  # of the message
    carries: Any
    row: str
    own: tuple[str, ...]
    prefix: str


PLANT, FCU = "plant", "fcu"  # rows


class AskedTick(NamedTuple):
    """One tick of a controller that tells nothing of itself: what the mission asked it for."""

    t: float  # simulation time, s
    engaged: float  # 2: it flies at every tick that it has answered
    setpoint: Setpoint  # as sent last, extrapolated to this tick


def declared_for(tick: Any, params: Any, record: Any) -> Iterator[Declaration]:
    """The topics of a flight. `tick`, `params`: of its law; `record`: the plant's truth.

    `params` None: of a controller that tells nothing.
    """
    yield Declaration(TRUTH, "PlantTruth", record, PLANT, (), "")
    yield from _reports("plant", PlantReport)
    if params is None:
        yield Declaration(ASKED, "MissionSetpoint", Setpoint, FCU, ("t", "engaged"), "setpoint.")
        return
    for name, kind in fields(tick).items():
        if is_value(kind) and fields(kind):  # a law without a guard has nothing to tell of one
            title = "law" if name == "state" else name
            own = ("t", "engaged") if name == "state" else ("t",)  # by what it remembers
            message = "".join(part.capitalize() for part in ("fcu", *title.split("_")))
            yield Declaration(f"/fcu/{title}", message, kind, FCU, own, f"{name}.")
    yield from _reports("fcu", Report)
    yield Declaration(PARAMS, "FcuParams", params, "", ("t",), "")


def _reports(who: str, report: Any) -> Iterator[Declaration]:
    """One topic for each value of a report."""
    for name, kind in fields(report).items():
        title = f"{who.capitalize()}{name.capitalize()}"
        yield Declaration(f"/{who}/{name}", title, kind, "", ("t",), f"{name}.")


@cache
def comments(cls: Any) -> dict[str, str]:
    """Field name -> the comment that stands on its line in the source of `cls`."""
    file = inspect.getsourcefile(cls) or ""
    linecache.checkcache(file)
    source = "".join(linecache.getlines(file, sys.modules[cls.__module__].__dict__))
    classes, lines = _declared(source)
    if cls.__qualname__ not in classes:
        raise OSError(f"{file}: the source of {cls.__qualname__} is not there")
    found = {}
    for item in classes[cls.__qualname__].body:
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
            behind = lines[item.lineno - 1][item.end_col_offset :].decode().strip()
            if item.lineno == item.end_lineno and behind.startswith("#"):
                found[item.target.id] = behind.lstrip("# ")
    return found


@cache
def _declared(source: str) -> tuple[dict[str, ast.ClassDef], list[bytes]]:
    """The classes of a module by their qualified names, and its lines; parsed once for all of them."""

    def inside(node: ast.AST, scope: str) -> Iterator[tuple[str, ast.ClassDef]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.ClassDef):
                yield scope + child.name, child
                yield from inside(child, f"{scope}{child.name}.")
            elif isinstance(child, ast.FunctionDef):
                yield from inside(child, f"{scope}{child.name}.<locals>.")

    return dict(inside(ast.parse(source), "")), source.encode().splitlines()


def file_name(topic: Declaration) -> str:
    """Path of the .proto file of `topic`, as an import statement names it."""
    return f"{PACKAGE}/{topic.name.strip('/').replace('/', '_')}.proto"


class _File:
    """A FileDescriptorProto being filled, with its comments."""

    def __init__(self, name: str) -> None:
        self.proto = FileDescriptorProto(name=name, package=PACKAGE, syntax="proto3")

    def comment(self, path: list[int], *, leading: str = "", trailing: str = "") -> None:
        """Give the element at `path` (descriptor.proto, Location) its comment."""
        if leading or trailing:
            location = self.proto.source_code_info.location.add(path=path, span=[0, 0, 0])
            if leading:
                location.leading_comments = f" {leading}\n"
            if trailing:
                location.trailing_comments = f" {trailing}\n"

    def describe(self, message: DescriptorProto, path: list[int], cls: Any, full_name: str) -> None:
        """Append the fields of `cls` to `message`, which stands at `path` in the file."""
        beside = comments(cls)
        for name, kind in fields(cls).items():
            field = message.field.add(
                name=name,
                number=len(message.field) + 1,
                label=FieldDescriptorProto.LABEL_OPTIONAL,
                type=_MESSAGE if is_value(kind) else _DOUBLE,
            )
            self.comment([*path, 2, len(message.field) - 1], trailing=beside.get(name, ""))
            if is_value(kind):
                field.type_name = f".{self._type(message, path, kind, full_name)}"

    def _type(self, message: DescriptorProto, path: list[int], cls: Any, full_name: str) -> str:
        """Full name of the message for `cls`: a shared one, or one nested in `message`."""
        if cls.__module__ == algebra.__name__:
            return f"{PACKAGE}.{cls.__name__}"
        name = f"{full_name}.{cls.__name__}"
        if all(nested.name != cls.__name__ for nested in message.nested_type):
            nested = message.nested_type.add(name=cls.__name__)
            nested_path = [*path, 3, len(message.nested_type) - 1]
            self.comment(nested_path, leading=_summary(cls))
            self.describe(nested, nested_path, cls, name)
        return name


def _summary(cls: Any) -> str:
    return (inspect.getdoc(cls) or "").split("\n\n")[0].replace("\n", " ")


def geometry_file() -> FileDescriptorProto:
    """Vec3, Quat and Rotors, which every other file imports."""
    file = _File(GEOMETRY)
    for i, cls in enumerate((algebra.Vec3, algebra.Quat, algebra.Rotors)):
        message = file.proto.message_type.add(name=cls.__name__)
        file.comment([4, i], leading=_summary(cls))
        file.describe(message, [4, i], cls, f"{PACKAGE}.{cls.__name__}")
    return file.proto


def topic_file(topic: Declaration) -> FileDescriptorProto:
    """The file with the message of `topic`."""
    file = _File(file_name(topic))
    if any(is_value(kind) for kind in fields(topic.carries).values()):
        file.proto.dependency.append(GEOMETRY)
    message = file.proto.message_type.add(name=topic.title)
    file.comment([4, 0], leading=f"{topic.name}: {_summary(topic.carries)}")
    of_tick = comments(Tick)
    for i, name in enumerate(topic.own):
        message.field.add(
            name=name, number=i + 1, label=FieldDescriptorProto.LABEL_OPTIONAL, type=_DOUBLE
        )
        file.comment([4, 0, 2, i], trailing=of_tick.get(name, _TIME_COMMENT))
    file.describe(message, [4, 0], topic.carries, f"{PACKAGE}.{topic.title}")
    _describe_ticks(file, topic)
    return file.proto


def _describe_ticks(file: _File, topic: Declaration) -> None:
    """Append the message in which ticks of `topic` share a Zenoh sample."""
    message = file.proto.message_type.add(name=topic.title + TICKS)
    file.comment([4, 1], leading=f"A Zenoh sample of {topic.name}: some ticks, in order.")
    for i, (name, kind, comment) in enumerate(_OF_TICKS):
        field = message.field.add(
            name=name, number=i + 1, label=FieldDescriptorProto.LABEL_REPEATED, type=kind
        )
        if kind == _MESSAGE:
            field.type_name = f".{PACKAGE}.{topic.title}"
        file.comment([4, 1, 2, i], trailing=comment)


def topic_of(declared: Declaration) -> Topic:
    """What it says to whoever does not have the NamedTuple."""
    file = topic_file(declared)
    needed = FileDescriptorSet(file=[*([geometry_file()] if file.dependency else []), file])
    return Topic(
        name=declared.name, message=f"{PACKAGE}.{declared.title}",
        schema=needed.SerializeToString(deterministic=True),
        row=declared.row, own=declared.own, prefix=declared.prefix,
    )  # fmt: skip


@cache
def topics_for(tick: Any, params: Any, record: Any) -> dict[str, Topic]:
    """By name, the topics of a flight, as `declared_for`."""
    return {each.name: topic_of(each) for each in declared_for(tick, params, record)}


class Kinds(NamedTuple):
    """The NamedTuple classes of what is told in a flight: its law's, and the plant's."""

    tick: Any
    params: Any  # None: of a controller that tells nothing of itself
    record: Any

    @classmethod
    def of(cls, law: Law) -> Kinds:
        """Those of a flight of our plant under a law."""
        return cls(law.ticks.Tick, law.settings.Settings, PlantRecord)

    @property
    def topics(self) -> dict[str, Topic]:
        """By name."""
        return topics_for(*self)

    @property
    def tells(self) -> bool:
        """Whether the controller tells of itself."""
        return self.params is not None

    @property
    def fcu_row(self) -> Any:
        """The class of a whole row of the flight controller."""
        return fcu_row(self.tick) if self.tells else self.tick

    @property
    def plant_row(self) -> Any:
        """The class of a whole row of the plant."""
        return plant_row(self.record)

    @property
    def params_row(self) -> Any:
        """The class of what is handed on of the law's parameters."""
        return params_row(self.params)


OURS = Kinds(Tick, Settings, PlantRecord)
UNTOLD = Kinds(AskedTick, None, PlantRecord)  # of a flight of which the truth alone is known
DECLARED = tuple(declared_for(*OURS))
TOPICS = OURS.topics
TICK_TOPICS = tuple(topic for topic in TOPICS.values() if topic.row == FCU)
FcuRow, PlantRow, ParamsRow = OURS.fcu_row, OURS.plant_row, OURS.params_row


def proto_text(file: FileDescriptorProto) -> str:
    """`file` as .proto source, comments included."""
    notes = {tuple(loc.path): loc for loc in file.source_code_info.location}

    def message_lines(message: DescriptorProto, path: tuple[int, ...], scope: str) -> Iterator[str]:
        if path in notes:
            summary = notes[path].leading_comments.strip()
            yield from (f"// {line}" for line in textwrap.wrap(summary, 88))
        name = f"{scope}.{message.name}"
        yield f"message {message.name} {{"
        for i, nested in enumerate(message.nested_type):
            for line in message_lines(nested, (*path, 3, i), name):
                yield f"  {line}"
            yield ""
        for i, field in enumerate(message.field):
            kind = field.type_name.removeprefix(f".{name}.").removeprefix(f".{file.package}.")
            note = notes.get((*path, 2, i))
            comment = f"  // {note.trailing_comments.strip()}" if note else ""
            repeated = "repeated " if field.label == FieldDescriptorProto.LABEL_REPEATED else ""
            plain = "fixed64" if field.type == _FIXED64 else "double"
            yield f"  {repeated}{kind or plain} {field.name} = {field.number};{comment}"
        yield "}"

    lines = [
        "// Derived from the NamedTuples of the source by `make schemas`; not edited by hand.",
        f'syntax = "{file.syntax}";',
        f"package {file.package};",
        *[f'import "{name}";' for name in file.dependency],
    ]
    for i, message in enumerate(file.message_type):
        lines += ["", *message_lines(message, (4, i), file.package)]
    return "\n".join(lines) + "\n"


def texts() -> dict[str, str]:
    """File name -> .proto source, for every schema of a recording that is our own."""
    of_asked = (topic for topic in declared_for(*UNTOLD) if topic.name == ASKED)
    files = [geometry_file(), *map(topic_file, (*DECLARED, *of_asked))]
    return {file.name: proto_text(file) for file in files}


def main(arguments: list[str]) -> int:
    """Write the schemas below the folder named on the command line."""
    if len(arguments) != 1:
        print("usage: python -m gcs_tools.recording.schema FOLDER", file=sys.stderr)
        return 2
    for name, text in texts().items():
        path = Path(arguments[0]) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
