"""The table of conditions: which action each takes, and what a look finds."""

from __future__ import annotations

import pytest

from fcu.interface.airframe import believed
from fcu.mavlink.definitions import Severity
from fcu.parameters import Parameters
from fcu.process.settings import settings
from fcu.vehicle.conditions import MODES, ROWS, Action, By, Condition
from fcu.vehicle.modes import Mode


@pytest.fixture
def params():
    return Parameters(settings(*believed(), 500.0), 1)


# as PX4 numbers them (docs/mavlink.md)
ACTIONS = {
    Condition.OFFBOARD_LOST: (
        "COM_OBL_RC_ACT",
        {0: Action.POSITION, 3: Action.RETURN, 4: Action.LAND, 5: Action.HOLD, 6: Action.TERMINATE,
         7: Action.DISARM},
    ),
    Condition.BATTERY_CRITICAL: (
        "COM_LOW_BAT_ACT", {0: Action.WARN, 2: Action.LAND, 3: Action.RETURN},
    ),
    Condition.BATTERY_EMERGENCY: (
        "COM_LOW_BAT_ACT", {0: Action.WARN, 2: Action.LAND, 3: Action.LAND},
    ),
    Condition.STICKS_LOST: (
        "NAV_RCL_ACT",
        {1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.DISARM},
    ),
    Condition.STATION_LOST: (
        "NAV_DLL_ACT",
        {0: Action.NONE, 1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND, 5: Action.TERMINATE,
         6: Action.DISARM},
    ),
    Condition.ATTITUDE_LOST: ("CBRK_FLIGHTTERM", {0: Action.TERMINATE, 121212: Action.WARN}),
    Condition.STATE_LOST: ("CBRK_FLIGHTTERM", {0: Action.TERMINATE, 121212: Action.WARN}),
    Condition.STATE_STUCK: ("CBRK_FLIGHTTERM", {0: Action.TERMINATE, 121212: Action.WARN}),
    Condition.BELIEFS_CONTRADICTED: (
        "MR_GUARD_ACT", {0: Action.NONE, 1: Action.HOLD, 2: Action.LAND},
    ),
    Condition.FLIGHT_TIME_LOW: (
        "COM_FLTT_LOW_ACT", {0: Action.NONE, 1: Action.WARN, 3: Action.RETURN},
    ),
    Condition.ROTOR_LOST: (
        "COM_ACT_FAIL_ACT",
        {0: Action.WARN, 1: Action.HOLD, 2: Action.LAND, 3: Action.RETURN, 4: Action.TERMINATE},
    ),
    Condition.LAW_FAILED: ("MR_LAW_ACT", {0: Action.STOP, 1: Action.WARN}),
    Condition.FENCE_BREACHED: (
        "GF_ACTION",
        {0: Action.NONE, 1: Action.WARN, 2: Action.HOLD, 3: Action.RETURN, 4: Action.TERMINATE,
         5: Action.LAND},
    ),
}  # fmt: skip


def test_every_condition_that_a_parameter_acts_on_is_listed():
    assert set(ACTIONS) == {c for c, row in ROWS.items() if isinstance(row.action, By)}


@pytest.mark.parametrize("condition", ACTIONS, ids=lambda c: c.name)
@pytest.mark.computes
def test_every_value_of_a_parameter_has_the_action_that_px4_gives_it(params, condition):
    name, expected = ACTIONS[condition]
    assert set(params.info(name).values) == set(expected)
    for value, action in expected.items():
        if params.info(name).row.at_start:
            given = {name: float(value)}
            params = Parameters(params.settings, 1, None, params.flown, params.airframe, given)
        else:
            params.set(name, float(value), armed=True)
        assert ROWS[condition].action(params) is action


def test_every_row_has_a_code_of_its_own_and_a_severity(params):
    assert len({row.code for row in ROWS.values()}) == len(ROWS)
    assert all(row.severity in Severity.__members__ for row in ROWS.values())


def test_the_loss_of_a_script_never_means_to_go_on(params):
    assert Mode.OFFBOARD not in MODES.values()
    for value in params.info("COM_OBL_RC_ACT").values:
        params.set("COM_OBL_RC_ACT", value, armed=True)
        assert ROWS[Condition.OFFBOARD_LOST].action(params) > Action.WARN


def test_with_defaults_a_battery_only_warns(params):
    levels = Condition.BATTERY_LOW, Condition.BATTERY_CRITICAL, Condition.BATTERY_EMERGENCY
    assert {ROWS[level].action(params) for level in levels} == {Action.WARN}
