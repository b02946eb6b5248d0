"""The scripts in the README, as they stand there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from fcu.interface.status_texts import Code
from gcs_tools.recording.events import logged

README = Path(__file__).parents[2] / "README.md"
SCRIPTS = {
    "pymavlink" if "pymavlink" in code else "mavsdk": code
    for code in re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
}


def test_the_pymavlink_script_is_short():
    assert len(SCRIPTS["pymavlink"].splitlines()) <= 15


@pytest.mark.parametrize("name", ["pymavlink", "mavsdk"])
def test_the_pymavlink_script_flies_and_lands(vehicle, run, tmp_path, name):
    up = vehicle("--speed", "4")
    script = tmp_path / "script.py"
    script.write_text(SCRIPTS[name].replace("14540", str(up.ports.script)))
    run(script)
    (folder,) = (up.folder / "runs").iterdir()
    codes = [event.code for event in logged(folder)]
    assert Code.DISARMED_LANDED.name in codes


def test_the_script_of_the_guards_readme_sets_beliefs(vehicle, run, tmp_path):
    text = (README.parent / "fcu/guard/README.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (printed,) = re.findall(r"```\n(MR_M_MAX.*?)```", text, re.DOTALL)
    up = vehicle()
    script = tmp_path / "script.py"
    script.write_text(code.replace("14540", str(up.ports.script)))
    assert run(script).strip().endswith(printed.strip())
