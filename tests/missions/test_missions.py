"""Every mission that is shipped, and what the stack claims beyond them, flown in process."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

import gcs_tools
from gcs_tools.judging.result import read
from gcs_tools.recording import reader as recording
from tests.patience import PATIENCE_S

MISSIONS = sorted(
    path
    for path in Path(gcs_tools.__file__).parents[1].glob("missions/**/*.toml")
    if path.parent.name != "campaigns"  # each of them is many flights of a mission
)
METRICS = {
    "reference_error_rms_m", "reference_error_rms_settled_m", "reference_error_max_m", "reference_error_final_m",
    "setpoint_error_rms_m", "setpoint_error_rms_settled_m", "setpoint_error_max_m",
    "setpoint_error_final_m", "thrust_saturated_fraction",
    "tilt_saturated_fraction", "torque_saturated_fraction", "yaw_saturated_fraction",
    "rotor_saturated_fraction", "governed_fraction", "margin_min_n",
    "margin_tilt_min_deg", "margin_condition_min_n", "thrust_max_n", "tilt_max_deg",
}  # fmt: skip
KEYS = {
    "mission", "title", "passed", "exit_code", "ended", "seed", "rate_hz", "sim_time_s",
    "wall_time_s", "real_time_factor", "startup_s", "ticks", "slips", "trajectory_sha256",
    "versions", "values", "expectations", "items", "metrics", "settle_s", "folder", "changes", "causes", "not_finite",
    "warnings", "mode", "failsafes",
    "schema_version", "error", "controller", "script",
}  # fmt: skip


@pytest.fixture
def flown(tmp_path):
    """`flown("paper_nominal", "law.f_m=2")`: the result of a flight without sockets."""

    def fly(mission, *settings, figure="never", **options):
        return gcs_tools.fly(
            str(mission), settings=settings, in_process=True, out=tmp_path / "run", figure=figure,
            **options,
        )  # fmt: skip

    return fly


def met(flight):
    """Fail with the expectations missed and the numbers measured."""
    missed = "\n".join(f"[expect] {line}" for line in flight.expectations if not line.passed)
    assert flight.passed, f"{flight.mission} {flight.error or ''}\n{missed}"


@pytest.mark.parametrize("mission", MISSIONS, ids=lambda path: path.stem)
def test_a_mission_meets_its_expectations(flown, mission):
    met(flown(mission, figure="always"))


@pytest.mark.parametrize("rate_hz", [250.0, 1000.0])
def test_the_nominal_flight_is_flown_at_other_rates(flown, rate_hz):
    met(flown("paper_nominal", rate_hz=rate_hz))


@pytest.mark.parametrize(
    ("lag_s", "limit_m"), [(0.02, 0.03), (0.08, 0.03), (0.1, 0.03), (0.15, 0.15)]
)
def test_the_belief_about_the_rotor_lag_may_be_wrong(flown, lag_s, limit_m):
    limit = f"expect.reference_error_rms_settled_m={limit_m}"
    met(flown("paper_nominal", f"plant.rotor_lag_s={lag_s}", limit))


@pytest.mark.parametrize(("f_m", "duration_s", "final_m"), [(2, 20, 0.1), (3, 30, 0.5)])
def test_a_reference_model_that_asks_too_much_settles(flown, f_m, duration_s, final_m):
    met(
        flown(
            "paper_fast", f"law.f_m={f_m}", f"flight.duration_s={duration_s}",
            f"expect.reference_error_final_m={final_m}", "expect.reference_error_max_m=20",
        )
    )  # fmt: skip


@pytest.mark.parametrize("mission", ["paper_printed", "paper_printed_fast"])
def test_with_the_achieved_force_the_printed_flights_are_tracked(flown, mission):
    flight = flown(mission, "law.prediction=achieved")
    assert flight.ended == "time"
    assert flight.metrics["reference_error_rms_settled_m"] <= 0.03


@pytest.mark.parametrize("seed", range(1, 6))
def test_noise_of_any_seed_is_flown_through(flown, seed):
    met(flown("noisy_state", seed=seed))


def test_a_flight_that_diverges_unasked_is_missed(flown, tmp_path):
    flight = flown("paper_printed_fast", "expect.ended=time")
    assert (flight.exit_code, flight.ended, flight.passed) == (1, "diverged", False)
    assert read(tmp_path / "run" / "result.json") == flight


def finite(content):
    if isinstance(content, dict):
        return all(map(finite, content.values()))
    if isinstance(content, list):
        return all(map(finite, content))
    return not isinstance(content, float) or math.isfinite(content)


def test_a_newcomers_first_command(tmp_path):
    """Over the wire, through the command line: everything that a run leaves behind."""
    done = subprocess.run(
        [sys.executable, "-m", "gcs_tools", "fly", "paper_nominal", "--out", "run",
         "--junit", "junit.xml"],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=PATIENCE_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    run = tmp_path / "run"
    content = json.loads((run / "result.json").read_text())
    assert content.keys() == KEYS
    assert content["metrics"].keys() >= METRICS
    assert None not in content["metrics"].values()
    assert finite(content)
    assert content["passed"]
    assert (content["exit_code"], content["ended"]) == (0, "time")
    assert {line["name"] for line in content["expectations"]} > {"reference_error_rms_settled_m"}
    recorded = recording.read(run / "flight.mcap")
    assert recorded.complete
    assert len(recorded.plant) == len(recorded.fcu) == content["ticks"] == 10_000
    assert (run / "flight.png").stat().st_size > 10_000
    assert "waiting for the plant" in (run / "fcu.log").read_text()
    assert (run / "plant.log").exists()
    assert 'failures="0"' in (tmp_path / "junit.xml").read_text()
