"""Plan files: what a ground station would upload for them, and what is wrong with one."""

from __future__ import annotations

import copy
import json
import math
import random
from pathlib import Path

import pytest

import gcs_tools
from gcs_tools.flight.plan_look import look
from gcs_tools.missions import fields, plan_file
from gcs_tools.missions.mission import MissionError, load
from gcs_tools.missions.plan_file import PlanError, read
from tests.command_line import gcs

SQUARE = Path(gcs_tools.__file__).parents[1] / "missions" / "square.plan"


@pytest.fixture
def file(tmp_path):
    """`file(tables or text, "name.plan")`: a file."""

    def write(content, name="a.plan"):
        path = tmp_path / name
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return path

    return write


@pytest.fixture
def tables():
    return json.loads(SQUARE.read_text())


def test_a_plan_of_qgroundcontrol_is_read():
    plan = read(SQUARE)
    assert [item.command for item in plan.mission] == [22, 178, 16, 16, 16, 16, 21]
    assert [item.command for item in plan.fence] == [5001] * 4 + [5004]
    assert plan.fence[0].params[0] == 4.0
    assert math.isnan(plan.mission[2].params[3])  # null
    assert len(plan.rally) == 1
    assert plan.lands
    assert look(plan).refused == ""


def test_a_jump_leads_to_the_item_of_its_number(file, tables):
    items = tables["mission"]["items"]
    items.insert(
        5, {"autoContinue": True, "command": 177, "doJumpId": 50, "frame": 2,
            "params": [3, 2, 0, 0, 0, 0, 0], "type": "SimpleItem"}
    )  # fmt: skip
    assert read(file(tables)).mission[5].params[:2] == (2.0, 2.0)
    items[5]["params"][0] = 99
    with pytest.raises(PlanError, match=r"items\[5\]\.params\[0\]"):
        read(file(tables))


def test_a_survey_is_flown_by_the_items_that_it_holds(file, tables):
    items = tables["mission"]["items"]
    survey = {"complexItemType": "survey", "type": "ComplexItem",
              "TransectStyleComplexItem": {"Items": items[2:5]}}  # fmt: skip
    tables["mission"]["items"] = [*items[:2], survey, *items[5:]]
    assert read(file(tables)).mission == read(SQUARE).mission
    del survey["TransectStyleComplexItem"]
    with pytest.raises(PlanError, match="survey"):
        read(file(tables))


WAYPOINTS = """QGC WPL 110
0 1 0 16 0 0 0 0 47.4 8.5 500 1
1 0 3 22 0 0 0 0 47.4 8.5 6 1
2 0 3 16 0 2 0 0 47.4002 8.5 8 1
3 0 2 177 2 1 0 0 0 0 0 1
4 0 3 20 0 0 0 0 0 0 0 0
"""


def test_a_waypoints_file_is_read_without_its_home(file):
    plan = read(file(WAYPOINTS, "a.waypoints"))
    assert [item.command for item in plan.mission] == [22, 16, 177, 20]
    assert plan.mission[2].params[0] == 1.0  # as home is not counted
    assert [item.autocontinue for item in plan.mission] == [True, True, True, False]
    assert (plan.home.lat_deg, plan.home.alt_m) == (47.4, 500.0)


@pytest.mark.parametrize(
    ("line", "where"),
    [
        ("2 0 3 16 0 2 0 0 47.4002 8.5 8", ":4: expected 12 numbers"),
        ("2 0 3 x 0 2 0 0 47.4002 8.5 8 1", ":4: expected 12 numbers"),
        ("2 0 3.5 16 0 2 0 0 47.4002 8.5 8 1", ":4: expected whole numbers"),
        ("7 0 3 16 0 2 0 0 47.4002 8.5 8 1", ":4: expected item 2"),
        (
            "2 0 3 16 0 2 0 0 1e300 8.5 8 1",
            ":4: expected a number from -1e+09 to 1e+09 in column 9",
        ),
        ("2 0 3 16 0 2 0 0 47.4002 8.5 -inf 1", "in column 11"),
        (f"2 0 3 16 {'9' * 6000} 2 0 0 47.4002 8.5 8 1", "in column 5"),
    ],
)
def test_a_broken_line_is_named(file, line, where):
    lines = WAYPOINTS.splitlines()
    lines[3] = line
    with pytest.raises(PlanError) as told:
        read(file("\n".join(lines), "a.waypoints"))
    assert where in str(told.value)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"fileType": "Plan"}', "[" * 5000, "QGC WPL 110\n"]
)
def test_what_is_no_plan_is_said(file, text):
    with pytest.raises(PlanError):
        read(file(text))


@pytest.mark.parametrize("value", ["1e300", "-1000000001", "1e999", "9" * 310, "9" * 6000])
def test_a_number_that_is_too_large_is_named(file, tables, value):
    """Also a whole one that no float holds, and one of more digits than Python reads."""
    tables["mission"]["items"][2]["params"][4] = "HERE"
    path = file(json.dumps(tables).replace('"HERE"', value))
    told = gcs("plan", "show", path)
    assert told.exit_code == 2
    said = " ".join(told.output.split())
    assert ".mission.items[2].params[4]: expected a number from -1e+09 to 1e+09" in said


def test_plans_have_the_bound_of_mission_files():
    assert plan_file._MOST == fields.MOST


def test_a_byte_order_mark_is_passed_over(file):
    assert read(file("\ufeff" + SQUARE.read_text())).mission == read(SQUARE).mission
    assert read(file("\ufeff" + WAYPOINTS, "a.waypoints")).home is not None


@pytest.mark.parametrize("corners", [[], [[47.4, 8.5]], None])
def test_a_polygon_without_an_inside_is_refused(file, tables, corners):
    """It would be a plan without its fence."""
    polygon = tables["geoFence"]["polygons"][0]
    if corners is None:
        del polygon["polygon"]
    else:
        polygon["polygon"] = corners
    with pytest.raises(PlanError, match=r"\.geoFence\.polygons\[0\]\.polygon: expected 3 corners"):
        read(file(tables))


@pytest.mark.parametrize("number", [[1], "1", None, True, 1.5, 1e300])
def test_a_number_to_jump_to_that_is_none_is_refused(file, tables, number):
    tables["mission"]["items"][1]["doJumpId"] = number
    with pytest.raises(PlanError, match=r"\.mission\.items\[1\]\.doJumpId: expected a whole"):
        read(file(tables))


def test_a_speed_of_almost_nothing_leaves_a_time(file, tables):
    tables["mission"]["items"][1]["params"][1] = 1e-320
    assert math.isfinite(read(file(tables)).most_s)


def mutated(rng, tables):
    """A plan with one value somewhere in it replaced by another one, or taken out."""
    made = copy.deepcopy(tables)
    places = []

    def walk(value):
        each = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in list(each):
            places.append((value, key))
            if isinstance(inner, dict | list):
                walk(inner)

    walk(made)
    for _ in range(rng.randint(1, 3)):
        value, key = rng.choice(places)
        if isinstance(value, dict) and rng.random() < 0.3:
            value.pop(key, None)
        elif not isinstance(value, list) or key < len(value):
            value[key] = rng.choice(
                [None, -1, 0, 1e9, 1e300, -7.5, True, "x", [], {}, 2**40, 400, 177, 5001]
            )
    return made


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.computes
def test_a_mutated_plan_is_read_or_refused_with_its_place(file, tables, seed):
    """A hundred of each seed: nothing but a PlanError, and a look that says why or takes it."""
    rng = random.Random(seed)
    for _ in range(100):
        try:
            plan = read(file(mutated(rng, tables)))
            found = look(plan)
        except PlanError:
            continue
        assert found.refused or len(found.steps) == len(plan.mission)


def test_a_plan_file_is_a_mission_by_itself():
    mission = load(str(SQUARE))
    (item,) = mission.flight.items
    assert (item.kind, item.plan.lands, mission.flight.start.on_ground) == ("plan", True, True)
    assert mission.flight.duration_s > 60.0


def test_a_mission_names_its_plan(tmp_path):
    toml = 'title = "A plan."\n[flight]\nduration_s = 60.0\nground_z_m = 0.0\nstart = { on_ground = true }\n'
    path = tmp_path / "a.toml"
    path.write_text(f'{toml}plan = "none.plan"\n')
    with pytest.raises(
        MissionError, match=r"a\.toml:6: \[flight\] plan: .*none\.plan: No such file"
    ):
        load(str(path))
    (tmp_path / "square.plan").write_text(SQUARE.read_text())
    path.write_text(f'{toml}plan = "square.plan"\n')
    assert load(str(path)).flight.items[0].kind == "plan"
    path.write_text(f'{toml}arena_m = 10.0\nplan = "square.plan"\n')
    with pytest.raises(MissionError, match=r"\[flight\] plan: leads .* arena_m"):
        load(str(path))


def test_a_plan_that_leads_nowhere_is_no_mission(tmp_path):
    plan = json.loads(SQUARE.read_text())
    speed = {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 4.0, -1, 0, 0, 0, 0]}
    plan["mission"]["items"] = [speed]
    (tmp_path / "still.plan").write_text(json.dumps(plan))
    with pytest.raises(MissionError, match=r"still\.plan: no item leads the vehicle anywhere"):
        load(str(tmp_path / "still.plan"))


def test_another_version_of_waypoints_is_refused(file):
    with pytest.raises(PlanError, match=r":1: expected QGC WPL 110, got version 120"):
        read(file(WAYPOINTS.replace("110", "120", 1), "a.waypoints"))


@pytest.mark.parametrize("text", ["WAYPOINTS", "SQUARE"])
def test_a_plan_by_another_name_is_told_by_its_content(tmp_path, text):
    path = tmp_path / "a.txt"
    path.write_text(WAYPOINTS if text == "WAYPOINTS" else SQUARE.read_text())
    with pytest.raises(MissionError, match=r"a plan: its name has to end in \.plan or \.waypoints"):
        load(str(path))


@pytest.mark.parametrize("version", [7, 0, "1", None])
def test_another_version_of_a_plan_is_named(file, tables, version):
    tables["version"] = version
    with pytest.raises(PlanError, match=r"\.version: expected 1, got "):
        read(file(json.dumps(tables)))
    tables["version"], tables["mission"]["version"] = 1, version
    with pytest.raises(PlanError, match=r"\.mission\.version: expected 2, got "):
        read(file(json.dumps(tables)))


def test_a_file_of_another_kind_is_told_what_there_are(tmp_path):
    path = tmp_path / "way.kml"
    path.write_text('<?xml version="1.0"?><kml></kml>')
    done = gcs("fly", path)
    assert done.exit_code == 2
    assert "a file whose name ends in one of .toml, .plan, .waypoints" in " ".join(
        done.stderr.split()
    )


@pytest.mark.parametrize(("jump", "returns"), [(None, 4), (3, 4), (6, None)])
def test_a_return_ends_a_plan_unless_a_jump_leads_over_it(file, tables, jump, returns):
    items = tables["mission"]["items"]
    items[4].update(command=20, frame=2, params=[0, 0, 0, 0, 0, 0, 0])
    if jump is not None:
        to = items[jump]["doJumpId"]
        items[2].update(command=177, frame=2, params=[to, 1, 0, 0, 0, 0, 0])
    assert read(file(json.dumps(tables))).returns == returns
