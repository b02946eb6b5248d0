"""Where in a mission file a value stands, and what is wrong with it, in words."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

_TABLE = re.compile(r"\s*(\[{1,2})\s*([^\[\]]+?)\s*\]{1,2}\s*(#.*)?$")


def line_of(text: str, path: Sequence[str | int]) -> int | None:
    """The line (from 1) of the key at `path`, or of the nearest thing above it; None: nowhere.

    Follows table headers, arrays of tables, dotted keys and inline tables by their keys; an
    index inside an array gives the line of the array's key, or of its element where each
    stands on a line of its own.
    """
    names = [str(p) for p in path if isinstance(p, str)]
    lines = text.splitlines()
    best: int | None = None
    depth = 0
    table: list[str] = []
    for number, line in enumerate(lines, 1):
        header = _TABLE.match(line)
        if header:
            table = [part.strip().strip("\"'") for part in header[2].split(".")]
            if names[: len(table)] == table and len(table) > depth:
                best, depth = number, len(table)
            continue
        key = re.match(r"\s*([A-Za-z0-9_.\"'-]+)\s*=", line)
        if key:
            full = table + [part.strip("\"' ") for part in key[1].split(".")]
            if names[: len(full)] == full and len(full) > depth:
                best, depth = number, len(full)
                inner = names[len(full) :]
                while inner and re.search(rf"\b{re.escape(inner[0])}\s*=", line):
                    inner, depth = inner[1:], depth + 1
    return best


def explain(error: ValidationError, source: str, text: str, model: type[BaseModel]) -> str:
    """Every fault, a line each: file:line: [table] key: what was expected."""
    return "\n".join(_one(fault, source, text, model) for fault in error.errors())


def _one(fault: Any, source: str, text: str, model: type[BaseModel]) -> str:
    path = _known_path(fault["loc"], model)
    line = line_of(text, path)
    where = f"{source}:{line}" if line else source
    if not path:
        return f"{where}: {fault['msg']}"
    dotted = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path[1:]).lstrip(".")
    name = f"[{path[0]}] {dotted}" if dotted else str(path[0])
    if fault["type"] == "extra_forbidden":
        near = difflib.get_close_matches(str(path[-1]), _keys(model, path[:-1]), 1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        return f"{where}: {name}: unknown key{hint}"
    if fault["type"] == "missing":
        return f"{where}: {name}: missing"
    message = str(fault["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")
    message = message.removeprefix("expected ")
    given = fault.get("input")
    shown = "" if isinstance(given, dict) else f", got {given!r}"
    return f"{where}: {name}: expected {message}{shown}"


def _known_path(loc: Sequence[str | int], model: type[BaseModel]) -> list[str | int]:
    """`loc` without the names that pydantic puts in for the members of a union."""
    return [p for p in loc if isinstance(p, int) or re.fullmatch(r"[a-z][A-Za-z0-9_]*", p) and p not in _UNION]  # fmt: skip


_UNION = {"float", "int", "list", "str", "dict", "tuple", "constrained"}


def _keys(model: Any, path: Sequence[str | int]) -> list[str]:
    """The keys that the table at `path` may have."""
    for name in path:
        if isinstance(name, int):
            continue
        field = getattr(model, "model_fields", {}).get(name)
        if field is None:
            return []
        model = _model_in(field.annotation)
    fields = getattr(model, "model_fields", {})
    return [field.alias or name for name, field in fields.items()]


def _model_in(annotation: Any) -> Any:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for part in getattr(annotation, "__args__", ()):
        found = _model_in(part)
        if found is not None:
            return found
    return None
