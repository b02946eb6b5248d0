"""A real-time flight's recorded inputs, through the law again, give its recorded outputs."""

from __future__ import annotations

import numpy as np
import pytest

import gcs_tools
from fcu.kernel.buffers import columns, size
from fcu.kernel.rows import column
from fcu.process.settings import Settings
from fcu.process.tick import FLYING, TAKE_OVER, Remembered, Tick, tick
from gcs_tools.recording import reader as recording


@pytest.mark.parametrize(
    ("mission", "speed"), [("paper_nominal", 1.0), ("noisy_state", 1.0), ("figure_eight", None)]
)
def test_recorded_inputs_give_the_recorded_outputs(tmp_path, mission, speed):
    settings = ["flight.duration_s=2.5"]
    flown = gcs_tools.fly(
        mission, speed=speed, settings=settings, out=tmp_path / "run", figure="never"
    )
    assert flown.error is None
    recorded = recording.read(tmp_path / "run" / "flight.mcap")
    assert recorded.complete
    assert len(recorded.fcu) == flown.ticks == 1250

    ticks = recorded.fcu.rows_of(Tick)
    settings = np.array([recorded.params[name] for name in columns(Settings)])
    remembered, again = np.zeros(size(Remembered)), np.zeros_like(ticks)
    names = ("t", "engaged", "setpoint", "measured")
    inputs = zip(*(column(Tick, ticks, name) for name in names), strict=True)
    for row, (t, engaged, setpoint, measured) in zip(again, inputs, strict=True):
        tick(t, engaged, remembered, settings, setpoint, 0.0, measured, row)
    assert again.tobytes() == ticks.tobytes()
    assert set(recorded.fcu["engaged"]) == {TAKE_OVER, FLYING}
