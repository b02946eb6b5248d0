"""What is set in flight loses no vehicle whose guard refuses: what it flies was accepted before."""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np
import pytest

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import column
from fcu.laws.face import SharedTick
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import from_tables

STILL = Vec3(0.0, 0.0, 0.0)
RATE = 500
AGAIN_S = 0.5


def east(far: float) -> Setpoint:
    return Setpoint(r_c=Vec3(far, 0.0, 0.0), v_c=STILL, a_c=STILL, psi_c=0.0, psi_dot_c=0.0)


def flown(far: float, over_s: float, *said: tuple[float, str, float]) -> MemoryFlight:
    """A flight to `far` (m) east at 3 s; `said`: at a time, a parameter is set to a value."""
    flight = MemoryFlight(
        scenario(from_tables("set", {
            "title": "Hold.",
            "flight": {"duration_s": over_s, "ground_z_m": -1e3, "arena_m": 1e4, "setpoints": [[0, 0, 0, 0]]},
        })),
        None, (lambda rows: None, lambda rows: None),
    )  # fmt: skip
    with ExitStack() as stack:
        vehicle = flight.begin(stack)
        waiting = sorted(said)
        for k in range(1, round(over_s / AGAIN_S)):
            at_s = k * AGAIN_S
            while waiting and waiting[0][0] <= at_s:
                time_s, name, value = waiting.pop(0)
                assert flight._fly_to(round(time_s * RATE))
                vehicle.set_parameter(name, value)
            assert flight._fly_to(round(at_s * RATE))
            vehicle.set_setpoint(east(far if at_s >= 3.0 else 0.0), at_s)
        flight.flown()
    return flight


CASES = {
    "policy": (5.0, (4.0, "MR_GUARD", 2.0)),
    "wind": (2.0, (1.0, "MR_GUARD", 2.0), (1.5, "MR_GRD_WIND", 0.0), (3.3, "MR_GRD_WIND", 12.0)),
    "f_m": (8.0, (1.0, "MR_GUARD", 2.0), (1.2, "MR_F_M", 0.6), (3.6, "MR_F_M", 2.0)),
}


@pytest.mark.parametrize("case", CASES)
def test_a_vehicle_arrives_where_it_was_going_as_parameters_change(case: str) -> None:
    far, *said = CASES[case]
    rows = flown(far, 20.0, *said).flown().fcu
    off = column(SharedTick, rows, "measured.r_E") - np.array([far, 0.0, 0.0])
    away = np.linalg.norm(off, axis=1)
    assert away.max() < 1.3 * far
    assert away[-RATE:].max() < 0.1
