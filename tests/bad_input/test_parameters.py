"""Parameters that cannot be set, and what the vehicle has not.

`tests/bad_input/README.md` says which line of the bad-input catalogue is where.
"""

from __future__ import annotations

import math
import struct

import pymavlink.dialects.v20.common as mavlink
import pytest

from tests.bad_input.hovering import NAN


@pytest.mark.parametrize(
    ("name", "value", "kind", "error"),
    [
        (b"MR_GAMMA", NAN, 9, 2), (b"MR_GAMMA", math.inf, 9, 2), (b"MR_GAMMA", -1.0, 9, 2),
        (b"MR_GAMMA", 500.0, 6, None), (b"MAV_SYS_ID", 5.0, 9, 5), (b"COM_OBL_RC_ACT", 1.0, 9, 2),
        (b"MR_M_MIN", 30.0, 9, 2), (b"MR_F_M", 8.0, 9, 2), (b"MR_PRED", 0.0, 9, 3),
        (b"", 1.0, 9, 1), (b"NO_SUCH_PARAM", 1.0, 9, 1), (b"ABCDEFGHIJKLMNOP", 1.0, 9, 1),
        (b"\xff\xfe", 1.0, 9, 1),
    ],
)  # fmt: skip
def test_a_bad_parameter_is_answered_with_the_value_in_force(flying, name, value, kind, error):
    """R1 to R4: unchanged, PARAM_ERROR, and the reason in words."""
    read = mavlink.MAVLink_param_request_read_message(flying.at.system_id, 1, name, -1)
    known = error not in (1,)
    if known:
        flying.send(read)
        before = flying.heard("PARAM_VALUE").param_value
    flying.send(mavlink.MAVLink_param_set_message(flying.at.system_id, 1, name, value, kind))
    if known:
        assert flying.heard("PARAM_VALUE").param_value == before
    if error is not None:
        answer = flying.heard("PARAM_ERROR")
        assert (answer.error, answer.target_system) == (error, 245)
    flying.tick(2)
    assert flying.armed


@pytest.mark.parametrize("index", [-2, 32767, -32768])
def test_an_index_that_is_none_is_an_error_and_no_crash(flight, index):
    """R5."""
    flight.send(mavlink.MAVLink_param_request_read_message(flight.at.system_id, 1, b"", index))
    assert flight.heard("PARAM_ERROR").error == 1
    flight.tick()


def test_an_unstable_combination_is_refused_and_says_with_what(flight):
    """R4: each value in its range."""
    system = flight.at.system_id
    flight.send(mavlink.MAVLink_param_set_message(system, 1, b"MR_F_M", 8.0, 9))
    assert "unstable" in flight.says("MR_F_M 8 refused")


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        (b"MR_T_MAX", 10.0, "too weak for 8 kg"), (b"MR_T_MIN", 100.0, "no way down at 8 kg"),
        (b"MR_M_0", 1.0, "MR_M_0 1 refused"), (b"MR_M_MAX", 7.5, "MR_M_MAX 7.5 refused"),
        (b"MR_J_MAX", 0.4, "would not hover"), (b"MR_F_M", 8.0, "unstable"),
    ],
)  # fmt: skip
def test_what_would_not_let_it_hover_is_refused(flying, name, value, why):
    """R4: each value in its range, and the vehicle is in the air."""
    flying.send(mavlink.MAVLink_param_set_message(flying.at.system_id, 1, name, value, 9))
    assert flying.heard("PARAM_ERROR").error == 2
    flying.says(why)


def test_a_name_of_control_characters_reaches_nobodys_terminal(flight):
    """R2: a line of log is one line."""
    name = b"\x1b[31mA\nB"
    flight.send(mavlink.MAVLink_param_set_message(flight.at.system_id, 1, name, 1.0, 9))
    text = flight.says("Unknown parameter")
    assert text.isprintable()
    assert "\x1b" not in flight.program.text()


def test_parameters_are_saved_when_asked_and_read_when_named(hover, tmp_path):
    """R6: at most one at a time, whole, and a broken disk costs a sentence."""
    file = tmp_path / "octo.params"
    flight = hover("--params", file)
    flight.send(mavlink.MAVLink_param_set_message(flight.at.system_id, 1, b"MR_F_M", 1.25, 9))
    assert flight.heard("PARAM_VALUE").param_value == 1.25
    flight.send(flight.long(245, 1))
    results = [flight.heard("COMMAND_ACK").result]
    while results[-1] == mavlink.MAV_RESULT_IN_PROGRESS:
        results.append(flight.heard("COMMAND_ACK").result)
    assert results[-1] == mavlink.MAV_RESULT_ACCEPTED
    flight.says("Parameters saved")
    flight.close()
    flight.program.kill()
    again = hover("--params", file)
    read = mavlink.MAVLink_param_request_read_message(again.at.system_id, 1, b"MR_F_M", -1)
    again.send(read)
    assert again.heard("PARAM_VALUE").param_value == 1.25


def test_missions_files_and_logs_are_answered(flight):
    system = flight.at.system_id
    flight.send(mavlink.MAVLink_mission_request_list_message(system, 1))
    assert flight.heard("MISSION_COUNT").count == 0
    flight.send(mavlink.MAVLink_mission_count_message(system, 1, 65535))
    assert flight.heard("MISSION_ACK").type == mavlink.MAV_MISSION_NO_SPACE
    payload = [3, 0, 0, 4, 0, 0, 0, 0, *[0] * 243]
    flight.send(mavlink.MAVLink_file_transfer_protocol_message(0, system, 1, payload))
    answer = bytes(flight.heard("FILE_TRANSFER_PROTOCOL").payload)
    assert struct.unpack_from("<HBBBB", answer) == (4, 0, 129, 1, 4)
    flight.send(mavlink.MAVLink_log_request_list_message(system, 1, 0, 65535))
    assert flight.heard("LOG_ENTRY").num_logs == 0
