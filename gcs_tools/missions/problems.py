"""Problems of the tables of a file, each a line with its place in the file."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from types import MappingProxyType
from typing import Any

from pydantic import BaseModel, ValidationError

from fcu.interface.files.input_file import plain, shown
from fcu.interface.files.spelling import suggestion_or_list
from fcu.interface.files.toml_lines import KeyPath, nearest
from gcs_tools.judging.metrics import RENAMED
from gcs_tools.missions import items

MOST = 20  # problems of a file that are told, each a line

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


def told(
    error: ValidationError, model: type[BaseModel], source: str, found: Mapping[KeyPath, int],
    branches: Collection[str] = (), options: Mapping[str, str] = MappingProxyType({}),
) -> str:  # fmt: skip
    """One line for each problem, in the order of the file.

    model : what the tables should have been. found : the lines of the file.
    options : by key of the file: the option of a command line that was given in its place.
    branches : names that pydantic puts into a path for the types that a value may have.
    """
    placed = []
    problems = error.errors(include_url=False)
    lacking: dict[KeyPath, int] = {}  # by array: the last index that it lacks
    for problem in problems:
        if problem["type"] == "missing" and isinstance(last := problem["loc"][-1], int):
            array = problem["loc"][:-1]
            lacking[array] = max(last, lacking.get(array, 0))
    wrong_items = {problem["loc"][:-1] for problem in problems}
    for problem in problems:
        path: KeyPath = tuple(part for part in problem["loc"] if part not in branches)
        path = path[:-1] if path[-1:] == ("[key]",) else path
        context, got = problem.get("ctx", {}), problem["input"]
        kind = problem["type"]
        if kind == "too_short" and problem["loc"] in wrong_items:
            continue  # of its items, which are wrong themselves
        if kind in ("mission", "because"):
            path, got = (*path, *context["key"]), context.get("got")
            got = _NOTHING if got is None else got
        if kind == "extra_forbidden":
            if path[0] == "expect" and (now := RENAMED.get(str(path[-1]))) is not None:
                said = f"this metric is called {now} now (docs/missions.md)"
            else:
                known = _known(path[:-1], model)
                meant = _elsewhere(path, model) or suggestion_or_list(path[-1], known)
                said = f"no such key{meant}"
        elif kind == "missing":
            said = "is missing"
            if isinstance(path[-1], int):  # one such problem for each number
                if len(got) < path[-1]:
                    continue
                path = path[:-1]
                said = f"expected {lacking[path] + 1} numbers, got {shown(got)}"
        elif kind == "too_long":
            what = "numbers" if context["max_length"] <= 10 else "elements at most"
            said = f"expected {context['max_length']} {what}, got {shown(got)}"
        elif kind == "because":
            said = context["why"]
        else:
            form = _EXPECTED.get(kind)  # else in pydantic's words
            said = f"expected {form.format(**context)}" if form else _lower(problem["msg"])
            said += "" if got is _NOTHING else f", got {shown(got)}"
            if kind == "model_type" and (keys := _known(path, model)):
                said += f" (a table of {', '.join(keys)})"
        path = _as_written(_untagged(path), found)
        line = nearest(found, path) or nearest(found, _undotted(path))
        where = source if line is None else f"{source}:{line}"
        if (option := options.get(str(path[0]))) is not None:
            placed.append((0, f"{option}: {said}"))
            continue
        placed.append((line or 0, f"{where}: {_key(path, got, model)}: {said}"))
    lines = [text for _, text in sorted(placed, key=lambda item: item[0])]
    if (more := len(lines) - MOST) > 0:
        lines[MOST:] = [f"{source}: and {more} more"]
    return "\n".join(lines)


def _lower(text: str) -> str:
    return f"{text[:1].lower()}{text[1:]}"


def _undotted(path: KeyPath) -> KeyPath:
    """The path of a key that stands for nested tables: draw, "plant.mass_kg"."""
    return tuple(
        name for part in path for name in (part.split(".") if isinstance(part, str) else (part,))
    )


def _as_written(path: KeyPath, found: Mapping[KeyPath, int]) -> KeyPath:
    """The key that a file has for one that is derived of it: `plan` is short for an item."""
    is_short = path[:3] == ("flight", "items", 0) and ("flight", "plan") in found
    return ("flight", "plan") if is_short else path


def _key(path: KeyPath, got: Any, model: type[BaseModel]) -> str:
    """`[flight] setpoints[0].at_s`; `title`, arrays and tables themselves stand alone."""
    text = "".join(f"[{p}]" if isinstance(p, int) else f".{plain(p)}" for p in path[1:])
    first = plain(str(path[0]))
    if text.startswith("["):
        return f"{first}{text}"
    if text:
        return f"[{first}] {text.removeprefix('.')}"
    known = model.model_fields.get(str(path[0]))
    is_table = isinstance(got, dict) if known is None else any(_models(known.annotation))
    return f"[{first}]" if is_table else first


def _elsewhere(path: KeyPath, kind: type[BaseModel]) -> str:
    """The place of a key that was given without its table."""
    if len(path) == 1:
        for name, field in kind.model_fields.items():
            for model in _models(field.annotation):
                if path[0] in model.model_fields:
                    return f" (did you mean {field.alias or name}.{path[0]}?)"
    return ""


def _known(path: KeyPath, kind: type[BaseModel]) -> list[str]:
    """The keys of the table at `path`."""
    model: Any = kind
    alternatives: list[Any] = []
    for name in path:
        if isinstance(name, str) and not name.isdecimal():  # the number of an item of a plan
            tagged = [each for each in alternatives if name in _kinds(each)]
            if tagged:
                model = tagged[0]
            elif name in model.model_fields:  # not the free key of a table of tables
                alternatives = list(_models(model.model_fields[name].annotation))
                model = alternatives[0]
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
