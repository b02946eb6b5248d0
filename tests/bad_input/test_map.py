"""The map of the bad-input catalogue: what it names is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
NAMES = {
    name
    for file in TESTS.rglob("test_*.py")
    for name in re.findall(r"^def test_(\w+)", file.read_text(), re.MULTILINE)
}
MAP = (TESTS / "bad_input" / "README.md").read_text()
FILES = set(re.findall(r"\b(\w+/test_\w+)", MAP))


@pytest.mark.parametrize("named", sorted(set(re.findall(r"`(\w+)…?`", MAP)) - {"bad_input"}))
def test_a_test_that_is_named_is_there(named):
    assert any(name.startswith(named) for name in NAMES)


@pytest.mark.parametrize("file", sorted(FILES))
def test_a_file_that_is_named_is_there(file):
    assert (TESTS / f"{file}.py").exists()


def test_every_line_is_there():
    lines = [*(f"P{n}" for n in range(1, 14)), *(f"C{n}" for n in range(1, 13))]
    lines += [*(f"S{n}" for n in range(1, 10)), *(f"R{n}" for n in range(1, 7))]
    lines += [f"H{n}" for n in range(1, 6)]
    assert set(re.findall(r"^\| ([PCSRH]\d+) \|", MAP, re.MULTILINE)) == set(lines)
