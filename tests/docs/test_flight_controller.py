"""The page about the plant link: its program is the one that is flown, its tables are what is sent."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from fcu.interface.airframe import find, read
from fcu.interface.messages import Battery, RotorCommand, VehicleState
from fcu.interface.ports import ports
from fcu.kernel.buffers import from_buffer, size, to_buffer
from fcu.mavlink.definitions import Definition, definition, message
from fcu.mavlink.framing import expected
from fcu.mavlink.plant_link import Ending, PlantCodec
from gcs_tools.flight.foreign_flight import values
from gcs_tools.judging.metrics import OF_THE_TRUTH

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "flight-controller-of-your-own.md").read_text()
FLOWN = ROOT / "tests" / "foreign_controller"
TYPES = {"uint8": "B", "int8": "b", "uint16": "H", "int16": "h", "uint32": "I", "int32": "i",
         "uint64": "Q", "float": "f"}  # fmt: skip
TABLES = dict(re.findall(r"^### ([A-Z_]+)\n\n((?:\|.*\n)+)", PAGE, re.M))


def _rows(table: str) -> list[list[str]]:
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]
    ]


@pytest.mark.parametrize(
    ("language", "file"), [("python", "cascade.py"), ("toml", "step_in_still_air.toml")]
)
def test_what_it_prints_is_what_the_tests_fly(language, file):
    (block,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.S)
    assert block == (FLOWN / file).read_text()


@pytest.mark.parametrize("name", TABLES)
def test_each_field_is_one_of_the_definition_and_has_its_type(name):
    known = {field.name: field for field in definition(name).fields}
    told = {}
    for names, kind, _what in _rows(TABLES[name]):
        base, _, length = kind.rstrip("]").partition("[")
        told |= dict.fromkeys(re.findall(r"`(\w+)`", names), (TYPES[base], int(length or 0)))
    assert {n: (known[n].code, known[n].length) for n in told} == told
    leaves_out = f"### {name}\n\n{TABLES[name]}\nIts other fields carry nothing." in PAGE
    assert leaves_out == (told.keys() != known.keys())


def test_all_messages_of_the_link_have_a_table():
    assert TABLES.keys() == {
        "HEARTBEAT", "ODOMETRY", "ACTUATOR_OUTPUT_STATUS", "BATTERY_STATUS", "HIL_ACTUATOR_CONTROLS",
        "SET_POSITION_TARGET_LOCAL_NED",
    }  # fmt: skip


def test_the_ports_are_those_of_an_instance():
    told = dict(re.findall(r"^\| (\d+)\+N \| (.+?) \|$", PAGE, re.M))
    at, first = ports(0), ports(1)
    for port in ("plant", "fcu_plant", "script", "fcu_script"):
        assert str(getattr(at, port)) in told
        assert getattr(first, port) == getattr(at, port) + 1
    assert len(told) == 4


def test_the_words_of_a_command_are_listed():
    table = PAGE.partition("| word | becomes |")[2].partition("\n\n")[0]
    assert set(re.findall(r"`\{(\w+)\}`", table)) == values(0, 1.0, Path()).keys()


def test_what_can_be_expected_is_listed():
    for name in OF_THE_TRUTH:
        assert f"`{name}`" in PAGE or f"`{'_'.join(name.split('_')[:2])}_…`" in PAGE


def _unpacked(datagram: bytes, *names: str) -> list[dict[str, object]]:
    found, at = [], 0
    for each in names:
        of: Definition = definition(each)
        payload, at = expected(of, datagram, at, 3, 1)
        found.append(of.unpack(payload))
    assert at == len(datagram)
    return found


def test_a_state_says_what_the_tables_say():
    """1 m East, 2 m North, 3 m up, nose to the East, 5 m/s East; rotor 1 turns counter-clockwise."""
    spin = read(find("s1000")).rotors.spin
    codec = PlantCodec(3, spin)
    buffer = np.zeros(size(VehicleState))
    buffer[:3], buffer[3:6], buffer[6] = (1.0, 2.0, 3.0), (5.0, 0.0, 0.0), 1.0
    buffer[-8:] = 300.0
    battery = Battery(voltage=24.0, current=50.0, drawn_Ah=1.5, remaining=0.5, energy_J=1e5)
    state, rotors, charge = _unpacked(
        codec.pack_state(2000, buffer, battery),
        "ODOMETRY",
        "ACTUATOR_OUTPUT_STATUS",
        "BATTERY_STATUS",
    )
    assert [state[name] for name in ("x", "y", "z", "vx", "vy", "vz")] == [2, 1, -3, 5, 0, 0]
    assert state["q"] == pytest.approx(
        [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    )  # 90 degrees clockwise
    assert (state["time_usec"], state["frame_id"], state["child_frame_id"]) == (2000, 1, 12)
    assert np.isnan(state["pose_covariance"][0]) and np.isnan(state["velocity_covariance"][0])
    assert rotors["active"] == 255
    assert [*rotors["actuator"][:8]] == [300.0 * each for each in spin]
    assert (charge["current_consumed"], charge["energy_consumed"]) == (1500, 1000)
    assert (charge["voltages"][0], charge["current_battery"]) == (24_000, 5000)
    assert charge["battery_remaining"] == 50
    hold = codec.pack_hold(0, buffer, ending=Ending.CRASHED)
    heartbeat, _, _ = _unpacked(hold, "HEARTBEAT", "ODOMETRY", "ACTUATOR_OUTPUT_STATUS")
    assert (heartbeat["custom_mode"], heartbeat["system_status"], heartbeat["autopilot"]) == (
        2,
        6,
        8,
    )


def test_an_answer_as_the_table_has_it_is_taken():
    """Flags, mode and the controls behind the eighth are not looked at."""
    controls = [0.1 * i for i in range(8)] + [7.0] * 8
    packed = message("HIL_ACTUATOR_CONTROLS", time_usec=4000, flags=0, controls=controls, mode=0)
    codec = PlantCodec(3, read(find("s1000")).rotors.spin)
    datagram = codec._framed(definition("HIL_ACTUATOR_CONTROLS"), packed.payload)
    command = np.zeros(size(RotorCommand))
    assert codec.parse_controls(datagram, command) == (4000, False, False)
    assert to_buffer(from_buffer(RotorCommand, command)) == pytest.approx(controls[:8], rel=1e-6)
