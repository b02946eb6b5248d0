"""The truth that the angular estimate is held against is what turns a vehicle that is flown."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from fcu.kernel.buffers import columns, to_buffer
from fcu.process.settings import Settings
from fcu.process.tick import Tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load, override
from gcs_tools.pictures.plot import estimates
from gcs_tools.pictures.plot.window import Window
from gcs_tools.recording.reader import VALUES, Recording
from gcs_tools.recording.table import Table
from sitl_plant.physics.types import PlantRecord


def test_the_angular_truth_explains_the_motion() -> None:
    """J w' less the believed torque and the couplings, by differences, in flight with a weak rotor."""
    mission = override(load("weak_rotor"), "flight.duration_s=3.0")
    mission = override(mission, "flight.rate_hz=1000")
    mission = override(mission, "plant.rotor_loss=[{rotor=1, at_s=2.0, effectiveness=0.6}]")
    scene = scenario(mission)
    plant, fcu = law_alone.fly(scene)
    values = {k: asdict(v) for k, v in mission.values_in_force().items()}
    recording = Recording(
        path=Path("weak.mcap"), metadata={VALUES: json.dumps(values)}, plant=Table.of(PlantRecord, plant),
        fcu=Table.of(Tick, fcu), params=dict(zip(columns(Settings), to_buffer(scene.settings).tolist(), strict=True)),
        events=[], reports={}, topics={}, lost={}, complete=True,
    )  # fmt: skip
    window = Window.of(recording, None, None)
    truth = np.stack([e.truth for e in estimates.angular(window) if e.truth is not None], axis=1)
    assert truth.shape == (3000, 3)

    h, J = 1.0 / 1000.0, window.plant["J"]
    w = window.plant["state.w_B"]
    # what the truth leaves: the rotors' believed torque, couplings, and their gyroscopic torque
    turning = window.plant["state.Omega"]
    spin, airframe = np.array(scene.law.rotors.spin), scene.world.params.airframe
    gyro = (
        airframe.J_m
        * (turning @ spin)[:, None]
        * np.stack([-w[:, 1], w[:, 0], np.zeros(len(w))], axis=1)
    )
    f = np.array(scene.law.rotors.c_T) * turning**2
    x, y = np.array(scene.law.rotors.x), np.array(scene.law.rotors.y)
    tau = np.stack([f @ y, -f @ x, -scene.law.rotors.k_Q * (f @ spin)], axis=1)
    rest = truth + (tau + gyro - np.cross(w, J * w)) / J

    predicted = 0.5 * h * (rest[1:] + rest[:-1])
    off = np.abs(np.diff(w, axis=0) - predicted) / h
    # the trapezium follows neither the loss, a step, nor the rotors' jolts of the first second
    smooth = (plant[1:, 0] > 1.0) & (np.abs(plant[1:, 0] - 2.0) > 1.5 * h)
    assert np.abs(truth[2400:]).max() > 2.0, "the weak rotor shows"
    assert off[smooth].max() < 0.01  # rad/s^2
