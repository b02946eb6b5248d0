"""`gcs envelope --worst-wind`, and what it writes."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from gcs_tools.cli.envelope import envelope
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import scenario
from gcs_tools.gusts import worst_wind
from gcs_tools.gusts.ends import ends
from gcs_tools.gusts.limits import LIMITS, outputs, rooms
from gcs_tools.missions.mission import load

MISSION = """title = "The vehicle flies two metres."
[flight]
duration_s = 3.0
setpoints = [{ at_s = 0.0, position_m = [2.0, 0.0, 0.0] }]
[expect]
reached = false
"""


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    """A search of a round, from few flights: what is tested is not how far it gets."""
    for name, value in {"FIRST_ROUNDS": 1, "ROUNDS": 1, "FACETS": dict.fromkeys(LIMITS, 1)}.items():
        monkeypatch.setattr(worst_wind, name, value)
    monkeypatch.setattr(worst_wind, "ends", lambda scene: ends(scene)[1:2])
    monkeypatch.setattr(worst_wind, "_apart", lambda flown, k, of: iter(flown[3:4]))


def run(*arguments):
    return CliRunner().invoke(envelope, [*map(str, arguments)])


@pytest.mark.computes
def test_what_it_states_is_flown_again_by_the_mission_that_it_writes(tmp_path):
    (tmp_path / "x.toml").write_text(MISSION)
    picture, winds = tmp_path / "room.png", tmp_path / "winds"
    done = run(tmp_path / "x.toml", "--worst-wind", "--parts", 1, "--winds", winds, "--figure", picture, "--json")  # fmt: skip
    said = json.loads(done.stdout)
    assert [row["limit"] for row in said["worst"]] == list(LIMITS)
    assert done.exit_code == int(said["saturates"])
    assert (said["wind_m_s"], said["wind_rate_m_s2"], said["vehicles"]) == (12.0, 20.0, 12)
    assert picture.stat().st_size > 10_000
    for k, row in enumerate(said["worst"]):
        scene = scenario(load(winds / f"{row['limit']}-1.toml"))
        _, law = law_alone.fly(scene)
        room = rooms(scene, outputs(law))[round(said["transient_s"] * 500) :, k]
        assert room.min() == pytest.approx(row["room_n"], abs=1e-3)


@pytest.mark.computes
def test_the_table_has_a_row_for_each_limit_and_part(tmp_path):
    (tmp_path / "x.toml").write_text(MISSION)
    done = run(tmp_path / "x.toml", "--worst-wind", "--parts", 2)
    for limit in LIMITS:
        assert done.stdout.count(f"{limit.replace('_', ' ')} ") == 2


@pytest.mark.parametrize("mission", ["square_and_land", "figure_eight"])
@pytest.mark.computes
def test_items_and_curves_are_flown_too(mission):
    """Items from hover where they begin, and it says that take-off and landing are left out."""
    said = json.loads(run(mission, "--worst-wind", "--parts", 1, "--json").stdout)
    assert [row["limit"] for row in said["worst"]] == list(LIMITS)
    assert all(row["room_n"] < row["room_still_n"] + 5.0 for row in said["worst"])
    assert any("take-off, landing" in remark for remark in said["remarks"]) == (mission == "square_and_land")  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("gust_step", "--parts", 2), "--parts: expected with --worst-wind"),
        (("gust_step", "--winds", "x"), "--winds: expected with --worst-wind"),
        (("tests/scripts/hop.toml", "--worst-wind"), "does not run scripts"),
        (("plan_square", "--worst-wind"), "does not look at plans"),
        (("gust_step", "--worst-wind", "--set", "law.module=px4"), "px4: expected mmrac"),
        (("gust_step", "--worst-wind", "--set", "law.c_angle=200"), "unstable with these gains"),
        (("gust_step", "--worst-wind", "--set", "flight.duration_s=3000"), "at most 600 s"),
        (("urban_step", "--worst-wind", "--set", "law.guard=refuse"), "refused"),
    ],
)
@pytest.mark.computes
def test_what_it_does_not_take_is_said(arguments, said):
    done = run(*arguments)
    assert done.exit_code == 2
    assert said in " ".join(done.output.split())
