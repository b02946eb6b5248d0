"""A thousand mutated plans, some over a link that loses a fifth: never half a plan, never silence."""

from __future__ import annotations

import pytest

from tests.attacks.plans import attack


@pytest.mark.parametrize("seed", range(4))
def test_mutated_plans_are_taken_whole_or_not_at_all(seed):
    results = attack(seed, 250)
    assert results["MAV_MISSION_ACCEPTED"] > 25  # a fifth of them, by the whole attack
    assert len(results) > 5
