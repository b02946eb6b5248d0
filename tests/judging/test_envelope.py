"""A mission before it flies: the terms of its room, and how far each condition reaches."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.kernel.algebra import Vec3
from gcs_tools.flight.run import prepared
from gcs_tools.judging.envelope import WAYS, arrivals, arrives_s, speed, terms, tightest, way
from tests.judging.test_admitted import steps

UP_AND_FAR = steps((0.0, 0.0, 0.0, 3.0), (1.0, 0.0, 20.0, 3.0))
SHORT = "flight.duration_s=2"


def scene_of(*settings: str):
    return prepared("gust_step", (SHORT, *settings))


def test_all_terms_together_leave_the_margin_and_what_a_way_demands_costs() -> None:
    """A climb takes the greatest mass times its acceleration from what the rotors can lift."""
    _, scene = scene_of()
    still, rest = Vec3(0.0, 0.0, 0.0), 5.0
    hover = terms(scene.settings, still, still, rest)
    assert hover.acceleration == 0.0
    assert hover.left == pytest.approx(rest)
    climb = terms(scene.settings, Vec3(0.0, 0.0, 6.0), still, rest)
    assert 0.0 < climb.acceleration < hover.hover == climb.hover
    assert climb.left == pytest.approx(rest)
    sideways = terms(scene.settings, still, Vec3(6.0, 0.0, 0.0), rest)
    assert (sideways.acceleration, sideways.speed > hover.speed) == (0.0, True)
    assert sideways.left == pytest.approx(rest)


def test_the_tightest_point_is_the_worst_of_the_way_with_the_motion_that_it_has_there() -> None:
    _, scene = scene_of(UP_AND_FAR)
    found, rows = tightest(scene), way(scene)
    assert found.margin == rows[:, 1].min() < rows[0, 1]
    assert found.at == pytest.approx(1.0, abs=0.05)  # the second step begins
    assert found.a_d.y > 3.0  # its way
    after = rows[np.searchsorted(rows[:, 0], found.at)]
    assert (*found.a_d, *found.v) == tuple(after[2:8])
    assert 0.0 < found.v.z < 3.0  # of the first, which is still flown
    assert abs(found.v.x) < 1e-9


def test_the_exact_set_reaches_farther_than_the_largest_ball_in_it() -> None:
    settings = scene_of()[1].settings
    for name in ("to the side", "up"):
        found = speed(settings, WAYS[name], name)
        assert found.ball is not None and found.ball > 0.0
        assert found.exact > 1.05 * found.ball


def test_each_setpoint_is_arrived_at_from_rest_at_the_one_before() -> None:
    """The first in the time that is stated for the mission, one that is farther away later."""
    mission, scene = scene_of("law.guard='govern'", UP_AND_FAR)
    near, far = arrivals(mission.flight, scene)
    assert near.within_s is not None and far.within_s is not None
    assert near.within_s == arrives_s(scene)
    assert far.within_s > near.within_s
    assert [(each.at_s, each.stands_s) for each in (near, far)] == [(0.0, 1.0), (1.0, 1.0)]
    assert arrivals(mission.flight, scene_of("law.guard='warn'", UP_AND_FAR)[1]) == ()
