"""A comparison of laws is a campaign of each mission: kept, continued, flown again, and never lost as a whole."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from pyarrow import parquet

from gcs_tools.campaigns import comparing, results, seed_draws
from gcs_tools.campaigns.batch import fly_batch
from gcs_tools.campaigns.campaign_file import CampaignError, parsed
from gcs_tools.campaigns.entrant import entrant
from gcs_tools.campaigns.procedure import read
from gcs_tools.campaigns.running import Ending, RunningError, processes, run
from gcs_tools.campaigns.seed_draws import Stream
from gcs_tools.campaigns.store import Store, locked
from gcs_tools.missions.mission import load
from tests.command_line import gcs

HERE = {"bits": "a"}
SEEDS = """title = "Vehicles within what is believed."
mission = "hover.toml"
laws = ["mmrac", { law = "mmrac", label = "l1:unmatched=tilted", set = { "law.f_m" = 0.8 } }]
flights = 4
seed = 3
fly = "law"
[seeds]
rotor_lag = [0.75, 1.25]
far_m = 5.0
"""
AT = "    limits, v, angles = params.limits, measured.v_E, euler(matrix(measured.q_EB))\n"
POKE = """from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def poke(context, value):
    def made(context, builder, signature, arguments):
        at = builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())
        builder.store(ir.Constant(ir.IntType(64), 1), at)
        return context.get_dummy_value()
    return types.void(types.int64), made


"""


def campaign(folder: Path, text: str = SEEDS):
    return parsed(text, "seeds.toml", folder, "seeds")


def test_the_draws_of_seeds_are_those_of_a_comparison(tmp_path, hover):
    made = campaign(tmp_path)
    mission = load(hover)
    of_seed = seed_draws.sampled(mission, read().draws, Stream.TEST, 3 + 2)
    values = made.draws.values(2, made.draws.quantities(2), made.variants[0].base)
    in_force = of_seed.values_in_force()
    assert {key: in_force[key].value for key in values} == values
    assert set(made.draws.quantities(2)) == set(made.draws.names)
    assert "plant.mass_kg" in made.draws.names


def test_seed_0_draws_nothing(tmp_path, hover):
    made = campaign(tmp_path, SEEDS.replace("seed = 3", "seed = 0"))
    assert made.draws.values(0, made.draws.quantities(0), {}) == {}
    assert made.draws.values(1, made.draws.quantities(1), {})["flight.seed"] > 0


def test_what_a_mission_says_of_its_vehicle_is_not_drawn(tmp_path, hover):
    hover.write_text(f"{hover.read_text()}[plant]\nmass_kg = 7.5\n")
    assert "plant.mass_kg" not in campaign(tmp_path).draws.names


@pytest.mark.parametrize(
    ("was", "now", "said"),
    [
        ('fly = "law"', 'fly = "vehicle"', '[seeds]: expected fly = "law"'),
        ("[seeds]", "[success]\nsetpoint_error_final_m = 0.1\n[seeds]", "[seeds]: expected no"),
        ("[seeds]", '[draw]\n"plant.mass_kg" = { uniform = [7.0, 8.0] }\n[seeds]', "[seeds]: expected neither"),
        ('"law.f_m" = 0.8', '"plant.mass_kg" = 8.0', "expected keys of [law] alone"),
        ("far_m = 5.0", "far_m = 0.0", "[seeds] far_m"),
        ("[0.75, 1.25]", "[1.25, 0.75]", "least and greatest, got 1.25 and 0.75"),
        ("far_m = 5.0\n", "", "[seeds] far_m"),
        ("far_m = 5.0", "far_m = 5.0\nfar = 5.0", "[seeds] far"),
    ],
)  # fmt: skip
def test_seeds_beside_what_does_not_go_with_them_are_refused(tmp_path, hover, was, now, said):
    assert was in SEEDS
    with pytest.raises(CampaignError) as refused:
        campaign(tmp_path, SEEDS.replace(was, now))
    assert said in str(refused.value)


def test_a_flight_that_ends_far_from_its_setpoint_is_a_failure(tmp_path, hover):
    made = campaign(tmp_path, SEEDS.replace("far_m = 5.0", "far_m = 1e-9"))
    quantities = made.draws.quantities(0)
    values = made.draws.values(0, quantities, made.variants[0].base)
    (row,) = fly_batch(made.plan(), [(0, 0, values)])
    assert (row.success, row.missed, row.ended) == (False, "far", "time")


def test_the_campaigns_of_a_comparison_share_its_flights_of_a_law(hover):
    missions = [load(hover), load("benchmark/steps")]
    laws = [entrant("mmrac"), entrant("mmrac", "quad")]
    parts = comparing.campaigns(laws, missions, range(5, 8), read())
    assert [part.folder for part in parts] == [
        "s1000-hover",
        "s1000-steps",
        "quad-hover",
        "quad-steps",
    ]
    assert [(part.campaign.n, part.campaign.in_all) for part in parts] == [(3, 6)] * 4
    assert len({part.campaign.identity for part in parts}) == 4


@pytest.fixture(scope="module")
def compared(tmp_path_factory, cascade):
    """A comparison of two laws, written."""
    folder = tmp_path_factory.mktemp("compared")
    hover = folder / "hover.toml"
    from tests.comparing.conftest import HOVER

    hover.write_text(HOVER)
    command = (
        "compare",
        "mmrac",
        cascade,
        "--missions",
        hover,
        "--seeds",
        3,
        "--junit",
        folder / "j.xml",
        "--out",
    )
    done = gcs(*command, folder / "out")
    assert done.exit_code == 0, done.output
    return folder, command


@pytest.mark.slow
def test_a_flight_of_a_comparison_flies_again_to_the_bit_and_nothing_is_expected_of_it(
    compared, tmp_path, monkeypatch
):
    folder, _ = compared
    monkeypatch.chdir(tmp_path)
    flight = f"{folder / 'out' / 'flights' / 's1000-hover'}#2:plain_cascade"
    done = gcs("fly", flight, "--in-process", "--figure", "never")
    assert "the same trajectory to the bit" in done.stderr
    assert "in a comparison nothing is expected" in done.stderr
    assert "setpoint_error_rms_m" not in done.stdout
    assert done.exit_code == 0


@pytest.mark.slow
def test_a_comparison_that_was_interrupted_goes_on_to_the_same_bytes(compared, tmp_path):
    folder, command = compared
    first = gcs(*command, tmp_path / "out")
    assert first.exit_code == 0, first.output
    kept = tmp_path / "out" / "flights" / "s1000-hover"
    before = (kept / "flights.parquet").read_bytes()
    (tmp_path / "out" / results.JSON).unlink()
    (tmp_path / "letter").write_text("dear")
    for name in ("results.png", results.PARQUET):
        (tmp_path / "out" / name).unlink()
        (tmp_path / "out" / name).symlink_to(tmp_path / "letter")
    again = gcs(*command, tmp_path / "out")
    assert again.exit_code == 0, again.output
    assert (tmp_path / "letter").read_text() == "dear"
    assert (kept / "flights.parquet").read_bytes() == before
    for name in (results.JSON, results.PARQUET):
        assert (tmp_path / "out" / name).read_bytes() == (folder / "out" / name).read_bytes()


def test_two_comparisons_do_not_fly_in_one_folder_at_once(tmp_path, hover):
    out = tmp_path / "out"
    with locked(out, "comparison"):
        done = gcs("compare", "mmrac", "--missions", hover, "--out", out)
    assert done.exit_code == 2
    assert "another process flies a comparison in this folder" in done.stderr.replace("\n", " ")
    assert [path.name for path in out.iterdir()] == [".lock"]


@pytest.mark.parametrize(
    ("holds", "said"),
    [
        ("letter", "not empty"),
        ("campaign.json", "not empty"),
        ("result.json", "not empty"),
        ("flights/s1000-drop/campaign.json", "s1000-drop is of another comparison"),
    ],
)
def test_a_comparison_is_not_flown_in_a_folder_of_something_else(tmp_path, hover, holds, said):
    held = tmp_path / "out" / holds
    held.parent.mkdir(parents=True)
    held.write_text("dear")
    done = gcs("compare", "mmrac", "--missions", hover, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert said in done.stderr.replace("\n", " ")
    assert [path for path in (tmp_path / "out").rglob("*") if path.is_file()] == [held]


@pytest.mark.slow
def test_another_comparison_is_refused_in_the_folder_of_one(compared):
    folder, command = compared
    changed = tuple(2 if part == 3 else part for part in command)
    done = gcs(*changed, folder / "out")
    assert done.exit_code == 2
    assert "results.json: of other seeds; name a new folder" in done.stderr.replace("\n", " ")
    part = folder / "out" / "flights" / "s1000-hover"
    done = gcs("campaign", part / "campaign.toml", "--seed", 7, "--out", part)
    assert done.exit_code == 2
    assert "another campaign was flown here: its" in done.stderr.replace("\n", " ")


@pytest.mark.slow
def test_a_comparison_has_the_page_and_the_cases_of_a_campaign(compared):
    folder, _ = compared
    part = folder / "out" / "flights" / "s1000-hover"
    assert not (part / "report.html").exists()  # which takes longer than the flights
    again = gcs("campaign", part)
    assert again.exit_code == 0, again.output
    assert "plain_cascade" in (part / "report.html").read_text()
    assert json.loads((part / "result.json").read_text())["passed"] is True
    suite = ET.parse(folder / "j.xml").getroot()
    assert [each.get("name") for each in suite] == [
        "s1000-hover mmrac",
        "s1000-hover plain_cascade",
    ]
    assert suite.get("failures") == suite.get("errors") == "0"


def crashing(folder: Path, cascade: str) -> Path:
    """A law that writes beyond its memory where it is higher than 0.1 m."""
    text = Path(cascade).read_text()
    assert AT in text
    law = folder / "crashes.py"
    law.write_text(POKE + text.replace(AT, f"{AT}    if measured.r_E.z > 0.1:\n        poke(8)\n"))
    return law


@pytest.mark.slow
def test_a_law_that_ends_its_process_loses_that_flight_of_a_comparison_alone(
    tmp_path, cascade, hover
):
    law = crashing(tmp_path, cascade)
    low = tmp_path / "low.toml"
    low.write_text(hover.read_text().replace("0.2]", "0.0]"))
    command = [
        sys.executable,
        "-m",
        "gcs_tools",
        "compare",
        str(law),
        "--missions",
        f"{low},{hover}",
    ]
    done = subprocess.run(
        [*command, "--seeds", "0..0", "--json"], cwd=tmp_path, capture_output=True, text=True, check=False
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    found = {each["mission"]: each for each in json.loads(done.stdout)["flights"]}
    assert found["low"]["why_lost"] == ""
    assert f"signal {signal.SIGSEGV.value}" in found["hover"]["why_lost"]
    last = done.stderr.splitlines()[-1]
    assert all(part in last for part in ("crashes in hover with seed 0", "1 of its 2 flights"))


@pytest.mark.slow
def test_a_campaign_loses_the_flights_alone_that_end_their_process(tmp_path, cascade, hover):
    crashing(tmp_path, cascade)
    text = """title = "Some end their process."
mission = "hover.toml"
laws = ["crashes.py"]
flights = 6
fly = "law"
[draw]
"flight.setpoints[0].position_m[2]" = { choice = [0.0, 0.5] }
"""
    (tmp_path / "some.toml").write_text(text)
    command = [
        sys.executable,
        "-m",
        "gcs_tools",
        "campaign",
        "some.toml",
        "--out",
        "out",
        "--no-report",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 3, done.stderr
    rows = parquet.read_table(tmp_path / "out" / "flights.parquet").to_pylist()
    high = [row["draw.flight.setpoints[0].position_m[2]"] > 0.0 for row in rows]
    assert len(rows) == 6 > sum(high) > 0
    assert [row["ended"] == "aborted" for row in rows] == high
    assert all(
        "ended its process by signal" in row["error"]
        for row, is_high in zip(rows, high, strict=True)
        if is_high
    )


@pytest.mark.slow
def test_a_worker_that_is_killed_from_outside_is_no_flight_s_doing(tmp_path, hover):
    made = campaign(tmp_path, SEEDS.replace("flights = 4", "flights = 400"))
    kept = Store(tmp_path / "out", made, HERE)
    killed = []

    def kill(_at):
        if not killed:
            worker = next(each for each in multiprocessing.active_children())
            killed.append(worker.pid)
            os.kill(worker.pid, signal.SIGKILL)

    with pytest.raises(RunningError, match="was killed"), processes(1) as workers:
        run(made, kept, workers, Ending.of(made, kept), kill)
    assert 0 < kept.flown < 800
