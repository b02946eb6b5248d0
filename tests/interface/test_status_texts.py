"""What a vehicle says: every code has a text, and every number its place in it."""

from __future__ import annotations

import re
import string
from pathlib import Path

import pytest

import fcu
import sitl_plant
from fcu.interface.status_texts import CUT, ROOM, Code, Told, brief, lacks, says, words
from fcu.mavlink.definitions import command_name


def places(code):
    """The specifications of the values of a code's text."""
    return [spec for _, name, spec, _ in string.Formatter().parse(code.value) if name is not None]


def example(code):
    return Told(code, tuple(3 if spec in ("", "#x") else 3.0 for spec in places(code)))


@pytest.mark.parametrize("code", Code)
def test_every_code_has_a_text_of_its_own_and_is_known_by_it(code):
    text = words(example(code))
    assert text.isascii() and not re.search(r"[{}]", text)
    assert says(text, code)


def test_every_code_is_told_by_somebody():
    sources = (p for room in (fcu, sitl_plant) for p in Path(room.__file__).parent.rglob("*.py"))
    told = {name for p in sources for name in re.findall(r"Code\.([A-Z]\w*)", p.read_text())}
    assert {code.name for code in Code} - told == set()


def test_a_reason_is_worded_inside_what_it_is_a_reason_of():
    why = Told(Code.SPEED_RANGE, (50.0, 12.0))
    denied = Told(Code.DENIED, ("Speed", why))
    assert words(denied) == "Speed denied: 50 m/s (expected 0.1 to 12)"


def test_a_wind_that_follows_from_an_airframe_is_told_in_three_digits():
    assert words(Told(Code.MORE_DRAG, (7.41188,))).endswith("in a wind of 7.41 m/s")


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


# --- in the 50 characters of a STATUSTEXT

CODES = list(Code)
LONG = {"": "Figure eight", "#x": 0xFFFF, "newtons": 1e300, "metres": 99_999.9, "percent": 0.0}
NAMES = {  # the longest that stands there, where it is not the name of a mode
    Code.BUSY: max((command_name(n) for n in range(5000)), key=len),
    Code.LATE_REPETITION: max((command_name(n) for n in range(5000)), key=len),
    Code.UNSUPPORTED: max((command_name(n) for n in range(5000)), key=len),
    Code.NOT_TAKEN: "SET_ACTUATOR_CONTROL_TARGET",
    Code.PARAMETER_UNKNOWN: 16 * "X",
    Code.PARTLY_IGNORED: "latitude and longitude",
    Code.PARAMETER_UNUSED: 7,
    Code.PARAMETER_NAN: 7,
    Code.ANOTHER_SENDS: 255,
    Code.COMMAND_FRAME: 255,
    Code.FRAME_UNSUPPORTED: 255,
    Code.FRAME_NOT_LOCAL: 255,
    Code.FRAME_NOT_GLOBAL: 255,
    Code.NOT_FINITE: "acceleration",
    Code.NOT_KNOWN_YET: 2**24,
}


def longest(code):
    """Texts with values as long as they get."""
    if code is Code.PARAMETER_TYPE:
        return Told(code, (16 * "X", "REAL32"))
    if code is Code.ABOVE_LIMIT:
        return Told(code, ("acceleration", 99_999.9, "m/s^2"))
    longer = {**LONG, "": NAMES.get(code, LONG[""])}
    return Told(code, tuple(longer.get(spec, -9999.9) for spec in places(code)))


def section(first, last):
    return CODES[CODES.index(first) : CODES.index(last) + 1]


LACKING = [
    Told(Code.LACKS, (Told(what, n * (9999.9,)), short, Told(part, (of,))))
    for what, n in ((Code.WAY, 1), (Code.WAY_LED, 2), (Code.SPEED_AND_WAY, 2))
    for part in (Code.METRES_OF_IT, Code.PERCENT_OF_IT, Code.PERCENT_LED)
    for of in (0.0, 1.0)
    for short in (1e300, 99_999.9)
]
VEHICLES = [longest(code) for code in section(Code.NO_STATE, Code.ASKS_TOO_MUCH)] + LACKING
COMMANDS = [longest(code) for code in section(Code.TO_NO_SYSTEM, Code.INTERVAL_NEGATIVE)]
SETPOINTS = [longest(code) for code in section(Code.ANOTHER_SENDS, Code.YAW_RATE_ONLY)] + LACKING
BELIEFS = [longest(code) for code in section(Code.LIGHTER, Code.TRIM_PINNED)]
REASONS = [
    *(Told(Code.DENIED, ("Figure eight", why)) for why in VEHICLES + COMMANDS),
    *(Told(Code.NOT_READY_TO_ARM, (why,)) for why in VEHICLES),
    *(Told(Code.SETPOINT_REFUSED, (why,)) for why in SETPOINTS),
    *(Told(Code.NOT_AS_BELIEVED, (why,)) for why in BELIEFS),
]
OUTER = [longest(code) for code in CODES if code.value[0].isupper()]


@pytest.mark.parametrize("told", OUTER + REASONS, ids=words)
def test_every_text_fits_a_statustext_whatever_its_numbers(told):
    text = brief(told)
    assert 0 < len(text) <= ROOM
    assert CUT not in text
    assert says(text, told.code)


def test_a_text_that_fits_is_told_whole():
    told = Told(Code.DENIED, ("Takeoff", Told(Code.NO_STATE)))
    assert brief(told) == words(told)


def test_of_two_texts_that_fit_the_longer_is_told():
    why = Told(Code.LACKS, (Told(Code.WAY, (30.0,)), 4.1, Told(Code.METRES_OF_IT, (15.0,))))
    assert (
        brief(Told(Code.SETPOINT_REFUSED, (why,)))
        == "Setpoint rejected: lacks 5 N; 15.0 m would do"
    )


def test_a_name_that_is_longer_than_the_text_is_cut_and_shown_to_be():
    text = brief(Told(Code.UNSUPPORTED, (80 * "x",)))
    assert len(text) == ROOM
    assert text.endswith(CUT)
