"""Every room of more than five files has a README, and what it names is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.rooms.readme_imports import LINE, LINTER, ROOT, readmes


def is_room(folder: Path) -> bool:
    return sum(path.name != "__init__.py" for path in folder.glob("*.py")) > 5


ROOMS = [
    folder
    for name in LINTER["root_packages"]
    for folder in (ROOT / name, *(ROOT / name).rglob("*"))
    if folder.is_dir() and is_room(folder)
]
READMES = [
    *(path for name in (*LINTER["root_packages"], "tests") for path in (ROOT / name).rglob("README.md")
      if "node_modules" not in path.parts),
]  # fmt: skip


def label(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("room", ROOMS, ids=label)
def test_a_room_of_more_than_five_files_has_a_readme(room):
    assert (room / "README.md").exists()


@pytest.mark.parametrize("readme", READMES, ids=label)
def test_files_that_a_readme_names_exist(readme):
    named = re.findall(r"`((?:\.\./)?[\w./]+(?:\.py|\.md|\.toml|/))`", readme.read_text())
    missing = [
        n
        for n in named
        if not any((at / n).exists() for at in (readme.parent, readme.parents[1], ROOT))
    ]
    assert not missing


@pytest.mark.parametrize(("readme", "line"), readmes().items(), ids=map(label, readmes()))
def test_what_a_readme_says_may_be_imported_is_the_contract(readme, line):
    assert LINE.search(readme.read_text())[0] == line  # if not: make schemas


def test_rooms_say_what_they_may_import():
    assert len(readmes()) >= 10
