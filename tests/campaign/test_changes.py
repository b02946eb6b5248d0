"""Changes of a campaign by the command line: seed, values of the mission, metrics."""

from __future__ import annotations

import json

import pytest

from gcs_tools.campaigns import store
from gcs_tools.campaigns.campaign_file import CampaignError, Changes, read, settings
from tests.campaign.test_command import gcs

FILE = """
title = "t"
mission = "paper_nominal"
flights = 3
seed = 5
set = { "plant.mass_kg" = 8.0 }
laws = ["mmrac", { law = "px4", set = { "plant.mass_kg" = 7.5 } }]
[draw]
"wind.azimuth_deg" = { uniform = [0.0, 360.0] }
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text(FILE)
    return path


def test_another_seed_draws_other_flights_and_is_another_campaign(file):
    plain, other = read(file), read(file, Changes(seed=6))
    assert other.draws.seed == 6
    assert other.draws.quantities(0) != plain.draws.quantities(0)
    assert other.identity != plain.identity
    assert read(file, Changes(seed=5)).identity == plain.identity


def test_a_value_is_that_of_every_law_whatever_the_file_says(file):
    found = read(file, Changes(set=settings(["plant.mass_kg=6.5"])))
    for variant in found.variants:
        assert variant.mission.plant.mass_kg == 6.5
        assert variant.base["plant.mass_kg"] == 6.5


@pytest.mark.parametrize(
    ("written", "names"),
    [
        ("wind.azimuth_deg=10", "wind.azimuth_deg"),  # drawn
        ("plant.mas_kg=7", "mass_kg"),
        ("plant.mass_kg", "TABLE.KEY=VALUE"),
    ],
)
def test_a_value_that_cannot_be_set_is_refused_by_its_name(file, written, names):
    with pytest.raises(CampaignError, match=names):
        read(file, Changes(set=settings([written])))


def test_the_seed_of_the_noise_can_be_set(file):
    found = read(file, Changes(set=settings(["flight.seed=3"])))
    assert "flight.seed" not in found.draws.values(0, {}, found.variants[0].base)


def test_metrics_are_shown_and_ranked_by_the_first_and_change_no_flight(file):
    found = read(file, Changes(metrics=("setpoint_error_max_m", "thrust_saturated_fraction")))
    assert found.ranked_by == "setpoint_error_max_m"
    assert found.identity == read(file).identity


@pytest.mark.computes
def test_a_folder_keeps_what_was_changed(file, tmp_path):
    out = tmp_path / "out"
    changed = (
        "--seed", "7", "--set", "plant.mass_kg=7", "--set", "flight.duration_s=0.5",
        "--metrics", "setpoint_error_max_m", "--flights", "2", "--no-report", "-j", "1",
    )  # fmt: skip
    first = gcs("campaign", file, *changed, "--out", out, "--json")
    told = json.loads(first.stdout)
    again = store.reopened(out, unchanged=True)
    assert again.changes.seed == 7
    assert again.changes.set == {"plant.mass_kg": 7, "flight.duration_s": 0.5}
    assert [each["name"] for each in told["laws"][0]["metrics"]] == ["setpoint_error_max_m"]
    other = gcs("campaign", out, "--json", "--metrics", "thrust_saturated_fraction")
    metrics = json.loads(other.stdout)["laws"][0]["metrics"]
    assert [each["name"] for each in metrics] == ["thrust_saturated_fraction"]
    for option in (("--seed", "8"), ("--set", "plant.mass_kg=8")):
        refused = gcs("campaign", out, *option)
        assert refused.exit_code == 2
        assert option[0] in refused.stderr


def test_an_unknown_metric_is_refused_with_the_nearest(file, tmp_path):
    found = gcs("campaign", file, "--metrics", "setpoint_error_mx_m", "--out", tmp_path / "o")
    assert found.exit_code == 2
    assert "setpoint_error_max_m" in found.stderr
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("changes", [{"set": 3}, {"seed": "x"}, {"metrics": 1}, {"a": 1}, [], "x"])
def test_a_folder_with_changes_that_are_none_is_refused(file, tmp_path, changes):
    store.Store(tmp_path / "o", read(file), {})
    path = tmp_path / "o" / "campaign.json"
    about = json.loads(path.read_text())
    path.write_text(json.dumps({**about, "changes": changes}))
    with pytest.raises(CampaignError):
        store.reopened(tmp_path / "o")


@pytest.mark.parametrize(
    ("was", "now", "changes", "said"),
    [
        ("", "", Changes(flights=30), "it has 3 flights, here 30 are asked for"),
        ("", "", Changes(seed=7), "its seed is 5, here 7"),
        ("seed = 5\n", "", Changes(), "its seed is 5, here 1"),
        ("", "", Changes(set={"plant.mass_kg": 7.0}), "it has no --set plant.mass_kg, here it is 7.0"),
        ("flights = 3", "# more\nflights = 4", Changes(), "it has 3 flights, here 4 are asked for"),
        ("0.0, 360.0", "0.0, 180.0", Changes(), r"its draw.wind.azimuth_deg.uniform is [0.0, 360.0], here [0.0, 180.0]"),
        ('set = { "plant.mass_kg" = 8.0 }\n', "", Changes(), "its set.plant.mass_kg is 8.0, here there is none"),
        ('"mmrac", {', '"se3", {', Changes(), 'its laws[0] is "mmrac", here "se3"'),
    ],
)  # fmt: skip
@pytest.mark.computes
def test_another_campaign_in_a_folder_is_told_by_the_first_key_that_differs(
    file, tmp_path, was, now, changes, said
):
    store.Store(tmp_path / "o", read(file), {})
    file.write_text(file.read_text().replace(was, now, 1) if was else file.read_text())
    with pytest.raises(store.Refused) as refused:
        store.Store(tmp_path / "o", read(file, changes), {})
    assert f"another campaign was flown here: {said};" in str(refused.value)


def test_a_comment_and_a_title_may_change_in_a_file_whose_campaign_goes_on(file, tmp_path):
    store.Store(tmp_path / "o", read(file), {})
    file.write_text("# better\n" + file.read_text().replace('"t"', '"another"', 1))
    store.Store(tmp_path / "o", read(file), {})


def test_what_is_given_twice_is_refused(file):
    with pytest.raises(CampaignError, match=r"--set plant\.mass_kg: given twice"):
        settings(["plant.mass_kg=7", "plant.mass_kg = 8"])
    metrics = 'metrics = ["tilt_max_deg", "tilt_max_deg"]'
    file.write_text(file.read_text().replace("seed = 5", metrics))
    with pytest.raises(CampaignError, match=r"c\.toml:5: metrics: tilt_max_deg is there twice"):
        read(file)


def test_a_number_of_flights_of_the_command_line_is_not_blamed_on_the_file(file):
    grid = 'method = "grid"\nseed = 5'
    text = file.read_text().replace("flights = 3\nseed = 5", grid)
    file.write_text(text.replace("360.0]", "360.0], levels = 4"))
    with pytest.raises(CampaignError) as refused:
        read(file, Changes(flights=6))
    assert str(refused.value) == "--flights: expected a multiple of the 4 points, got 6"
