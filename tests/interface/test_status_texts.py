"""What a vehicle says: every code has a text, and every number its place in it."""

from __future__ import annotations

import re
import string
from pathlib import Path

import pytest

import fcu
import sitl_plant
from fcu.interface.status_texts import Code, Told, lacks, says, words
from fcu.mavlink.definitions import Severity
from fcu.mavlink.replies import status_text


def places(code):
    """The specifications of the values of a code's text."""
    return [spec for _, name, spec, _ in string.Formatter().parse(code.value) if name is not None]


def example(code):
    return Told(code, tuple(3 if spec in ("", "#x") else 3.0 for spec in places(code)))


@pytest.mark.parametrize("code", Code)
def test_every_code_has_a_text_of_its_own_and_is_known_by_it(code):
    text = words(example(code))
    assert text.isascii() and not re.search(r"[{}]", text)
    assert all(len(chunk.payload[1:51]) <= 50 for chunk in status_text(Severity.INFO, text))
    assert says(text, code)


@pytest.mark.parametrize("code", Code)
def test_every_code_is_told_by_somebody(code):
    sources = (p for room in (fcu, sitl_plant) for p in Path(room.__file__).parent.rglob("*.py"))
    users = [p for p in sources if f"Code.{code.name}" in p.read_text()]
    assert users, "nobody says so"


def test_a_reason_is_worded_inside_what_it_is_a_reason_of():
    why = Told(Code.SPEED_RANGE, (50.0, 12.0))
    denied = Told(Code.DENIED, ("Speed", why))
    assert words(denied) == "Speed denied: 50 m/s (expected 0.1 to 12)"


def test_a_wind_that_follows_from_an_airframe_is_told_in_three_digits():
    assert words(Told(Code.MORE_DRAG, (7.41188,))).endswith("of a wind of 7.41 m/s")


@pytest.mark.parametrize(
    ("lack", "text"),
    [
        ((30.0, 0.0, 4.1, 0.5), "30.0 m needs 5 N more than available; 15.0 m of it would do"),
        ((30.0, 0.0, 4.1, 0.0), "30.0 m needs 5 N more than available; no part of it would do"),
        ((0.5, 8.0, 4.1, 0.507), "8.0 m/s needs 5 N more than available; 50 % of it would do"),
        ((0.5, 8.0, 4.1, 0.017), "8.0 m/s needs 5 N more than available; 1 % of it would do"),
        ((0.5, 8.0, 4.1, 0.009), "8.0 m/s needs 5 N more than available; no part of it would do"),
        ((2.0, 8.0, 4.1, 0.0), "8.0 m/s and 2.0 m needs 5 N more than available; no part of it would do"),
        ((30.0, 0.0, 2e6, 0.5), "30.0 m needs 2e+06 N more than available; 15.0 m of it would do"),
    ],
)  # fmt: skip
def test_what_is_missing_is_never_rounded_to_nothing(lack, text):
    assert words(lacks(*lack)) == text


def test_a_kind_is_without_its_numbers():
    def far(metres):
        return Told(Code.SETPOINT_REFUSED, (Told(Code.ABOVE_LIMIT, ("position", metres, "m")),))

    assert far(1.0).kind == far(2.0).kind
    assert far(1.0).kind != Told(Code.SETPOINT_REFUSED, (Told(Code.FORCE),)).kind


def test_a_text_cut_into_chunks_is_known_by_its_first():
    text = words(Told(Code.SETPOINT_REFUSED, (lacks(30.0, 0.0, 4.1, 0.5),)))
    assert says(text[:50], Code.SETPOINT_REFUSED)
    assert not says(text[50:], Code.SETPOINT_REFUSED)
