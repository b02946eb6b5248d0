"""The map of a campaign: which cells have which values, and where drawn files lie."""

from __future__ import annotations

import numpy as np
import pyarrow
import pytest

from gcs_tools.campaigns import maps
from gcs_tools.campaigns.analysis import Flights
from gcs_tools.campaigns.campaign_file import CampaignError, parsed, read

TEXT = """title = "Places"
mission = "paper_nominal"
method = "grid"
[draw]
"plant.mass_kg" = { choice = [7.0, 8.0] }
"wind.azimuth_deg" = { choice = [0.0, 90.0, 180.0] }
"law.guard" = { choice = ["warn", "govern"] }
"law.f_m" = { uniform = [0.5, 3.5], levels = 3 }
"""
MAP = """[map]
over = ["plant.mass_kg", "wind.azimuth_deg"]
"""


def made(text, folder):
    return parsed(text, "campaign.toml", folder, "campaign")


def table(campaign, succeeds):
    """Flights of a campaign, of which those succeed whose quantities say so."""
    rows = [campaign.draws.quantities(n) for n in range(campaign.n)]
    columns = {f"draw.{name}": [row[name] for row in rows] for name in rows[0]}
    n, word = campaign.n, [""] * campaign.n
    return pyarrow.table(
        {
            **columns, "number": range(n), "law": ["mmrac"] * n, "ended": word, "missed": word, "error": word,
            "success": [bool(succeeds(row)) for row in rows],
        }
    )  # fmt: skip


def test_a_cell_has_the_greatest_value_up_to_which_all_flights_succeed(tmp_path):
    campaign = made(TEXT + MAP + 'up_to = "law.f_m"\npanels = "law.guard"\n', tmp_path)
    assert campaign.draws.quantities(0)["law.f_m"] == 1.0  # and 2, 3
    # 7 kg fails at 2 alone, 8 kg at 1 and above 90 degrees not at all
    flown = table(campaign, lambda row: row["law.f_m"] != 2.0 if row["plant.mass_kg"] == 7.0 else row["law.f_m"] > 1.0 or row["wind.azimuth_deg"] > 90.0)  # fmt: skip
    found = maps.drawn(campaign.document.map, Flights(flown, "mmrac"))
    every, first, *_ = found.panels
    np.testing.assert_array_equal(every.cells, [[1.0, np.nan], [1.0, np.nan], [1.0, 3.0]])
    np.testing.assert_array_equal(every.none, [[False, True], [False, True], [False, False]])
    np.testing.assert_array_equal(first.cells, every.cells)
    assert first.title == "law.guard warn" and found.levels == (1.0, 2.0, 3.0)
    letter, out = tmp_path / "letter", tmp_path / "out"
    letter.write_text("dear")
    out.mkdir()
    (out / "map.png").symlink_to(letter)
    (path,) = maps.save(campaign, flown, out)
    assert path.read_bytes().startswith(b"\x89PNG") and not path.is_symlink()
    assert letter.read_text() == "dear"


def test_without_a_third_quantity_a_cell_has_the_share_that_succeeds(tmp_path):
    campaign = made(TEXT + MAP, tmp_path)
    flown = table(campaign, lambda row: row["law.f_m"] < row["plant.mass_kg"] - 4.5)
    (panel,) = maps.drawn(campaign.document.map, Flights(flown, "mmrac")).panels
    np.testing.assert_allclose(panel.cells, [[2 / 3, 1.0]] * 3)


@pytest.mark.parametrize(
    ("map_of", "said"),
    [
        (MAP.replace("azimuth_deg", "azimut"), "drawn quantities"),
        (MAP + 'up_to = "plant.mass_kg"\n', "quantities that differ"),
        (MAP + 'panels = "law.f_m"\n', "drawn with choice"),
        (MAP + 'labels = { "plant.mas_kg" = "kg" }\n', r"toml:11: .*not drawn \(did you mean plant.mass_kg\?\)"),
        ("[map]\n", r"\[map\] over: is missing"),
    ],
)  # fmt: skip
def test_a_map_of_what_is_not_drawn_is_refused(tmp_path, map_of, said):
    with pytest.raises(CampaignError, match=said):
        made(TEXT + map_of, tmp_path)


def test_a_map_changes_no_flight(tmp_path):
    assert made(TEXT, tmp_path).identity == made(TEXT + MAP, tmp_path).identity


def test_files_that_are_drawn_lie_beside_the_mission():
    campaign = read("street_map")
    values = campaign.draws.values(0, campaign.draws.quantities(0), campaign.variants[0].base)
    assert values["wind.field.file"] == str(campaign.variants[0].beside / "street/from_000.field")
