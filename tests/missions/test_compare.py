"""Several flights: of many seeds, side by side, in one figure; and runs by their folders."""

from __future__ import annotations

import inspect
import json
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, get_type_hints

import pytest
from click.testing import CliRunner, Result

import gcs_tools
from gcs_tools.cli.program import main
from gcs_tools.judging import comparison, result
from gcs_tools.recording import reader


def called(*arguments: Any) -> Result:
    return CliRunner().invoke(main, list(map(str, arguments)))


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two hovers, of two seconds, in gusts of which the second's are stronger."""
    folder = tmp_path_factory.mktemp("runs")
    for name, gust in (("calm", 2.0), ("windy", 6.0)):
        flown = gcs_tools.fly(
            "gust_step", settings=["flight.duration_s=7", "wind.step_at_s=5", "expect.reached=true",
            "expect.reference_error_max_m=1", f"wind.step_m_s=[{gust}, 0.0, 0.0]"],
            in_process=True, out=folder / name, figure="never",
        )  # fmt: skip
        assert flown.passed and flown.folder == str(folder / name)
    return [folder / "calm", folder / "windy"]


def test_every_seed_is_flown_counted_and_named(tmp_path: Path) -> None:
    report = tmp_path / "junit.xml"
    done = called(
        "fly", "noisy_state", "--seed", "2..4", "--in-process", "--record", "none", "--figure",
        "never", "--set", "flight.duration_s=6", "--out", tmp_path / "runs", "--junit", report,
    )  # fmt: skip
    folders = [f"noisy_state-seed-{seed}" for seed in (2, 3, 4)]
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == folders
    left = [result.read(tmp_path / "runs" / name / "result.json") for name in folders]
    assert [each.seed for each in left] == [2, 3, 4]
    assert len({each.trajectory_sha256 for each in left}) == 3
    passed = sum(each.passed for each in left)
    assert done.stdout.splitlines()[-1].startswith(f"{passed} of 3 passed in ")
    assert "changed: flight.duration_s = 6 (--set), flight.seed = 3 (--seed)" in done.stdout
    names = [case.get("name") for case in ET.parse(report).getroot()]
    assert names == [f"noisy_state seed {seed}" for seed in (2, 3, 4)]


def test_those_that_failed_are_named(tmp_path: Path) -> None:
    done = called(
        "fly", "noisy_state", "--seed", "2..3", "--in-process", "--record", "none", "--figure",
        "never", "--set", "flight.duration_s=1", "--set", "expect.ended=crashed",
        "--out", tmp_path / "runs",
    )  # fmt: skip
    assert done.exit_code == 1
    last = done.stdout.splitlines()[-1]
    assert last.startswith("0 of 2 passed in ")
    assert last.endswith(" s; failed: noisy_state-seed-2, noisy_state-seed-3")


@pytest.mark.parametrize("seeds", ["3..1", "-1", "1..", "one", "1..1001"])
def test_seeds_that_are_none_are_refused(seeds: str) -> None:
    done = called("fly", "noisy_state", f"--seed={seeds}")
    assert done.exit_code == 2
    assert "Invalid value for '--seed'" in done.stderr


def test_metrics_are_told_with_their_differences_and_what_was_flown(runs: list[Path]) -> None:
    done = called("compare", *runs, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert [run["name"] for run in found["runs"]] == ["calm", "windy"]
    first, second = (run["metrics"]["reference_error_max_m"] for run in found["runs"])
    (differences,) = found["differences"]
    assert differences["reference_error_max_m"] == second - first > 0.0
    assert found["values"] == {"wind.step_m_s": ["[2.0, 0.0, 0.0]", "[6.0, 0.0, 0.0]"]}
    table = called("compare", *runs).stdout
    assert "2 flights; 2 of 2 passed" in table
    assert "wind.step_m_s: [2.0, 0.0, 0.0], [6.0, 0.0, 0.0]" in table


def test_a_recording_has_the_metrics_of_its_result(runs: list[Path]) -> None:
    """Whichever of the two a run is given by, and whatever of the two is left."""
    done = called("compare", runs[0] / "result.json", runs[0] / "flight.mcap", "--json")
    found = json.loads(done.stdout)
    of_result, of_recording = (run["metrics"] for run in found["runs"])
    assert of_result == pytest.approx(of_recording)
    assert found["values"] == {}


def test_of_an_older_result_the_recording_is_read(runs: list[Path], tmp_path: Path) -> None:
    old = shutil.copytree(runs[1], tmp_path / "old")
    (old / "result.json").write_text('{"schema_version": 1}')
    done = called("compare", runs[1], old, "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["differences"][0]["reference_error_max_m"] == pytest.approx(0.0)
    (old / "flight.mcap").unlink()
    done = called("compare", runs[1], old)
    assert done.exit_code == 2
    assert "a result of version 1" in done.stderr


def test_of_many_flights_least_mean_and_most_are_told(runs: list[Path]) -> None:
    done = called("compare", *runs, *runs, runs[1])
    (line,) = (row for row in done.stdout.splitlines() if row.startswith("reference_error_max_m"))
    _, least, mean, most, *_ = line.split()
    assert 0.0 < float(least) < float(mean) < float(most)
    assert float(mean) == pytest.approx((2 * float(least) + 3 * float(most)) / 5, rel=1e-3)


def test_flights_that_are_equal_are_said_to_be(runs: list[Path]) -> None:
    assert "one trajectory, bit for bit" in called("compare", runs[0], runs[0]).stdout
    assert "one trajectory" not in called("compare", *runs).stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "Missing argument"),
        (["RUN"], "expected two runs or more"),
        (["RUN", "nowhere"], "nowhere: No such file"),
        (["RUN", "RUN", "--figure", "a.gif"], "ends in none of png, svg, pdf"),
    ],
)
def test_what_cannot_be_compared_is_refused(runs: list[Path], arguments, said) -> None:
    done = called("compare", *(runs[0] if each == "RUN" else each for each in arguments))
    assert done.exit_code == 2
    assert said in done.stderr


@pytest.mark.parametrize("command", ["plot", "compare"])
def test_errors_of_several_flights_are_one_figure(runs, tmp_path, command) -> None:
    out = tmp_path / "errors.svg"
    done = called(command, *runs, "--out" if command == "plot" else "--figure", out)
    assert done.exit_code == 0, done.output
    drawn = out.read_text(encoding="utf-8")
    for text in ("calm", "windy", "Distance from the setpoint that the mission asks for, m"):
        assert text in drawn


def test_the_numbers_of_that_figure_are_those_of_the_verdicts(runs, tmp_path) -> None:
    done = called("plot", *runs, "--out", tmp_path / "errors.png", "--json")
    found = json.loads(done.stdout)["errors"]["runs"]
    for run in runs:
        flown = result.read(run / "result.json").metrics
        assert found[run.name] == pytest.approx({name: flown[name] for name in found[run.name]})


def test_flights_are_drawn_over_each_other(runs, tmp_path) -> None:
    out = tmp_path / "over.svg"
    done = called("plot", *runs, "--what", "position,margin", "--out", out)
    assert done.exit_code == 0, done.output
    drawn = out.read_text(encoding="utf-8")
    for text in ("calm", "windy", "Position up, m", "Margin of the condition, N"):
        assert text in drawn
    assert str(tmp_path) not in drawn


@pytest.mark.parametrize("what", ["estimates", "positon", ""])
def test_what_cannot_be_drawn_over_each_other_is_refused(runs, what) -> None:
    done = called("plot", *runs, "--what", what)
    assert done.exit_code == 2
    assert "there are errors, position" in done.stderr


def test_flights_are_called_by_what_tells_them_apart() -> None:
    paths = [Path("/a/one/run"), Path("/b/one/run"), Path("/b/two/run"), Path("/b/two/run")]
    assert comparison.distinct(paths) == [
        "a/one/run",
        "b/one/run",
        "b/two/run (1)",
        "b/two/run (2)",
    ]
    assert comparison.distinct(paths[1:3]) == ["one/run", "two/run"]
    assert comparison.distinct([Path("/x/calm"), Path("/x/windy")]) == ["calm", "windy"]


def test_a_table_of_flights_fits_80_columns(runs, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    long = tmp_path / ("a" * 60)
    shutil.copytree(runs[0], long)
    lines = called("compare", runs[0], long, runs[1]).stdout.splitlines()
    rows = [line for line in lines if line.startswith(("reference_error", "setpoint_error"))]
    assert rows and all(len(row) <= 80 and "…" not in row for row in rows)
    assert lines[1] == f"B  {long.name}"


def test_a_runs_folder_does_wherever_its_recording_does(runs, tmp_path) -> None:
    run = shutil.copytree(runs[0], tmp_path / "run")
    assert called("plot", run, "--what", "tracking").exit_code == 0
    assert (run / "flight-tracking.png").is_file()
    assert f"{run / 'flight.mcap'}: " in called("recover", run).stdout
    (run / "flight.mcap").unlink()
    for command in ("plot", "recover", "replay", "view"):
        done = called(command, run)
        assert done.exit_code == 2
        assert "there is no flight.mcap in this folder" in done.stderr


def test_flying_from_python_is_typed_and_documented() -> None:
    options = inspect.signature(gcs_tools.fly).parameters
    assert all(option.kind is not option.VAR_KEYWORD for option in options.values())
    hints = get_type_hints(gcs_tools.fly)
    assert hints.keys() == {*options, "return"} and Any not in hints.values()
    assert hints["return"] is result.Result
    for name in options:
        assert name in (gcs_tools.fly.__doc__ or "")


def test_a_run_is_found_by_its_result(runs) -> None:
    left = result.read(runs[0] / "result.json")
    assert reader.read(Path(left.folder) / "flight.mcap").complete


def test_where_their_figure_is_is_told_and_none_is_overwritten(runs, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = "-".join(run.name for run in runs[:2])
    for end in ("", "-1"):
        path = tmp_path / f"errors-{names}{end}.svg"
        assert not path.exists()
        done = called("plot", *runs[:2], "--format", "svg")
        assert done.exit_code == 0, done.output
        assert done.stdout.startswith(f"{path.name}  errors of 2 flights")
        assert path.is_file()
    (tmp_path / "figures").mkdir()
    done = called("plot", *runs[:2], *runs[:2], "--out", "figures", "--format", "svg")
    assert done.stdout.startswith(f"figures/errors-{runs[0].name}-and-3-more.svg")
