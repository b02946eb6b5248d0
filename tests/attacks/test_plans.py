"""A thousand mutated plans, some over a link that loses a fifth: never half a plan, never silence.

And a few of the plans that are drawn, flown in wind and judged by the truth.
"""

from __future__ import annotations

import pytest

from tests.attacks.flown_plans import flown
from tests.attacks.plans import attack


@pytest.mark.parametrize("seed", range(4))
def test_mutated_plans_are_taken_whole_or_not_at_all(seed):
    results = attack(seed, 250)
    assert results["MAV_MISSION_ACCEPTED"] > 25  # a fifth of them, by the whole attack
    assert len(results) > 5


# 117: in this wind, a hexa took the lag of its reference model for the ground at 5 m and cut its rotors, six times
@pytest.mark.slow
@pytest.mark.parametrize("seed", [117, 100, 101])
def test_a_drawn_plan_is_flown_whole_or_refused_for_a_way_outside(seed):
    each = flown(seed)
    assert each.wrong == ""
