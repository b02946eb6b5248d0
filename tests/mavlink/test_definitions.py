"""The numbers that are not the dialect's own are the standard's."""

from __future__ import annotations

import pymavlink.dialects.v20.all as mavlink
import pytest

from fcu.mavlink import definitions as ours
from fcu.mavlink.px4_modes import AutoMode, MainMode, custom_mode, main_and_sub


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (ours.CommandId.SET_STANDARD_MODE, "MAV_CMD_DO_SET_STANDARD_MODE"),
        (ours.Result.CANCELLED, "MAV_RESULT_CANCELLED"),
        (ours.Result.UNSUPPORTED_MAV_FRAME, "MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME"),
        (ours.Capability.PARAM_ENCODE_BYTEWISE, "MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE"),
        (ours.THRUST_BODY, "ATTITUDE_TARGET_TYPEMASK_THRUST_BODY_SET"),
        (ours.LOCKSTEP, "HIL_ACTUATOR_CONTROLS_FLAGS_LOCKSTEP"),
        *((error, f"MAV_PARAM_ERROR_{error.name}") for error in ours.ParameterError),
    ],
)
def test_a_number_by_hand_is_the_dialects_where_it_has_it(number, name):
    assert number == getattr(mavlink, name, number)


def test_numbers_newer_than_the_dialect_are_the_standards():
    assert (ours.Result.CANCELLED, ours.Result.UNSUPPORTED_MAV_FRAME) == (6, 9)
    assert (ours.CommandId.SET_STANDARD_MODE, ours.THRUST_BODY, ours.AUTO_MODE) == (262, 32, 4)
    assert (ours.LOCKSTEP, ours.Capability.PARAM_ENCODE_BYTEWISE) == (1, 16)
    assert [int(error) for error in ours.ParameterError] == [1, 2, 3, 5, 7]


@pytest.mark.parametrize(
    ("members", "numbers"),
    [
        (ours.Result, range(10)),
        (ours.Severity, range(8)),
        (ours.SystemStatus, [0, 1, 2, 3, 4, 5, 6, 8]),
        (ours.LandedState, range(5)),
        (ours.Frame, [0, 1, 3, 5, 6, 7, 8, 9, 10, 11, 12]),
    ],
)
def test_enumerations_are_as_they_are_spoken_of(members, numbers):
    assert list(members) == list(numbers)


def test_masks_take_each_field_out_of_use_once():
    masks = [
        ours.IGNORE_POSITION, ours.IGNORE_VELOCITY, ours.IGNORE_ACCELERATION, ours.FORCE,
        ours.IGNORE_YAW, ours.IGNORE_YAW_RATE,
    ]  # fmt: skip
    assert masks == [0x7, 0x38, 0x1C0, 0x200, 0x400, 0x800]


def test_modes_are_px4s():
    assert [(m.name, m.value) for m in MainMode] == [
        ("MANUAL", 1), ("ALTITUDE", 2), ("POSITION", 3), ("AUTO", 4), ("ACRO", 5),
        ("OFFBOARD", 6), ("STABILIZED", 7),
    ]  # fmt: skip
    assert (AutoMode.TAKEOFF, AutoMode.LOITER, AutoMode.RETURN, AutoMode.LAND) == (2, 3, 5, 6)
    assert custom_mode(MainMode.AUTO, AutoMode.LAND) == 4 << 16 | 6 << 24
    assert main_and_sub(4 << 16 | 6 << 24) == (MainMode.AUTO, AutoMode.LAND)
