"""The pages about missions and recordings: their files are flown, and their scripts run."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import gcs_tools
from gcs_tools.judging.metrics import METRICS
from gcs_tools.judging.result import Result
from gcs_tools.recording import reader
from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[2]


def blocks(page: str, kind: str) -> list[str]:
    text = (ROOT / "docs" / page).read_text()
    return [
        code for name, code in re.findall(r"```(\w*)\n(.*?)```", text, re.DOTALL) if name == kind
    ]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """The mission of the page, flown in its folder."""
    folder = tmp_path_factory.mktemp("page")
    mission, *_ = blocks("missions.md", "toml")
    (folder / "two_points.toml").write_text(mission)
    result = gcs_tools.fly(
        str(folder / "two_points.toml"), in_process=True, out=folder / "run", figure="never"
    )
    return folder, result


def run(folder: Path, script: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script], cwd=folder, capture_output=True, text=True,
        check=False, timeout=PATIENCE_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_items_of_the_page_pass_with_the_verdict_that_is_printed_there(tmp_path):
    (tmp_path / "square.toml").write_text(blocks("missions.md", "toml")[1])
    result = gcs_tools.fly(
        str(tmp_path / "square.toml"), in_process=True, out=tmp_path / "run", figure="never"
    )
    is_printed(result, blocks("missions.md", "")[1])


def test_the_mission_of_the_page_passes_with_the_verdict_that_is_printed_there(flown):
    is_printed(flown[1], blocks("missions.md", "")[0])


def is_printed(result: Result, printed: str) -> None:
    assert result.passed
    for line in result.expectations:
        assert re.search(rf"^met +{re.escape(line.text)} +{re.escape(line.shown)}$", printed, re.M)


def test_the_script_of_the_docs_flies_its_mission(flown):
    folder, _ = flown
    (script,) = blocks("missions.md", "python")
    told = run(folder, script).splitlines()
    assert told[0].startswith("True ")
    assert any(
        "Contradicts assumptions: more drag than in a wind of 12 m/s" in line for line in told
    )


@pytest.mark.parametrize("name", METRICS)
def test_the_page_names_every_metric(name):
    """In full, or its end or its start, as the table shortens them."""
    text = (ROOT / "docs" / "missions.md").read_text()
    parts = name.split("_")
    ends = {f"`…_{'_'.join(parts[n:])}`" for n in range(1, len(parts))}
    assert any(each in text for each in (f"`{name}`", f"`{parts[0]}_…`", *ends))


def test_the_script_of_the_other_page_reads_the_recording(flown):
    folder, result = flown
    script, with_pandas = blocks("recordings.md", "python")
    most, _, _, at, _ = run(folder, script).split()
    assert float(most) == pytest.approx(result.metrics["reference_error_max_m"], abs=5e-4)
    assert 0.0 < float(at) < 25.0
    table = reader.read(folder / "run" / "flight.mcap").fcu  # what pandas is given
    assert table.rows.shape == (len(table), len(table.names))
    for column in re.findall(r'fcu\["(.*?)"\]', with_pandas):
        assert column in table.names
