"""A field of wind: what a vehicle meets between its values, at its faces and at its walls."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from fcu.interface.airframe import read
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import matrix, rotate
from fcu.kernel.rows import slice_of
from sitl_plant.physics.parameters import plant_params, start_state
from sitl_plant.physics.truth import truth
from sitl_plant.physics.types import PlantParams
from sitl_plant.physics.wind import air, disk, field, near
from sitl_plant.physics.wind.field import Field, component_on, frozen
from sitl_plant.physics.wind.layers import FieldLayer, Layers, layered
from sitl_plant.physics.wind.packed_field import FieldError, opened, save

RATE = np.array([[0.1, -0.02, 0.03], [0.05, 0.2, -0.04], [-0.03, 0.01, -0.3]])  # dv/dr, 1/s
BASE = np.array([3.0, -2.0, 0.5])
PARAMS = plant_params(truth(read()), 500.0)


def linear(t=(0.0,), uneven=False, top=field.NO_TOP) -> Field:
    """A staggered field that is linear in space, 20 x 16 x 12 cells of 2 m, of no divergence."""
    edges = [2.0 * np.arange(n + 1) for n in (20, 16, 12)]
    if uneven:
        edges[2] = edges[2] ** 1.2
    centres = [0.5 * (e[1:] + e[:-1]) for e in edges]
    parts = []
    for axis in range(3):
        x, y, z = (edges[i] if i == axis else centres[i] for i in range(3))
        zz, yy, xx = np.meshgrid(z, y, x, indexing="ij")
        v = BASE[axis] + RATE[axis, 0] * xx + RATE[axis, 1] * yy + RATE[axis, 2] * zz
        of_time = np.stack([v * (1.0 + 0.1 * s) for s in t])
        parts.append(component_on(x, y, z, of_time.astype(np.float32)))
    bounds = np.array([f(e) for e in edges for f in (np.min, np.max)])
    high = np.full((16, 20), top, dtype=np.float32)
    return Field(
        frozen(np.array(t)), *parts, frozen(bounds), *map(frozen, (edges[0], edges[1], high))
    )


def velocity(of: Field, r, k=0, f=0.0):
    """The air at one place, sampled twice: the second time as of the cell before."""
    places, out = np.array([r, r], dtype=np.float64).T.copy(), np.zeros((3, 2))
    field.sample_all(of, places, k, f, out)
    np.testing.assert_array_equal(*out.T)
    return out[:, 0]


def true_at(r):
    return BASE + RATE @ np.asarray(r)


@pytest.mark.parametrize("uneven", [False, True])
def test_a_linear_field_is_met_to_the_rounding_of_float32(uneven):
    made, random = linear(uneven=uneven), np.random.default_rng(1)
    for r in random.uniform([1.0, 1.0, 1.2], [39.0, 31.0, 22.0], (200, 3)):
        met = velocity(made, r)
        np.testing.assert_allclose(met, true_at(r), atol=2e-6)


def test_a_staggered_component_is_met_at_its_faces_as_it_stands_there():
    made = linear()
    r = made.u.x[3], made.u.y[4], made.u.z[5]
    assert velocity(made, r)[0] == made.u.v[0, 5, 4, 3]


def test_time_is_interpolated_holds_at_its_end_or_begins_anew():
    made = linear(t=(0.0, 1.0, 2.0))
    r = (10.0, 11.0, 12.0)
    for t, repeats, factor in (
        (0.5, False, 1.05),
        (1.75, False, 1.175),
        (9.0, False, 1.2),
        (3.5, True, 1.15),
    ):
        k, f = field.time_in(made.t, t, repeats)
        np.testing.assert_allclose(
            velocity(made, r, k, f), factor * true_at(r), rtol=1e-6, atol=2e-6
        )


def test_the_disk_gives_the_mean_velocity_and_the_rotation_of_the_air():
    """Of a field that is linear: its value at the centre, and half its curl about the vertical."""
    made, at_hubs = linear(), np.zeros((3, 8))
    r = (20.0, 15.0, 11.0)
    mean, w = disk.meet(
        made, PARAMS.airframe, Vec3(0.0, 0.0, 0.0), 1.0, Vec3(*r), matrix(start_state(PARAMS).q_EB), 0, 0.0, np.zeros((near.ROWS, 8)), at_hubs
    )  # fmt: skip
    np.testing.assert_allclose(mean, true_at(r), atol=1e-5)
    assert w.z == pytest.approx(0.5 * (RATE[1, 0] - RATE[0, 1]), abs=1e-5)
    assert w.x == pytest.approx(RATE[2, 1], abs=1e-5)
    assert w.y == pytest.approx(-RATE[2, 0], abs=1e-5)


def test_the_motion_of_the_air_is_found_by_rotors_that_stand_unevenly():
    """A field in rigid rotation, met by five rotors whose centre is not that of the vehicle."""
    x = (0.4, 0.1, -0.3, -0.35, 0.2, 0.0, 0.0, 0.0)
    y = (0.1, 0.5, 0.3, -0.4, -0.2, 0.0, 0.0, 0.0)
    c_T = (1e-5, 2e-5, 1e-5, 3e-5, 1e-5, 0.0, 0.0, 0.0)
    odd = PARAMS.airframe._replace(x=Rotors(*x), y=Rotors(*y), c_T=Rotors(*c_T))
    places = [np.arange(0.0, 21.0, 2.0)] * 3
    zz, yy, xx = np.meshgrid(*places, indexing="ij")
    w, r = np.array([0.3, -0.2, 0.1]), np.array([10.0, 10.0, 10.0])
    at = np.stack([xx, yy, zz], axis=-1) - r
    v = np.array([1.0, 2.0, 3.0]) + np.cross(w, at)
    parts = [component_on(*places, np.float32(v[None, ..., i])) for i in range(3)]
    made = linear()._replace(u=parts[0], v=parts[1], w=parts[2])
    q = Quat(0.9, 0.3, -0.2, (1.0 - 0.81 - 0.09 - 0.04) ** 0.5)
    mean, found = disk.meet(
        made,
        odd,
        Vec3(0.0, 0.0, 0.0),
        1.0,
        Vec3(*r),
        matrix(q),
        0,
        0.0,
        np.zeros((near.ROWS, 8)),
        np.zeros((3, 8)),
    )
    np.testing.assert_allclose(mean, [1.0, 2.0, 3.0], atol=1e-5)
    np.testing.assert_allclose(rotate(matrix(q), found), w, atol=1e-5)


@pytest.mark.parametrize("cells_m", [(2.0, 2.0, 2.0), (0.9, 4.0, 3.0), (0.3, 0.3, 0.3)])
@pytest.mark.parametrize("times", [(0.0,), (0.0, 1.0, 2.0)])
@pytest.mark.parametrize("uneven", [False, True])
def test_eight_hubs_at_once_meet_what_each_meets_by_itself(cells_m, times, uneven):
    """The same bits, while cells, times and the edges of the field are passed: with what is kept, and beyond it."""
    random, parts = np.random.default_rng(7), []
    for axis in range(3):
        x, y, z = (cells_m[i] * (np.arange(12) + 0.5 * (i != axis)) for i in range(3))
        values = random.normal(0.0, 3.0, (len(times), 12, 12, 12))
        parts.append(component_on(x, y, z**1.1 if uneven else z, np.float32(values)))
    made = linear(t=times)._replace(u=parts[0], v=parts[1], w=parts[2])
    kept, out, alone = np.zeros((near.ROWS, 8)), np.zeros((3, 8)), np.zeros((3, 8))
    far = 12.0 * np.array(cells_m)[:, None]
    arms = random.uniform(-0.5, 0.5, (3, 8)) * [[1.0], [1.0], [0.2]]
    for n in range(400):
        kept[near.HUBS : near.HUBS + 3] = far * (n / 360.0 - 0.05) + arms + random.normal(0.0, 0.1)
        k, f = field.time_in(made.t, n / 190.0, False)
        near.meet(made, kept, k, f, out)
        field.sample_all(made, kept[near.HUBS : near.HUBS + 3], k, f, alone)
        np.testing.assert_array_equal(out, alone)


def met(made: Field, tmp_path: Path, r, **layer):
    """The parameters of a plant at a position in a field."""
    save(tmp_path / "f", made, {})
    of = layered(Layers(field=FieldLayer(str(tmp_path / "f"), (0.0, 0.0, 0.0), **layer)), PARAMS)
    params = to_buffer(PARAMS)
    state = start_state(PARAMS)._replace(r_E=Vec3(*r))
    air.blow(of, params, to_buffer(state), 0, 0.002)
    return params


def part(params, name):
    return params[slice_of(PlantParams, name)]


def test_a_vehicle_meets_the_field_scaled_and_its_rotors_the_vertical_wind(tmp_path):
    r = (20.0, 15.0, 11.0)
    params = met(linear(), tmp_path, r, scale=0.5)
    np.testing.assert_allclose(part(params, "wind.steady"), 0.5 * true_at(r), atol=1e-5)
    inflow = part(params, "wind.inflow")
    upward = 0.5 * true_at(r)[2]
    assert upward < 0.0
    assert (inflow < 1.0).all()  # air from above takes thrust
    assert len(set(inflow.round(9))) == 8  # each rotor has its own
    off = met(linear(), tmp_path, r, inflow=False)
    assert (part(off, "wind.inflow") == 1.0).all()


@pytest.mark.parametrize(
    ("r", "wall"),
    [
        ((20.0, 15.0, 11.0), 0.0),
        ((20.0, 15.0, 4.0), 1.0),
        ((50.0, 15.0, 11.0), 2.0),
        ((20.0, 15.0, 5.2), 0.0),
    ],
)
def test_roofs_are_ground_buildings_are_hit_and_a_field_has_an_end(tmp_path, r, wall):
    params = met(linear(top=5.0), tmp_path, r)
    assert part(params, "ground.wall")[0] == wall
    if wall != 2.0:
        assert part(params, "ground.z")[0] == 5.0


def test_a_wall_beside_the_vehicle_is_hit_by_the_tip_of_a_rotor(tmp_path):
    made = linear(top=0.0)
    high = made.top.copy()
    high[:, :10] = 20.0  # west of x = 20
    made = made._replace(top=frozen(high))
    reach = 0.5225 + disk.rotor_radius(PARAMS.airframe)
    at = {x: part(met(made, tmp_path, (x, 15.0, 11.0)), "ground.wall")[0] for x in (20.0 + 0.9 * reach, 20.0 + 1.01 * reach)}  # fmt: skip
    assert list(at.values()) == [1.0, 0.0]


def test_a_packed_field_is_mapped_once_and_read_again_to_the_bit(tmp_path):
    made = linear(t=(0.0, 2.0))
    save(tmp_path / "f", made, {"title": "x"})
    packed = opened(tmp_path / "f")
    assert packed is opened(tmp_path / "f")
    assert packed.about["title"] == "x"
    for name in "uvw":
        assert getattr(packed.field, name).v.tobytes() == getattr(made, name).v.tobytes()


@pytest.mark.parametrize("harm", ["axes.npz", "u.npy", "about.json"])
def test_a_packed_field_that_is_damaged_is_an_error(tmp_path, harm):
    save(tmp_path / "f", linear(), {})
    path = tmp_path / "f" / harm
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(FieldError):
        opened(tmp_path / "f")


@pytest.mark.parametrize(
    ("broken", "why"),
    [
        (lambda axes: axes | {"u_x": axes["u_x"] * np.nan}, "u_x of axes.npz is no row of finite"),
        (lambda axes: axes | {"v_y": axes["v_y"][::-1]}, "v_y of axes.npz does not rise"),
        (lambda axes: axes | {"bounds": axes["bounds"][:3]}, "the bounds of axes.npz are none"),
        (lambda axes: axes | {"top": axes["top"] * np.float32(np.nan)}, "the heights of axes.npz"),
        (lambda axes: {k: v for k, v in axes.items() if k != "t"}, "axes.npz lacks 't'"),
    ],
)
def test_a_packed_field_whose_places_are_none_is_damaged(tmp_path, broken, why):
    save(tmp_path / "f", linear(), {})
    with np.load(tmp_path / "f" / "axes.npz") as axes:
        found = dict(axes)
    np.savez(tmp_path / "f" / "axes.npz", **broken(found))
    with pytest.raises(FieldError, match="damaged") as error:
        opened(tmp_path / "f")
    assert why in str(error.value) and str(error.value).count("pack it again") == 1


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e6])
def test_a_packed_field_of_values_that_are_no_wind_is_damaged(tmp_path, value):
    made = linear()
    u = np.array(made.u.v)
    u[0, 1, 1, 1] = value
    save(tmp_path / "f", made._replace(u=made.u._replace(v=u)), {})
    with pytest.raises(FieldError, match=r"u\.npy has values that are not finite, or beyond 150"):
        opened(tmp_path / "f")


@pytest.mark.parametrize("name", ["about.json", "axes.npz", "u.npy"])
def test_a_packed_field_of_a_pipe_is_refused_without_waiting(tmp_path, name):
    save(tmp_path / "f", linear(), {})
    (tmp_path / "f" / name).unlink()
    os.mkfifo(tmp_path / "f" / name)
    with pytest.raises(FieldError, match="not a device or a pipe"):
        opened(tmp_path / "f")


@pytest.mark.parametrize("text", ["[" * 100_000, "[]", '{"format": 1, "notes": "abc"}', "7"])
def test_a_packed_field_that_says_nonsense_of_itself_is_refused(tmp_path, text):
    save(tmp_path / "f", linear(), {})
    (tmp_path / "f" / "about.json").write_text(text)
    with pytest.raises(FieldError, match="pack it again"):
        opened(tmp_path / "f")
