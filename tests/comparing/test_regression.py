"""Flights held against a baseline: what is worse, what differs first, and who is told."""

from __future__ import annotations

import json
import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gcs_tools
from gcs_tools.campaigns.regression import RegressionError, held_against
from gcs_tools.judging.comparison import ComparedFlight
from tests.command_line import gcs

METRIC, FLOOR = "setpoint_error_rms_m", "margin_min_n"
FLIGHT = ComparedFlight(
    "a", Path("a"), "hop", True, {METRIC: 1.0, FLOOR: 10.0}, {}, "aa", 1, "time"
)


def flights(values: dict[int, float], metric: str = METRIC) -> list[ComparedFlight]:
    return [
        replace(FLIGHT, name=str(seed), seed=seed, metrics={**FLIGHT.metrics, metric: value})
        for seed, value in values.items()
    ]


@pytest.mark.parametrize(
    ("metric", "value", "is_worse"),
    [
        (METRIC, 1.0049, False), (METRIC, 1.0051, True), (METRIC, 0.5, False),
        (FLOOR, 9.951, False), (FLOOR, 9.949, True), (FLOOR, 20.0, False),
    ],
)  # fmt: skip
def test_with_the_same_seed_a_metric_is_worse_beyond_the_tolerance(metric, value, is_worse):
    (held,) = held_against(flights({1: value}, metric), [FLIGHT])
    assert (held.by, held.passed) == ("seeds", not is_worse)
    assert [each.metric for each in held.worse] == ([metric] if is_worse else [])


def test_with_other_seeds_the_baseline_gives_an_interval():
    """Of 20 flights whose spread is 0.1, one more is within 0.1 t sqrt(1 + 1/20) of their mean."""
    random = np.random.default_rng(1)
    drawn = random.normal(size=20)
    drawn = 1.0 + 0.1 * (drawn - drawn.mean()) / drawn.std(ddof=1)
    baseline = flights(dict(enumerate(drawn.tolist(), 1)))
    t = 2.860935  # Student's, 19 degrees of freedom, 1 - 0.01/2 for two metrics
    edge = 1.0 + t * 0.1 * np.sqrt(1.0 + 1.0 / 20.0)
    for value, is_worse in ((edge - 1e-4, False), (edge + 1e-4, True)):
        (held,) = held_against(flights({99: value}), baseline)
        assert (held.by, held.passed) == ("interval", not is_worse)


@pytest.mark.parametrize("pace", ["real", "speed:8", "held", "None"])
def test_a_script_by_the_wall_never_flies_the_same_twice(pace):
    """Two flights of one script differ whatever was changed, unless its time is held."""
    made = replace(FLIGHT, values={"flight.script": "python hop.py", "flight.pace": pace})
    other = replace(made, metrics={METRIC: 1.02, FLOOR: 10.0})
    if pace == "held":
        (held,) = held_against([other], [made])
        assert (held.by, held.passed) == ("seeds", False)
        return
    with pytest.raises(
        RegressionError, match=r"no two flights are the same: hold them against .* 3 fl"
    ):
        held_against([other], [made])
    baseline = [replace(made, name=name, metrics={METRIC: value, FLOOR: 10.0}) for name, value in
                (("a", 0.98), ("b", 1.0), ("c", 1.03))]  # fmt: skip
    (held,) = held_against([other], baseline)
    assert (held.by, held.passed) == ("interval", True)


def test_a_held_script_with_a_clock_of_its_own_goes_by_the_interval():
    """MAVSDK's threads keep the clock of the wall, whatever the mission's pace."""
    held = {"flight.script": "python fly.py", "flight.pace": "held"}
    made = replace(FLIGHT, values=held, by_wall=True)
    now = replace(made, metrics={METRIC: 1.02, FLOOR: 10.0})
    with pytest.raises(RegressionError, match="a baseline of 3 flights"):
        held_against([now], [made])
    values = {"a": 0.98, "b": 1.0, "c": 1.03}
    baseline = [replace(made, name=n, metrics={METRIC: v, FLOOR: 10.0}) for n, v in values.items()]
    (found,) = held_against([now], baseline)
    assert (found.by, found.passed) == ("interval", True)


@pytest.mark.parametrize("known", [1, 2, 3])
def test_a_metric_of_fewer_than_three_flights_gives_no_interval(known):
    baseline = [
        replace(each, metrics={METRIC: each.metrics[METRIC], FLOOR: 10.0 if i < known else None})
        for i, each in enumerate(flights({1: 1.0, 2: 1.1, 3: 0.9, 4: 1.0}))
    ]
    now = flights({99: 1.0})
    if known < 3:
        with pytest.raises(
            RegressionError, match=rf"{FLOOR} has a value in {known} of .* 4 flights"
        ):
            held_against(now, baseline)
        return
    (found,) = held_against(now, baseline)
    assert (found.by, found.passed) == ("interval", True)


def test_a_flight_that_fails_is_told_by_what_it_missed():
    lost = replace(FLIGHT, passed=False, missed=("tilt_max_deg <= 1: 20.2",))
    (held,) = held_against([lost], [FLIGHT])
    assert held.failed == ("a failed: tilt_max_deg <= 1: 20.2",)


@pytest.mark.parametrize(
    ("mine", "said"),
    [
        ([replace(FLIGHT, seed=2)], "fly the same seeds"),
        ([replace(FLIGHT, mission="skip")], "no mission in common"),
    ],
)
def test_what_cannot_be_held_against_it_is_refused(mine, said):
    with pytest.raises(RegressionError, match=said):
        held_against(mine, [FLIGHT])
    with pytest.raises(RegressionError, match="a second flight"):
        held_against([FLIGHT], [FLIGHT, replace(FLIGHT, name="b")])


def test_a_flight_that_fails_and_a_mission_that_is_missing_are_worse():
    other = replace(FLIGHT, mission="skip")
    failed = replace(FLIGHT, passed=False, ended="crashed")
    first, second = held_against([failed], [FLIGHT, other])
    assert first.failed == ("a failed: crashed",)
    assert not second.passed and second.flights == 0
    (held,) = held_against([failed], [failed])  # as the baseline did
    assert held.passed


def test_of_the_same_seeds_each_flight_that_fails_and_passed_is_told():
    """As many fail as before, but another one."""
    one, two = (replace(FLIGHT, name=str(seed), seed=seed) for seed in (1, 2))
    lost = [replace(each, passed=False, ended="crashed") for each in (one, two)]
    (held,) = held_against([lost[0], two], [one, lost[1]])
    assert held.failed == ("1 failed: crashed",)


@pytest.mark.parametrize(("lost", "is_more"), [(10, False), (13, False), (18, True)])
def test_of_other_seeds_flights_fail_more_often_beyond_chance(lost, is_more):
    """Ten of twenty failed in the baseline. P(at least 18 of 20 | 28 of 40) is 0.7 % (Fisher)."""
    before = [replace(FLIGHT, name=str(k), seed=k, passed=k > 10) for k in range(1, 21)]
    now = [replace(FLIGHT, name=str(k), seed=k, passed=k > 100 + lost) for k in range(101, 121)]
    (held,) = held_against(now, before)
    assert (held.by, bool(held.failed)) == ("interval", is_more)


def test_flights_that_have_a_value_are_compared_though_others_have_none():
    before, now = (
        flights(dict.fromkeys(range(1, 21), 0.1)),
        flights(dict.fromkeys(range(1, 21), 9.0)),
    )
    without = {METRIC: None, FLOOR: 10.0}
    before[0] = replace(before[0], metrics=without)
    (held,) = held_against(now, before)
    assert [(each.metric, each.value) for each in held.worse] == [(METRIC, 9.0)]
    (held,) = held_against([before[0], *now[1:]], before)
    assert [each.metric for each in held.worse] == [METRIC]
    (held,) = held_against(before, before)
    assert held.passed


@pytest.mark.computes
def test_shares_of_time_that_are_mostly_0_raise_no_false_alarm():
    """One flight in twenty meets a limit for a while: of 400 comparisons, at most a few say worse."""
    random = np.random.default_rng(2)
    name = "torque_saturated_fraction"

    def drawn(first: int) -> list[ComparedFlight]:
        shares = np.where(random.random(50) < 0.05, random.exponential(1e-3, 50), 0.0)
        return flights(dict(enumerate(shares.tolist(), first)), name)

    told = sum(not held_against(drawn(1), drawn(101))[0].passed for _ in range(400))
    assert told <= 4  # a hundredth


def test_a_run_without_a_verdict_is_refused(tmp_path):
    """One whose runner was killed, or whose result is cut: the recording alone says not that it passed."""
    with pytest.raises(RegressionError, match="has no verdict"):
        held_against([replace(FLIGHT, passed=None, path=tmp_path)], [FLIGHT])


def test_a_metric_that_is_lost_is_worse():
    (held,) = held_against([replace(FLIGHT, metrics={METRIC: None, FLOOR: 10.0})], [FLIGHT])
    assert [each.value for each in held.worse] == [None]


# --- with flights


def fly(
    out: Path, *settings: str, seed: int = 1, mission: str = "noisy_state", for_s: float = 7.0
) -> Path:
    gcs_tools.fly(
        mission, settings=[f"flight.duration_s={for_s}", *settings], seed=seed, in_process=True,
        out=out, figure="never",
    )  # fmt: skip
    return out


@pytest.fixture(scope="module")
def baseline(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("baseline")
    for seed in (1, 2):
        fly(folder / str(seed), seed=seed)
    return folder


def judged(*arguments: object) -> tuple[int, dict]:
    done = gcs("compare", *arguments, "--json")
    return done.exit_code, json.loads(done.stdout)


@pytest.mark.computes
def test_the_same_flights_are_as_the_baseline(baseline, tmp_path):
    for seed in (1, 2):
        fly(tmp_path / str(seed), seed=seed)
    for how in ("--fail", "--exact"):
        code, found = judged(tmp_path, baseline, how)
        assert (code, found["passed"]) == (0, True)
        assert found["missions"][0]["flights"] == 2


@pytest.mark.computes
def test_a_gain_by_two_per_cent_is_seen(baseline, tmp_path):
    run = fly(tmp_path / "run", "law.f_m=2.04")
    code, found = judged(run, baseline, "--exact", "--junit", tmp_path / "j.xml")
    (mission,) = found["missions"]
    assert (code, mission["passed"]) == (1, False)
    assert mission["changed"] == {"law.f_m": ["2.04", "2.0"]}
    ((name, parted),) = mission["parted"]
    assert (name, parted["t"], parted["kinds"][0]) == ("run", 0.0, "guard")
    (case,) = ET.parse(tmp_path / "j.xml").getroot()
    assert case.get("name") == "noisy_state" and case.find("failure") is not None


@pytest.mark.parametrize(
    ("settings", "kind", "t"),
    [
        (["plant.mass_change={at_s=3.0,mass_kg=8.01}"], "mass", 3.0),
        (["wind.step_at_s=2.0", "wind.step_m_s=[0.1,0.0,0.0]"], "wind", 2.0),
        (
            ["flight.setpoints=[{at_s=0.0,position_m=[4.0,7.0,18.0]},{at_s=4.0,position_m=[4.0,7.0,17.9]}]"],
            "setpoint", 4.0,
        ),
        (["plant.rotor_loss=[{rotor=1,at_s=5.0,effectiveness=0.95}]"], "motion", 5.0),
    ],
)  # fmt: skip
@pytest.mark.computes
def test_what_differs_first_is_nearest_to_the_cause(baseline, tmp_path, settings, kind, t):
    _, found = judged(fly(tmp_path / "run", *settings), baseline / "1", "--exact")
    ((_, parted),) = found["missions"][0]["parted"]
    assert parted["kinds"][0] == kind
    assert parted["t"] == pytest.approx(t, abs=0.011)


@pytest.mark.computes
def test_a_flight_that_goes_on_longer_differs_where_the_other_ends(baseline, tmp_path):
    run = fly(tmp_path / "run", for_s=7.5)
    _, found = judged(run, baseline / "1", "--exact")
    ((_, parted),) = found["missions"][0]["parted"]
    assert parted["t"] == pytest.approx(7.0, abs=0.003)
    assert parted["only"] == "this flight"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("A", "--fail"), "expected RUN and BASELINE"),
        (("A", "B", "--junit", "j.xml"), "goes with --fail"),
        (("A", "B", "--tolerance", "0.1"), "goes with --fail"),
        (("A", "nowhere", "--fail"), "expected a run, or a folder with runs"),
        (("A", "B", "--fail", "--missions", "take_off"), "draw nothing"),
    ],
)
def test_wrong_use_is_told(baseline, arguments, said):
    where = {"A": baseline / "1", "B": baseline / "2"}
    done = gcs("compare", *(where.get(each, each) for each in arguments))
    assert done.exit_code == 2 and said in done.stderr


def test_without_a_recording_the_trajectory_alone_is_compared(baseline, tmp_path):
    run = shutil.copytree(baseline / "1", tmp_path / "run")
    (run / "flight.mcap").unlink()
    assert judged(run, baseline, "--exact")[0] == 0
    other = fly(tmp_path / "other", "law.f_m=2.04")
    (other / "flight.mcap").unlink()
    code, found = judged(other, baseline, "--exact")
    assert code == 1
    assert "where is not known" in found["missions"][0]["failed"][0]
