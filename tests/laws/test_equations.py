"""The marks in the code and the tables of the READMEs of laws and guard, held against each other."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

import fcu
from fcu.guard.types import GuardInternals, GuardParams, GuardState
from fcu.interface.messages import RotorCommand, Setpoint, VehicleState
from fcu.kernel import algebra
from fcu.kernel.buffers import fields, is_value
from fcu.laws import face
from fcu.laws.mmrac import types

ROOT = Path(fcu.__file__).parents[1]
LAWS, GUARD = ROOT / "fcu" / "laws", ROOT / "fcu" / "guard"
LAW = LAWS / "mmrac"
OTHERS = sorted({file.parent for file in LAWS.glob("*/law.py")} - {LAW})  # each of its own paper
MARKED = [
    *(path for path in sorted(LAWS.rglob("*.py")) if not set(path.parents) & set(OTHERS)),
    *sorted(GUARD.glob("*.py")),
    *sorted((ROOT / "sitl_plant" / "physics").rglob("*.py")),
]
# Of each publication: the READMEs with its tables, and the files with its marks. The first README
# has the departures.
BOOKS = [
    pytest.param((LAW, GUARD), MARKED, id="mmrac"),
    *(pytest.param((folder,), sorted(folder.rglob("*.py")), id=folder.name) for folder in OTHERS),
]

COMMENT = re.compile(r"#\s*((?:\(\d+\)\s*)*)(?:departure ([\d, ]+))?$")


def section(folder, title):
    """The lines of one `## ` section of a folder's README."""
    text = (folder / "README.md").read_text(encoding="utf-8")
    return text.split(f"\n## {title}\n")[1].split("\n## ")[0].splitlines()


def table(folder, title):
    """The rows of a section's table, as stripped cells, without its head."""
    rows = [line for line in section(folder, title) if line.startswith("|")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[2:]]


def listed(folder):
    """Numbers of the departures that a law's README lists."""
    text = (folder / "README.md").read_text(encoding="utf-8")
    return [int(n) for n in re.findall(r"^(\d+)\. \*\*", text, re.MULTILINE)]


def marks(files):
    """(equations, departures, file, function) of every marked line."""
    for path in files:
        text = path.read_text(encoding="utf-8")
        functions = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.FunctionDef)]
        for number, line in enumerate(text.splitlines(), 1):
            found = COMMENT.search(line)
            if not found or not (found[1] or found[2]):
                continue
            names = [f.name for f in functions if f.lineno <= number <= f.end_lineno]
            assert names, f"{path}:{number}: a mark outside a function"
            equations = re.findall(r"\(\d+\)", found[1])
            departures = [int(d) for d in re.findall(r"\d+", found[2] or "")]
            yield equations, departures, path, names[-1]


@pytest.mark.parametrize(("folders", "files"), BOOKS)
def test_every_marked_equation_is_in_the_index_and_every_row_is_marked(folders, files):
    marked = {(e, path, name) for equations, _, path, name in marks(files) for e in equations}
    indexed = [
        (e, (folder / file).resolve(), name)
        for folder in folders
        for e, _, file, name in table(folder, "Equations")
    ]
    assert len(indexed) == len(set(indexed))
    assert marked == set(indexed)


@pytest.mark.parametrize("folder", [LAW, GUARD, *OTHERS], ids=lambda folder: folder.name)
def test_the_index_is_in_the_order_of_the_paper(folder):
    numbers = [int(row[0].strip("()")) for row in table(folder, "Equations")]
    assert numbers == sorted(numbers)


@pytest.mark.parametrize(("folders", "files"), BOOKS)
def test_every_departure_in_the_code_is_listed_and_every_one_listed_is_in_the_code(folders, files):
    marked = {d for _, departures, _, _ in marks(files) for d in departures}
    assert listed(folders[0]) == list(range(1, len(listed(folders[0])) + 1))
    assert marked == set(listed(folders[0]))


@pytest.mark.parametrize(("folders", "files"), BOOKS)
def test_a_departure_named_anywhere_is_one_of_the_list(folders, files):
    for path in [*files, *(folder / "README.md" for folder in folders)]:
        for number in re.findall(r"departures? (\d+)", path.read_text(encoding="utf-8")):
            assert int(number) in listed(folders[0]), path


def test_equations_cited_in_the_code_are_the_papers():
    """The paper numbers its equations from 1 to 45."""
    for path in MARKED:
        for cited in re.findall(r"Paper ([^.\n]*)", path.read_text(encoding="utf-8")):
            assert all(1 <= int(n) <= 45 for n in re.findall(r"\((\d+)\)", cited)), path


def parts(cls):
    """A NamedTuple class and those of its fields, but for vectors and the like."""
    yield cls
    for kind in fields(cls).values():
        if is_value(kind) and kind.__module__ != algebra.__name__:
            yield from parts(kind)


@pytest.mark.parametrize(
    ("folder", "classes"),
    [
        (LAW, (types.Params, types.State, types.Internals, face.Outputs)),
        (LAW, (RotorCommand, Setpoint, VehicleState)),
        (GUARD, (GuardParams, GuardState, GuardInternals)),
    ],
)
def test_every_field_has_a_row_in_the_symbol_table(folder, classes):
    named = {name for row in table(folder, "Symbols") for name in re.findall(r"`(\w+)`", row[1])}
    for cls in (part for whole in classes for part in parts(whole)):
        assert set(cls._fields) <= named, (cls, set(cls._fields) - named)


@pytest.mark.parametrize("folder", OTHERS, ids=lambda folder: folder.name)
def test_every_field_of_a_law_has_a_row_in_its_symbol_table(folder):
    named = {name for row in table(folder, "Symbols") for name in re.findall(r"`(\w+)`", row[1])}
    law = importlib.import_module(f"fcu.laws.{folder.name}.law")
    for whole in (law.Params, law.State, law.Internals):
        own = [cls for cls in parts(whole) if cls.__module__.startswith(f"fcu.laws.{folder.name}.")]
        assert own[0] is whole
        for cls in own:  # what all laws share has its rows in mmrac's table
            assert set(cls._fields) <= named, (cls, set(cls._fields) - named)


@pytest.mark.parametrize("folder", [LAW, GUARD, *OTHERS], ids=lambda folder: folder.name)
def test_every_symbol_is_in_the_file_its_row_names(folder):
    for row in table(folder, "Symbols"):
        assert len(row) == 6, row
        text = (folder / row[5]).read_text(encoding="utf-8")
        for name in re.findall(r"`(\w+)`", row[1]):
            assert re.search(rf"^    {name}: ", text, re.MULTILINE), f"{name} in {row[5]}"
