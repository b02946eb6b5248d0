"""Counts docstrings that are hard to read, by folder, and refuses more of them than before.

python -m tests.rooms.words            # exit code 1 if a folder has more of them (`make check`)
python -m tests.rooms.words --write    # write the smaller counts down (`make schemas`)

A docstring begins with a verb or a noun: one that begins with What, Whether, Where or Who is an
indirect question. A semicolon joins two sentences that a reader would rather have one by one.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
ALLOWED = Path(__file__).with_name("words.toml")
PACKAGES = ("fcu", "sitl_plant", "gcs_tools", "tests")
QUESTIONS = ("What", "Whether", "Where", "Who")

Counts = dict[str, dict[str, int]]  # folder -> fault -> how many docstrings


class Fault(NamedTuple):
    """One docstring that is hard to read."""

    folder: str
    place: str  # file:line
    fault: str  # "questions" or "semicolons"
    docstring: str


def faults(path: Path, root: Path = ROOT) -> Iterator[Fault]:
    """The docstrings of a file that are hard to read."""
    name = path.relative_to(root)
    for node in ast.walk(ast.parse(path.read_bytes())):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        text = ast.get_docstring(node)
        if text is None:
            continue
        place = f"{name}:{node.body[0].lineno}"
        first, *_ = text.split()
        if first.rstrip(",:") in QUESTIONS:
            yield Fault(name.parent.as_posix(), place, "questions", text)
        if ";" in text:
            yield Fault(name.parent.as_posix(), place, "semicolons", text)


def all_faults(root: Path = ROOT) -> list[Fault]:
    """The docstrings of all packages and of the tests that are hard to read."""
    paths = [path for package in PACKAGES for path in sorted((root / package).rglob("*.py"))]
    return [
        fault for path in paths if "node_modules" not in path.parts for fault in faults(path, root)
    ]


def counts(found: list[Fault]) -> Counts:
    """Faults by folder and kind."""
    counted = Counter((fault.folder, fault.fault) for fault in found)
    made: Counts = {}
    for (folder, fault), n in sorted(counted.items()):
        made.setdefault(folder, {})[fault] = n
    return made


def excess(found: list[Fault], allowed: Counts) -> dict[tuple[str, str], int]:
    """By folder and kind: how many faults there are more than `allowed`."""
    return {
        (folder, fault): n - allowed.get(folder, {}).get(fault, 0)
        for folder, row in counts(found).items()
        for fault, n in row.items()
        if n > allowed.get(folder, {}).get(fault, 0)
    }


def written(allowed: Counts) -> str:
    """The text of words.toml."""
    lines = [
        "# Docstrings that are hard to read, by folder: these numbers only fall.",
        "# Written by: python -m tests.rooms.words --write",
    ]
    for folder, row in allowed.items():
        told = ", ".join(f"{fault} = {n}" for fault, n in row.items())
        lines.append(f'"{folder}" = {{ {told} }}')
    return "\n".join(lines) + "\n"


def lowered(found: list[Fault], allowed: Counts) -> Counts:
    """`allowed`, without what is not needed any more."""
    return {
        folder: kept
        for folder, row in counts(found).items()
        if (kept := {f: min(n, allowed.get(folder, {}).get(f, 0)) for f, n in row.items()})
        and any(kept.values())
    }


def main(arguments: list[str]) -> int:
    """Check the counts, or write smaller ones. Returns the exit code."""
    found = all_faults()
    allowed: Counts = tomllib.loads(ALLOWED.read_text())
    if arguments == ["--write"]:
        ALLOWED.write_text(written(lowered(found, allowed)))
        return 0
    over = excess(found, allowed)
    for (folder, kind), more in over.items():
        print(f"{folder}: {more} more docstrings than before with {kind} (tests/rooms/words.toml):")
        for fault in found:
            if (fault.folder, fault.fault) == (folder, kind):
                print(f"  {fault.place}: {fault.docstring.splitlines()[0]}")
    if over:
        print(
            "A docstring begins with a verb or a noun, and has no semicolon: reword the new ones."
        )
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
