"""The table of modes: numbers that clients know, what each needs, and what follows."""

from __future__ import annotations

import itertools

import pytest

from fcu.vehicle import modes
from fcu.vehicle.modes import MODES, ON_LOSS, TRANSITIONS, Event, Mode, Need


def test_every_mode_has_its_own_numbers_and_is_found_by_them():
    for mode, row in MODES.items():
        number = modes.custom_mode(mode)
        assert modes.of_numbers(number >> 16 & 0xFF, number >> 24) is mode
        if row.standard:
            assert modes.of_standard(row.standard) is mode
    assert len({modes.custom_mode(mode) for mode in Mode}) == len(Mode)


@pytest.mark.parametrize(
    ("mode", "number"),  # px4_custom_mode: main << 16 | sub << 24
    [
        (Mode.HOLD, 4 << 16 | 3 << 24),
        (Mode.TAKEOFF, 4 << 16 | 2 << 24),
        (Mode.RETURN, 4 << 16 | 5 << 24),
        (Mode.LAND, 4 << 16 | 6 << 24),
        (Mode.POSITION, 3 << 16),
        (Mode.OFFBOARD, 6 << 16),
    ],
)
def test_px4s_encoding(mode, number):
    assert modes.custom_mode(mode) == number


@pytest.mark.parametrize(
    "numbers", [(1, 0), (2, 0), (5, 0), (7, 0), (4, 4), (4, 1), (0, 0), (255, 255)]
)
def test_what_this_vehicle_does_not_have_is_none(numbers):
    assert modes.of_numbers(*numbers) is None


def test_no_mode_is_called_absent_that_is_there():
    assert all(modes.of_numbers(*numbers) is None for numbers in modes.OTHERS)
    assert all(modes.of_standard(number) is None for number in modes.OTHER_STANDARD)
    assert modes.shown(4, 3) == "Hold"
    assert modes.shown(4, 4) == "Mission"
    assert modes.shown(9, 9) == "9, 9"


def test_a_mode_is_entered_exactly_when_its_needs_are_met():
    for wanted in Mode:
        needs = frozenset(MODES[wanted].needs)
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


def test_the_loss_of_a_script_never_means_to_go_on():
    assert Mode.OFFBOARD not in ON_LOSS.values()
    assert set(ON_LOSS) == {0, 3, 4, 5, 6, 7}
