"""A word that is none of those that may be written is told alike, wherever it stands."""

from __future__ import annotations

import math

import pytest

from fcu.interface.airframe import AirframeError, airframe, read
from fcu.interface.files.input_file import shown
from fcu.interface.parameter import ParameterError
from fcu.process.settings import PARAMETERS
from gcs_tools.missions.mission import MissionError, load

WORDS = {row.key: row for row in PARAMETERS if row.words is not None}


@pytest.mark.parametrize("key", WORDS)
def test_a_mission_and_an_airframe_say_the_same_of_a_wrong_word(key):
    with pytest.raises(ParameterError) as of_airframe:
        WORDS[key].numbers("both")
    with pytest.raises(MissionError) as of_mission:
        load("gust_step", [f"law.{key}=both"])
    said = str(of_airframe.value).removeprefix(f"{key}: ")
    *others, last = WORDS[key].words
    assert said == f"expected {', '.join(others)} or {last}, got both"
    assert str(of_mission.value).endswith(f"[law] {key}: {said}")


@pytest.mark.parametrize(("setting", "said"), [
    ("expect.ended=well", "expected time, arrived, landed, done, script, refused, diverged, crashed or fell, got well"),
    ("law.guard=true", "expected warn, govern or refuse, got true"),
    ('law.guard="true"', 'expected warn, govern or refuse, got "true"'),
    ('law.guard="on and off"', 'got "on and off"'),
    ("law.guard=3", "refuse, got 3"),
])  # fmt: skip
def test_words_stand_without_quotes_and_what_is_no_word_with_them(setting, said):
    with pytest.raises(MissionError) as error:
        load("gust_step", [setting])
    assert str(error.value).endswith(said)


def test_two_ways_to_place_rotors_at_once_are_told_without_quotes():
    rotors = {**read().tables["rotors"], "position_m": [[1.0, 0.0]]}
    with pytest.raises(AirframeError, match=r"angle_deg and radius_m, got both$"):
        airframe(rotors)


@pytest.mark.parametrize(("value", "said"), [
    ("fast", '"fast"'), (True, "true"), (math.nan, "nan"), (math.inf, "inf"), ([1, "a"], '[1, "a"]'),
    ({"a": [False]}, "{a = [false]}"), ("x" * 99, '"' + 56 * "x" + "..."),
])  # fmt: skip
def test_a_value_is_shown_as_toml_writes_it(value, said):
    assert shown(value) == said


@pytest.mark.parametrize("sign", ["\n", "\x1b", "\u2028", "\x85", "\udc80"])
def test_what_cannot_be_printed_stays_on_the_line(sign):
    assert shown(f"a{sign}b").isprintable()
