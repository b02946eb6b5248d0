"""Landings in wind, flown whole and judged by the truth."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools import fly, read

MISSION = """
title = "A landing in air that rises."

[flight]
duration_s = 60.0
ground_z_m = 0.0
start = { on_ground = true }

[[flight.items]]
kind = "take_off"
height_m = 9.5

[[flight.items]]
kind = "hold"
for_s = 3.0

[[flight.items]]
kind = "land"

[law]
guard = "govern"

[plant]
mass_kg = 7.0

[wind]
steady_m_s = [0.0, 0.0, 6.2]

[expect]
ended = "landed"
"""


@pytest.mark.slow
def test_in_air_that_rises_no_rotor_is_cut_above_the_ground(tmp_path):
    """It hangs in the updraft, slower than its setpoint sinks, as its reference model does."""
    (tmp_path / "rises.toml").write_text(MISSION)
    result = fly(
        str(tmp_path / "rises.toml"), in_process=True, out=tmp_path / "run", figure="never"
    )
    assert result.passed
    recording = read(tmp_path / "run" / "flight.mcap")
    t, z = recording.plant["t"], recording.plant["state.r_E"][:, 2]
    aloft = (t > 5.0) & (z > z[0] + 0.05)
    assert recording.fcu["outputs.T_c"][aloft].min() > 0.25 * 7.0 * 9.81
    assert np.abs(z[-1] - z[0]) < 0.05
