"""`gcs fault` on a vehicle that is up: listed, refused, done, cleared."""

from __future__ import annotations

import struct
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from fcu.mavlink.failures import fault as fault_of
from fcu.mavlink.failures import order
from gcs_tools.cli.fault import GIVEN
from gcs_tools.cli.fault import fault as fault_command
from gcs_tools.flight.fault_order import choices, clear


def test_every_fault_but_those_of_the_link_can_be_given_by_hand():
    assert [each.name for each in choices()] == GIVEN


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("motor_weak", "--rotor", "3", "--much", "0"), "--much 0"),
        (("motor_weak", "--much", "nan"), "--much nan"),
        (("motor_weak", "--much", "7"), "--much 7: expected 0 to 1 of thrust and torque left"),
        (("state_jumps", "--much", "-2e4"), "expected -10000 to 10000 m to the east"),
        (("motor_off", "--much", "0.5"), "motor_off has no size"),
        (("motor_weak", "--for", "inf"), "--for inf"),
        (("motor_weak", "--for", "nan"), "--for nan"),
        (("clear", "--for", "2"), "clear takes neither"),
        (("state_off", "--rotor", "1"), "state_off is of no rotor"),
        (("motor_of",), "'motor_of': no such fault (did you mean motor_off?)"),
    ],
)
def test_what_would_be_done_as_something_else_is_refused(words, why):
    done = CliRunner().invoke(fault_command, words)
    assert (done.exit_code, why in done.output) == (2, True), done.output


@pytest.mark.parametrize(("rotor", "asked"), [(2, [(101, 2)]), (0, [(6, 0), (100, 0), (101, 0)])])
def test_clear_is_of_one_rotor_or_of_everything(rotor, asked):
    told = []
    vehicle = SimpleNamespace(command=lambda _number, unit, _ok, of, *_: told.append((unit, of)))
    clear(vehicle, rotor)
    assert told == asked


def test_what_a_command_carries_is_the_decimal_that_was_given():
    """A float32 of 0.06 is a little less, and would be told as 5 %."""
    received = struct.unpack("<7f", struct.pack("<7f", 100, 4, 0, 0.06, 0.3, 0, 0))
    asked = order(received)
    assert (asked.much, asked.for_s) == (0.06, 0.3)
    assert fault_of(asked, 0).size.a == 0.06


def test_the_list_names_the_range_of_each_size():
    done = CliRunner().invoke(fault_command, [])
    assert done.exit_code == 0
    for each in choices():
        [line] = [line for line in done.output.splitlines() if line.startswith(f"{each.name} ")]
        assert (f"({each.least:g} to {each.most:g} " in line) is bool(each.what), line


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
    assert (code, "expected 0 to 1" in text) == (2, True), text
    assert fault("clear")[0] == 0
    assert up.interrupted() == 0
