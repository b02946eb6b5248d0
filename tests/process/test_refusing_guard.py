"""A guard that refuses loses no vehicle that leads itself: take-off, landing, the way home, steps, sticks."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import numpy as np
import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.kernel.rows import column
from fcu.laws.face import SharedTick
from fcu.mavlink.definitions import CommandId
from fcu.mavlink.px4_modes import MainMode
from fcu.services.status import STEP_SUB
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import from_tables
from sitl_plant.physics.types import PlantRecord

RATE = 500
AWAY = {"kind": "return"}
DOWN = {"kind": "land"}


@pytest.mark.parametrize("end", [DOWN, AWAY], ids=["land", "return"])
@pytest.mark.parametrize("height_m", [1.0, 5.0])
def test_a_guard_that_refuses_takes_off_and_lands_again(
    height_m: float, end: dict[str, Any]
) -> None:
    """The reference is held to a jerk there, and what nobody looked ahead at swung ever farther."""
    mission = from_tables("refuses", {
        "title": "Up and down.",
        "flight": {
            "duration_s": 40.0, "ground_z_m": 0.0, "start": {"on_ground": True},
            "items": [{"kind": "take_off", "height_m": height_m}, {"kind": "hold", "for_s": 3.0}, end],
        },
        "law": {"guard": "refuse"},
    })  # fmt: skip
    flown = MemoryFlight(scenario(mission), None, (lambda rows: None, lambda rows: None)).fly()
    assert flown.ended == "landed"
    heights = column(PlantRecord, flown.plant, "state.r_E")[:, 2]
    assert height_m - 0.1 < heights.max() < height_m + 0.2
    assert column(PlantRecord, flown.plant, "state.v_E")[:, 2].min() > -1.2
    assert np.isfinite(heights).all()


def hovering(stack: ExitStack, over_s: float) -> tuple[MemoryFlight, Any]:
    """A vehicle that holds in the air, under MR_GUARD 2, and its script."""
    mission = from_tables("leads", {
        "title": "Hold.",
        "flight": {"duration_s": over_s, "ground_z_m": -1e3, "arena_m": 1e4, "setpoints": [[0, 0, 0, 0]]},
        "law": {"guard": "refuse"},
    })  # fmt: skip
    flight = MemoryFlight(scenario(mission), None, (lambda rows: None, lambda rows: None))
    vehicle = flight.begin(stack)
    assert flight._fly_to(RATE)
    vehicle.hold()
    return flight, vehicle


def swings(flight: MemoryFlight) -> float:
    """The farthest that the vehicle was from its reference model, m."""
    rows = flight.flown().fcu
    rows = rows[column(SharedTick, rows, "engaged") > 0.5]
    off = column(SharedTick, rows, "measured.r_E") - column(
        SharedTick, rows, "outputs.reference.r_m"
    )
    return float(np.linalg.norm(off, axis=1).max())


def test_steps_that_were_accepted_with_another_f_m_swing_no_farther() -> None:
    with ExitStack() as stack:
        flight, vehicle = hovering(stack, 25.0)
        for name, value in (("MR_F_M", 0.6), ("REF_STEP_E", 6.0), ("REF_STEP_T", 3.0)):
            vehicle.set_parameter(name, value)
        vehicle.command(CommandId.SET_MODE, 1.0, MainMode.AUTO, STEP_SUB)
        assert flight._fly_to(4 * RATE)
        vehicle.set_parameter("MR_F_M", 2.0)
        assert flight._fly_to(24 * RATE)
        assert swings(flight) < 0.3


def test_sticks_lead_it_away_and_it_stops() -> None:
    codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    with ExitStack() as stack:
        flight, vehicle = hovering(stack, 25.0)
        vehicle.command(CommandId.SET_MODE, 1.0, MainMode.POSITION, 0.0)
        for k in range(50, 125):  # full ahead for 7 s, and hands off
            assert flight._fly_to(k * RATE // 5 - 9 * RATE)
            ahead = 1000 if k < 85 else 0
            stick = mavlink.MAVLink_manual_control_message(1, ahead, 0, 500, 0, 0)
            vehicle._link.send(stick.pack(codec))
            vehicle.messages(0.0)
        assert swings(flight) < 0.3
        v = column(SharedTick, flight.flown().fcu, "measured.v_E")[-RATE:]
        assert np.linalg.norm(v, axis=1).max() < 0.1
