"""Layers of wind in a mission: what it flies, alone and in lanes, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fcu.kernel.rows import column
from gcs_tools.flight import law_alone, law_flights
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import MissionError, load
from sitl_plant.physics.types import PlantRecord
from sitl_plant.physics.wind.field import Field, component_on, frozen
from sitl_plant.physics.wind.layers import Layers, LayersError
from sitl_plant.physics.wind.layers import load as load_layers
from sitl_plant.physics.wind.layers import save as save_layers
from sitl_plant.physics.wind.packed_field import save

HEAD = """title = "The vehicle hovers in layers of wind."
[flight]
duration_s = 3.0
setpoints = [{ at_s = 0.0, position_m = [0.0, 0.0, 0.0] }]
start = { position_m = [0.0, 0.0, 0.0] }
ground_z_m = -20.0
[wind]
"""
LAYERS = """steady_m_s = [4.0, 2.0, 0.0]
shear = "log"
turbulence = "von_karman"
turbulence_w20_m_s = 7.7
gusts = [{ at_s = 1.0, velocity_m_s = [0.0, 3.0, 0.0], rise_s = 0.5 }]
"""


def mission(folder: Path, wind: str):
    (folder / "m.toml").write_text(HEAD + wind)
    return load(folder / "m.toml")


def air(rows):
    return column(PlantRecord, rows, "v_air_E")


def a_field(folder: Path, speed: float = 5.0) -> None:
    """Uniform wind to East with a building of 6 m east of x = 30, 60 x 60 x 40 m."""
    edges = [np.linspace(0.0, n, int(n) // 4 + 1) for n in (60.0, 60.0, 40.0)]
    shape = (1, 11, 16, 16)
    parts = [component_on(*edges, np.full(shape, v, dtype=np.float32)) for v in (speed, 0, 0)]
    top = np.zeros((15, 15), dtype=np.float32)
    top[:, 8:] = 6.0
    bounds = np.array([0.0, 60.0, 0.0, 60.0, -1.0, 40.0])
    made = Field(
        frozen(np.zeros(1)), *parts, frozen(bounds), frozen(edges[0]), frozen(edges[1]), frozen(top)
    )
    save(folder / "f", made, {})


def test_the_papers_wind_by_name_is_that_of_its_numbers_to_the_bit(tmp_path):
    named = scenario(mission(tmp_path, 'base = "paper"\n'))
    written = load("paper_nominal").wind
    assert named.world.params.wind == scenario(load("paper_nominal")).world.params.wind
    assert named.layers is None and written.amplitude_m_s == (7.2, 7.2, 5.7)
    other = mission(tmp_path, 'base = "paper"\namplitude_m_s = [1.0, 1.0, 1.0]\n').wind
    assert other.amplitude_m_s == (1.0, 1.0, 1.0) and other.frequency_rad_s == (1.5, 1.6, 1.7)


def test_layers_are_composed_and_a_seed_repeats_them(tmp_path):
    scene = scenario(mission(tmp_path, LAYERS))
    plant, again = law_alone.fly(scene)[0], law_alone.fly(scene)[0]
    assert plant.tobytes() == again.tobytes()
    calm = replace(scene, layers=scene.layers._replace(turbulence=None))
    v = air(law_alone.fly(calm)[0])
    grown = np.log(20.0 / 0.1) / np.log(10.0 / 0.1)
    np.testing.assert_allclose(v[0], [4.0 * grown, 2.0 * grown, 0.0], rtol=1e-6)
    np.testing.assert_allclose(v[750] - v[0], [0.0, 3.0, 0.0], atol=1e-3)  # the top of the gust
    assert air(plant)[:, 0].std() > 0.01
    other = replace(scene, layers=scene.layers._replace(seed=2))
    assert law_alone.fly(other)[0].tobytes() != plant.tobytes()


def test_of_no_mean_wind_there_is_no_turbulence(tmp_path):
    """Not even in still air, where nothing would carry it past."""
    scene = scenario(mission(tmp_path, 'turbulence = "dryden"\nturbulence_w20_m_s = 0.0\n'))
    assert (air(law_alone.fly(scene)[0]) == 0.0).all()


def test_vehicles_in_lanes_meet_the_air_that_they_meet_alone(tmp_path):
    """Samples, layers and a field, each of its own seed: the same bits."""
    a_field(tmp_path)
    (tmp_path / "gust.csv").write_text("t_s,x_m_s,y_m_s,z_m_s\n0,0,0,0\n1,2,1,0\n")
    winds = {
        "layers": LAYERS, "samples": 'file = "gust.csv"\n',
        "field": LAYERS + 'field = { file = "f", origin_m = [15.0, 30.0, 20.0] }\n',
    }  # fmt: skip
    for wind in winds.values():
        scene = scenario(mission(tmp_path, wind))
        layers = scene.layers
        scenes = [
            replace(scene, layers=layers and layers._replace(seed=seed)) for seed in range(1, 5)
        ]
        found = law_flights.fly(scenes)
        for each, flown in zip(scenes, found, strict=True):
            assert flown.plant.tobytes() == law_alone.fly(each)[0].tobytes()


def test_a_building_in_the_way_ends_a_flight_and_so_does_the_end_of_a_field(tmp_path):
    a_field(tmp_path)
    field = 'field = { file = "f", origin_m = [28.0, 30.0, 3.0] }\n'
    assert law_flights.by_itself(scenario(mission(tmp_path, field))).ended == 0
    into = 'field = { file = "f", origin_m = [31.4, 30.0, 3.0] }\n'  # its rotors reach the wall
    assert law_flights.by_itself(scenario(mission(tmp_path, into))).ended == 3
    out = 'field = { file = "f", origin_m = [28.0, 59.99, 3.0] }\nsteady_m_s = [0.0, 12.0, 0.0]\n'
    assert law_flights.by_itself(scenario(mission(tmp_path, out))).ended == 4


@pytest.mark.parametrize(
    ("wind", "said"),
    [
        ('base = "papers"\n', 'base: expected paper'),
        ('turbulence = "dryden"\n', "turbulence needs both"),
        ('turbulence = "kaimal"\nturbulence_w20_m_s = 3.0\n', "turbulence: expected dryden or von_karman"),
        ('shear = "log"\nroughness_m = 10.0\n', "roughness_m: expected less than shear_height_m"),
        ("gusts = [{ at_s = 1.0, velocity_m_s = [1.0, 0.0, 0.0], rise_s = 0.0 }]\n", "rise_s"),
        ('field = { file = "nowhere" }\n', "expected a packed field"),
        ('field = { file = "." }\n', "a folder, but no packed field (gcs wind pack makes one)"),
    ],
)  # fmt: skip
def test_what_is_no_wind_is_refused(tmp_path, wind, said):
    with pytest.raises(MissionError) as raised:
        mission(tmp_path, wind)
    assert said in str(raised.value)


def test_a_field_cannot_be_turned(tmp_path):
    a_field(tmp_path)
    with pytest.raises(MissionError, match="cannot be turned"):
        mission(tmp_path, 'azimuth_deg = 10.0\nfield = { file = "f" }\n')


def test_layers_are_handed_over_to_the_bit_and_what_is_none_is_refused(tmp_path):
    a_field(tmp_path)
    layers = mission(tmp_path, LAYERS + 'field = { file = "f", scale = 1.1 }\n').wind.layers(7)
    save_layers(tmp_path / "l.json", layers)
    assert load_layers(tmp_path / "l.json") == layers
    for text in ("{", "[]", '{"shears": 1}'):
        (tmp_path / "l.json").write_text(text)
        with pytest.raises(LayersError):
            load_layers(tmp_path / "l.json")
    assert isinstance(layers, Layers)


def test_a_flight_that_outlasts_its_field_is_refused_or_told_what_follows(tmp_path):
    a_field(tmp_path)
    axes = dict(np.load(tmp_path / "f" / "axes.npz"))
    axes["t"] = np.array([0.0, 2.0])
    np.savez(tmp_path / "f" / "axes.npz", **axes)
    for name in "uvw":
        part = np.load(tmp_path / "f" / f"{name}.npy")
        np.save(tmp_path / "f" / f"{name}.npy", np.concatenate((part, part)))
    (tmp_path / "f" / "about.json").write_text('{"format": 1, "times": 2}')
    with pytest.raises(MissionError, match="the field ends 2 s after the flight begins"):
        mission(tmp_path, 'field = { file = "f" }\n')
    for after in ("hold", "repeat"):
        mission(tmp_path, f'field = {{ file = "f", after = "{after}" }}\n')


@pytest.mark.parametrize(
    ("origin", "why"),
    [
        ("[-5000.0, 30.0, 20.0]", "begins at x = -5000 m, outside the field: 0 to 60 m"),
        ("[30.0, 30.0, 50.0]", "begins at z = 50 m, outside the field: -1 to 40 m"),
        ("[50.0, 30.0, 2.0]", "begins 2 m up, in a building of 6 m"),
    ],
)
def test_a_flight_that_begins_outside_its_field_or_in_a_building_is_refused(tmp_path, origin, why):
    a_field(tmp_path)
    with pytest.raises(MissionError, match="origin_m") as error:
        mission(tmp_path, f'field = {{ file = "f", origin_m = {origin} }}\n')
    assert why in str(error.value)
    mission(tmp_path, 'field = { file = "f", origin_m = [50.0, 30.0, 6.0] }\n')  # on the roof
