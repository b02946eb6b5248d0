"""The guard's parameters, set while a rotor is lost: taken, and said to promise nothing."""

from __future__ import annotations

import pymavlink.dialects.v20.all as mavlink
import pytest

from fcu.interface.status_texts import Code
from tests.services.test_station import Met


def texts_of_setting(met, name, value):
    """Set a parameter. Returns the codes that are told of it, once the value is echoed."""
    met.logged.clear()
    name = name.encode()
    echo = met.say(mavlink.MAVLink_param_set_message(1, 1, name, value, 9))
    assert [round(each.param_value, 6) for each in echo] == [value]
    return [told.code for _, told, _ in met.logged]


@pytest.mark.parametrize("before", [0.0, 1.0])
def test_without_a_rotor_the_guard_is_said_to_promise_nothing(before):
    met = Met()
    met.observe()
    params = met.station._params
    params.set("MR_GUARD", before, False)
    params.lose((3,))
    assert texts_of_setting(met, "MR_GUARD", 2.0) == [Code.GUARD_VOID]
    assert texts_of_setting(met, "MR_GRD_WIND", 4.0) == [Code.GUARD_VOID]
    assert texts_of_setting(met, "MR_F_M", 1.1) == []
    assert texts_of_setting(met, "MR_GUARD", 0.0) == [], "a guard that warns alone keeps to nothing"
    params.set("MR_GUARD", 1.0, False)
    params.lose(())
    assert texts_of_setting(met, "MR_GRD_WIND", 5.0) == []
