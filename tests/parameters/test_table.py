"""One table of parameters: builder, missions, MAVLink, docs and README hold the same."""

from __future__ import annotations

import json
import math
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from fcu.interface.airframe import OCTO, believed, load
from fcu.interface.parameter import Parameter, ParameterError, blank, default, filled, values
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns
from fcu.laws import loader
from fcu.parameters import VEHICLE, Parameters, Refused, entries
from fcu.parameters_page import page
from fcu.process.settings import PARAMETERS, Settings, check, settings
from gcs_tools.missions import schema
from gcs_tools.missions.mission import MissionError, override
from gcs_tools.missions.mission import load as mission
from gcs_tools.missions.tables import law_table

ROOT = Path(__file__).parents[2]
AIRFRAME = load(OCTO)
KEYED = [row for row in PARAMETERS if row.key]
RANGED = [row for row in KEYED if row.words is None]
BY_MAVLINK = entries(PARAMETERS, AIRFRAME)
IN_SCHEMA = json.loads(schema.text())["$defs"]


def in_schema(row):
    above, _, key = row.key.rpartition(".")
    return IN_SCHEMA[above.capitalize() or "Law"]["properties"][key]


def numbers_in(node):
    """Every node of a JSON Schema that is one number."""
    if isinstance(node, dict):
        if node.get("type") == "number":
            yield node
        for inside in node.values():
            yield from numbers_in(inside)
    elif isinstance(node, list):
        for inside in node:
            yield from numbers_in(inside)


def name(row):
    return row.name


@cache
def defaults():
    """Settings of the defaults, which take a while to derive."""
    return settings(*believed(), 500.0)


def test_names_and_keys_are_told_apart_and_fit():
    names = [part.name for row in (*PARAMETERS, *VEHICLE) for part in row.parts]
    assert len(names) == len(set(names)) == len(entries((*PARAMETERS, *VEHICLE), AIRFRAME))
    assert all(0 < len(n.encode()) <= 16 for n in names)
    keys = [row.key for row in KEYED]
    assert len(keys) == len(set(keys))
    assert all(row.sentence and row.group for row in (*PARAMETERS, *VEHICLE))


@pytest.mark.parametrize("row", PARAMETERS, ids=name)
def test_a_row_is_of_fields_that_there_are(row):
    assert set(row.fields) <= set(columns(Settings))
    assert {f for part in row.parts for f in part.fields} in ({*row.fields}, set())
    row.numbers(default(row, AIRFRAME))  # within its range


@pytest.mark.parametrize("row", RANGED, ids=name)
def test_missions_and_their_schema_have_its_range_sentence_and_unit(row):
    node = in_schema(row)
    assert row.sentence in node["description"] and row.unit in node["description"]
    ends = [(n.get("minimum", -math.inf), n.get("maximum", math.inf)) for n in numbers_in(node)]
    allowed = {(row.low, row.high)}
    assert set(ends) - {(-math.inf, math.inf)} == allowed - {(-math.inf, math.inf)}


@pytest.mark.parametrize("row", [r for r in KEYED if r.words], ids=name)
def test_missions_and_mavlink_have_its_words(row):
    assert set(in_schema(row)["enum"]) == set(row.words)
    assert BY_MAVLINK[row.parts[0].name].values == tuple(sorted(row.words.values()))


@pytest.mark.parametrize("row", [r for r in RANGED if not r.interval], ids=name)
@pytest.mark.parametrize("end", ["low", "high"])
@pytest.mark.computes
def test_what_is_out_of_range_is_refused_wherever_it_is_said(row, end):
    """By the builder, by missions, over MAVLink and in Params handed over; the end itself by none."""
    value, beyond = getattr(row, end), 1.01 * getattr(row, end) + (1e-3 if end == "high" else -1e-3)
    if end == "low" and value > 0.0:
        beyond = 0.99 * value
    if not math.isfinite(value):
        return
    three = len(row.fields) == 3
    row.numbers([value] * 3 if three else value)
    with pytest.raises(ParameterError, match=f"^{re.escape(row.key)}: "):
        settings(*believed(), 500.0, {row.key: [beyond] * 3 if three else beyond})
    said = f"law.{row.key}={[beyond] * 3 if three else beyond!r}"
    with pytest.raises(MissionError, match=re.escape(f"[law] {row.key}")):
        override(mission("paper_nominal"), said)
    for part in row.parts:
        params = Parameters(defaults(), 1)
        scaled = math.degrees(beyond) if row.degrees else beyond
        with pytest.raises(Refused) as refused:
            params.set(part.name, scaled, False)
        assert refused.value.kind == "VALUE_OUT_OF_RANGE"
    if row.fields:
        numbers = (beyond,) * len(row.fields)
        law = row.put(defaults(), numbers)
        if row.get(law) == pytest.approx(numbers):  # a response slower than the rotors is none
            with pytest.raises(ParameterError):
                check(law)


@pytest.mark.parametrize("row", [r for r in RANGED if r.parts], ids=name)
@pytest.mark.computes
def test_a_value_that_is_built_with_is_the_one_that_mavlink_tells(row):
    """A twentieth less than the default, whatever the conversion."""
    given = [0.95 * v for v in row.numbers(default(row, AIRFRAME))]
    law = settings(*believed(), 500.0, {row.key: given if len(given) > 1 else given[0]})
    params = Parameters(law, 1)
    for part in row.parts:
        value = given[row.fields.index(part.fields[0])]
        value = math.degrees(value) if row.degrees else value
        assert params[part.name] == pytest.approx(value, rel=1e-6)


@pytest.mark.computes
def test_every_row_is_on_the_page_in_its_group():
    sections = {s.splitlines()[0]: s for s in page().split("\n## ")}
    for row in (*PARAMETERS, *VEHICLE):
        assert not row.key or f"| {row.key} " in sections[row.group].replace(",", " ")
        for part in row.parts:
            (line,) = re.findall(rf"^.*\| {part.name} \|.*$", page(), re.MULTILINE)
            assert line in sections[row.group] and part.sentence in line


@pytest.mark.parametrize(("room", "of"), [("laws/mmrac", "law."), ("guard", "guard.")])
def test_the_readmes_have_the_units_of_the_table(room, of):
    text = (ROOT / "fcu" / room / "README.md").read_text(encoding="utf-8")
    units = {}
    for names, unit in re.findall(r"^\|[^|]*\| (`[^|]*`) \|[^|]*\| ([^|]*) \|", text, re.MULTILINE):
        each = unit.replace("²", "^2").replace("³", "^3").replace("–", "").split(", ")
        for n, name in enumerate(re.findall(r"`([\w.]+)`", names)):
            units[name] = each[n % len(each)]
    held = 0
    for row in RANGED:
        field = row.fields[0].removesuffix(".x") if row.fields else ""
        if field.startswith(of) and row.convert is None:
            assert units[field.rpartition(".")[2]] == row.unit, row.name
            held += 1
    assert held > 4


# --- a law of somebody else's


class Plain(NamedTuple):
    h: float
    k_p: float
    damping: Vec3


ROWS = (
    Parameter("k_p", "PL_KP", 2.0, 0.1, 10.0, "1/s", "gain of the position"),
    Parameter("damping", "", 1.0, 0.0, 5.0, "", "of each axis", axes=True),
)


def test_a_law_of_somebody_elses_gets_keys_of_missions_and_a_page():
    start = filled(blank(Plain, h=0.004), ROWS, values(ROWS, AIRFRAME, {"damping": [1, 2, 3]}))
    assert start == Plain(h=0.004, k_p=2.0, damping=Vec3(1.0, 2.0, 3.0))
    for chosen in ({"k_p": 11.0}, {"k_p": "fast"}, {"k_q": 1.0}, {"damping": [1.0, 2.0]}):
        with pytest.raises(ParameterError):
            values(ROWS, AIRFRAME, chosen)
    assert law_table(ROWS).model_validate({"k_p": 3.0}).k_p == 3.0
    assert "| k_p | PL_KP | 2 | 0.1 to 10 1/s | gain of the position |" in page(ROWS)


def test_a_law_of_somebody_elses_gets_names_of_mavlink():
    law = loader.load(ROOT / "tests" / "own_law" / "plain_cascade.py")
    start = law.settings.settings(*believed(), 500.0)
    params = Parameters(start, 1, flown=law)
    assert params.set("PC_K_R", 4.0, True)
    assert params.settings == start._replace(law=start.law._replace(k_r=4.0))
    assert "MR_F_M" not in params.names
