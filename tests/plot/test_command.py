"""`gcs plot`, on recordings that are whole, cut short, not recordings at all."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from gcs_tools.cli import plot as commands_plot
from gcs_tools.cli.program import main
from gcs_tools.pictures.plot.figures import FORMATS, STANDARD
from gcs_tools.recording import reader as recording
from gcs_tools.recording.writer import RecordingWriter


@pytest.fixture
def run(made: Any, tmp_path: Path) -> Path:
    """A recording of both processes, on file."""
    made.set_plant(**{"state.r_E.x": 0.02})
    return written(made, tmp_path / "flight.mcap")


@pytest.fixture
def brief(make: Callable[..., Any], tmp_path: Path) -> Path:
    """A recording of 0.1 s: most of the time of `gcs plot` is the reading."""
    return written(make(0.1), tmp_path / "flight.mcap")


def written(made: Any, path: Path, reports: bool = True) -> Path:
    whole = made.recording()
    with RecordingWriter(path, made.metadata) as recorder:
        recorder.set_params(made.params)
        plant, fcu = (made.plant, made.fcu) if reports else (whole.plant.rows, whole.fcu.rows)
        for i in range(0, len(plant), 500):  # both sides side by side, as in a flight
            recorder.add_plant(plant[i : i + 500])
            recorder.add_fcu(fcu[i : i + 500])
    return path


def called(*arguments: Any) -> Result:
    return CliRunner().invoke(main, ["plot", *map(str, arguments)])


def test_the_command_knows_what_can_be_drawn() -> None:
    """Its own lists, so that --help need not import the figures, are those of the figures."""
    assert tuple(STANDARD) == commands_plot.NAMES
    assert commands_plot.FORMATS == FORMATS


@pytest.mark.slow
def test_plot_draws_all_figures_in_a_process(run: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "gcs_tools", "plot", str(run)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    for line, name in zip(lines, STANDARD, strict=True):
        assert line.startswith(f"{run.parent / f'flight-{name}.png'}  {name}: ")
        assert (run.parent / f"flight-{name}.png").stat().st_size > 10_000
    assert "tracking: settled RMS 2 cm off the reference, worst 2 cm" in lines[1]


@pytest.mark.computes
def test_plot_draws_one_figure_into_a_file(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "report.svg"
    done = called(run, "--what", "tracking", "--out", out, "--json", "--from", 6, "--to", 7)
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert list(found) == ["tracking"]
    assert found["tracking"]["path"] == str(out)
    assert found["tracking"]["reference_error_rms_settled_m"] == pytest.approx(0.02)
    assert out.read_text(encoding="utf-8").startswith("<?xml")


@pytest.mark.slow
def test_plot_draws_some_figures_into_a_folder(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "for" / "the report"
    done = called(run, "--what", "limits,wind", "--out", out, "--format", "pdf")
    assert done.exit_code == 0, done.output
    assert sorted(p.name for p in out.iterdir()) == ["flight-limits.pdf", "flight-wind.pdf"]


@pytest.mark.slow
def test_what_is_missing_is_said_and_matters_only_if_asked_for(made: Any, tmp_path: Path) -> None:
    run = written(made, tmp_path / "flight.mcap", reports=False)
    done = called(run, "--json")
    assert done.exit_code == 0, done.output
    assert "timing: not drawn" in done.stderr and "Error" not in done.stderr
    found = json.loads(done.stdout)
    assert found["timing"]["path"] is None and "no timing" in found["timing"]["missing"]
    assert found["tracking"]["path"] == str(tmp_path / "flight-tracking.png")

    asked = called(run, "--what", "tracking,timing")
    assert asked.exit_code == 2
    assert "Error: timing: not drawn, neither /fcu/timing nor /plant/timing" in asked.stderr
    assert "tracking: settled" in asked.stdout


@pytest.mark.computes
def test_a_recording_cut_short_is_drawn_and_it_is_said(
    make: Callable[..., Any], tmp_path: Path
) -> None:
    run = written(make(4.0), tmp_path / "flight.mcap")
    data = run.read_bytes()
    run.write_bytes(data[: len(data) // 2])
    done = called(run, "--what", "tracking", "--format", "svg")
    assert done.exit_code == 0, done.output
    assert "cut short after" in done.stderr
    assert "cut short after" in (tmp_path / "flight-tracking.svg").read_text(encoding="utf-8")


@pytest.mark.computes
def test_lost_messages_are_said(
    make: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    run = tmp_path / "flight.mcap"
    lossy = replace(make(0.1).recording(run), lost={"/fcu/law": 12, "/plant/truth": 1})
    monkeypatch.setattr(recording, "read", lambda _: lossy)
    done = called(run, "--what", "limits")
    assert done.exit_code == 0
    assert "Messages lost: 12 of /fcu/law, 1 of /plant/truth." in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--what", "trackin"], "did you mean tracking?"),
        (["--what", "limits,"], "no figure ''"),
        (["--out", "a.png"], "a folder for 7 figures"),
        (["--what", "wind", "--out", "a.gif"], "ends in none of png, svg, pdf"),
        (["--what", "wind", "--out", "a.pdf", "--format", "png"], "is not --format png"),
        (["--from", "9"], "has 0 to 0.098 s"),
        (["--to", "-1"], "has 0 to 0.098 s"),
        (["--from", "3", "--to", "2"], "--from 3 is not before --to 2"),
        (["--from", "nan"], "has 0 to 0.098 s"),
        (["--what", "wind", "--out", "no/where/a.png"], "no/where/a.png: No such file"),
    ],
)
@pytest.mark.computes
def test_a_bad_command_line_is_refused(brief: Path, arguments: list[str], said: str) -> None:
    done = called(brief, *arguments)
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.split())
    assert [p.name for p in brief.parent.iterdir()] == ["flight.mcap"]


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    done = called(tmp_path / "gone.mcap")
    assert done.exit_code == 2 and "gone.mcap: No such file" in done.stderr
    (tmp_path / "text.mcap").write_text("not a recording")
    done = called(tmp_path / "text.mcap")
    assert done.exit_code == 2 and "text.mcap: " in done.stderr and done.stdout == ""


@pytest.mark.computes
def test_a_full_disk_is_an_error(brief: Path, tmp_path: Path) -> None:
    (tmp_path / "flight-wind.pdf").symlink_to("/dev/full")
    done = called(brief, "--what", "wind", "--format", "pdf")
    assert done.exit_code == 2
    assert f"Error: {tmp_path / 'flight-wind.pdf'}: No space left" in done.stderr


def test_a_folder_in_the_way_is_an_error(brief: Path, tmp_path: Path) -> None:
    (tmp_path / "flight-wind.png").mkdir()
    done = called(brief, "--what", "wind")
    assert done.exit_code == 2
    assert f"Error: {tmp_path / 'flight-wind.png'}: Is a directory" in done.stderr
