"""A folder that is used again: runs in it are replaced, and nothing else is ever removed."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import gcs_tools
from gcs_tools.flight.run_folder import UsageError, alone_in, emptied
from tests.command_line import gcs

SHORT = ("flight.duration_s=0.05",)


def flown(out: Path, **options: object) -> gcs_tools.Result:
    return gcs_tools.fly(
        "gust_step", settings=SHORT, in_process=True, out=out, figure="never", **options
    )


def test_a_run_is_replaced_if_that_is_asked_for(tmp_path: Path) -> None:
    out = tmp_path / "run"
    first = flown(out)
    (out / "flight.png").write_bytes(b"of the run before")
    with pytest.raises(UsageError, match=r"not empty .*--overwrite"):
        flown(out)
    again = flown(out, overwrite=True)
    assert again.trajectory_sha256 == first.trajectory_sha256
    assert not (out / "flight.png").exists()


@pytest.mark.parametrize("name", ["notes.txt", "elsewhere"])
def test_what_no_run_left_is_not_removed(tmp_path: Path, name: str) -> None:
    out = tmp_path / "mine"
    (out / "a").mkdir(parents=True)
    (out / "a" / "result.json").write_text("{}")
    (out / name).write_text("mine")
    with pytest.raises(UsageError, match=f"{name} was not left by a run"):
        emptied(out)
    assert (out / "a" / "result.json").exists()
    (out / name).unlink()
    emptied(out)
    assert list(out.iterdir()) == []


@pytest.mark.parametrize("name", ["letter.txt", "folder", "result.toml"])
def test_a_folder_with_a_result_and_anything_else_is_left_as_it_is(
    tmp_path: Path, name: str
) -> None:
    """Somebody's home, into which a result was copied."""
    (tmp_path / "result.json").write_text("{}")
    if name == "folder":
        (tmp_path / name).mkdir()
    else:
        (tmp_path / name).write_text("mine")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(UsageError, match=f"{name} was not left by a run"):
        emptied(tmp_path)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("name", ["holiday.png", "server.log", "drawing.svg", "list.jsonl"])
def test_a_file_is_a_runs_by_its_name_not_by_its_kind(tmp_path: Path, name: str) -> None:
    (tmp_path / "result.json").write_text("{}")
    (tmp_path / name).write_text("mine")
    with pytest.raises(UsageError, match=f"{name} was not left by a run"):
        emptied(tmp_path)
    assert (tmp_path / name).exists()


@pytest.mark.parametrize("mark", ["settings.json", "flight.mcap", "world.json"])
def test_what_a_killed_run_left_is_removed(tmp_path: Path, mark: str) -> None:
    for name in (mark, "fcu.log", "plant.jsonl", ".result.json.abc"):
        (tmp_path / name).write_text("")
    emptied(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_what_its_script_left_is_of_the_run(tmp_path: Path) -> None:
    told = {"script": {"files": ["square.csv", "figures"]}}
    (tmp_path / "result.json").write_text(json.dumps(told))
    (tmp_path / "square.csv").write_text("1,2")
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "a.png").write_text("")
    (tmp_path / "mine.csv").write_text("3,4")
    with pytest.raises(UsageError, match=r"mine\.csv was not left by a run"):
        emptied(tmp_path)
    (tmp_path / "mine.csv").unlink()
    emptied(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_of_one_runner_at_a_time(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with alone_in(out), pytest.raises(UsageError, match="another run is being written there"):
        flown(out)
    assert flown(out).ticks


def test_a_link_is_not_followed(tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    (there / "result.json").write_text("{}")
    (tmp_path / "out").symlink_to(there)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "one").symlink_to(there)
    for out in ("out", "runs"):
        with pytest.raises(UsageError, match="was not left by a run"):
            emptied(tmp_path / out)
    assert (there / "result.json").exists()


def test_a_mission_has_one_name_in_a_report_whether_it_can_be_flown_or_not(tmp_path: Path) -> None:
    folder = tmp_path / "sub"
    folder.mkdir()
    text = (Path(__file__).parents[2] / "missions" / "gust_step.toml").read_text()
    (folder / "good.toml").write_text(text)
    (folder / "bad.toml").write_text(text + "\n[nothing]\n")
    done = gcs(
        "fly", folder / "good.toml", folder / "bad.toml", "--set", *SHORT, "--in-process", "--figure",
        "never", "--record", "none", "--junit", tmp_path / "junit.xml", "--out", tmp_path / "out",
    )  # fmt: skip
    assert done.exit_code == 2
    cases = ET.parse(tmp_path / "junit.xml").getroot().findall("testcase")
    assert sorted(case.get("name", "") for case in cases) == ["bad", "good"]
