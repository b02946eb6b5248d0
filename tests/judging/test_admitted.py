"""Missions whose setpoints a guard that refuses would not fly: known before anything starts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import gcs_tools
from gcs_tools.flight.run import UsageError, fly_missions, prepared
from gcs_tools.judging.preflight_check import refusal, unflyable

REFUSE = 'law.guard="refuse"'
SLOW = "law.f_m=0.8"


def why(mission: str, *settings: str) -> str:
    return refusal(prepared(mission, settings)[1])


def steps(*places: tuple[float, float, float, float]) -> str:
    """`steps((at_s, x, y, z), ...)`: a setting of setpoints."""
    each = ", ".join(f"{{at_s={t}, position_m=[{x}, {y}, {z}]}}" for t, x, y, z in places)
    return f"flight.setpoints=[{each}]"


@pytest.mark.slow
def test_a_refusal_says_which_setpoint_why_and_what_would_do() -> None:
    said = why("paper_fast", REFUSE)
    assert said.startswith("setpoint at 0 s refused: 19.7 m needs ")
    assert said.endswith(" m of it would do")


@pytest.mark.parametrize("policy", ["warn", "govern"])
def test_other_policies_fly_it(policy: str) -> None:
    assert why("paper_fast", f'law.guard="{policy}"') == ""


@pytest.mark.slow
def test_what_is_said_to_do_is_flown_and_saturates_nothing(tmp_path: Path) -> None:
    """Nor do the rotors: the reference's acceleration does not jump."""
    part = float(why("paper_fast", REFUSE).split("; ")[1].split()[0]) / 19.72
    less = steps((0.0, 4.0 * part, 7.0 * part, 18.0 * part))
    rotors = "expect.rotor_saturated_fraction={limit=0.0, from=0.5}"
    found = gcs_tools.fly(
        "paper_fast", settings=[REFUSE, less, "law.J_hat_0=0.3", rotors], in_process=True,
        out=tmp_path / "run", figure="never",
    )  # fmt: skip
    assert found.passed, found.expectations
    for which in ("thrust", "tilt"):
        assert found.metrics[f"{which}_saturated_fraction"] == 0.0


def test_a_later_setpoint_is_looked_at_from_where_the_reference_is_then() -> None:
    near = (0.0, 0.0, 0.0, 3.0)
    assert why("gust_step", REFUSE, SLOW, steps(near)) == ""
    far = why("gust_step", REFUSE, SLOW, steps(near, (10.0, 0.0, 0.0, 40.0)))
    assert far.startswith("setpoint at 10 s refused: 37.0 m needs ")
    assert why("gust_step", REFUSE, SLOW, steps(near, (10.0, 0.0, 0.0, 8.0))) == ""
    back = why("gust_step", REFUSE, SLOW, steps(near, (1.0, 0.0, 0.0, 40.0)))
    assert back.startswith("setpoint at 1 s refused: 39.")  # still on its way


def unflyable_of(*settings: str) -> list[tuple[float, str, bool]]:
    """When each setpoint is sent that cannot be flown as written, why, and whether that is expected."""
    found = unflyable(*prepared("gust_step", settings))
    return [(each.at_s, each.why, each.expected) for each in found]


HERE, WIDE = (0.0, 0.0, 0.0, 3.0), "flight.arena_m=1000"
ON_GROUND = "flight.start={on_ground=true}"


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ([steps(HERE, (9.0, 90.0, 0.0, 3.0))], []),
        ([steps(HERE, (9.0, 99.0, 0.0, 25.0))], [(9.0, "arena"), (9.0, "far")]),
        ([steps(HERE, (9.0, 101.0, 0.0, 3.0)), WIDE], [(9.0, "far")]),
        ([steps((0.0, 101.0, 0.0, 0.0)), WIDE], [(0.0, "far")]),
        ([steps(HERE, (9.0, 0.0, 0.0, -2.0))], [(9.0, "low")]),
        ([steps(HERE, (9.0, 0.0, 0.0, -11.0))], [(9.0, "ground")]),
        ([steps(HERE, (9.0, 0.0, 0.0, 0.0)), ON_GROUND, "flight.ground_z_m=0"], [(9.0, "ground")]),
        ([steps(HERE, (9.0, 0.0, 0.0, 0.1)), ON_GROUND, "flight.ground_z_m=0"], []),
        ([steps(HERE), "flight.yaw={amplitude_rad=1.0, frequency_rad_s=3.0}"], [(0.0, "turns")]),
    ],
    ids=["near", "arena", "far", "at once", "low", "below", "on", "above", "turning"],
)  # fmt: skip
@pytest.mark.computes
def test_setpoints_that_cannot_be_flown_as_written_are_known_before(settings, expected) -> None:
    assert unflyable_of(*settings) == [(*each, False) for each in expected]
    limited = [each for each in unflyable_of(*settings, "expect.limited=true") if not each[2]]
    assert limited == [(at_s, why, False) for at_s, why in expected if why == "arena"]
    assert all(each[2] for each in unflyable_of(*settings, "expect.ended='diverged'"))


def test_how_far_away_a_setpoint_is_depends_on_how_the_guard_has_led_the_vehicle() -> None:
    """A second after the one before it the vehicle has not come far; it is there in the end."""
    late, early = (
        steps(HERE, (2.0, 90.0, 0.0, 3.0), (at_s, 180.0, 0.0, 3.0)) for at_s in (60.0, 4.0)
    )
    for policy, far in (("govern", True), ("warn", False)):
        chosen = "flight.duration_s=70", WIDE, f"law.guard='{policy}'", "law.f_m=2.0"
        assert unflyable_of(*chosen, late) == []
        assert bool(unflyable_of(*chosen, early)) is far


def test_a_mission_that_expects_a_refusal_is_flown_unless_it_is_the_first(tmp_path: Path) -> None:
    far, expected = steps(HERE, (6.0, 0.0, 0.0, 40.0)), "expect.limited=true"
    found = gcs_tools.fly(
        "gust_step", settings=[REFUSE, SLOW, far, "expect.reached=false", expected],
        in_process=True, out=tmp_path / "run", figure="never", record="none",
    )  # fmt: skip
    lines = {line.name: line for line in found.expectations}
    assert lines["limited"].passed and found.ended == "time"
    assert any(warned.text.startswith("Setpoint rejected: 37.0 m") for warned in found.warnings)
    with pytest.raises(UsageError, match="no flight begins with a refused setpoint"):
        gcs_tools.fly("paper_fast", settings=[REFUSE, expected], in_process=True)


REFUSAL = r'paper_fast: setpoint at 0 s .* \(law.guard = "refuse"\)'


def test_a_single_mission_that_the_guard_refuses_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=REFUSAL):
        fly_missions(["paper_fast"], settings=[REFUSE], in_process=True, out=tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_a_mission_that_the_guard_refuses_does_not_keep_others_from_flying(tmp_path: Path) -> None:
    flown, refused = fly_missions(
        ["gust_step", "paper_fast"], settings=[REFUSE, "flight.duration_s=0.5"], in_process=True,
        out=tmp_path / "runs", figure="never",
    )  # fmt: skip
    assert (flown.mission, flown.ended) == ("gust_step", "time")
    assert (refused.exit_code, refused.ended) == (2, "rejected")
    assert refused.error is not None
    assert re.match(REFUSAL, refused.error)
    assert [folder.name for folder in (tmp_path / "runs").iterdir()] == ["gust_step"]
