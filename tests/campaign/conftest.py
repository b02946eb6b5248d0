"""A short campaign, and its parts flown by nobody."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_tools.campaigns.campaign_file import Campaign, parsed

HOVER = """title = "A hover from half a metre away."
[flight]
duration_s = 1.0
setpoints = [{ at_s = 0.0, position_m = [0.5, 0.0, 0.2] }]
[plant]
noise = { position_m = 0.01 }
[wind]
steady_m_s = [2.0, 0.0, 0.0]
"""
CAMPAIGN = """title = "A hover with a mass that is not known."
mission = "hover.toml"
flights = 20
fly = "law"
[draw]
"plant.mass_kg" = { uniform = [0.8, 1.2], relative = true }
"wind.steady_m_s[1]" = { uniform = [-6.0, 6.0] }
"flight.setpoints[0].position_m[2]" = { normal = [0.2, 0.1] }
[success]
setpoint_error_final_m = 0.45
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Where a mission and a campaign of it are."""
    (tmp_path / "hover.toml").write_text(HOVER)
    (tmp_path / "drawn.toml").write_text(CAMPAIGN)
    return tmp_path


@pytest.fixture
def make(folder: Path):
    """A campaign of other lines: those before [draw] that are changed, and [draw] itself."""

    def made(head: str = "", draw: str | None = None, tail: str = "") -> Campaign:
        first, rest = CAMPAIGN.split("[draw]\n")
        for line in filter(None, head.splitlines()):
            name = line.split(" = ")[0]
            kept = [each for each in first.splitlines() if each.split(" = ")[0] != name]
            first = "\n".join([*kept, line]) + "\n"
        quantities, success = rest.split("[success]\n")
        text = f"{first}[draw]\n{quantities if draw is None else draw}\n[success]\n{success}{tail}"
        return parsed(text, "drawn.toml", folder, "drawn")

    return made
