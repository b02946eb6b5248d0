"""The table of modes: what each needs, and what follows."""

from __future__ import annotations

import itertools

from fcu.vehicle import modes
from fcu.vehicle.modes import NEEDS, TRANSITIONS, Event, Mode, Need


def test_a_mode_is_entered_exactly_when_its_needs_are_met():
    for wanted in Mode:
        needs = frozenset(NEEDS[wanted])
        for n in range(len(Need) + 1):
            for met in map(frozenset, itertools.combinations(Need, n)):
                missing = modes.denied(wanted, met)
                assert (missing is None) == (needs <= met)
                assert missing is None or missing in needs - met


def test_every_mode_and_event_has_a_mode_that_follows():
    for mode, event in itertools.product(Mode, Event):
        assert modes.after(mode, event) in Mode
    assert modes.after(Mode.TAKEOFF, Event.ARRIVED) is Mode.HOLD
    assert modes.after(Mode.RETURN, Event.ARRIVED) is Mode.LAND
    assert modes.after(Mode.HOLD, Event.ARRIVED) is Mode.HOLD
    assert all(TRANSITIONS[mode, Event.DISARMED] is Mode.HOLD for mode in Mode)
