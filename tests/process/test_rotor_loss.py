"""A rotor that stops in flight: found over the wire as in process, told by an order, and flown on without."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.interface.status_texts import Code, Told, brief
from fcu.kernel.buffers import from_buffer
from fcu.laws import loader
from fcu.parameters import Parameters
from fcu.process.baseline import Baseline
from fcu.process.configuration import read_airframe, read_settings
from gcs_tools.recording.reader import read
from gcs_tools.studies.rotor_loss import Cell, Losing, fly, mission, scenario
from tests import two_ways

pytestmark = pytest.mark.slow  # flies


TEXT = """title = "A rotor is lost."
airframe = "s1000"
[flight]
duration_s = 8.0
setpoints = [[0.0, 0.0, 0.0, 10.0]]
start = { position_m = [0.0, 0.0, 10.0] }
[vehicle.params]
CA_FAILURE_MODE = 1
COM_ACT_FAIL_ACT = 1
[[plant.faults]]
kind = "motor_off"
at_s = 3.0
rotor = 4
[expect]
failsafe = { name = "rotor_lost", from = 3.1, to = 3.25 }
reached = 1.0
"""


def test_a_lost_rotor_is_found_and_flown_without_both_ways(tmp_path):
    (tmp_path / "lost.toml").write_text(TEXT)
    for way, result in two_ways.fly_both(tmp_path / "lost.toml", tmp_path).items():
        rows = read(tmp_path / way / "flight.mcap").fcu
        after = rows["t"] > result.failsafes[0].time_s
        assert (rows["outputs.thrusts.r4"][after] == 0.0).all()
        assert (rows["command.u.r4"][after] == 0.0).all()
        assert (rows["outputs.thrusts.r4"][~after & (rows["t"] < 3.0)] > 1.0).all()


def test_an_order_is_told_at_once_and_the_rotor_may_come_back():
    found = fly(Cell("s1000", "hover", "mmrac", "order"), 3)
    assert found.end == "flies on"
    assert 0.0 <= found.told_s <= 0.004 + 1e-9


@pytest.mark.parametrize("seed", range(6))
def test_a_hexacopter_that_is_told_lands(seed):
    assert fly(Cell("hexa", "hover", "mmrac", "found"), seed).end == "lands"


@pytest.mark.parametrize(
    "cell",
    [Cell("s1000", "hover", "mmrac", "untold"), Cell("s1000", "step", "mmrac", "found")],
    ids=lambda cell: cell.tells,
)
def test_a_guard_that_governs_does_not_lead_a_vehicle_away_without_a_rotor(cell):
    """It governed on once: untold 288 of 300 were lost, and told some were 10 m past the setpoint."""
    assert {fly(cell, seed).end for seed in (0, 1, 8)} == {"flies on"}


DOWN = """title = "A rotor stops on the way down."
airframe = "s1000"
[flight]
duration_s = 60.0
ground_z_m = 0.0
arena_m = 1000.0
start = { position_m = [0.0, 0.0, 60.0] }
setpoints = [{ at_s = 0.0, position_m = [0.0, 0.0, 60.0] }, { at_s = 4.0, position_m = [0.0, 0.0, 6.0] }]
[vehicle.params]
MR_SP_BELOW = 200.0
[[plant.faults]]
kind = "motor_off"
at_s = 5.5
rotor = 1
[wind]
base = "paper"
"""
LATE = """title = "A rotor is found late."
airframe = "x8"
[flight]
duration_s = 30.0
ground_z_m = 0.0
start = { position_m = [0.0, 0.0, 10.0] }
setpoints = [[0.0, 0.0, 0.0, 10.0]]
[vehicle.params]
FD_ACT_MOT_TOUT = 700.0
[[plant.faults]]
kind = "motor_off"
at_s = 5.0
rotor = 1
"""


def flown(text, folder):
    """(position, velocity), E, of a vehicle, flown in process."""
    (folder / "m.toml").write_text(text)
    two_ways.fly(folder / "m.toml", folder, "process")
    rows = read(folder / "process" / "flight.mcap").plant
    return rows["state.r_E"], rows["state.v_E"]


def test_rotor_loss_in_a_descent_makes_it_no_faster(tmp_path):
    """A guard that let go of the reference at once had it fall at 16.7 m/s to the ground."""
    r, v = flown(DOWN, tmp_path)
    assert v[:, 2].min() > -2.0
    assert r[:, 2].min() > 5.5


def test_a_reference_does_not_go_with_a_vehicle_that_is_driven_away(tmp_path):
    """One that gave way was led 35 m away by the time that the loss was found."""
    r, _ = flown(LATE, tmp_path)
    off = np.linalg.norm(r - np.array([0.0, 0.0, 10.0]), axis=1)
    assert off.max() < 1.5
    assert off[-1] < 0.05


def test_until_a_rotor_is_lost_no_bit_changes():
    """By CA_FAILURE_MODE, and with the detector at work in both."""
    rows = [
        Losing(scenario(mission(Cell("s1000", "step", "mmrac", tells), 5, 2, 6.0)), 2, -1)
        .fly()
        .plant
        for tells in ("untold", "found")
    ]
    before = int((rows[0][:, 0] < 6.1).sum())
    assert rows[0][:before].tobytes() == rows[1][:before].tobytes()
    assert rows[0][before : before + 50].tobytes() != rows[1][before : before + 50].tobytes()


def test_the_baseline_that_waits_follows_the_loss():
    law = loader.load()
    airframe = read_airframe(law)
    params = Parameters(read_settings(law, None, 500.0, airframe), 1, None, law, airframe)
    waits = Baseline(airframe, 0.002)
    kind = type(waits._whole)
    for lost in ((3,), ()):
        params.lose(lost)
        waits.share(params)
        of_px4 = from_buffer(kind, waits._settings).law
        assert of_px4.rotors.w == params.law.rotors.w
        assert of_px4.limits.T_max == params.law.limits.T_max
        assert (of_px4.rotors.w.r3 == 0.0) is bool(lost)


@pytest.mark.parametrize(
    "code", [Code.LOSS_NOT_SHARED, Code.LOSS_SHARED, Code.LOSS_LANDS, Code.LOSS_FALLS]
)
def test_text_of_a_rotor_loss_has_room(code):
    assert len(brief(Told(Code.ROTOR_LOST, (8, Told(code))))) <= 50
