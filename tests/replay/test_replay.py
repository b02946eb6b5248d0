"""A real-time flight's recorded inputs, through the law again, give its recorded outputs."""

from __future__ import annotations

import numpy as np
import pytest

import gcs_tools
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.buffers import columns, size
from fcu.laws.mmrac import cascade
from fcu.laws.mmrac.types import LawState, Tick
from gcs_tools.recording import reader as recording

TICK = columns(Tick)


def part(name, of):
    """The columns of a Tick that hold one of its values."""
    first = TICK.index(f"{name}.{columns(of)[0]}")
    return slice(first, first + size(of))


MEASURED, SETPOINT = part("measured", VehicleState), part("setpoint", Setpoint)
STATE, ENGAGED = part("state", LawState), TICK.index("engaged")


@pytest.mark.parametrize(
    ("mission", "speed"), [("paper_nominal", 1.0), ("noisy_state", 1.0), ("figure_eight", None)]
)
def test_recorded_inputs_give_the_recorded_outputs(tmp_path, mission, speed):
    settings = ["flight.duration_s=2.5"]
    flown = gcs_tools.fly(mission, speed=speed, settings=settings, out=tmp_path / "run")
    assert flown.error is None
    recorded = recording.read(tmp_path / "run" / "flight.mcap")
    assert recorded.complete
    assert len(recorded.fcu) == flown.ticks == 1250

    state, again = np.zeros(size(LawState)), np.zeros_like(recorded.fcu)
    for row, inputs in zip(again, recorded.fcu, strict=True):
        cascade.tick(
            inputs[0], inputs[ENGAGED], state, recorded.params, inputs[SETPOINT], 0.0,
            inputs[MEASURED], row,
        )  # fmt: skip
        state = row[STATE].copy()
    assert again.tobytes() == recorded.fcu.tobytes()
    assert set(recorded.fcu[:, ENGAGED]) == {cascade.TAKE_OVER, cascade.FLYING}
