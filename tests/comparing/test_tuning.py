"""Tuning: a detuned law gets better, the same way every time; what is free, and how far."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from gcs_tools.campaigns import gains_file, procedure, tuning
from gcs_tools.campaigns.entrant import EntrantError, entrant, free
from gcs_tools.campaigns.score import NAMES, REFUSED, Score, cost, lost
from gcs_tools.campaigns.seed_draws import Stream
from gcs_tools.missions.mission import load

HOW = procedure.read()


def test_each_different_number_of_a_row_is_a_factor():
    found = tuning.factors(entrant("mmrac"))
    assert [(each.row.key, each.at) for each in found] == [
        ("f_m", (0,)), ("zeta_m", (0,)), ("gamma", (0,)),
        ("c_angle", (0, 1)), ("c_angle", (2,)), ("c_rate", (0, 1)), ("c_rate", (2,)),
    ]  # fmt: skip
    same = tuning.gains(found, [1.0] * 7)
    assert same["c_angle"] == [each.default for each in (found[3], found[3], found[4])]
    twice = tuning.gains(found, [1.0, 1.0, 2.0, 2.0, 0.5, 1.0, 1.0])
    assert twice["gamma"] == 2.0 * same["gamma"]
    assert twice["c_angle"] == [2.0 * same["c_angle"][0]] * 2 + [0.5 * same["c_angle"][2]]
    assert twice["c_rate"] == same["c_rate"]


def test_a_factor_ends_at_the_range_of_its_row(cascade):
    found = tuning.factors(entrant(cascade))
    at = [each.row.key for each in found].index("k_rate")
    multiples = [1.0] * len(found)
    multiples[at] = 100.0
    assert tuning.gains(found, multiples)["k_rate"] == found[at].row.high


def test_a_gain_of_nought_stays(cascade):
    keys = [each.row.key for each in tuning.factors(entrant(cascade, settings=("law.d_v=0.0",)))]
    assert "d_v" not in keys
    assert len(free(entrant(cascade).law)) == 5


def test_a_law_without_free_gains_is_refused(tmp_path, cascade):
    text = Path(cascade).read_text().replace(", gain=True", "")
    (tmp_path / "fixed.py").write_text(text)
    with pytest.raises(EntrantError, match="gain=True"):
        tuning.factors(entrant(str(tmp_path / "fixed.py")))


def test_the_search_finds_the_bottom_of_a_bowl_within_its_budget():
    how = HOW.search.model_copy(update={"evaluations_per_gain": 40})
    target, asked, told = np.array([0.7, -0.4, 0.2]), [], []

    def bowl(point):
        asked.append(point.copy())
        return float(((point - target) ** 2).sum())

    best, done = tuning.search(bowl, 3, how, 1, told.append)
    assert done == len(asked) == len(told) == 120
    assert (asked[0] == 0.0).all()
    assert np.abs(best - target).max() < 0.02
    assert told[-1].best == min(each.cost for each in told)
    assert all(np.abs(point).max() <= math.log(4.0) + 1e-12 for point in asked)


def test_where_the_defaults_lose_every_flight_the_search_begins_at_the_first_that_does_not():
    target, asked, told = np.array([0.9, -0.9]), [], []

    def hole(point):  # lost but for a corner, which no step from the defaults reaches
        asked.append(point.copy())
        away = float(((point - target) ** 2).sum())
        return away if away < 0.2 else 8.0

    best, done = tuning.search(hole, 2, HOW.search, 1, told.append, lost=8.0)
    assert done == len(asked) == 50
    assert (asked[0] == 0.0).all()
    assert np.abs(best - target).max() < 0.1
    assert all(np.abs(point).max() <= math.log(4.0) + 1e-12 for point in asked)
    assert tuning.search(lambda _: 8.0, 2, HOW.search, 1, told.append, lost=8.0)[1] <= 50


def test_a_setting_of_a_law_is_flown_told_and_written(tmp_path, followed):
    made = entrant("l1:unmatched=tilted")
    assert (made.label, gains_file.name(made)) == (
        "l1:unmatched=tilted",
        "l1-unmatched-tilted-s1000",
    )
    assert made.mission(load("benchmark/steps")).given["law"]["unmatched"] == "tilted"
    tried = tuning.Tried({"A_v": 6.0}, 1.0, 0)
    text = gains_file.text(made, tuning.Tuned((), tried, (), 1, 1), followed)
    (tmp_path / "l1.toml").write_text(text)
    read = gains_file.read(tmp_path / "l1.toml")
    assert read.law == made.name
    assert dict(read.values) == {"unmatched": "tilted", "A_v": 6.0}
    assert entrant("mmrac").chosen(load("benchmark/steps")) == {}
    with pytest.raises(EntrantError, match="unmatched"):
        entrant("l1:unmatched=sideways").mission(load("benchmark/steps"))


def test_the_objective_is_as_the_procedure_says():
    of = HOW.objective
    told = {"error_m": 0.06, "error_all_m": 0.3, "noise": 0.01}
    flown = Score("", **told, **dict.fromkeys(set(NAMES) - set(told), 1.0))
    wanted = math.log(4.0) + 0.25 * math.log(16.0) + 0.25 * math.log(2.0)
    assert cost(flown, of) == pytest.approx(wanted)
    assert cost(lost("crashed"), of) == of.lost
    mean = tuning.mean_cost([flown, lost("far")], of)
    assert mean == pytest.approx(0.5 * (cost(flown, of) + of.lost))


@pytest.mark.slow
def test_a_detuned_law_gets_better_the_same_way_every_time(cascade, followed):
    detuned = entrant(cascade, settings=("law.k_r=0.3", "law.k_v=1.0"))
    found, again = (tuning.tune(detuned, followed) for _ in range(2))
    assert found.best.cost < 0.8 * found.defaults.cost
    assert found.best.gains["k_r"] > 0.3
    assert found.evaluations == 2 * 5 * 6
    assert not found.best.lost
    text = gains_file.text(detuned, found, followed)
    assert text == gains_file.text(detuned, again, followed)


@pytest.mark.slow
def test_what_was_tuned_flies_as_it_was_validated(cascade, followed, tmp_path):
    made = entrant(cascade)
    found = tuning.tune(made, followed)
    path = tmp_path / "cascade.toml"
    path.write_text(gains_file.text(made, found, followed))
    read = gains_file.read(path)
    assert (read.law, read.airframe, read.digest) == (cascade, "s1000", made.law.digest)
    validation = tuning.Flights(made, followed.validation, Stream.VALIDATION, followed, times=1)
    (scores,) = validation.scores([read.values])
    assert tuning.mean_cost(scores, followed.objective) == read.provenance["cost"]
    assert read.provenance["procedure_sha256"] == followed.sha256


@pytest.mark.slow
def test_gains_that_no_vehicle_would_arm_with_cost_a_loss(followed):
    flights = tuning.Flights(
        entrant("mmrac"), followed.training, Stream.TRAINING, followed, times=1
    )
    (scores,) = flights.scores([{"c_angle": 150.0, "c_rate": 5.0}])
    assert {score.lost for score in scores} == {REFUSED}


def test_the_missions_of_the_procedure_are_shipped():
    names = (*HOW.training.missions, *HOW.validation.missions, HOW.margins.mission)
    assert len({load(name).name for name in names}) == 10
