"""Flights of laws alone, several at a time: each row is that of the same flight by itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fcu.kernel import cache, compile
from fcu.kernel.lanes import WIDTH
from fcu.kernel.rows import column_of
from fcu.laws.loader import LawError
from fcu.process.tick import Tick
from gcs_tools.flight import law_alone, law_flights
from gcs_tools.flight.run import prepared
from gcs_tools.studies import lanes_check
from sitl_plant.physics.dynamics import CRASHED, DIVERGED, FLYING
from sitl_plant.physics.types import PlantRecord

DRAWN, SEED = 96, 3


@pytest.fixture(scope="module")
def scene():
    return prepared("paper_nominal", ["flight.duration_s=0.4"])[1]


def fly(scenes, *keep):
    """In lanes, compiled or not."""
    return law_flights.fly(scenes, *keep, in_all=law_flights.ALWAYS)


def varied(scene, n):
    """The same with another mass each."""

    def heavier(i):
        params = scene.world.params
        return replace(
            scene, world=scene.world._replace(params=params._replace(m=params.m + 0.1 * i))
        )

    return [heavier(i) for i in range(n)]


def same(one, scene):
    plant, law = law_alone.fly(scene)
    assert one.plant.tobytes() == np.ascontiguousarray(plant).tobytes()
    assert one.law.tobytes() == np.ascontiguousarray(law).tobytes()
    assert one.ticks == len(law)


@pytest.mark.computes
def test_drawn_flights_have_the_bits_of_each_by_itself():
    found = lanes_check.check(DRAWN, SEED, duration_s=1.5)
    assert found.different == ()
    assert found.in_lanes > 0.8 * DRAWN
    assert found.crashed > 0
    assert found.diverged > 0


@pytest.mark.slow
def test_four_lanes_fly_as_one():
    scenes = [lanes_check.sampled_scenario(i, SEED, 1.5) for i in range(3 * DRAWN)]
    alike = [s for s in scenes if s.settings == scenes[0].settings]  # one law is compiled for it
    flown = law_flights.fly(alike, width=4, in_all=law_flights.ALWAYS)
    assert sum(one.in_lanes for one in flown) > 0.8 * len(alike) > 12
    assert {one.ended for one in flown} == {FLYING, CRASHED, DIVERGED}
    for one, scene in zip(flown, alike, strict=True):
        same(one, scene)


def test_fewer_flights_than_lanes(scene):
    scenes = varied(scene, WIDTH - 1)
    for one, each in zip(fly(scenes), scenes, strict=True):
        assert one.in_lanes
        same(one, each)


def test_settings_that_differ_share_lanes(scene):
    scenes = [
        prepared("paper_nominal", ["flight.duration_s=0.4", f"law.f_m={f_m}"])[1]
        for f_m in (0.6, 0.8, 1.0)
    ]
    for one, each in zip(fly(scenes), scenes, strict=True):
        assert one.in_lanes
        same(one, each)


def test_settings_that_differ_in_the_sign_of_nought_are_not_alike(scene):
    law = scene.law
    scenes = [
        replace(scene, settings=scene.settings._replace(law=law._replace(trim_max=trim_max)))
        for trim_max in (0.0, -0.0)
    ]
    for one, each in zip(fly(scenes), scenes, strict=True):
        assert one.in_lanes
        same(one, each)


def test_what_is_chosen_by_a_word_parts_groups_and_no_lanes():
    """A law may branch on it, as that of the paper does on what it is told to predict with."""
    chosen = ([], ['law.prediction="demanded"'], ["law.guard=govern"])
    scenes = [
        prepared("paper_nominal", ["flight.duration_s=0.2", f"law.f_m={f_m}", *settings])[1]
        for f_m in (0.8, 1.0)
        for settings in chosen
    ]
    groups = law_flights.groups(scenes, in_all=law_flights.ALWAYS)
    assert sorted(map(sorted, groups)) == [[0, 3], [1, 4], [2, 5]]
    for one, each in zip(fly(scenes), scenes, strict=True):
        assert one.in_lanes
        same(one, each)


def test_branches_that_not_all_lanes_take_are_flown_one_by_one(monkeypatch):
    """What a law is told to predict with is asked in an `if`; here nobody knows that it is chosen."""
    monkeypatch.setattr(law_flights, "_choices", lambda scene: ())
    scenes = [
        prepared("paper_nominal", ["flight.duration_s=0.2", *settings])[1]
        for settings in ([], ['law.prediction="demanded"'])
    ]
    for one, each in zip(fly(scenes), scenes, strict=True):
        assert not one.in_lanes
        same(one, each)


def test_a_flight_without_a_group_flies_by_itself(scene):
    (one,) = fly([scene])
    assert not one.in_lanes
    same(one, scene)


def test_flights_end_in_their_own_time(scene):
    """One leaves its arena at once, one is over before its next setpoint; the others fly on."""
    first, *others = varied(scene, 4)
    params = others[0].world.params._replace(arena=1e-4)
    lost = replace(others[0], world=others[0].world._replace(params=params))
    short = replace(others[1], ticks=7)
    scenes = [first, lost, short, others[2]]
    found = fly(scenes)
    assert [one.ended for one in found] == [FLYING, DIVERGED, FLYING, FLYING]
    assert found[2].ticks == 7 < found[1].ticks < found[0].ticks == first.ticks
    for one, each in zip(found, scenes, strict=True):
        assert one.in_lanes
        same(one, each)


def test_a_fall_to_the_ground_ends_its_lane_alone(scene):
    scenes = varied(scene, 3)
    params = scenes[1].world.params
    roof = scenes[1].world.start.r_E.z - params.ground.gear - 0.5
    params = params._replace(
        m=10.0 * params.m, ground=params.ground._replace(z=roof, impact_max=0.5)
    )
    scenes[1] = replace(scenes[1], world=scenes[1].world._replace(params=params))
    found = fly(scenes)
    assert [one.ended for one in found] == [FLYING, CRASHED, FLYING]
    assert len(found[1].plant) == len(found[1].law) + 1
    same(found[1], scenes[1])


def test_a_part_of_the_rows(scene):
    keep = law_flights.Keep(plant=("state.r_E", "ended"), law=("outputs.T_c", "command"), every=7)
    scenes = varied(scene, 3)
    for one, each in zip(fly(scenes, keep), scenes, strict=True):
        plant, law = law_alone.fly(each)
        at = [*range(1, 4), column_of(PlantRecord, "ended")]
        assert np.array_equal(one.plant, plant[::7, at])
        assert one.law.shape == (-(-len(law) // 7), 9)
        assert np.array_equal(one.law[:, 0], law[::7, column_of(Tick, "outputs.T_c")])
        alone = law_flights.by_itself(each, keep)
        assert one.plant.tobytes() == alone.plant.tobytes()
        assert one.law.tobytes() == alone.law.tobytes()


def test_what_is_kept_has_its_names(scene):
    keep = law_flights.Keep(plant=("ended",), law=("setpoint.r_c", "outputs.T_c"))
    whole = law_flights.LawFlown(*law_alone.fly(scene), scene.ticks, FLYING, False)
    every = law_flights.tables(scene, whole)
    for one in (*fly(varied(scene, 2), keep)[:1], law_flights.by_itself(scene, keep)):
        plant, law = law_flights.tables(scene, one, keep)
        assert plant.names == ("ended",)
        assert law.names == ("setpoint.r_c.x", "setpoint.r_c.y", "setpoint.r_c.z", "outputs.T_c")
        for name in law.names:
            assert np.array_equal(law[name], every[1][name])


def test_rows_have_room(scene, monkeypatch):
    scenes = varied(scene, 8)
    flown = fly(scenes)
    kept = flown[0].plant.nbytes + flown[0].law.nbytes
    for room, together in ((9 * kept, True), (1.5 * kept, False)):
        monkeypatch.setattr(law_flights, "ROOM", int(room))
        again = fly(scenes)
        assert [one.in_lanes for one in again] == [together] * 8
        assert [one.plant.tobytes() for one in again] == [one.plant.tobytes() for one in flown]


def test_no_rows_at_all(scene):
    one, _ = fly(varied(scene, 2), law_flights.Keep(plant=(), law=()))
    assert one.plant.shape[1] == one.law.shape[1] == 0
    assert one.ticks == scene.ticks


def test_a_field_that_there_is_not_is_named(scene):
    with pytest.raises(AttributeError, match="no_such"):
        fly(varied(scene, 2), law_flights.Keep(plant=("state.no_such",)))


def test_a_state_that_no_controller_would_read_is_told(scene):
    scenes = varied(scene, 2)
    start = scenes[1].world.start._replace(q_EB=scenes[1].world.start.q_EB.scaled(1.2))
    scenes[1] = replace(scenes[1], world=scenes[1].world._replace(start=start))
    found = dict(law_flights.each(scenes, in_all=law_flights.ALWAYS))
    same(found[0], scenes[0])
    assert isinstance(found[1], LawError)
    with pytest.raises(LawError, match="unit quaternion"):
        fly(scenes)


def test_the_groups_have_alike_settings_where_these_fill_lanes(scene):
    other = prepared("paper_nominal", ["flight.duration_s=0.4", "law.f_m=0.7"])[1]
    scenes = [scene, other] * 5 + [replace(scene, period_us=scene.period_us + 1)]
    groups = list(law_flights.groups(scenes, width=4, in_all=law_flights.ALWAYS))
    assert sorted(i for group in groups for i in group) == list(range(11))
    assert groups[:2] == [[0, 2, 4, 6], [1, 3, 5, 7]]
    assert sorted(map(sorted, groups[2:])) == [[8, 9], [10]]


def test_flights_of_one_length_share_lanes(scene):
    """A lane whose flight is over waits for the longest."""
    scenes = varied(scene, 16)
    scenes = [replace(one, ticks=one.ticks // (1 + i % 2)) for i, one in enumerate(scenes)]
    groups = law_flights.groups(scenes, width=8, in_all=law_flights.ALWAYS)
    assert list(groups) == [[*range(1, 16, 2)], [*range(0, 16, 2)]]


@pytest.fixture
def compiled(monkeypatch):
    """The kernels of lanes that are in the cache: none but what a test adds."""
    found = set()
    monkeypatch.setattr(law_flights, "_ready", set())
    monkeypatch.setattr(
        law_flights, "is_cached", lambda name, package="fcu", told=True: name in found
    )
    return found


def test_lanes_are_compiled_for_flights_that_repay_it(scene, compiled):
    scenes = varied(scene, 4)
    repaid = law_flights.REPAID / scene.ticks
    assert len(list(law_flights.groups(scenes))) == 4
    assert len(list(law_flights.groups(scenes, in_all=0.9 * repaid))) == 4
    assert len(list(law_flights.groups(scenes, in_all=1.1 * repaid))) == 1
    assert [one.in_lanes for one in law_flights.fly(scenes)] == [False] * 4


def test_ticks_are_counted_for_each_law_and_kind_of_settings(scene, compiled):
    """Those that fly in other lanes, or beside nobody, repay nothing."""
    others = [
        replace(scene, settings=scene.settings._replace(law=scene.law._replace(f_m=f_m)))
        for f_m in (0.6, 0.7)
    ]
    scenes = [*varied(scene, 8), *others]
    repaid = law_flights.REPAID / scene.ticks
    groups = law_flights.groups(scenes, width=8, in_all=2.0 * repaid)
    assert sorted(map(sorted, groups)) == [[0, 1, 2, 3, 4, 5, 6, 7], [8], [9]]


def test_lanes_that_are_compiled_fly_any_flights(scene, compiled):
    scenes = varied(scene, 4)
    compiled |= {"fcu.process.tick.lanes_each_at", "lane_flights.burst"}
    assert len(list(law_flights.groups(scenes))) == 4  # their settings are alike
    compiled |= {"fcu.process.tick.lanes_at"}
    assert len(list(law_flights.groups(scenes))) == 1


def test_compiling_is_told_where_lanes_are_not_waited_for(scene, tmp_path, monkeypatch):
    """Asking whether they are there is no word to the user."""
    monkeypatch.setattr(law_flights, "_ready", set())
    monkeypatch.setattr(cache, "_told", set())
    monkeypatch.setitem(compile._folders, "fcu", cache.Folder(tmp_path))
    assert len(list(law_flights.groups(varied(scene, 4)))) == 4
    assert cache._told == set()


@pytest.mark.computes
def test_a_law_that_cannot_be_compiled_for_lanes_flies_by_itself():
    """It calls a function of the C library that lanes do not have."""
    law = "tests/own_law/plain_cascade.py"
    scenes = [prepared("gust_step", ["flight.duration_s=0.2"], law=law, seed=i)[1] for i in (1, 2)]
    for one, each in zip(fly(scenes), scenes, strict=True):
        assert not one.in_lanes
        same(one, each)


@pytest.mark.computes
def test_two_versions_of_a_law_share_no_lanes(tmp_path):
    file = tmp_path / "law.py"
    scenes = []
    for version in ("", "# another version\n"):
        file.write_text(Path("tests/own_law/plain_cascade.py").read_text() + version)
        scenes += [prepared("gust_step", ["flight.duration_s=0.1"], law=str(file))[1]] * 4
    assert scenes[0].flown.source == scenes[4].flown.source
    groups = law_flights.groups(scenes, in_all=law_flights.ALWAYS)
    assert sorted(map(sorted, groups)) == [[0, 1, 2, 3], [4, 5, 6, 7]]
