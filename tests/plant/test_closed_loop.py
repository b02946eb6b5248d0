"""Law and plant together: the same bits uncompiled, and the printed law as the paper flies it."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fcu
from fcu.interface.airframe import airframe, load, read
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import columns, size, to_buffer
from fcu.kernel.rows import column, slice_of
from fcu.process import tick as control
from fcu.process.settings import settings
from fcu.process.tick import Remembered, Tick
from sitl_plant.physics import tick
from sitl_plant.physics.parameters import plant_params, start_state, steps_per_tick
from sitl_plant.physics.truth import truth
from tests.patience import PATIENCE_S

ROOT = Path(fcu.__file__).parents[1]
OCTO = load(Path(fcu.__file__).with_name("airframes") / "s1000.toml")
WIND = {
    "amplitude_m_s": [7.2, 7.2, 5.7],
    "frequency_rad_s": [1.5, 1.6, 1.7],
    "rotation_amplitude_rad_s": [0.7, 0.6, 0.5],
    "rotation_frequency_rad_s": [2.5, 2.4, 2.3],
}
ZERO = Vec3(0.0, 0.0, 0.0)
COMMAND = slice_of(Tick, "command")


def inputs(rate_hz, lag, **law):
    """Law, plant, and start, in the paper's wind from r = 0 with the ground far below."""
    believed = airframe(OCTO["rotors"])
    params = plant_params(
        truth(read()), rate_hz, {"rotor_lag_s": lag}, WIND, ground_z_m=-1e4, arena_m=1e4
    )
    told = settings(believed, OCTO, rate_hz, {"rotor_lag_s": lag, **law})
    return [to_buffer(value) for value in (told, params, start_state(params))]


def closed_loop(told, plant, state, rate_hz, ticks, buffer=np.array):
    """Rows float64[ticks, size(Tick)] of a flight to (4, 7, 18) m under a swinging yaw command.

    buffer : what makes a buffer of a list: np.array for compiled code. Plain code is given
    lists, whose items are Python's floats (a numpy float would turn a leaf into an array).
    """
    row, remembered, reported, no_noise, drawn = (
        buffer([0.0] * n) for n in (size(Tick), size(Remembered), 21, tick.NOISE, 2)
    )
    rows, h, steps = np.empty((ticks, size(Tick))), 1.0 / rate_hz, steps_per_tick(rate_hz)
    for k in range(ticks):
        t = k * h
        yaw, yaw_rate = 0.5 * math.sin(0.5 * t), 0.25 * math.cos(0.5 * t)
        setpoint = to_buffer(Setpoint(Vec3(4.0, 7.0, 18.0), ZERO, ZERO, yaw, yaw_rate))
        tick.sense(state, no_noise, reported)
        engaged = control.FLYING if k else control.TAKE_OVER
        sent = buffer(setpoint.tolist())
        control.tick(t, engaged, remembered, told, sent, 0.0, reported, row)
        rows[k] = row
        tick.advance(plant, state, drawn, row[COMMAND], t, steps)
    return rows


@pytest.mark.slow
@pytest.mark.parametrize(("prediction", "lag"), [("achieved", 0.05), ("demanded", 0.0)])
def test_plain_python_flies_the_same_bits(tmp_path, prediction, lag):
    given = inputs(500.0, lag, prediction=prediction)
    np.savez(tmp_path / "inputs.npz", *given)
    subprocess.run(
        [sys.executable, __file__, str(tmp_path)],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)},
        check=True,
        timeout=PATIENCE_S,
    )
    rows = closed_loop(*given, 500.0, 200)
    assert np.all(np.isfinite(rows))
    plain = np.load(tmp_path / "rows.npy")
    different = np.argwhere(plain.view(np.int64) != rows.view(np.int64))
    assert not len(different), f"tick {different[0][0]}: {columns(Tick)[different[0][1]]}"


def flight(rate_hz, **law):
    """Tracking error (m, after 5 s, root mean square) and greatest height (m) of 20 s at lag 0."""
    rows = closed_loop(*inputs(rate_hz, 0.0, **law), rate_hz, round(20.0 * rate_hz))
    r = column(Tick, rows, "measured.r_E")
    error = np.linalg.norm(r - column(Tick, rows, "outputs.reference.r_m"), axis=1)[
        round(5.0 * rate_hz) :
    ]
    return float(np.sqrt(np.mean(error**2))), float(r[:, 2].max())


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [250.0, 500.0, 1000.0])
def test_the_printed_law_tracks_at_1_and_diverges_at_1_4(rate_hz):
    error, _ = flight(rate_hz, f_m=1.0, prediction="demanded")
    assert error < 0.35
    _, height = flight(rate_hz, f_m=1.4, prediction="demanded")
    assert height > 100.0  # of a setpoint at 18 m: Figures 9 to 11


@pytest.mark.parametrize("rate_hz", [250.0, 500.0, 1000.0])
@pytest.mark.parametrize("f_m", [1.0, 1.4])
@pytest.mark.computes
def test_with_the_achieved_force_both_track(rate_hz, f_m):
    error, height = flight(rate_hz, f_m=f_m)
    assert error < 0.03
    assert height < 19.0


@pytest.mark.parametrize("f_m", [2.0, 3.0])
def test_a_reference_far_beyond_the_thrust_stays_bounded(f_m):
    """Departure 13: no demand becomes full thrust upwards."""
    error, height = flight(500.0, f_m=f_m)
    assert height < 40.0
    assert error < 0.10


def test_without_the_plants_reaction_the_printed_law_tracks_worse():
    """Departure 9: a huge J_implicit takes gamma f^2 / J out of the divisor."""
    with_it, _ = flight(500.0, prediction="demanded")
    without, _ = flight(500.0, prediction="demanded", J_implicit=1e9)
    assert without > 3.0 * with_it


if __name__ == "__main__":  # the plain side, started by the test
    assert not hasattr(control.tick, "py_func"), "compiled after all"
    folder = Path(sys.argv[1])
    given = [array.tolist() for array in np.load(folder / "inputs.npz").values()]
    np.save(folder / "rows.npy", closed_loop(*given, 500.0, 200, buffer=list))
