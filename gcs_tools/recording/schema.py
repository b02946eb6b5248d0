"""The Protobuf schemas of a recording, derived from the NamedTuples that carry the quantities.

One message a topic; every message starts with `t`, the simulation time. The unit and frame
that stand as a comment beside a field in the source stand as its comment in the schema.
`python -m gcs_tools.recording.schema FOLDER` writes the schemas as .proto text.
"""

from __future__ import annotations

import ast
import inspect
import io
import sys
import textwrap
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

from fcu.interface.diagnostics import PlantReport, Report
from fcu.kernel import algebra
from fcu.kernel.buffers import columns, fields, is_value
from fcu.settings import Settings
from fcu.tick import Tick
from sitl_plant.physics.types import PlantRecord

PACKAGE = "m_mrac"
GEOMETRY = f"{PACKAGE}/geometry.proto"
_DOUBLE = FieldDescriptorProto.TYPE_DOUBLE
_MESSAGE = FieldDescriptorProto.TYPE_MESSAGE
TICKS = "Ticks"  # what the name of a message of several ticks ends with
_FIXED64 = FieldDescriptorProto.TYPE_FIXED64
_OF_TICKS = (
    ("sequence", _FIXED64, "number of each tick, from 0; a gap is a loss"),
    ("time_ns", _FIXED64, "simulation time of each, ns"),
    ("tick", _MESSAGE, "each"),
)
_TIME_COMMENT = "simulation time, s"


class Topic(NamedTuple):
    """One topic of a recording, and the part of a row that its messages carry."""

    name: str
    message: str  # name of the Protobuf message, without its package
    carries: Any  # the NamedTuple whose fields the message has
    own: tuple[str, ...]  # floats of the row itself that stand before them
    prefix: str  # of the names of the other columns in the row

    def column(self, field: str) -> str:
        """Name in the row of the field of the message called `field` (dotted)."""
        return field if field in self.own else self.prefix + field


def _fcu_topics() -> Iterator[Topic]:
    """One topic for each value of a Tick; `engaged` goes with what the law remembers."""
    for name, kind in fields(Tick).items():
        if is_value(kind):
            title = "law" if name == "state" else name
            own = ("t", "engaged") if name == "state" else ("t",)
            message = "".join(part.capitalize() for part in title.split("_"))
            yield Topic(f"/fcu/{title}", f"Fcu{message}", kind, own, f"{name}.")


def _reported(who: str, report: Any) -> list[Topic]:
    """One topic for each value of a report."""
    return [
        Topic(f"/{who}/{name}", f"{who.capitalize()}{name.capitalize()}", kind, ("t",), f"{name}.")
        for name, kind in fields(report).items()
    ]


PLANT = Topic("/plant/truth", "PlantTruth", PlantRecord, (), "")
(PLANT_TIMING,) = _reported("plant", PlantReport)
FCU = tuple(_fcu_topics())
WIND, STATUS, TIMING = _reported("fcu", Report)
PARAMS = Topic("/fcu/params", "FcuParams", Settings, ("t",), "")
OF_PLANT = (PLANT, PLANT_TIMING)  # of a row of the plant
OF_FCU = (*FCU, WIND, STATUS, TIMING)  # of a row of the flight controller
TOPICS = (*OF_PLANT, *OF_FCU, PARAMS)

PLANT_COLUMNS = [*columns(PlantRecord), *columns(PlantReport)]
FCU_COLUMNS = [*columns(Tick), *columns(Report)]


@cache
def comments(cls: Any) -> dict[str, str]:
    """Field name -> the comment that stands on its line in the source of `cls`."""
    source = textwrap.dedent(inspect.getsource(cls))
    on_line = {
        token.start[0]: token.string.lstrip("# ").strip()
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    body = ast.parse(source).body[0]
    assert isinstance(body, ast.ClassDef)
    return {
        item.target.id: on_line[item.lineno]
        for item in body.body
        if isinstance(item, ast.AnnAssign)
        and isinstance(item.target, ast.Name)
        and item.lineno in on_line
    }


def file_name(topic: Topic) -> str:
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


def topic_file(topic: Topic) -> FileDescriptorProto:
    """The file with the message of `topic`."""
    file = _File(file_name(topic))
    if any(is_value(kind) for kind in fields(topic.carries).values()):
        file.proto.dependency.append(GEOMETRY)
    message = file.proto.message_type.add(name=topic.message)
    file.comment([4, 0], leading=f"{topic.name}: {_summary(topic.carries)}")
    of_tick = comments(Tick)
    for i, name in enumerate(topic.own):
        message.field.add(
            name=name, number=i + 1, label=FieldDescriptorProto.LABEL_OPTIONAL, type=_DOUBLE
        )
        file.comment([4, 0, 2, i], trailing=of_tick.get(name, _TIME_COMMENT))
    file.describe(message, [4, 0], topic.carries, f"{PACKAGE}.{topic.message}")
    _describe_ticks(file, topic)
    return file.proto


def _describe_ticks(file: _File, topic: Topic) -> None:
    """Append the message in which ticks of `topic` share a Zenoh sample."""
    message = file.proto.message_type.add(name=topic.message + TICKS)
    file.comment([4, 1], leading=f"A Zenoh sample of {topic.name}: some ticks, in order.")
    for i, (name, kind, comment) in enumerate(_OF_TICKS):
        field = message.field.add(
            name=name, number=i + 1, label=FieldDescriptorProto.LABEL_REPEATED, type=kind
        )
        if kind == _MESSAGE:
            field.type_name = f".{PACKAGE}.{topic.message}"
        file.comment([4, 1, 2, i], trailing=comment)


def schema(topic: Topic) -> FileDescriptorSet:
    """Everything needed to decode the messages of `topic`."""
    file = topic_file(topic)
    return FileDescriptorSet(file=[*([geometry_file()] if file.dependency else []), file])


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
    files = [geometry_file(), *map(topic_file, TOPICS)]
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
