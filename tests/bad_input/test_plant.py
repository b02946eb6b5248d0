"""A plant that says what cannot be: the vehicle flies on.

`tests/bad_input/README.md` says which line of the bad-input catalogue is where.
"""

from __future__ import annotations

import numpy as np

from fcu.interface.status_texts import Code, Told
from tests.bad_input.hovering import OFFBOARD

GPS = 32  # MAV_SYS_STATUS_SENSOR_GPS
NEITHER_PLACED_NOR_WELL = 1 | 2 | 4 | 1024  # ESTIMATOR_STATUS


def test_a_position_that_jumps_a_kilometre_is_not_flown_on(flying):
    """H2: and it is told, and comes back."""
    flying.tick(50)
    flying.state[0] += 1000.0
    try:
        flying.stream(1)
        flying.tick(100)
        flying.says(Told(Code.POSITION_JUMPED, (1000.0,)))
        assert np.ptp(flying.command) < 1e-6  # nothing is done about it: all rotors alike
        assert abs(flying.asked(32, "LOCAL_POSITION_NED").y) < 0.01
        assert flying.asked(1, "SYS_STATUS").onboard_control_sensors_health & GPS == 0
        assert flying.asked(230, "ESTIMATOR_STATUS").flags == NEITHER_PLACED_NOR_WELL
    finally:
        flying.state[0] -= 1000.0
    flying.tick(1)
    flying.says(Told(Code.POSITION_BACK))
    assert flying.asked(1, "SYS_STATUS").onboard_control_sensors_health & GPS == GPS
    assert flying.mode() == OFFBOARD


def test_a_state_that_is_stuck_is_told(flying):
    """H2: the plant of this test hovers to the bit."""
    for _ in range(6):
        flying.stream(1)
        flying.tick(100)
    flying.says(Told(Code.STATE_STUCK))
    assert flying.mode() == OFFBOARD
