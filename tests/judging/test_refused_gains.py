"""Gains that a vehicle refuses: known before anything starts, in every way of flying."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import gcs_tools
from fcu.__main__ import main
from fcu.guard import stability
from fcu.guard.gains import deciding
from fcu.interface import handover
from fcu.laws import loader
from fcu.process.configuration import ConfigurationError, read_airframe, read_settings
from gcs_tools.campaigns.batch import OrderedFlight, fly_batch
from gcs_tools.campaigns.campaign_file import CampaignError, read
from gcs_tools.flight.run import UsageError, fly_missions, prepared
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.preflight_check import refused_gains
from gcs_tools.missions.mission import MissionError, load, shipped
from tests.command_line import gcs

QUICK, FLY = "law.f_m=5", 'law.unstable_gains="fly"'
ROOT = Path(__file__).resolve().parents[2]
MISSION = """title = "A step."
[flight]
duration_s = 3.0
setpoints = [{ at_s = 0.0, position_m = [0.0, 0.0, 1.0] }]
[law]
zeta_m = 1.0
f_m = 5.0
"""


@pytest.fixture
def quick(tmp_path: Path) -> Path:
    path = tmp_path / "quick.toml"
    path.write_text(MISSION)
    return path


@pytest.fixture
def pinned(tmp_path: Path) -> Path:
    """An S1000 whose file pins gains that a vehicle refuses."""
    path = tmp_path / "mine.toml"
    shipped_text = (ROOT / "fcu/airframes/s1000.toml").read_text()
    assert "\nf_m = 2.0\n" in shipped_text
    path.write_text(shipped_text.replace("\nf_m = 2.0\n", "\nf_m = 5.0\n"))
    return path


def line_of(path: Path, text: str) -> int:
    return next(i for i, line in enumerate(path.read_text().splitlines(), 1) if text in line)


def why(name: str | Path, *settings: str, **more: str) -> str:
    return refused_gains(*prepared(str(name), settings, **more))


@pytest.mark.parametrize("setting", [QUICK, "law.c_angle=30"])
def test_a_gain_from_the_command_line_is_named(setting: str) -> None:
    key = setting.removeprefix("law.").partition("=")[0]
    said = why("paper_nominal", setting)
    assert f"{key} = " in said and "(--set)" in said


def test_a_gain_of_the_mission_is_named_with_its_line(quick: Path) -> None:
    assert f"f_m = 5.0 (mission:{line_of(quick, 'f_m =')})" in why(quick)


def test_a_gain_of_the_airframe_is_named_with_its_line(pinned: Path) -> None:
    line = line_of(pinned, "f_m = 5.0")
    assert f"f_m = 5.0 (mine.toml:{line})" in why("airframe_step", airframe=str(pinned))
    law = loader.load()
    with pytest.raises(ConfigurationError, match=rf"f_m = 5\.0 \(mine\.toml:{line}\)"):
        read_settings(law, None, 500.0, read_airframe(law, str(pinned)))


def test_a_mission_may_ask_for_gains_that_are_refused_and_says_so() -> None:
    mission, scene = prepared("paper_nominal", (QUICK, FLY))
    assert refused_gains(mission, scene) == ""
    assert mission.values_in_force()["law.unstable_gains"].value == "fly"


def test_a_law_without_the_rule_has_no_such_key() -> None:
    with pytest.raises(UsageError, match="unstable_gains: no such key"):
        prepared("gust_step", (FLY,), law="px4")


@pytest.mark.parametrize("name", [*shipped(), *shipped("benchmark")])
@pytest.mark.computes
def test_no_shipped_mission_is_refused(name: str) -> None:
    mission = load(name)
    assert refused_gains(mission, scenario(mission)) == ""


@pytest.mark.parametrize("in_process", [True, False])
def test_refused_gains_start_and_write_nothing(in_process: bool, tmp_path: Path) -> None:
    """A single mission, a mission flown with two seeds, and a flight from Python leave no folder."""
    out = tmp_path / "runs"
    for name in ("paper_nominal", "take_off"):
        with pytest.raises(UsageError, match="unstable with"):
            gcs_tools.fly(name, settings=[QUICK], in_process=in_process, out=out)
    with pytest.raises(UsageError, match="unstable with"):
        fly_missions(["noisy_state"], settings=[QUICK], seed=[1, 2], in_process=in_process, out=out)
    assert not out.exists()


@pytest.mark.slow
def test_the_command_line_exits_with_2(quick: Path, pinned: Path, tmp_path: Path) -> None:
    handed = tmp_path / "settings.json"
    handover.save(handed, prepared(str(quick))[1].settings)
    for done in (
        gcs("fly", quick), gcs("fly", "airframe_step", "--airframe", pinned, "--in-process"),
        gcs("up", quick), gcs("up", "--airframe", pinned),
        fcu("--airframe", pinned), fcu("--handover", handed),
    ):  # fmt: skip
        assert done.exit_code == 2, done.output
        assert "unstable" in done.output


def test_a_handover_is_refused_unless_it_is_asked_for(quick: Path, tmp_path: Path) -> None:
    path, law = tmp_path / "settings.json", loader.load()
    settings = prepared(str(quick))[1].settings
    handover.save(path, settings)
    with pytest.raises(ConfigurationError, match=r"settings\.json"):
        read_settings(law, path, 500.0)
    assert read_settings(law, path, 500.0, flies_unstable=True) == settings


def fcu(*arguments: object) -> Result:
    return CliRunner().invoke(main, [*map(str, arguments)], catch_exceptions=False)


def campaign(folder: Path, draw: str) -> Path:
    path = folder / "gains.toml"
    path.write_text(
        'title = "Gains."\nmission = "gust_step"\nflights = 4\n'
        f"[draw]\n{draw}\n[success]\nsetpoint_error_final_m = 0.5\n"
    )
    return path


def test_a_campaign_of_gains_that_are_all_refused_does_not_start(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="unstable with"):
        read(campaign(tmp_path, '"law.f_m" = { uniform = [5.0, 6.0] }'))


@pytest.mark.parametrize("fly", ["vehicle", "law"])
def test_a_drawn_gain_that_is_refused_is_a_named_loss(fly: str) -> None:
    given = json.loads(json.dumps(load("gust_step").given))
    plan = json.dumps({"fly": fly, "flights": 1, "name": "gust_step", "laws": [{"given": given}]})
    (row,) = fly_batch(plan, [OrderedFlight(0, 0, {"law.f_m": 5.0})])
    assert (row.ended, row.success, row.exit_code) == ("rejected", False, 0)
    assert "pitch unstable with f_m = 5.0 (draw)" in row.error


def test_every_deciding_parameter_of_a_channel_is_a_key_of_missions() -> None:
    law = loader.load()
    keys = {row.key for row in law.settings.PARAMETERS}
    for channel in stability.CHANNELS:
        assert set(deciding(law, channel)) <= keys


def test_the_word_is_one_of_two() -> None:
    with pytest.raises(UsageError, match="expected fly or refuse"):
        prepared("paper_nominal", ('law.unstable_gains="maybe"',))
    with pytest.raises((UsageError, MissionError)):
        prepared("paper_nominal", ("law.unstable_gains=1",))
