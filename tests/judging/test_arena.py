"""Setpoints and the arena, of a flight that is short enough for uncompiled kernels."""

from __future__ import annotations

import pytest

from gcs_tools.flight.run import prepared
from gcs_tools.judging.preflight_check import unflyable
from tests.judging.test_admitted import HERE, steps


@pytest.mark.parametrize(("arena_m", "is_inside"), [(5.0, True), (4.999, False)])
def test_the_edge_of_the_arena_is_inside(arena_m: float, is_inside: bool) -> None:
    """A setpoint 3 m up and 4 m north of the start is 5 m away."""
    settings = (
        steps(HERE, (0.05, 0.0, 4.0, 3.0)), "flight.start={position_m=[0, 0, 0]}",
        "flight.duration_s=1", "law.guard='warn'", f"flight.arena_m={arena_m}",
    )  # fmt: skip
    mission, scene = prepared("gust_step", settings)
    found = [each.why for each in unflyable(mission, scene)]
    assert ("arena" not in found) is is_inside
