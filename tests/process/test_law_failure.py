"""A law that fails in flight: the flight ends with its error, or the baseline flies the same tick."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gcs_tools
from fcu.interface.status_texts import Code, Told, brief
from fcu.laws import loader
from fcu.parameters import Parameters, Refused
from fcu.process.configuration import read_airframe, read_settings
from gcs_tools.flight.scenario import OF_MISSIONS, scenario
from gcs_tools.missions.mission import load, override
from gcs_tools.recording.reader import read
from gcs_tools.studies.law_failures import fly, reference
from tests.two_ways import fly_both

pytestmark = pytest.mark.slow  # compiles a law

OWN = Path(__file__).parents[1] / "own_law"
START = "\n@kernel\ndef step(state, params, setpoint, measured):\n"
RAISES = f'{START}    if measured.r_E.x > 0.3:\n        raise ValueError("east of all reason")\n'
THRUSTS = "    thrusts, gave_up = allocate(params.rotors, T_c, tau_c)\n"
PULLS = f"{THRUSTS}    thrusts = select(measured.r_E.x > 0.3, -1.0, 1.0) * thrusts\n"
NOT_FINITE = f"{THRUSTS}    thrusts = select(measured.r_E.x > 0.3, nan, 1.0) * thrusts\n"


@pytest.fixture(scope="module")
def failing(tmp_path_factory):
    """Missions of laws that fail 0.3 m east of the start: one raises, one is not finite, one pulls down."""
    made = {}
    for name, old, new in (
        ("raises", START, RAISES), ("not finite", THRUSTS, NOT_FINITE), ("pulls", THRUSTS, PULLS),
    ):  # fmt: skip
        folder = tmp_path_factory.mktemp("law")
        text = (OWN / "plain_cascade.py").read_text().replace(old, new)
        (folder / "plain_cascade.py").write_text(text)
        mission = folder / "step_in_still_air.toml"
        mission.write_text((OWN / "step_in_still_air.toml").read_text())
        made[name] = mission
    return made


@pytest.mark.parametrize("how", ["raises", "not finite", "pulls"])
def test_the_baseline_flies_on_over_the_wire_as_in_process(failing, tmp_path, how):
    flown = fly_both(
        failing[how], tmp_path, params=["MR_LAW_ACT=1"],
        settings=["expect={}", "expect.failsafe=law_failed"],
    )  # fmt: skip
    for way, result in flown.items():
        (acted,) = result.failsafes
        assert (acted.name, acted.action) == ("law_failed", "px4")
        rows = read(tmp_path / way / "flight.mcap").fcu
        assert np.isfinite(rows["command"]).all()
        begins = np.flatnonzero(rows["engaged"] == 1.0)
        assert len(begins) == 2, "the law takes over, and then the baseline"
        assert rows["t"][begins[1]] == pytest.approx(acted.time_s)
        assert np.isnan(rows["state.v_E"][begins[1] :]).all()


def test_a_law_that_is_not_finite_is_flown_and_told_without_a_baseline(failing, tmp_path):
    flown = gcs_tools.fly(
        str(failing["not finite"]), in_process=True, out=tmp_path / "run", figure="never"
    )
    assert flown.failsafes == [] or flown.failsafes[0].name != "law_failed"
    assert not flown.passed
    assert flown.not_finite is not None
    assert "outputs.thrusts.r1" in flown.not_finite.fields


@pytest.mark.parametrize("tick", [1, 2, 137, 700])
def test_the_law_of_the_paper_may_fail_at_any_tick(tick):
    settings = ("vehicle.params.MR_LAW_ACT=1", "flight.duration_s=4")
    mission = load("gust_step")
    for setting in settings:
        mission = override(mission, setting)
    scene = scenario(mission)
    found = fly(scene, tick, reference(scene))
    assert found.whole
    assert found.tells
    assert found.excursion_m < 3.0


def test_a_waiting_baseline_changes_no_bit_of_a_flight():
    plain = load("gust_step")
    plain = override(plain, "flight.duration_s=4")
    rows = [
        reference(scenario(override(plain, f"vehicle.params.MR_LAW_ACT={act}"))) for act in (0, 1)
    ]
    assert rows[0].tobytes() == rows[1].tobytes()


def test_the_baseline_is_chosen_at_the_start():
    law = loader.load()
    airframe = read_airframe(law)
    params = Parameters(
        read_settings(law, None, 500.0, airframe), 1, None, law, airframe, OF_MISSIONS
    )
    assert params["MR_LAW_ACT"] == 0.0
    with pytest.raises(Refused) as error:
        params.set("MR_LAW_ACT", 1.0, False)
    assert error.value.kind == "READ_ONLY"
    assert len(error.value.brief) <= 50
    plain = Parameters(read_settings(law, None, 500.0, airframe), 1, None, law, airframe)
    assert plain["MR_LAW_ACT"] == 1.0


@pytest.mark.parametrize("why", ["rotors stopped", "raised ValueError: " + 40 * "x"])
def test_text_of_a_law_failure_has_room(why):
    text = brief(Told(Code.LAW_FAILED, (why, "px4")))
    assert len(text) <= 50
    assert "px4" in text
