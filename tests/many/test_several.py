"""Flights of laws alone, several at a time: each row is that of the same flight by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fcu.kernel.rows import column_of
from fcu.laws.loader import LawError
from fcu.tick import Tick
from gcs_tools.flight import law_alone, several
from gcs_tools.flight.run import prepared
from gcs_tools.studies import lanes_check
from sitl_plant.physics.dynamics import CRASHED, DIVERGED, FLYING
from sitl_plant.physics.types import PlantRecord

DRAWN, SEED = 96, 3


@pytest.fixture(scope="module")
def scene():
    return prepared("paper_nominal", ["flight.duration_s=0.4"])[1]


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


def test_drawn_flights_have_the_bits_of_each_by_itself():
    found = lanes_check.check(DRAWN, SEED, duration_s=1.5)
    assert found.different == ()
    assert found.in_lanes > 0.8 * DRAWN
    assert found.crashed > 0
    assert found.diverged > 0


@pytest.mark.slow
def test_in_four_lanes_too():
    scenes = [lanes_check.drawn(i, SEED, 1.5) for i in range(3 * DRAWN)]
    alike = [s for s in scenes if s.settings == scenes[0].settings]  # one law is compiled for it
    flown = several.fly(alike, width=4)
    assert sum(one.in_lanes for one in flown) > 0.8 * len(alike) > 12
    assert {one.ended for one in flown} == {FLYING, CRASHED, DIVERGED}
    for one, scene in zip(flown, alike, strict=True):
        same(one, scene)


def test_fewer_flights_than_lanes(scene):
    scenes = varied(scene, 5)
    for one, each in zip(several.fly(scenes), scenes, strict=True):
        assert one.in_lanes
        same(one, each)


def test_settings_that_differ_share_lanes(scene):
    scenes = [
        prepared("paper_nominal", ["flight.duration_s=0.4", f"law.f_m={f_m}"])[1]
        for f_m in (0.6, 0.8, 1.0)
    ]
    for one, each in zip(several.fly(scenes), scenes, strict=True):
        assert one.in_lanes
        same(one, each)


def test_settings_that_differ_in_the_sign_of_nought_are_not_alike(scene):
    law = scene.law
    scenes = [
        replace(scene, settings=scene.settings._replace(law=law._replace(trim_max=trim_max)))
        for trim_max in (0.0, -0.0)
    ]
    for one, each in zip(several.fly(scenes), scenes, strict=True):
        assert one.in_lanes
        same(one, each)


def test_branches_that_not_all_lanes_take_are_flown_one_by_one(scene):
    """What a law is told to predict with is asked in an `if`."""
    scenes = [
        prepared("paper_nominal", ["flight.duration_s=0.2", *settings])[1]
        for settings in ([], ['law.prediction="demanded"'])
    ]
    for one, each in zip(several.fly(scenes), scenes, strict=True):
        assert not one.in_lanes
        same(one, each)


def test_one_alone_flies_by_itself(scene):
    (one,) = several.fly([scene])
    assert not one.in_lanes
    same(one, scene)


def test_flights_end_in_their_own_time(scene):
    """One leaves its arena at once, one is over before its next setpoint; the others fly on."""
    first, *others = varied(scene, 4)
    params = others[0].world.params._replace(arena=1e-4)
    lost = replace(others[0], world=others[0].world._replace(params=params))
    short = replace(others[1], ticks=7)
    scenes = [first, lost, short, others[2]]
    found = several.fly(scenes)
    assert [one.ended for one in found] == [FLYING, DIVERGED, FLYING, FLYING]
    assert found[2].ticks == 7 < found[1].ticks < found[0].ticks == first.ticks
    for one, each in zip(found, scenes, strict=True):
        assert one.in_lanes
        same(one, each)


def test_one_that_falls_on_the_ground(scene):
    scenes = varied(scene, 3)
    params = scenes[1].world.params
    roof = scenes[1].world.start.r_E.z - params.ground.gear - 0.5
    params = params._replace(
        m=10.0 * params.m, ground=params.ground._replace(z=roof, impact_max=0.5)
    )
    scenes[1] = replace(scenes[1], world=scenes[1].world._replace(params=params))
    found = several.fly(scenes)
    assert [one.ended for one in found] == [FLYING, CRASHED, FLYING]
    assert len(found[1].plant) == len(found[1].law) + 1
    same(found[1], scenes[1])


def test_a_part_of_the_rows(scene):
    keep = several.Keep(plant=("state.r_E", "ended"), law=("outputs.T_c", "command"), every=7)
    scenes = varied(scene, 3)
    for one, each in zip(several.fly(scenes, keep), scenes, strict=True):
        plant, law = law_alone.fly(each)
        at = [*range(1, 4), column_of(PlantRecord, "ended")]
        assert np.array_equal(one.plant, plant[::7, at])
        assert one.law.shape == (-(-len(law) // 7), 9)
        assert np.array_equal(one.law[:, 0], law[::7, column_of(Tick, "outputs.T_c")])
        alone = several.by_itself(each, keep)
        assert one.plant.tobytes() == alone.plant.tobytes()
        assert one.law.tobytes() == alone.law.tobytes()


def test_no_rows_at_all(scene):
    one, _ = several.fly(varied(scene, 2), several.Keep(plant=(), law=()))
    assert one.plant.shape[1] == one.law.shape[1] == 0
    assert one.ticks == scene.ticks


def test_a_field_that_there_is_not_is_named(scene):
    with pytest.raises(AttributeError, match="no_such"):
        several.fly(varied(scene, 2), several.Keep(plant=("state.no_such",)))


def test_a_state_that_no_controller_would_read_is_told(scene):
    scenes = varied(scene, 2)
    start = scenes[1].world.start._replace(q_EB=scenes[1].world.start.q_EB.scaled(1.2))
    scenes[1] = replace(scenes[1], world=scenes[1].world._replace(start=start))
    found = dict(several.each(scenes))
    same(found[0], scenes[0])
    assert isinstance(found[1], LawError)
    with pytest.raises(LawError, match="unit quaternion"):
        several.fly(scenes)


def test_the_groups_have_alike_settings_where_these_fill_lanes(scene):
    other = prepared("paper_nominal", ["flight.duration_s=0.4", "law.f_m=0.7"])[1]
    scenes = [scene, other] * 5 + [replace(scene, period_us=scene.period_us + 1)]
    groups = list(several.groups(scenes, width=4))
    assert sorted(i for group in groups for i in group) == list(range(11))
    assert groups[:2] == [[0, 2, 4, 6], [1, 3, 5, 7]]
    assert sorted(map(sorted, groups[2:])) == [[8, 9], [10]]


def test_a_law_that_cannot_be_compiled_for_lanes_flies_by_itself():
    """It calls a function of the C library that lanes do not have."""
    law = "tests/own_law/plain_cascade.py"
    scenes = [prepared("gust_step", ["flight.duration_s=0.2"], law=law, seed=i)[1] for i in (1, 2)]
    for one, each in zip(several.fly(scenes), scenes, strict=True):
        assert not one.in_lanes
        same(one, each)
