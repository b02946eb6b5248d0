"""The numbers that ground stations know a mode by."""

from __future__ import annotations

import pytest

from fcu.services import status
from fcu.services.status import MODES
from fcu.vehicle.modes import Mode


def test_every_mode_has_its_own_numbers_and_is_found_by_them():
    for mode, row in MODES.items():
        number = status.custom_mode(mode)
        assert status.of_numbers(number >> 16 & 0xFF, number >> 24) is mode
        if row.standard:
            assert status.of_standard(row.standard) is mode
    assert len({status.custom_mode(mode) for mode in Mode}) == len(Mode)


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
    assert status.custom_mode(mode) == number


@pytest.mark.parametrize("numbers", [(8, 0), (4, 9), (4, 1), (0, 0), (255, 255)])
def test_what_this_vehicle_does_not_have_is_none(numbers):
    assert status.of_numbers(*numbers) is None


def test_no_mode_is_called_absent_that_is_there():
    assert all(status.of_numbers(*numbers) is None for numbers in status.OTHERS)
    assert all(status.of_standard(number) is None for number in status.OTHER_STANDARD)
    assert status.shown(4, 3) == "Hold"
    assert status.shown(4, 4) == status.shown(4, 0) == "Mission"
    assert status.shown(9, 9) == "9, 9"


def test_every_mode_is_known_by_numbers():
    assert set(MODES) == set(Mode)
