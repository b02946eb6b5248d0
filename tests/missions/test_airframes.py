"""Every shipped airframe flies the missions that are written for any, on gains that follow from it."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

import gcs_tools
from fcu.interface.airframe import SHIPPED
from gcs_tools.judging.result import junit
from gcs_tools.judging.result import read as read_result
from gcs_tools.missions.mission import shipped
from tests.command_line import gcs

OWN_LAW = Path(__file__).parents[1] / "own_law" / "plain_cascade.py"
MISSIONS = ("airframe_step", "airframe_eight", "airframe_noise", "airframe_tour")
PAGE = Path(__file__).parents[2] / "docs" / "missions.md"
SECTION = PAGE.read_text().partition("## Which shipped mission")[2].partition("\n## ")[0]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in SECTION.splitlines()
    if line.startswith("| `")
]


def flown(mission, airframe, folder):
    """The result of a mission in process, with nothing kept but it."""
    return gcs_tools.fly(
        mission, airframe=airframe, in_process=True, figure="never", record="none",
        out=folder / "run",
    )  # fmt: skip


def test_the_page_says_of_each_shipped_mission_once_which_vehicle_it_is_for():
    named = [name for row in ROWS for name in re.findall(r"`([\w/.]+)`", row[0])]
    assert sorted(named) == sorted([*shipped(), "benchmark/..."])
    assert named[: len(MISSIONS)] == list(MISSIONS)
    assert "benchmark/... are for every airframe" in " ".join(gcs("fly", "--help").stdout.split())


@pytest.mark.slow
@pytest.mark.parametrize("law", ["px4", str(OWN_LAW)])
@pytest.mark.parametrize("mission", MISSIONS)
def test_laws_without_a_guard_are_judged_by_the_truth(mission, law, tmp_path):
    flight = gcs_tools.fly(
        mission, law=law, in_process=True, figure="never", record="none", out=tmp_path / "run"
    )
    assert flight.passed, flight.expectations
    assert {each.passed for each in flight.expectations} == {True, None}
    written = read_result(tmp_path / "run" / "result.json")
    assert [each.passed for each in written.expectations] == [
        each.passed for each in flight.expectations
    ]
    junit([flight], tmp_path / "junit.xml")
    (case,) = ElementTree.parse(tmp_path / "junit.xml").getroot()
    (out,) = case
    left = [each for each in flight.expectations if each.passed is None]
    assert out.tag == "system-out" and out.text.count("laws_with") == 0
    assert len(out.text.splitlines()) == len(left)


@pytest.mark.slow
def test_a_law_that_drops_the_vehicle_fails_by_the_truth(tmp_path):
    flight = gcs_tools.fly(
        "airframe_step", law="px4", settings=["plant.mass_kg=20.0"], in_process=True, figure="never",
        record="none", out=tmp_path / "run",
    )  # fmt: skip
    assert not flight.passed and any(each.is_missed for each in flight.expectations)


@pytest.mark.slow
@pytest.mark.parametrize("mission", [
    *shipped("benchmark"),
    *(name for row in ROWS if row[1].endswith("meant for the S1000")
      for name in re.findall(r"`(\w+)`", row[0])),
])  # fmt: skip
@pytest.mark.parametrize("airframe", SHIPPED)
def test_what_the_page_says_of_every_airframe_is_so(airframe, mission, tmp_path):
    flight = flown(mission, airframe, tmp_path)
    assert flight.passed, flight.expectations


@pytest.mark.slow
@pytest.mark.parametrize(("mission", "airframe", "item", "off_m"), [
    ("urban_step", "hexa", "reference_error_rms_settled_m", 0.0156),
    ("square_and_land", "quad", "item 3 (follow): setpoint_error_max_m", 0.54),
])  # fmt: skip
def test_what_a_mission_of_the_s1000_misses_with_others_is_what_the_page_says(
    mission, airframe, item, off_m, tmp_path
):
    flight = flown(mission, airframe, tmp_path)
    (missed,) = (line for line in flight.expectations if not line.passed)
    assert missed.text.startswith(item)
    assert missed.value == pytest.approx(off_m, rel=0.02)


@pytest.mark.parametrize("mission", MISSIONS)
@pytest.mark.parametrize("airframe", SHIPPED)
def test_an_airframe_flies_its_missions(airframe, mission, tmp_path):
    flight = flown(mission, airframe, tmp_path)
    assert [line.name for line in flight.expectations if not line.passed] == []
    assert flight.exit_code == 0
