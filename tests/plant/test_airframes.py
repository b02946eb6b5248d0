"""Vehicles of any rotors: what the allocation asks for is what the plant's rotors give."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from fcu.interface.airframe import AirframeError, read
from fcu.interface.messages import RotorCommand
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import from_buffer, to_buffer
from fcu.laws import allocation
from sitl_plant.physics import rotors as physics
from sitl_plant.physics.parameters import plant_params, start_state
from sitl_plant.physics.truth import path_of, truth
from sitl_plant.physics.types import PlantParams

QUAD = Path(__file__).parents[1] / "own_airframe" / "quad.toml"
CORNERS = [(0.16, -0.16), (-0.16, 0.16), (0.16, 0.16), (-0.16, -0.16)]
X8 = [*((x, y, 0.04) for x, y in CORNERS), *((x, y, -0.04) for x, y in CORNERS)]
VEHICLES = {
    "quad": {},
    "ahead": {"position_m": [(x + 0.02, y) for x, y in CORNERS]},
    "x8": {
        "position_m": X8, "spin": [1, 1, -1, -1, -1, -1, 1, 1],
        "thrust_coefficient": [0.7e-5] * 4 + [0.56e-5] * 4,
    },
    "hexa": {
        "position_m": [
            (0.2 * math.cos(a), 0.2 * math.sin(a)) for a in np.radians(np.arange(30, 390, 60))
        ],
        "spin": [1, -1] * 3,
    },
}  # fmt: skip
STILL = Rotors(*[1.0] * 8)


def file_of(folder, changes, text=None):
    """An airframe file as that of the quadrotor, with other values in [rotors]."""
    lines = (text or QUAD.read_text()).splitlines()
    for key, value in changes.items():
        array = [list(each) if isinstance(each, tuple) else each for each in value]
        lines = [f"{key} = {array}" if line.startswith(f"{key} =") else line for line in lines]
    (folder / "mine.toml").write_text("\n".join(lines))
    return read(folder / "mine.toml")


@pytest.fixture(params=VEHICLES)
def vehicle(request, tmp_path):
    """What the controller believes of its rotors, and the plant of the same file."""
    file = file_of(tmp_path, VEHICLES[request.param])
    believed = allocation.believed_rotors(file.rotors, 0.002, 0.03, f_min=0.1, kappa=3.0)
    return believed, plant_params(truth(file), 500.0, ground_z_m=-1e4)


@pytest.mark.parametrize("asked", [(0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.02)])  # fmt: skip
def test_the_plant_gives_what_was_allocated(vehicle, asked):
    rotors, params = vehicle
    f, gave_up = allocation.allocate(rotors, 14.0, Vec3(*asked))
    full = np.array(params.airframe.c_T)
    Omega = [math.sqrt(each / c) if c else 0.0 for each, c in zip(f, full, strict=True)]
    T, tau = physics.thrust_and_torque(params, Rotors(*Omega), STILL)
    assert gave_up == (0.0, 0.0)
    assert pytest.approx(14.0, rel=1e-12) == T
    np.testing.assert_allclose(tau, asked, atol=1e-12)


@pytest.mark.parametrize(("axis", "change"), [("x", (0.2, 0, 0)), ("y", (0, 0.2, 0)), ("z", (0, 0, 0.02))])  # fmt: skip
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_airframe_turns_to_the_side_of_the_torque(vehicle, fly, axis, change, side):
    """Forward-left-up: roll right side down, pitch nose down and yaw to the left are positive."""
    rotors, params = vehicle
    f, _ = allocation.allocate(rotors, params.m * 9.81, Vec3(*(side * c for c in change)))
    u = [
        math.sqrt(each / c) / full if c else 0.0
        for each, c, full in zip(f, rotors.c_T, rotors.Omega_max, strict=True)
    ]
    end = fly(params, start_state(params), Rotors(*u), 0.1)
    turned = {name: getattr(end.w_B, name) for name in "xyz"}
    assert side * turned[axis] > 0.02
    assert all(abs(w) < 0.2 * abs(turned[axis]) for name, w in turned.items() if name != axis)


def test_an_airframe_starts_in_a_hover_without_torque(vehicle):
    _, params = vehicle
    start = start_state(params)
    T, tau = physics.thrust_and_torque(params, start.Omega, STILL)
    assert pytest.approx(params.m * params.g, rel=1e-12) == T
    np.testing.assert_allclose(tau, (0.0, 0.0, 0.0), atol=1e-12)
    absent = np.array(params.airframe.spin) == 0.0
    assert (np.array(start.Omega)[absent] == 0.0).all()
    assert (np.array(start.Omega)[~absent] > 100.0).all()


def test_a_command_to_a_rotor_that_is_absent_turns_nothing(vehicle, fly):
    _, params = vehicle
    n = params.airframe.n
    start = start_state(params)
    u = [o / full if full else 1.0 for o, full in zip(start.Omega, params.airframe.Omega_max, strict=True)]  # fmt: skip
    end = fly(params, start, Rotors(*u), 0.5)
    assert end.Omega[n:] == (0.0,) * (8 - n)
    np.testing.assert_allclose(end.w_B, (0.0, 0.0, 0.0), atol=1e-9)


def test_a_loss_of_a_rotor_that_is_absent_is_refused():
    true = truth(read(QUAD))
    loss = {"rotor": 5, "at_s": 1.0, "effectiveness": 0.5}
    with pytest.raises(AirframeError, match="1 to 4"):
        plant_params(true, 500.0, {"rotor_loss": [loss]})


def test_params_of_any_vehicle_survive_the_way_through_a_file(vehicle):
    _, params = vehicle
    assert from_buffer(PlantParams, to_buffer(params)) == params
    assert isinstance(RotorCommand(u=STILL).u, Rotors)


# --- what is true


def test_without_a_file_the_middle_of_what_is_believed_is_true():
    true = truth(read(QUAD))
    assert true.vehicle["mass_kg"] == 1.5
    assert true.vehicle["inertia_kg_m2"] == pytest.approx([0.02, 0.02, 0.036])
    assert true.vehicle["drag"] == [0.05] * 3
    assert 1e-4 < true.vehicle["drag_torque"][0] < 1e-2
    assert (true.battery["cells"], true.battery["capacity_ah"]) == (4.0, 5.0)
    assert true.origins["vehicle", "mass_kg"] == "middle of quad.toml"
    sinks = true.vehicle["mass_kg"] * 9.81 / true.ground["stiffness_n_m"]
    assert sinks == pytest.approx(0.01, rel=0.05)


def test_what_makes_an_s1000_is_what_its_like_is_made_with(tmp_path):
    """Gear, drag torque and battery of an S1000 without a truth are as in its own, to a third."""
    (tmp_path / "s1000.toml").write_text(read().text)
    like, true = truth(read(tmp_path / "s1000.toml")), truth(read())
    for table in ("vehicle", "ground", "battery"):
        for key, value in getattr(true, table).items():
            np.testing.assert_allclose(getattr(like, table)[key], value, rtol=0.7, err_msg=key)


def test_a_truth_beside_a_file_is_what_is_flown(tmp_path):
    file = file_of(tmp_path, {})
    path = tmp_path / "mine.truth.toml"
    assert path_of(file) == path
    path.write_text("[vehicle]\nmass_kg = 1.62\n[rotors]\nlag_s = 0.05\nspin = [1, 1, -1, -1]\n")
    true = truth(file)
    params = plant_params(true, 500.0)
    assert (params.m, params.airframe.rotor_lag) == (1.62, 0.05)
    assert true.origins["vehicle", "mass_kg"] == "mine.truth.toml"
    assert true.origins["vehicle", "drag"] == "middle of mine.toml"
    assert true.identity.startswith("mine.truth.toml ")
    assert true.ground["stiffness_n_m"] == pytest.approx(1620.0)


@pytest.mark.parametrize(("text", "said"), [
    ("[vehicle]\nmass_kg = nan\n", "mass_kg: expected a number"),
    ("[vehicle]\nmass_kg = [1.5, 1.6]\n", "mass_kg: expected a number"),
    ("[vehicle]\ninertia_kg_m2 = [1e308, 1, 1]\n", "inertia_kg_m2: expected three numbers"),
    ("[vehicle]\nmass = 1.5\n", "did you mean mass_kg"),
    ("[vehicles]\nmass = 1.5\n", "did you mean vehicle"),
    ("vehicle = 3\n", "expected a table"),
    ("[rotors]\nspin = [1, -1, 1, -1]\n", "go together"),
    ("[rotors]\nspin = [1, -1, 1, -1, 1]\n", "5"),
    ("[battery]\nremaining = 2\n", "remaining: expected a number"),
    ("[ground]\nstiffness_n_m = 'hard'\n", "stiffness_n_m: expected a number"),
    ("[vehicle", "mine.truth.toml:1"),
])  # fmt: skip
def test_a_truth_that_cannot_be_is_refused_by_table_and_key(tmp_path, text, said):
    file = file_of(tmp_path, {})
    (tmp_path / "mine.truth.toml").write_text(text)
    with pytest.raises(AirframeError) as error:
        truth(file)
    assert "mine.truth.toml" in str(error.value)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_an_inertia_of_two_axes_is_refused(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(QUAD.read_text())
    path_of(read(path)).write_text("[vehicle]\ninertia_kg_m2 = [0.03, 0.03]\n")
    with pytest.raises(AirframeError, match="three numbers"):
        truth(read(path))


@pytest.mark.parametrize(("rate_hz", "steps"), [(1000.0, 1), (500.0, 2), (400.0, 3), (250.0, 4)])
def test_no_integration_step_is_longer_than_a_millisecond(rate_hz, steps):
    assert plant_params(truth(read(QUAD)), rate_hz).h == pytest.approx(1.0 / (rate_hz * steps))
