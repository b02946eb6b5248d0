"""The marks in the code and the tables of fcu/theory/README.md, held against each other."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import fcu

THEORY = Path(fcu.__file__).with_name("theory")
README = (THEORY / "README.md").read_text(encoding="utf-8")
BESIDE = [THEORY.parent / "guard" / name for name in ("hover.py", "responses.py")]  # of its README
MARK = re.compile(r"#\s*\((\d+)\)$")


def functions(tree, prefix=""):
    """(qualified name, first line, last line) of every function and method."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef):
            yield from functions(node, f"{node.name}.")
        elif isinstance(node, ast.FunctionDef):
            yield prefix + node.name, node.lineno, node.end_lineno


def marked():
    found = set()
    for path in [*sorted(THEORY.glob("*.py")), *BESIDE]:
        text = path.read_text(encoding="utf-8")
        spans = list(functions(ast.parse(text)))
        for number, line in enumerate(text.splitlines(), 1):
            if mark := MARK.search(line):
                names = [name for name, first, last in spans if first <= number <= last]
                assert names, f"{path}:{number}: a mark outside a function"
                found.add((int(mark[1]), path.name, names[-1]))
    return found


def rows(title):
    lines = README.split(f"\n## {title}\n")[1].split("\n## ")[0].splitlines()
    table = [line for line in lines if line.startswith("|")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in table[2:]]


def test_every_marked_equation_is_in_the_index_and_every_row_is_marked():
    indexed = [(int(row[0].strip("()")), row[2], row[3]) for row in rows("Equations")]
    assert set(indexed) == marked()
    assert [row[0] for row in indexed] == sorted(row[0] for row in indexed)


def test_equations_cited_are_the_papers():
    for path in [*THEORY.glob("*.py"), *BESIDE]:
        for cited in re.findall(r"Paper ([^.\n]*)", path.read_text(encoding="utf-8")):
            assert all(1 <= int(n) <= 45 for n in re.findall(r"\((\d+)\)", cited)), path


def test_every_command_names_a_file():
    named = {row[1].strip("`").split("/")[-1] for row in rows("What holds this")}
    assert named <= {path.name for path in Path(__file__).parent.glob("test_*.py")}
