"""What cannot be followed is said before anything is flown, and who waits no more is not kept."""

from __future__ import annotations

import threading
from concurrent.futures import CancelledError

import pytest
from click.testing import CliRunner

from fcu.interface.airframe import SHIPPED, AirframeError, read
from fcu.interface.parameter import ParameterError
from fcu.laws import loader
from gcs_tools.campaigns import margins, procedure
from gcs_tools.campaigns.entrant import entrant
from gcs_tools.campaigns.flights import each
from gcs_tools.cli.program import main
from gcs_tools.exit_codes import USAGE
from gcs_tools.missions.mission import MissionError, load, shipped


@pytest.mark.parametrize(
    ("was", "now"),
    [("seeds = [1, 2, 3, 4, 5]", "seeds = [1, -2]"), ("factor = 1.5", "factor = 1.000000001")],
)
def test_a_procedure_that_raises_or_never_ends_is_refused(tmp_path, was, now):
    text = procedure.SHIPPED.read_text()
    assert was in text
    file = tmp_path / "p.toml"
    file.write_text(text.replace(was, now))
    with pytest.raises(procedure.ProcedureError):
        procedure.read(file)


def test_missions_that_name_none_are_a_usage_error():
    ran = CliRunner().invoke(main, ["compare", "px4", "--missions", ","])
    assert ran.exit_code == USAGE
    assert "expected the name of a mission" in ran.output


@pytest.mark.parametrize("law", ["px4", "my_law.py"])
def test_laws_without_missions_are_told_what_they_need(law):
    ran = CliRunner().invoke(main, ["compare", law, "mmrac"])
    assert ran.exit_code == USAGE
    assert f"{law}: a law is compared with --missions" in ran.output


def test_a_setting_that_one_of_the_laws_has_not_says_which():
    asked = ["compare", "mmrac", "px4", "--missions", "benchmark/steps", "--set", "law.k_r_xy=1"]
    ran = CliRunner().invoke(main, asked)
    assert ran.exit_code == USAGE
    assert "mmrac: --set law.k_r_xy=1: [law] k_r_xy: no such key" in ran.output


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("steps", "(did you mean benchmark/steps?)"),
        ("benchmrk", "(did you mean benchmark?)"),
        ("benchmark", "expected a mission, got a folder of them: benchmark/delay, "),
    ],
)
def test_a_mission_of_a_folder_is_found_by_who_forgets_the_folder(name, said):
    with pytest.raises(MissionError) as caught:
        load(name)
    assert said in str(caught.value)


def test_a_folder_of_missions_is_flown_whole(tmp_path):
    asked = ["fly", "benchmark", "--set", "law.f_m=5", "--out", str(tmp_path / "out")]
    ran = CliRunner().invoke(main, asked)
    assert ran.exit_code == USAGE
    assert all(f"{path}.toml" in ran.output for path in shipped("benchmark"))
    assert not (tmp_path / "out").exists()


def test_a_word_that_is_an_array_is_refused():
    row = next(r for r in loader.load("px4").settings.PARAMETERS if r.words is not None)
    with pytest.raises(ParameterError):
        row.numbers([])


def test_least_thrust_above_the_weight_is_refused(tmp_path):
    text = SHIPPED["quad"].read_text()
    assert "thrust_min_n = 1.0" in text
    file = tmp_path / "quad.toml"
    file.write_text(text.replace("thrust_min_n = 1.0", "thrust_min_n = 14.0"))
    with pytest.raises(AirframeError, match="thrust_min_n: expected less than the weight"):
        read(file)


def test_a_margin_nobody_waits_for_flies_no_more():
    ended = threading.Event()
    ended.set()
    with pytest.raises(CancelledError):
        margins.margin(entrant("px4", "quad"), "wind", procedure.read(), ended)


def test_what_has_begun_is_told_when_an_item_raises():
    ended = threading.Event()

    def work(item: int) -> bool:
        if item == 0:
            raise ZeroDivisionError
        return ended.wait(60.0)

    with pytest.raises(ZeroDivisionError):
        list(each(work, [0, 1], on_end=ended.set))
    assert ended.is_set()
