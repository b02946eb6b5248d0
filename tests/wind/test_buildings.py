"""Buildings of a field as boxes, from the field to the recording and the picture."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs_tools.flight import run
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load
from gcs_tools.studies.street_field import BUILDINGS as HOUSES
from gcs_tools.wind_fields.buildings import BUILDINGS, boxes, told_boxes
from sitl_plant.physics.wind.packed_field import opened
from tests.wind.test_along import sheared


def test_boxes_are_the_houses_that_a_field_was_made_of():
    scene = scenario(load("street_canyon"))
    layer = scene.layers.field
    found = boxes(opened(Path(layer.path)).field, (0.0, 0.0, 0.0))
    wanted = [(*map(float, walls), 0.0, float(roof)) for *walls, roof in HOUSES]
    assert sorted(found) == sorted(wanted)
    assert found[0][5] == 28.0  # the highest first


def test_boxes_lie_about_the_origin_of_the_mission():
    assert boxes(sheared(), (10.0, 20.0, 3.0)) == [(-10.0, 10.0, -20.0, 0.0, -3.0, 5.0)]


def test_a_flight_tells_its_buildings_and_what_is_none_is_left_out():
    mission = load("street_canyon")
    told = json.loads(json.dumps(run.flies(mission, scenario(mission), mission.airframe)))
    assert len(told_boxes(told)) == len(HOUSES)
    assert told_boxes({BUILDINGS: json.dumps(told[BUILDINGS])}) == told_boxes(told)
    flat = load("paper_nominal")
    assert BUILDINGS not in run.flies(flat, scenario(flat), flat.airframe)
    assert told_boxes({}) == []


@pytest.mark.parametrize(
    "told", ["{", "[1, 2]", '[[1, 2, 3, 4, 5, "6"]]', "[[1, 2, 3, 4, 5, 1e300]]", '{"a": 1}', 7]
)
def test_buildings_that_are_none_are_left_out(told):
    assert told_boxes({BUILDINGS: told}) == []
