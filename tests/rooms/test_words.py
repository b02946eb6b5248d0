"""Docstrings that are hard to read are found, counted, and never more than before."""

from __future__ import annotations

import tomllib

import pytest

from tests.rooms import words

TEXT = '''"""A module."""

def plain():
    """Return the sum; of two numbers."""

def question():
    """Whether it flies."""

class Whose:
    """Whatever begins so is no question."""
'''


@pytest.fixture
def tree(tmp_path):
    for package in words.PACKAGES:
        (tmp_path / package).mkdir()
    (tmp_path / "fcu" / "made_up.py").write_text(TEXT)
    return tmp_path


def test_questions_and_semicolons_are_found_with_their_lines(tree):
    found = words.all_faults(tree)
    assert [(fault.place, fault.fault) for fault in found] == [
        ("fcu/made_up.py:4", "semicolons"),
        ("fcu/made_up.py:7", "questions"),
    ]


def test_more_than_allowed_is_an_excess_in_its_folder_alone(tree):
    found = words.all_faults(tree)
    assert words.excess(found, {"fcu": {"questions": 1, "semicolons": 1}}) == {}
    assert words.excess(found, {"fcu": {"questions": 1}}) == {("fcu", "semicolons"): 1}
    assert len(words.excess(found, {"fcu/vehicle": {"questions": 9, "semicolons": 9}})) == 2


def test_written_counts_only_fall(tree):
    found = words.all_faults(tree)
    allowed = {"fcu": {"questions": 5}, "gone": {"semicolons": 2}}
    lowered = words.lowered(found, allowed)
    assert lowered == {"fcu": {"questions": 1, "semicolons": 0}}
    assert tomllib.loads(words.written(lowered)) == lowered
