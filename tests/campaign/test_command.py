"""`gcs campaign` from the command line: flown, told, expected of, and one of its flights again."""

from __future__ import annotations

import html
import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from gcs_tools.campaigns import analysis
from gcs_tools.campaigns.campaign_file import shipped
from gcs_tools.campaigns.statistics import at_least
from gcs_tools.campaigns.verdict import Shown
from tests.command_line import gcs

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A campaign of a short mission, some of whose flights fail."""
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "hover.toml").write_text(HOVER)
    (folder / "winds.toml").write_text(WINDS)
    out = folder / "out"
    found = gcs(
        "campaign", folder / "winds.toml", "--out", out, "--json", "--junit", folder / "j.xml"
    )
    return folder, out, found


HOVER = """title = "A hover in a gust."
[flight]
duration_s = 1.5
setpoints = [{ at_s = 0.0, position_m = [0.0, 0.0, 0.0] }]
[plant]
noise = { position_m = 0.002 }
[wind]
step_m_s = [4.0, 0.0, 0.0]
step_at_s = 0.5
"""
WINDS = """title = "Gusts of unknown strength push a hovering vehicle."
mission = "hover.toml"
laws = ["mmrac", { law = "mmrac", label = "slow", set = { "law.f_m" = 0.8 } }]
flights = 40
fly = "law"
metrics = ["setpoint_error_max_m", "tilt_max_deg"]
expect = { success = { at_least = 0.9, confidence = 0.95 } }
[draw]
"wind.step_m_s[0]" = { uniform = [0.0, 16.0] }
"plant.mass_kg" = { uniform = [0.95, 1.05], relative = true }
"flight.yaw_deg" = { choice = [0.0, 90.0] }
[success]
setpoint_error_max_m = 0.04
"""


def test_a_campaign_is_told_and_kept(flown):
    _, out, found = flown
    told = json.loads(found.stdout)
    assert told == json.loads((out / "result.json").read_text())
    assert sorted(path.name for path in out.iterdir()) == [
        ".lock", "campaign.json", "campaign.toml", "flights.parquet", "report.html", "result.json",
    ]  # fmt: skip
    table = analysis.read(out / "flights.parquet")
    assert len(table) == 80
    assert table["number"].to_pylist() == [n for n in range(40) for _ in range(2)]
    assert table["law"].to_pylist()[:2] == ["mmrac", "slow"]
    # both laws meet the same draws
    drawn = table["draw.wind.step_m_s[0]"].to_numpy().reshape(40, 2)
    assert (drawn[:, 0] == drawn[:, 1]).all()
    (first, second) = told["laws"]
    failed = 40 - first["success"]["successes"]
    assert first["missed"]["setpoint_error_max_m"] == failed
    own = [row for row in table.to_pylist() if row["law"] == "mmrac"]
    assert all(row["success"] == (not row["missed"]) for row in own)
    assert f"setpoint_error_max_m by {failed}" in (out / "report.html").read_text()
    assert first["success"]["of"] == second["success"]["of"] == 40
    assert 0 < first["success"]["successes"] < 40
    assert told["differences"][0]["first"] == "mmrac"


def test_the_quantity_that_explains_the_failures_comes_first(flown):
    _, _, found = flown
    law = json.loads(found.stdout)["laws"][0]
    clearest, *others = law["causes"]
    assert clearest["name"] == "wind.step_m_s[0]"
    assert clearest["p"] < 1e-6
    assert clearest["direction"] > 0.95
    assert all(other["p"] > analysis.LIKELY for other in others)
    assert not law["worst"][0]["success"]


def test_an_expectation_that_is_not_shown_is_exit_code_1_and_a_failure_in_junit(flown):
    folder, _, found = flown
    assert found.exit_code == 1
    suite = ET.parse(folder / "j.xml").getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("2", "2", "0")
    message = suite.find("testcase/failure").get("message")
    assert "at least 0.9" in message


def test_a_finished_campaign_is_told_again_without_flying(flown):
    _, out, found = flown
    before = (out / "flights.parquet").read_bytes()
    again = gcs("campaign", out, "--json")
    assert json.loads(again.stdout) == json.loads(found.stdout)
    assert (out / "flights.parquet").read_bytes() == before


def test_laws_are_told_side_by_side_the_success_first(flown):
    _, out, found = flown
    told = json.loads(found.stdout)
    lines = gcs("campaign", out).stdout.splitlines()
    assert len(lines) <= 10
    for law, row in zip(told["laws"], lines[2:], strict=False):
        assert row.split()[:2] == [law["law"], f"{law['success']['successes']}/40"]
        assert "MISSED" in row
    assert f"(p = {told['differences'][0]['p']:.2g})" in lines[3]
    assert max(len(line) for line in lines if str(out) not in line) <= 80
    assert lines[-1].endswith(str(out / "report.html"))


@pytest.mark.parametrize("at_least", [0.5, 0.9])
def test_a_campaign_is_told_in_ten_lines_and_its_progress_in_a_pipe(
    tmp_path, monkeypatch, at_least
):
    monkeypatch.setattr("gcs_tools.cli.campaign_flying.LINE_S", 0.0)
    (tmp_path / "hover.toml").write_text(HOVER)
    head = f"expect = {{ success = {{ at_least = {at_least} }} }}"
    (tmp_path / "brief.toml").write_text(BRIEF.format(head=head, tail=SUCCESS))
    done = gcs("campaign", tmp_path / "brief.toml", "-j", "2", "--out", tmp_path / "out")
    told = json.loads((tmp_path / "out" / "result.json").read_text())["laws"][0]
    lines = done.stdout.splitlines()
    assert len(lines) <= 10
    assert max(len(line) for line in lines if str(tmp_path) not in line) <= 80
    assert f"{told['success']['successes']} of 50 flights" in lines[1]
    assert lines[2].split()[0] == ("met" if at_least == 0.5 else "MISSED")
    assert [line for line in lines if line.startswith("setpoint_error_max_m")]
    (fails,) = (line for line in lines if line.startswith("Failures go with"))
    assert "a high wind.step_m_s[0]" in fails
    (again,) = (line for line in lines if line.startswith("Fly again"))
    assert again.endswith(f"gcs fly '{tmp_path / 'out'}#{told['worst'][0]['number']}'")
    assert "50 of 50 flights" in done.stderr


@pytest.mark.parametrize(
    ("count", "of", "expected", "needed"),
    [
        (40, 40, 0.95, 59), (39, 40, 0.95, 93), (298, 298, 0.99, 299), (59, 59, 0.95, None),
        (30, 40, 0.95, None), (40, 40, 1.0, None), (0, 0, 0.9, None),
    ],
)  # fmt: skip
def test_the_flights_that_would_show_what_is_expected_are_counted(count, of, expected, needed):
    """Exact: 0.95 to the power of 59 is below 0.05, and of 58 it is not."""
    shown = Shown("mmrac", expected, at_least(count, of, 0.95), 0.95, count, of, 0.95)
    assert shown.needed == needed


def test_a_flight_of_a_campaign_flies_again_to_the_bit(flown, tmp_path):
    _, out, found = flown
    told = json.loads(found.stdout)["laws"][1]["worst"][0]
    name = f"{out}#{told['number']}:slow"
    again = gcs("fly", name, "--in-process", "--figure", "never", "--out", tmp_path / "run")
    assert "the same trajectory to the bit" in again.stderr
    assert again.exit_code == 1  # it failed there, and does here
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["metrics"]["setpoint_error_max_m"] == told["value"]
    assert (tmp_path / "run" / "flight.mcap").exists()


def test_another_trajectory_is_said(flown, tmp_path):
    _, out, _ = flown
    (out / "again").mkdir(exist_ok=True)
    name = f"{out}#3"
    table = analysis.read(out / "flights.parquet")
    import pyarrow
    from pyarrow import parquet

    wrong = pyarrow.array(["0" * 64] * len(table))
    column = table.schema.get_field_index("trajectory_sha256")
    kept = (out / "flights.parquet").read_bytes()
    parquet.write_table(
        table.set_column(column, "trajectory_sha256", wrong), out / "flights.parquet"
    )
    again = gcs("fly", name, "--in-process", "--figure", "never", "--record", "none", "--out", tmp_path / "r")  # fmt: skip
    (out / "flights.parquet").write_bytes(kept)
    assert again.exit_code == 3
    assert "another trajectory" in again.stderr


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("#99", "flights 0 to 39"),
        ("#1:px4", "there are mmrac, slow"),
        ("#abc", "FOLDER#NUMBER"),
        ("#" + "9" * 5000, "FOLDER#NUMBER"),
    ],
)
def test_a_flight_that_a_campaign_does_not_have_is_said(flown, name, said):
    _, out, _ = flown
    found = gcs("fly", f"{out}{name}")
    assert found.exit_code == 2
    assert said in found.stderr


BRIEF = """title = "A hover whose flights may fail."
mission = "hover.toml"
flights = 50
fly = "law"
{head}
[draw]
"wind.step_m_s[0]" = {{ uniform = [0.0, 16.0] }}
{tail}"""
RARE = 'rare = {{ metric = "setpoint_error_max_m", limit = {limit}, stage = 50, stages = 2 }}'
SUCCESS = "[success]\nsetpoint_error_max_m = 0.04\n"
TOGETHER = """"flight.duration_s" = { uniform = [1.0, 2.0] }
"flight.setpoints[1].at_s" = { uniform = [0.2, 1.4] }
"""


@pytest.mark.parametrize(
    ("head", "tail", "exit_code"),
    [
        ("expect = { success = { at_least = 0.99 } }", SUCCESS, 1),
        (RARE.format(limit=0.04), "", 0),
        (RARE.format(limit=100.0), "", 0),
    ],
)
def test_json_is_one_object_and_nothing_else(tmp_path, head, tail, exit_code):
    (tmp_path / "hover.toml").write_text(HOVER)
    (tmp_path / "brief.toml").write_text(BRIEF.format(head=head, tail=tail))
    done = subprocess.run(
        [sys.executable, "-m", "gcs_tools", "campaign", tmp_path / "brief.toml", "--json", "-j", "1",
         "--out", tmp_path / "out"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == exit_code, done.stderr
    told = json.loads(done.stdout)
    assert told == json.loads((tmp_path / "out" / "result.json").read_text())
    assert told["exit_code"] == exit_code
    if "rare" in head:
        failures = told["estimate"]["failures"]
        assert 0.0 <= told["estimate"]["effective"] <= failures
        assert bool(failures) == ("100" not in head)
        report = (tmp_path / "out" / "report.html").read_text()
        assert told["estimate"]["doubt"] in html.unescape(report)


def test_json_of_what_is_not_flown_is_nothing_and_the_error_is_told(tmp_path):
    (tmp_path / "hover.toml").write_text(HOVER)
    (tmp_path / "brief.toml").write_text(BRIEF.format(head="seed = -1", tail=""))
    done = gcs("campaign", tmp_path / "brief.toml", "--json", "--out", tmp_path / "out")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "brief.toml:5: seed" in done.stderr
    assert not (tmp_path / "out").exists()


def test_json_of_flights_that_cannot_be_flown_is_one_object(tmp_path):
    """Each of two quantities goes with the middle of the other, but not with its ends."""
    two = "0.0] }, { at_s = 0.5, position_m = [0.1, 0.0, 0.0] }]"
    (tmp_path / "hover.toml").write_text(HOVER.replace("0.0] }]", two))
    (tmp_path / "brief.toml").write_text(BRIEF.format(head="", tail=TOGETHER))
    done = gcs("campaign", tmp_path / "brief.toml", "--json", "--out", tmp_path / "out")
    assert done.exit_code == 2
    told = json.loads(done.stdout)
    assert told["exit_code"] == 2
    assert "at_s" in told["error"]
    assert told["error"] in done.stderr


@pytest.mark.parametrize("address", ["nonsense", "http://127.0.0.1:8786", "tcp://127.0.0.1"])
def test_an_address_that_is_none_is_refused_before_anything_is_made(flown, tmp_path, address):
    file, _, _ = flown
    found = gcs("campaign", file, "--out", tmp_path / "out", "--scheduler", address)
    assert found.exit_code == 2
    assert "expected tcp://HOST:PORT" in found.stderr
    assert not (tmp_path / "out").exists()


def test_a_scheduler_by_tls_without_certificates_is_a_sentence(flown, tmp_path):
    folder, _, _ = flown
    file = folder / "winds.toml"
    found = gcs("campaign", file, "--out", tmp_path / "out", "--scheduler", "tls://127.0.0.1:1")
    assert found.exit_code == 3
    assert "certificates" in found.stderr
    assert "Traceback" not in found.stderr


def test_the_report_needs_nothing_else(flown):
    _, out, _ = flown
    page = (out / "report.html").read_text()
    for asks in ("<script", "<link", "src=", "@import", "url(http"):
        assert asks not in page
    assert page.count("<svg") == 6  # the shrinking interval, two of failures a law, metrics
    assert f"{out}#" in page


def test_the_flights_open_in_other_programs(flown):
    _, out, _ = flown
    import duckdb
    import pandas
    import polars

    path = str(out / "flights.parquet")
    ours = analysis.read(out / "flights.parquet")["tilt_max_deg"].to_numpy()
    theirs = (
        pandas.read_parquet(path)["tilt_max_deg"].to_numpy(),
        polars.read_parquet(path)["tilt_max_deg"].to_numpy(),
        duckdb.sql(f"select tilt_max_deg from '{path}' order by number, law").fetchnumpy()["tilt_max_deg"],
    )  # fmt: skip
    assert all(np.array_equal(each, ours) for each in theirs)


def test_a_campaign_that_cannot_be_flown_is_exit_code_2(tmp_path):
    found = gcs("campaign", "paper_nois")
    assert found.exit_code == 2
    assert "did you mean paper_noise?" in found.stderr
    (tmp_path / "letter").write_text("dear")
    found = gcs("campaign", "paper_noise", "--out", tmp_path)
    assert found.exit_code == 2
    assert "not empty" in found.stderr


def test_a_law_that_raises_is_exit_code_2_before_anything_is_flown(tmp_path):
    law = (tmp_path / "broken.py").absolute()
    law.write_text("def step(:\n")
    (tmp_path / "hover.toml").write_text(HOVER)
    text = WINDS.replace('laws = ["mmrac"', 'laws = ["broken.py"')
    (tmp_path / "winds.toml").write_text(text)
    found = gcs("campaign", tmp_path / "winds.toml", "--out", tmp_path / "out")
    assert found.exit_code == 2
    assert "broken.py" in found.stderr
    assert not (tmp_path / "out").exists()


def test_a_whole_vehicle_flies_faults_that_a_law_alone_does_not(tmp_path):
    words = "campaign", "state_outage", "--flights", "12"
    assert gcs(*words, "--out", tmp_path / "vehicle").exit_code == 0
    words = "campaign", "ground_outage", "--flights", "4"
    assert gcs(*words, "--out", tmp_path / "with parameters").exit_code == 0
    text = (ROOT / "missions" / "campaigns" / "state_outage.toml").read_text()
    (tmp_path / "alone.toml").write_text(text.replace("flights = 300", 'flights = 2\nfly = "law"'))
    found = gcs("campaign", tmp_path / "alone.toml", "--out", tmp_path / "alone")
    assert found.exit_code == 2
    assert "state_off is answered by an autopilot" in found.stderr


def test_the_shipped_campaigns_can_be_flown_from_any_folder(tmp_path, monkeypatch):
    from gcs_tools.campaigns.campaign_file import read

    monkeypatch.chdir(tmp_path)  # files that their missions name are found beside those
    assert shipped()
    for name in shipped():
        assert read(name).n > 0
