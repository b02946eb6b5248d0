"""What passes and what fails, and how it is said."""

import math

import pytest

from gcs_tools.judging.expectations import ExpectError, judge_each

MEASURED = {"reference_error_rms_m": 0.025, "reference_error_max_m": 90.0, "thrust_max_n": math.nan}


def measured(name: str, t_from: float | None, t_to: float | None) -> float | None:
    value = MEASURED.get(name)
    return None if value is None else value * (1.0 if t_from is None else t_from)


@pytest.mark.parametrize(
    ("entry", "passed", "text"),
    [
        (0.025, True, "reference_error_rms_m ≤ 0.025: 0.025"),
        (0.0249, False, "reference_error_rms_m ≤ 0.0249: 0.025"),
        (1, True, "reference_error_rms_m ≤ 1: 0.025"),
        ({"limit": 0.25, "from": 12.0}, False, "reference_error_rms_m ≤ 0.25 from 12 s: 0.3"),
        ({"limit": 0.05, "from": 2, "to": 20.5}, True,
         "reference_error_rms_m ≤ 0.05 from 2 s to 20.5 s: 0.05"),
        ({"at_least": 0.02}, True, "reference_error_rms_m ≥ 0.02: 0.025"),
        ({"at_least": 0.03}, False, "reference_error_rms_m ≥ 0.03: 0.025"),
    ],
)  # fmt: skip
def test_limits_of_a_metric_are_judged(entry: object, passed: bool, text: str) -> None:
    _, judged = judge_each({"reference_error_rms_m": entry}, measured, "time")
    assert (judged.passed, str(judged)) == (passed, text)


@pytest.mark.parametrize("name", ["margin_min_n", "margin_tilt_min_deg", "margin_condition_min_n"])
def test_a_number_on_a_minimum_is_a_floor(name: str) -> None:
    for value, passed in ((-17.65, False), (0.0, True), (3.0, True)):
        expect = {name: 0.0, "nonfinite_samples": 9.0}
        _, judged, _ = judge_each(expect, lambda *_, value=value: value, "time")
        assert judged.passed is passed
    assert judged.text == f"{name} ≥ 0"
    with pytest.raises(ExpectError, match=rf"{name}.limit: expected at_least"):
        judge_each({name: {"limit": 0.0}}, measured, "time")


@pytest.mark.parametrize(
    ("ended", "samples", "named", "passed"),
    [
        ("time", 0.0, {}, [True]),
        ("time", None, {}, [True]),
        ("arrived", 3.0, {}, [True, False]),
        ("time", 3.0, {"nonfinite_samples": 3}, [True, True]),
        ("diverged", 3.0, {}, [True]),
    ],
)
def test_a_flight_that_ends_well_has_finite_samples(ended, samples, named, passed):
    expect = {"ended": ended, **named}
    judged = judge_each(expect, lambda name, t_from, t_to: samples, ended)
    assert [e.passed for e in judged] == passed


@pytest.mark.parametrize(("parts", "passed"), [({"guard"}, False), (set(), None)])
@pytest.mark.parametrize("entry", [{"limit": 0.0}, {"at_least": 1.0}])
def test_what_is_expected_of_laws_with_a_part_does_not_apply_to_others(entry, parts, passed):
    expect = {"reference_error_rms_m": {**entry, "laws_with": "guard"}}
    _, judged = judge_each(expect, measured, "time", has=parts.__contains__)
    assert judged.passed is passed and judged.is_missed is (passed is False)
    assert (judged.value is None) is (passed is None)
    _, judged = judge_each(expect, measured, "time")
    assert judged.passed is False
    with pytest.raises(ExpectError, match="laws_with: expected one of guard, reference"):
        judge_each({"reference_error_rms_m": {**entry, "laws_with": "wings"}}, measured, "time")


@pytest.mark.parametrize("name", ["setpoint_error_rms_m", "thrust_max_n", "no_such_metric"])
def test_a_metric_missing_or_not_finite_fails(name: str) -> None:
    for entry in (1e9, {"at_least": -1e9}):
        _, judged = judge_each({name: entry}, measured, "time")
        assert not judged.passed and judged.value is None
        assert str(judged).endswith(": no value")
        _, judged = judge_each({name: entry}, measured, "time", lambda *_: "nothing flew")
        assert judged.why == "nothing flew"
        assert str(judged).endswith(": no value: nothing flew")


@pytest.mark.parametrize(
    ("ended", "passed"),
    [
        ("time", True),
        ("arrived", True),
        ("diverged", False),
        ("crashed", False),
        ("aborted", False),
    ],
)
def test_a_flight_must_end_well_unless_expected_not_to(ended: str, passed: bool) -> None:
    (judged,) = judge_each({}, measured, ended)
    assert judged.passed is passed
    assert str(judged) == f"ended = time or arrived: {ended}"


def test_divergence_can_be_expected() -> None:
    expect = {"reference_error_max_m": {"at_least": 50.0}, "ended": "diverged"}
    assert [e.passed for e in judge_each(expect, measured, "diverged")] == [True, True]
    assert [e.passed for e in judge_each(expect, measured, "time")] == [False, True]


@pytest.mark.parametrize(
    ("expect", "reason"),
    [
        (
            {"reference_error_rms_m": {"limt": 1.0}},
            r"reference_error_rms_m.limt: expected one of limit, at_least",
        ),
        (
            {"reference_error_rms_m": {"from": 1.0}},
            "reference_error_rms_m: expected either limit or at_least",
        ),
        (
            {"reference_error_rms_m": {"limit": 1, "at_least": 1}},
            "expected either limit or at_least",
        ),
        (
            {"reference_error_rms_m": math.nan},
            "reference_error_rms_m.limit: expected a finite number, got nan",
        ),
        (
            {"reference_error_rms_m": "small"},
            "reference_error_rms_m.limit: expected a finite number, got 'small'",
        ),
        ({"reference_error_rms_m": True}, "expected a finite number, got True"),
        ({"ended": 3}, "ended: expected a word, got 3"),
    ],
)
def test_what_cannot_be_judged_is_refused(expect: dict[str, object], reason: str) -> None:
    with pytest.raises(ExpectError, match=reason):
        judge_each(expect, measured, "time")
