"""The attack on the guard: drawn again the same, within the beliefs, and able to find what is wrong."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from rich.table import Table

from fcu.guard import margin, noise, stability
from fcu.interface.airframe import believed
from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import column
from fcu.process.tick import Tick
from gcs_tools.flight import law_alone
from gcs_tools.gusts import worst_wind
from gcs_tools.gusts.ends import ends
from gcs_tools.judging.preflight_check import refusal
from gcs_tools.studies.attack import computed, draws, eddies, report
from gcs_tools.studies.attack.__main__ import campaign, flown, main, show
from gcs_tools.studies.attack.draws import (
    FIRST_S,
    SETPOINTS,
    WIND_M_S,
    WIND_M_S2,
    How,
    NoFlightError,
    Numbers,
    attack,
    parsed,
    sampled_attack,
)
from gcs_tools.studies.attack.search import search
from gcs_tools.studies.attack.verdict import LOST_M, chance, held, limits, verdict
from gcs_tools.studies.attack.wind import KINDS, pushes
from gcs_tools.wind_fields.check import divergence
from gcs_tools.wind_fields.grid import pack
from sitl_plant.physics.types import PlantRecord

UNGUARDED = How(policy="warn")
UNSTABLE = "law.c_angle=200"


def run(*arguments):
    return CliRunner().invoke(main, [*map(str, arguments)])


def numbers(**of):
    """In the middle of everything, but for these."""
    return Numbers(**{**dict.fromkeys(Numbers._fields, 0.5), **of})


def of_kind(wind="own", setpoints="step", **of):
    """Numbers of a kind of wind and a class of setpoints."""
    w, s = (
        (KINDS.index(wind) + 0.5) / len(KINDS),
        (SETPOINTS.index(setpoints) + 0.5) / len(SETPOINTS),
    )
    return numbers(wind=w, setpoints=s, **of)


def shortened(found, seconds):
    """The first seconds of a flight."""
    ticks = round(seconds * found.scene.rate_hz)
    keep = found.scene.sent_at < ticks
    scene = replace(
        found.scene,
        ticks=ticks,
        sent_at=found.scene.sent_at[keep],
        sent=tuple(s for s, k in zip(found.scene.sent, keep, strict=True) if k),
    )
    return replace(found, scene=scene, noise=found.noise[:ticks])


@pytest.mark.computes
def test_a_flight_of_a_seed_is_the_same_whoever_flies_it():
    how = How(noise="bounded")
    once, again = (flown(shortened(sampled_attack(3, 5, how), 4.0)) for _ in range(2))
    assert once.fcu.tobytes() == again.fcu.tobytes()
    assert once.plant.tobytes() == again.plant.tobytes()
    assert (
        sampled_attack(3, 6, how).numbers
        != sampled_attack(3, 5, how).numbers
        != sampled_attack(4, 5, how).numbers
    )
    assert campaign(How(), 3, 2) == campaign(How(), 3, 2)


def test_policies_fly_the_same_draws():
    govern, refuse = (sampled_attack(1, 2, How(policy=policy)) for policy in ("govern", "refuse"))
    assert govern.numbers == refuse.numbers
    assert govern.scene.sent == refuse.scene.sent
    assert govern.scene.world == refuse.scene.world
    assert (govern.scene.guard.policy, refuse.scene.guard.policy) == (1.0, 2.0)


@pytest.mark.parametrize("noise", ["none", "gaussian"])
@pytest.mark.parametrize("setpoints", SETPOINTS)
@pytest.mark.computes
def test_in_a_wind_of_its_own_every_tick_is_that_of_the_law_alone(setpoints, noise):
    """To the bit: nothing is refused, and the wind is left alone."""
    found = shortened(attack(of_kind("own", setpoints), How(noise=noise)), 5.0)
    rows = flown(found)
    plant, fcu = law_alone.fly(found.scene)
    assert rows.admitted.all()
    assert len(rows.fcu) == found.scene.ticks
    assert rows.fcu.tobytes() == fcu.tobytes()
    assert rows.plant.tobytes() == plant.tobytes()


@pytest.mark.parametrize("wind", KINDS)
def test_the_wind_keeps_to_its_speed_and_rate(wind):
    found = shortened(attack(of_kind(wind, "random", wind_speed=1.0, wind_every=0.0), How()), 10.0)
    rows = flown(found)
    air = column(PlantRecord, rows.plant, "v_air_E")
    speed = np.linalg.norm(air, axis=1)
    assert 0.5 * WIND_M_S < speed.max() <= WIND_M_S * (1.0 + 1e-9)
    rate = np.linalg.norm(np.diff(air, axis=0), axis=1) * found.scene.rate_hz
    assert rate.max() <= WIND_M_S2 * (1.0 + 1e-9)
    if wind != "own":
        assert rate.max() == pytest.approx(WIND_M_S2)


@pytest.mark.parametrize(("way", "towards"), [(1.0, (0.0, 0.0, -12.0)), (0.0, (0.0, 0.0, 12.0))])
def test_a_flipping_wind_is_met_head_on(way, towards):
    straight = of_kind("flipping", height=way, wind_speed=1.0)
    rows = flown(shortened(attack(straight, How()), 4.0))
    assert column(PlantRecord, rows.plant, "v_air_E")[-1] == pytest.approx(towards, abs=1e-6)


@pytest.mark.parametrize(
    ("demand", "towards"),
    [
        ((0.0, 0.0, 190.0), (0.0, 0.0, -1.0)),  # more thrust than there is: against it
        ((0.0, 0.0, 25.0), (0.0, 0.0, 1.0)),  # down to the floor: carried
        ((50.0, 0.0, 60.0), (-0.7071, 0.0, 0.7071)),  # out of the cone
    ],
)
def test_a_pushing_wind_drives_the_demand_to_its_nearest_limit(demand, towards):
    settings = sampled_attack(1, 0, How(as_shipped=True)).scene.settings
    known = margin.known(settings.guard, settings.law)
    demand, way = Vec3(*demand), pushes(known, Vec3(*demand))
    assert way == pytest.approx(towards, abs=1e-4)
    assert margin.distance(known, demand - 0.1 * way) == pytest.approx(
        margin.distance(known, demand) - 0.1, abs=1e-3
    )


def test_a_reference_that_swings_about_its_setpoint_is_not_late():
    """With 2.4 m/s^3 of jerk and f_m 2.6 it passes its setpoint by 1 m, and stood still 13.5 s later."""
    found = sampled_attack(1, 8816, How())
    assert 0.5 < verdict(found, flown(found)).took < 1.0


@pytest.mark.computes
def test_draws_lie_within_the_beliefs():
    vehicle, drag = believed()[1]["vehicle"], believed()[1]["air"]["drag"]
    shipped = sampled_attack(1, 0, How(as_shipped=True)).scene
    for k in range(60):
        found = sampled_attack(1, k, How())
        scene = found.scene
        plant, guard, initial = scene.world.params, scene.guard, scene.law.initial
        # the gains', and what is drawn
        told = {
            "policy": 0.0,
            "lift": 0.0,
            "lift_turns": 0.0,
            "lean_turns": 0.0,
            "swinging": 0.0,
            "T_turns": 0.0,
            "top": 0.0,
            "brake": 0.0,
            "down": 0.0,
            "w_max": 0.0,
        }
        assert guard._replace(**told) == shipped.guard._replace(**told)
        assert guard.m_min <= min(plant.m, initial.m_hat_0)
        assert guard.m_max >= max(plant.m, initial.m_hat_0)
        assert guard.w_max <= WIND_M_S
        assert guard.w_dot_max == WIND_M_S2
        assert found.gust.speed <= guard.w_max
        for J, (low, high) in zip(plant.J, vehicle["inertia_kg_m2"], strict=True):
            assert low <= J <= high
        assert all(0.0 <= c <= most for c, most in zip(plant.c_D, drag, strict=True))
        assert 0.4 <= scene.law.f_m <= 3.0
        assert stability.unstable(scene.law, scene.guard) == ""
        assert margin.sinking(margin.known(guard, scene.law)) >= 0.0
        assert np.all(np.diff(scene.sent_at) > 0)
        assert scene.sent_at[-1] < scene.ticks
        assert all(abs(x) < 0.5 * LOST_M for s in scene.sent for x in s.r_c) or len(scene.sent) == 2
    law = sampled_attack(1, 7, How(as_shipped=True)).scene.law
    assert law == shipped.law


def test_bounded_noise_is_within_one_sigma_and_fills_it():
    found = sampled_attack(1, 3, How(noise="bounded"))
    scale = found.scene.world.noise_scale
    assert scale == pytest.approx(np.repeat([0.01, 0.02, np.radians(0.2), 0.01], 3))
    part = np.abs(found.noise / scale)
    assert 0.99 < part.max() <= 1.0


def test_what_is_refused_is_not_flown():
    far = attack(of_kind("own", "step", far=1.0), How(policy="refuse"))
    rows = flown(shortened(far, 4.0))
    assert rows.admitted.tolist() == [1.0, 0.0]
    assert np.abs(column(Tick, rows.fcu, "setpoint.r_c")).max() == 0.0
    near = attack(of_kind("own", "step", far=0.0), How(policy="refuse"))
    assert flown(shortened(near, 4.0)).admitted.tolist() == [1.0, 1.0]


def test_room_is_where_the_allocation_begins_to_give_up():
    """Below a quarter of full thrust. Above it, both limits of a rotor may be met with room before either."""
    flags = rooms = 0
    for k in range(6):
        found = sampled_attack(1, k, UNGUARDED)
        rows = flown(shortened(found, 8.0)).fcu
        met = limits(found.scene, rows)
        thrust = column(Tick, rows, "outputs.T_c") + column(Tick, rows, "state.memory.T_trim")
        inside = (thrust > 8.0 * found.scene.law.rotors.f_min) & (thrust < 200.0)
        short, little = met.room < -1e-7, inside & (thrust < 50.0)
        assert np.array_equal(met.torque[little], short[little])
        assert met.torque[inside & short].all()
        flags, rooms = flags + met.torque.sum(), rooms + (met.room > 0.0).sum()
    assert flags > 10
    assert rooms > 1000


@pytest.mark.computes
def test_an_unguarded_law_is_contradicted():
    """The counter counts."""
    found = campaign(UNGUARDED, 20, 1)
    assert report.contradicts(found)
    assert report.counted(found)["saturated"][0] > 0
    assert report.groups(found)["all"].torque == sum(v.torque for v in found.values()) > 0
    first = next(iter(report.worst(found).values()))
    assert first.contradicts


@pytest.mark.parametrize("kind", ["bounded", "gaussian"])
def test_noise_that_is_drawn_is_believed_unless_it_is_to_be_unknown(kind):
    how = How(noise=kind, part=0.25)
    known, unknown = sampled_attack(1, 0, how), sampled_attack(1, 0, how._replace(unknown=True))
    scene = known.scene
    np.testing.assert_allclose(np.repeat(noise.amounts(scene.guard), 3), scene.world.noise_scale)
    assert scene.guard.gaussian == (kind == "gaussian")
    assert not noise.amounts(unknown.scene.guard).any()
    assert np.array_equal(known.noise[:100], unknown.noise[:100])
    if kind == "bounded":
        assert np.all(np.abs(known.noise) <= scene.world.noise_scale)


def test_noise_that_saturates_a_guard_that_does_not_know_of_it_does_not_where_it_does():
    """The same flight, with the noise of noisy_state, with and without the belief."""
    saturated = {}
    for unknown in (True, False):
        found = sampled_attack(1, 74, How(noise="bounded", unknown=unknown))
        saturated[unknown] = verdict(found, flown(found)).saturated
    assert saturated == {True: True, False: False}


def test_a_chance_is_told_where_there_is_room_for_the_noise():
    def of(part, kind):
        scene = sampled_attack(1, 6, How(noise=kind, part=part)).scene
        return held(scene), chance(scene)

    assert of(1.0, "gaussian") == (False, 1.0)
    assert of(0.05, "bounded") == (True, 0.0)
    there, told = of(0.05, "gaussian")
    assert there
    assert 1e-5 < told < 1e-2


def test_a_flight_that_is_lost_counts_whatever_its_limits():
    found = shortened(sampled_attack(1, 0, How()), 4.0)
    rows = flown(found)
    said = verdict(found, rows._replace(fcu=rows.fcu[:-1], plant=rows.plant[:-1]))
    assert said.lost
    assert said.contradicts
    assert not said.arrived


@pytest.mark.parametrize(("count", "limit"), [(0, 0.0036821), (1, 0.0055589), (1000, 1.0)])
def test_upper_limits_are_those_of_clopper_and_pearson(count, limit):
    assert report.upper(count, 1000) == pytest.approx(limit, rel=1e-3)


def test_gains_that_are_never_stable_fly_nothing(monkeypatch):
    monkeypatch.setattr(draws, "TRIES", 20)
    with pytest.raises(NoFlightError):
        sampled_attack(1, 0, How(settings=parsed([UNSTABLE])))


@pytest.mark.computes
def test_a_search_finds_what_is_worse_than_what_it_begins_with_and_it_flies_again(tmp_path):
    found = search(UNGUARDED, 128, 1)
    worst = found.found[0]
    assert found.flights <= 128
    again = attack(worst.numbers, UNGUARDED)
    assert verdict(again, flown(again)) == worst.verdict
    assert [f.verdict.least_n for f in found.found] == sorted(
        f.verdict.least_n for f in found.found
    )
    file = tmp_path / "found.json"
    done = run("--policy", "govern", "--search", 128, "--out", file, "--json")
    assert done.exit_code in (0, 1), done.output
    of = json.loads(file.read_text())["govern"]["found"][0]
    again = run("--policy", "govern", "--flight", file, "--json")
    assert json.loads(again.stdout)["govern"]["verdict"] == of["verdict"]


@pytest.mark.computes
def test_the_command_answers_by_its_exit_code(tmp_path):
    done = run("--flights", 4, "--json")
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert [said[policy]["groups"]["all"]["flights"] for policy in ("govern", "refuse")] == [4, 4]
    plain = run("--flights", 4, "--policy", "govern")
    assert plain.exit_code == 0
    assert "refuse" not in plain.stdout
    bad = run("--flights", 10, "--policy", "warn")
    assert bad.exit_code == 1, bad.output
    table = tmp_path / "ticks.csv"
    one = run("--flight", 2, "--policy", "govern", "--out", table)
    assert one.exit_code == 0, one.output
    names = table.read_text().splitlines()[0].split(",")
    ticks = np.loadtxt(table, delimiter=",", skiprows=1)
    assert ticks.shape == (sampled_attack(1, 2, How()).scene.ticks, len(names))
    assert {"t", "margin", "room", "air_z", "m_hat"} <= set(names)


@pytest.mark.parametrize(
    "arguments",
    [
        ("--policy", "never"),
        ("--flight", "1", "--search", "500"),
        ("--computed", "--search", "500"),
        ("--out", "x.csv"),
        ("--out", "nowhere/x.csv", "--flight", 17),
        ("--flight", "nowhere.json"),
        ("--set", "law.f_n=2"),
        ("--set", UNSTABLE),
        ("--flights", "0"),
    ],
)
def test_a_bad_command_line_is_one(arguments, monkeypatch):
    monkeypatch.setattr(draws, "TRIES", 20)
    assert run(*arguments).exit_code == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--part", "0.5"), "--part"),
        (("--unknown",), "--unknown"),
        (("--computed", "--seed", "3"), "--seed"),
        (("--manoeuvre", "hover"), "--manoeuvre"),
        (("--flight", "3", "--flights", "4"), "--flights"),
        (("--search", "128", "--flights", "4"), "--flights"),
        (("--flight", "found.json:1", "--seed", "3"), "--seed"),
        (("--flight", "found.json:1", "--as-shipped"), "--as-shipped"),
        (("--set", "flight.duration_s=3"), "flight.duration_s"),
        (("--set", "flight.yaw.amplitude_rad=3"), "flight.yaw.amplitude_rad"),
        (("--set", "law.guard=warn"), "--policy"),
        (("--set", "expect.ended=time"), "expect.ended"),
    ],
)
def test_an_option_that_would_change_nothing_is_refused(arguments, said):
    done = run(*arguments)
    assert (done.exit_code, done.stdout) == (2, "")
    assert said in done.stderr


def test_a_table_that_is_piped_is_whole(capsys):
    heads = [f"column {k} of a table" for k in range(20)]
    wide = Table(*heads)
    wide.add_row(*heads)
    show(wide)
    out = capsys.readouterr().out
    assert "…" not in out
    assert all(sum(head in line for line in out.splitlines()) == 2 for head in heads)


@pytest.mark.computes
def test_the_spine_flies_what_it_computes(monkeypatch):
    """A round of a search, for one vehicle: the attack's own flight in the wind leaves the same room."""
    monkeypatch.setattr(worst_wind, "FIRST_ROUNDS", 1)
    monkeypatch.setattr(worst_wind, "ROUNDS", 1)
    monkeypatch.setattr(worst_wind, "ends", lambda scene: ends(scene)[1:2])
    monkeypatch.setattr(worst_wind, "FACETS", dict.fromkeys(worst_wind.FACETS, 1))
    (torque,) = found = computed.spine(How(), ["descent"], limits=["torque"])
    assert torque.verdict.room_n == pytest.approx(torque.worst.computed_n, abs=1e-3)
    assert torque.verdict.torque == torque.worst.saturated
    assert torque.verdict.wind == "computed"
    assert computed.contradicts(found) == any(e.verdict.saturated for e in found)


@pytest.mark.parametrize("name", computed.MANOEUVRES)
@pytest.mark.computes
def test_a_manoeuvre_that_refuses_is_made_smaller_until_nothing_is_refused(name):
    scale, _, scene = computed.admitted(name, How(policy="refuse"))
    assert refusal(scene) == ""
    larger = computed.made(name, How(policy="refuse"), min(1.0, 2.0 * scale))[1]
    assert scale == 1.0 or refusal(larger) != ""
    times = scene.sent_at / scene.rate_hz
    assert (times[0], times[1]) == (0.0, FIRST_S)


@pytest.fixture
def coarse(monkeypatch):
    """Make fields of eddies of 20 cells of 50 m along each axis."""
    monkeypatch.setattr(eddies, "CELL_M", 50.0)
    monkeypatch.setattr(eddies, "CELLS", (20, 20, 20))


def test_a_field_of_eddies_is_free_of_divergence_and_of_up_to_one_metre_a_second(tmp_path, coarse):
    field = pack(eddies.eddies(), tmp_path / "e.field")
    assert divergence(field) < 1e-6
    speeds = [np.abs(part.v).max() for part in (field.u, field.v, field.w)]
    assert 0.5 < max(speeds) <= 1.2


def test_in_a_field_a_flight_has_no_other_wind_and_a_place_inside(tmp_path, coarse):
    pack(eddies.eddies(), tmp_path / "e.field")
    for u in (0.0, 0.5, 1.0):
        n = numbers(wind_share=u, wind_azimuth=u, wind_height=u, wind_speed=u, believed_wind=1.0)
        found = attack(n, How(field=str(tmp_path / "e.field")))
        layer = found.scene.layers.field
        assert layer.scale == pytest.approx(max(WIND_M_S * u, 1e-3))
        assert all(400.0 <= at <= 600.0 for at in layer.origin_m[:2])
        assert 449.0 <= layer.origin_m[2] <= 600.0
        assert found.gust.kind == 0.0 and found.wind == "field"
        assert tuple(found.scene.world.params.wind.steady) == (0.0, 0.0, 0.0)
