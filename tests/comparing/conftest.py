"""Laws and missions for tests of many flights: short, and without wind where nothing else is said."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_tools.campaigns import procedure
from gcs_tools.campaigns.procedure import SHIPPED, Procedure

CASCADE = str(Path(__file__).parents[1] / "own_law" / "plain_cascade.py")
HOVER = """title = "A hover from half a metre away."
[flight]
duration_s = 3.0
setpoints = [[0.0, 0.5, 0.0, 0.2]]
[expect]
setpoint_error_rms_m = { limit = 1.0, from = 1.0 }
"""


@pytest.fixture(scope="session")
def cascade() -> str:
    """A law of a user's own, whose gains are free."""
    return CASCADE


@pytest.fixture
def hover(tmp_path: Path) -> Path:
    """A short mission's file."""
    path = tmp_path / "hover.toml"
    path.write_text(HOVER)
    return path


@pytest.fixture
def short(tmp_path: Path, hover: Path) -> Path:
    """The file of a procedure that is followed in seconds."""
    lines, table = [], ""
    for line in SHIPPED.read_text().splitlines():
        table = line if line.startswith("[") else table
        name = line.partition(" ")[0]
        if table in ("[training]", "[validation]"):
            line = {"missions": f'missions = ["{hover}"]', "seeds": "seeds = 1"}.get(name, "")
            line = line or (table if name == table else "")
        elif table == "[search]":
            line = {"evaluations_per_gain": "evaluations_per_gain = 6", "seeds": "seeds = [1, 2]"}.get(name, line)  # fmt: skip
        elif table == "[margins]" and name == "mission":
            line = f'mission = "{hover}"'
        lines.append(line)
    path = tmp_path / "procedure.toml"
    path.write_text("\n".join(lines))
    return path


@pytest.fixture
def followed(short: Path) -> Procedure:
    """The same, read."""
    return procedure.read(short)
