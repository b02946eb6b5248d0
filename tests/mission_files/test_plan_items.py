"""Limits of items of a plan in a mission file."""

from __future__ import annotations

import pytest

from gcs_tools.missions.mission import MissionError, load


def test_expectations_of_plan_items_stand_in_expect():
    mission = load("plan_square", ["expect.items.3.passed_m=2"])
    assert mission.expectations()["items"]["3"] == {"passed_m": {"limit": 2.0}}


@pytest.mark.parametrize(
    ("mission", "setting", "said"),
    [
        ("plan_square", "expect.items.7.took_s=3", "items.7: expected an item of the plan, 0 to 6"),
        ("plan_square", "expect.items.2.tok_s=3", "did you mean took_s?"),
        ("plan_square", "expect.items.02.took_s=3", "items.02: expected the number of an item"),
        (
            "plan_square",
            "expect.items.1.passed_m=3",
            "item 1 leads to no place",
        ),
        ("plan_square", "expect.items.x.took_s=3", "items.x: expected the number of an item"),
        ("paper_nominal", "expect.items.2.took_s=3", "needs one plan"),
        ("square_and_land", "expect.items.2.took_s=3", "needs one plan"),
    ],
)
def test_what_cannot_be_held_against_a_plan_is_said_with_its_key(mission, setting, said):
    with pytest.raises(MissionError, match="expect") as told:
        load(mission, [setting])
    assert said in str(told.value)
