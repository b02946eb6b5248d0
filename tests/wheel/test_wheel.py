"""The wheel without the checkout: missions and airframes by name, laws, campaigns and scripts of a user's."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from fcu.kernel import compile
from tests.wheel.conftest import ROOT, Bare


def files(bare: Bare) -> dict[str, int]:
    """Our files in the environment, with the time at which each was written."""
    return {
        str(path): path.stat().st_mtime_ns
        for name in ("fcu", "gcs_tools", "sitl_plant")
        for path in (bare.packages / name).rglob("*")
        if path.is_file()
    }


def test_the_wheel_imports_no_file_of_the_checkout(bare: Bare, tmp_path: Path) -> None:
    show = "import fcu, gcs_tools, sitl_plant as s; print(*(m.__path__[0] for m in (fcu, gcs_tools, s)))"
    done = bare.run(tmp_path, "python", "-c", show)
    assert done.stdout.split() == [
        str(bare.packages / name) for name in ("fcu", "gcs_tools", "sitl_plant")
    ]
    for left_out in ("gcs_tools.studies", "fcu.theory"):
        assert bare.run(tmp_path, "python", "-c", f"import {left_out}").returncode == 1
    assert bare.run(tmp_path, "python", "-c", "import gcs_tools.judging.envelope").returncode == 0


def test_the_wheel_uses_what_the_checkout_has_compiled(bare: Bare, tmp_path: Path) -> None:
    show = "import fcu.kernel.compile as c; print(c.FINGERPRINT)"
    assert bare.run(tmp_path, "python", "-c", show).stdout.split() == [compile.FINGERPRINT]


def test_a_mission_by_name_is_the_flight_of_the_checkout(bare: Bare, tmp_path: Path) -> None:
    before = files(bare)
    done = bare.run(
        tmp_path, "gcs", "fly", "paper_nominal", "--in-process", "--json", "--out", "run"
    )
    assert done.returncode == 0, done.stderr
    (result,) = json.loads(done.stdout)
    assert result["trajectory_sha256"].startswith("4066f19aaf12")
    assert (tmp_path / "run" / "flight.mcap").stat().st_size > 0
    assert files(bare) == before  # so the packages may be read-only


@pytest.mark.parametrize(
    ("arguments", "copied"),
    [
        (["fly", "airframe_step", "--airframe", "quad"], []),
        (["fly", "step_in_still_air.toml", "--law", "plain_cascade.py"],
         ["own_law/step_in_still_air.toml", "own_law/plain_cascade.py"]),
        (["fly", "hop.toml", "--allow-commands"], ["scripts/hop.toml", "scripts/hop.py"]),
        (["test", "--speed", "8", "hop.py", "{url}"], ["scripts/hop.py"]),
        (["campaign", "paper_noise", "--flights", "4"], []),
    ],
    ids=["airframe", "law", "script-mission", "script", "campaign"],
)  # fmt: skip
def test_the_wheel_flies_a_mission(
    bare: Bare, tmp_path: Path, arguments: list[str], copied: list[str]
) -> None:
    for name in copied:
        shutil.copy(ROOT / "tests" / name, tmp_path)
    before = files(bare)
    done = bare.run(tmp_path, "gcs", arguments[0], "--out", "run", *arguments[1:])
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "result.json").is_file()
    assert files(bare) == before
