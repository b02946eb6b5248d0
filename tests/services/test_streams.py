"""What a vehicle of any airframe streams of its battery, read by pymavlink."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from types import SimpleNamespace

import pymavlink.dialects.v20.all as mavlink
import pytest

from fcu.interface import airframe as airframes
from fcu.interface.messages import Battery
from fcu.laws import loader
from fcu.mavlink.definitions import definition
from fcu.mavlink.framing import framed
from fcu.messages_page import written
from fcu.parameters import Parameters
from fcu.process.configuration import read_airframe, read_settings
from fcu.services.messages import ANSWERS, GROUPS, STREAMS

CELL_V = 3.8


def streamed(airframe, battery):
    """BATTERY_STATUS of a vehicle of an airframe (a name)."""
    law = loader.load()
    file = read_airframe(law, airframe)
    params = Parameters(read_settings(law, None, 500.0, file), 1, airframe=file)
    stream = STREAMS[definition("BATTERY_STATUS").id]
    (packed,) = stream.build(SimpleNamespace(battery=battery, params=params))
    (message,) = mavlink.MAVLink(None).parse_buffer(bytearray(framed(*packed, 0, 1, 1)))
    return message


@pytest.mark.parametrize(
    ("airframe", "cells"), [("s1000", 6), ("quad", 3), ("hexa", 3), ("racer", 4), ("x8", 4)]
)
def test_battery_status_has_the_cells_of_the_airframe(airframe, cells):
    file = read_airframe(loader.load(), airframe)
    assert file.tables["battery"]["cells"] == cells
    battery = Battery(
        voltage=cells * CELL_V, current=12.5, drawn_Ah=1.5, remaining=0.5, energy_J=1e5
    )
    message = streamed(airframe, battery)
    assert message.voltages == [3800] * cells + [65535] * (10 - cells)
    assert message.voltages_ext == [0] * 4


def test_all_shipped_airframes_are_looked_at():
    assert {path.stem for path in airframes.OCTO.parent.glob("*.toml")} == {
        "s1000", "quad", "hexa", "racer", "x8",
    }  # fmt: skip


def test_a_charge_that_is_not_known_is_said_to_be_none():
    unknown = Battery(math.nan, math.nan, math.nan, math.nan, math.nan)
    message = streamed("quad", unknown)
    assert message.voltages == [65535] * 10
    assert message.battery_remaining == -1


def test_a_rotor_that_turns_twice_as_fast_draws_eight_times_the_current():
    """The cube of its speed is a rotor's share. All of them together draw the battery's current."""
    Omega = (100.0, 200.0, 100.0, 200.0, 100.0, 200.0, 100.0, 200.0)
    rotors = SimpleNamespace(c_T=(1e-5,) * 8, spin=(1.0,) * 8, n=8)
    battery = Battery(voltage=22.0, current=36.0, drawn_Ah=0.0, remaining=1.0, energy_J=0.0)
    view = SimpleNamespace(
        t=1.0, battery=battery, measured=SimpleNamespace(Omega=Omega),
        law=SimpleNamespace(rotors=rotors),
    )  # fmt: skip
    halves = STREAMS[definition("ESC_STATUS").id].build(view)
    for half, first in zip(halves, (0, 4), strict=True):
        _, *numbers, index = struct.unpack("<Q4i8fB", half.payload)  # not in pymavlink's dialect
        assert index == first
        rpm, volts, amperes = numbers[:4], numbers[4:8], numbers[8:]
        assert rpm == [955, 1910, 955, 1910]  # rad/s times 30 / pi
        assert volts == [22.0] * 4
        assert amperes == pytest.approx([1.0, 8.0, 1.0, 8.0])


def test_the_page_has_the_table_of_messages():
    page = (Path(__file__).parents[2] / "docs/mavlink.md").read_text(encoding="utf-8")
    assert written(page) == page, "run: make schemas"


def test_each_group_of_old_stations_has_messages_that_are_streams():
    assert {number for group in GROUPS.values() for number in group} <= set(STREAMS)
    assert not set(STREAMS) & set(ANSWERS)
