"""The wind that a flight meets in a field, and pictures of fields: `gcs wind check --along`, `gcs wind show`."""

from __future__ import annotations

import json

import click
import numpy as np
import pytest
from click.testing import CliRunner

from gcs_tools.cli.wind import wind
from gcs_tools.studies import street_field
from gcs_tools.wind_fields import cut, sample
from gcs_tools.wind_fields.along import along
from gcs_tools.wind_fields.check import divergence
from gcs_tools.wind_fields.grid import packable
from sitl_plant.physics.wind import field as kernels
from sitl_plant.physics.wind.field import Field, component_on, frozen
from sitl_plant.physics.wind.packed_field import opened, save


def met(of, place, k, f):
    """The air at a place, as a vehicle meets it."""
    out = np.zeros((3, 1))
    kernels.sample_all(of, np.array([place], dtype=np.float64).T.copy(), k, f, out)
    return out[:, 0]


def sheared(times: int = 1) -> Field:
    """0.5 m/s more to East with every metre north, and 2 m/s more with every second. A house of 8 m."""
    x, y, z, t = (
        np.linspace(0, 40, 11),
        np.linspace(0, 80, 21),
        np.linspace(0, 20, 6),
        np.arange(times) * 1.0,
    )
    u = 0.5 * y[None, None, :, None] + 2.0 * t[:, None, None, None] + np.zeros((times, 6, 21, 11))
    parts = [component_on(x, y, z, np.float32(v)) for v in (u, 0 * u, 0 * u)]
    top = np.zeros((20, 10), dtype=np.float32)
    top[:5, :5] = 8.0
    bounds = frozen(np.array([0.0, 40.0, 0.0, 80.0, -1.0, 20.0]))
    return Field(frozen(t), *parts, bounds, frozen(x), frozen(y), frozen(top))  # fmt: skip


def test_tools_meet_the_air_that_the_vehicle_meets():
    random = np.random.default_rng(5)
    field = sheared(3)
    noisy = [
        part._replace(v=frozen(np.float32(random.normal(size=part.v.shape)))) for part in field[1:4]
    ]
    field = field._replace(u=noisy[0], v=noisy[1], w=noisy[2])
    r = random.uniform((-5, -5, -5), (45, 85, 25), (200, 3))
    t = random.uniform(-0.5, 3.0, 200)
    found = sample.velocity(field, r, t)
    for place, at, v in zip(r, t, found, strict=True):
        k, f = kernels.time_in(field.t, at, False)
        np.testing.assert_allclose(v, met(field, place, k, f), atol=1e-12)
        assert sample.heights(field, *place[:2]) == kernels.height(field, *place[:2])


def test_a_flight_meets_the_gradients_that_it_crosses_and_the_changes_in_time():
    t = np.linspace(0.0, 2.0, 201)
    r = np.stack([0 * t + 20.0, 30.0 + 4.0 * t, 0 * t + 10.0], axis=1)
    steady, changing = along(sheared(), t, r), along(sheared(3), t, r)
    assert steady.wind_m_s == pytest.approx(19.0)
    assert steady.rate_m_s2 == pytest.approx(2.0)  # 0.5 1/s at 4 m/s
    assert changing.rate_m_s2 == pytest.approx(4.0)  # and 2 m/s2
    assert (steady.eddy_m, steady.fastest_m_s) == (8.0, pytest.approx(4.0))
    assert steady.unresolved_m_s == pytest.approx(0.5 * 8.0)
    assert steady.guard_wind_m_s == pytest.approx(19.0 + 4.0)
    passing = np.hypot(19.0, 4.0)
    assert steady.unresolved_m_s2 == pytest.approx(0.5 * 8.0 ** (2 / 3) * passing, rel=1e-3)
    assert along(sheared(), t, r, scale=2.0).wind_m_s == pytest.approx(38.0)


def test_a_coarse_axis_hides_no_eddies_of_a_fine_one():
    random = np.random.default_rng(2)
    x, y, z = np.arange(0.0, 401.0, 20.0), np.array([-4000.0, 4000.0]), np.arange(0.0, 101.0, 20.0)
    u = np.repeat(random.normal(0.0, 3.0, (1, 6, 1, 21)), 2, axis=2)
    parts = [component_on(x, y, z, np.float32(v)) for v in (u, 0 * u, 0 * u)]
    ground, bounds = np.zeros((1, 1), np.float32), np.array([0.0, 400.0, -4e3, 4e3, -1.0, 100.0])
    ends = np.array([0.0, 400.0])
    flat = Field(frozen(np.zeros(1)), *parts, frozen(bounds), frozen(ends), frozen(1e5 * ends), frozen(ground))  # fmt: skip
    t = np.linspace(0.0, 30.0, 301)
    r = np.stack([100.0 + 5.0 * t, 0.0 * t, 0.0 * t + 50.0], axis=1)
    found = along(flat, t, r)
    over = sample.velocity(flat, r + np.array([40.0, 0.0, 0.0]), t) - sample.velocity(flat, r, t)
    assert found.eddy_m == 16000.0
    assert found.unresolved_m_s >= np.abs(over).max() > 1.0
    assert found.unresolved_m_s2 >= np.abs(over).max() / 40.0 * 40.0 ** (2 / 3) * 5.0


def test_a_field_that_begins_anew_is_met_so_and_its_jump_is_told():
    t = np.linspace(0.0, 5.0, 501)
    r = np.tile([20.0, 30.0, 10.0], (501, 1))
    held, again = along(sheared(3), t, r), along(sheared(3), t, r, repeats=True)
    assert held.rate_m_s2 == pytest.approx(2.0)
    assert again.rate_m_s2 == pytest.approx(2.0)
    assert again.jump_m_s == pytest.approx(4.0, abs=0.1)  # from 4 m/s more to none in a step
    assert (held.after_s, held.jump_m_s, again.after_s) == (3.0, 0.0, 0.0)
    for at in (1.5, 2.0, 2.5, 4.7):
        k, f = kernels.time_in(sheared(3).t, at, True)
        np.testing.assert_allclose(
            sample.velocity(sheared(3), r[:1], np.array([at]), repeats=True)[0],
            met(sheared(3), r[0], k, f),
            atol=1e-12,
        )


def test_a_flight_in_another_field_is_asked_where_it_lies(tmp_path, monkeypatch):
    from gcs_tools.cli import wind as command
    from gcs_tools.recording import reader

    told = {"wind.field.file": "two.field", "wind.field.origin_m": [1.0, 2.0, 3.0]}
    rows = {"state.r_E": np.zeros((3, 3)), "t": np.arange(3.0)}

    class Found:
        metadata = {reader.VALUES: json.dumps(told)}  # noqa: RUF012
        plant = type("Rows", (dict,), {"__len__": lambda _: 3})(rows)
        complete = True

    monkeypatch.setattr(reader, "read", lambda _: Found)
    assert command._way(tmp_path, None, tmp_path / "two.field").r[0].tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(click.BadParameter, match=r"flew in another field \(two\)"):
        command._way(tmp_path, None, tmp_path / "street.field")


@pytest.mark.computes
def test_the_stated_rate_covers_the_gradient_of_every_place():
    from gcs_tools.wind_fields.check import summary

    made = packable(street_field.street())
    stated = float(summary(made, {})["beliefs"][1].split()[1])
    random, step = np.random.default_rng(3), 1e-3
    r = random.uniform([1.0, 1.0, 1.0], [239.0, 119.0, 59.0], (4000, 3))
    t, here = np.zeros(4000), sample.velocity(made, r, np.zeros(4000))
    gradient = np.stack(
        [(sample.velocity(made, r + step * e, t) - here) / step for e in np.eye(3)], axis=2
    )
    assert 10.0 * np.linalg.norm(gradient, ord=2, axis=(1, 2)).max() <= stated


def test_cuts_go_where_a_flight_goes_and_show_its_buildings():
    path = np.stack([np.linspace(2, 38, 50), np.full(50, 10.0), np.full(50, 4.0)], axis=1)
    plan, section = cut.cuts(sheared(), None, 0.0, path)
    assert plan.title == "Plan, 4 m up" and section.title == "Section, 10 m north"
    assert np.isnan(plan.speed[(plan.b[:, None] < 19.9) & (plan.a[None, :] < 19.9)]).all()
    assert np.isnan(section.speed[0, 0]) and not np.isnan(section.speed[-1]).any()
    assert np.nanmax(plan.speed) == pytest.approx(40.0)
    plan, section = cut.cuts(sheared(), 12.0, 0.0, np.zeros((0, 3)))
    assert plan.title == "Plan, 12 m up" and section.title == "Section, 20 m east"
    assert not np.isnan(plan.speed).any()
    plan, _ = cut.cuts(sheared(), None, 0.0, np.zeros((0, 3)))
    assert plan.title == "Plan, 10 m up"  # half a cell above the roof


def test_places_outside_the_field_and_in_its_houses_are_not_known():
    t = np.linspace(0.0, 2.0, 201)
    r = np.stack([0 * t + 10.0, 10.0 + 8.0 * t, 0 * t + 4.0], axis=1)
    through = along(sheared(), t, r)
    assert through.outside == pytest.approx(5 / 8, abs=0.01)
    assert through.lines()[0].startswith("62% of it is outside the field or in a building")
    assert along(sheared(), t, r + np.array([0.0, 0.0, 5.0])).outside == 0.0
    assert along(sheared(), t, r + np.array([0.0, 0.0, 50.0])).outside == 1.0


@pytest.mark.computes
def test_the_street_is_free_of_divergence_and_nothing_flows_through_walls():
    made = packable(street_field.street())
    assert divergence(made) < 1e-6
    for west, east, south, north, roof in street_field.BUILDINGS:
        inside = made.u.x, (made.u.x >= west) & (made.u.x <= east)
        assert inside[1].any()
        of = made.u.v[0][
            np.ix_((made.u.z < roof), (made.u.y > south) & (made.u.y < north), inside[1])
        ]
        assert (of == 0.0).all()
        of = made.w.v[0][
            np.ix_(
                (made.w.z <= roof),
                (made.w.y > south) & (made.w.y < north),
                (made.w.x > west) & (made.w.x < east),
            )
        ]
        assert (of == 0.0).all()  # fmt: skip


@pytest.mark.computes
def test_the_shipped_street_is_what_its_study_makes():
    from gcs_tools.missions.mission import folder

    shipped, made = opened(folder() / "street.field").field, packable(street_field.street())
    for name in "uvw":
        np.testing.assert_allclose(getattr(shipped, name).v, getattr(made, name).v, atol=1e-4)
    assert (shipped.top == made.top).all()


@pytest.mark.computes
def test_what_cannot_be_drawn_or_looked_along_is_refused_and_leaves_no_file(tmp_path):
    save(tmp_path / "f", sheared(), {})
    (tmp_path / "no.mcap").write_bytes(b"no recording")
    run = CliRunner().invoke
    for arguments, why in (
        (["show", f"{tmp_path}/f", "--height", "30"], "30 m is outside the field: -1 to 20 m"),
        (["show", f"{tmp_path}/f", "--figure", f"{tmp_path}/f.txt"], "ends in none of .png, .svg, .pdf"),
        (["check", f"{tmp_path}/f", "--along", f"{tmp_path}/no.mcap"], "no.mcap"),
        (["check", f"{tmp_path}/f", "--along", f"{tmp_path}/f"], "there is no flight.mcap in this folder"),
        (["show", f"{tmp_path}/nowhere"], "does not exist"),
        (["show", f"{tmp_path}/f", "--at", "nan"], "the field lasts from 0 to 0 s"),
        (["check", f"{tmp_path}/f", "--origin", "1", "2", "3"], "name it (--along RUN)"),
        (["check", f"{tmp_path}/f", "--origin", "nan", "2", "3", "--along", f"{tmp_path}/no.mcap"], "three numbers of metres"),
    ):  # fmt: skip
        done = run(wind, arguments, standalone_mode=True)
        assert done.exit_code == 2, arguments
        assert why in done.output + str(done.exception), arguments
    assert sorted(p.name for p in tmp_path.iterdir()) == ["f", "no.mcap"]
    done = run(wind, ["show", f"{tmp_path}/f", "--figure", f"{tmp_path}/f.png"])
    assert done.exit_code == 0 and (tmp_path / "f.png").read_bytes()[:4] == b"\x89PNG"
    assert (
        json.loads(run(wind, ["check", f"{tmp_path}/f", "--json"]).output)["buildings"]
        == "up to 8 m"
    )
