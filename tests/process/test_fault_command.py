"""`gcs fault` on a vehicle that is up: listed, refused, done, cleared."""

from __future__ import annotations

import pytest

from gcs_tools.cli.fault import GIVEN
from gcs_tools.flight.fault_order import choices


def test_every_fault_but_those_of_the_link_can_be_given_by_hand():
    assert [each.name for each in choices()] == GIVEN


@pytest.mark.slow
def test_a_fault_is_listed_refused_done_and_cleared(start, instance):
    def fault(*words):
        program = start("gcs_tools", "fault", *words, "--instance", instance)
        return program.wait(), program.text()

    code, text = fault()
    assert code == 0
    assert all(name in text for name in GIVEN)
    up = start("gcs_tools", "up", "--instance", instance, "--no-publish")
    up.says("ready")
    code, text = fault("motor_weak", "--rotor", 2)
    assert (code, "SYS_FAILURE_EN is 0 (--enable sets it)" in text) == (3, True)
    code, text = fault("motor_weak", "--rotor", 2, "--much", 0.7, "--enable")
    assert (code, "done by the simulator" in text) == (0, True), text
    code, text = fault("motor_weak", "--much", 7)
    assert (code, "out of range" in text) == (3, True), text
    assert fault("clear")[0] == 0
    assert up.interrupted() == 0
