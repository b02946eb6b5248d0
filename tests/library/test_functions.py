"""The functions of `from gcs_tools import ...`: typed, as their page says, and the commands' work."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any, get_type_hints

import pytest

import gcs_tools
from gcs_tools.library.page import page

ROOT = Path(__file__).parents[2]
USE = """
import numpy as np
from gcs_tools import airframe, campaign, compare, fly, read, tune

passed: bool = fly("gust_step", in_process=True).passed
height: float = float(read("run").plant["state.r_E.z"][-1])
worse: list[str] = [each.metric for held in compare("a", "b", exact=True) for each in held.worse]
share: int = campaign("c.toml", out="o").analysis.laws[0].success.successes
gains: float = tune("px4").best.cost
flies: bool = airframe("hexa").flies
"""


@pytest.mark.computes
def test_the_page_is_what_the_docstrings_say():
    assert (ROOT / "docs/python.md").read_text(encoding="utf-8") == page()  # if not: make schemas


@pytest.mark.parametrize("name", gcs_tools.FUNCTIONS)
def test_each_function_is_typed_and_documented(name):
    function = getattr(gcs_tools, name)
    names = [*inspect.signature(function).parameters, "return"]
    assert set(function.__annotations__) == set(names)
    assert "Any" not in [str(function.__annotations__[each]) for each in names]
    text = inspect.getdoc(function)
    assert text is not None and "Raises" in text
    for each in names[:-1]:
        assert each in text


@pytest.mark.slow
def test_a_type_checker_knows_what_they_return(tmp_path):
    (tmp_path / "use.py").write_text(USE)
    for text, found in ((USE, 0), (USE.replace("passed: bool", "passed: str"), 1)):
        (tmp_path / "use.py").write_text(text)
        done = subprocess.run(
            [sys.executable, "-m", "mypy", "--config-file", ROOT / "pyproject.toml", tmp_path / "use.py"],
            cwd=ROOT, capture_output=True, text=True, timeout=300,
        )  # fmt: skip
        assert done.returncode == found, done.stdout


@pytest.mark.slow
def test_importing_the_package_imports_none_of_it():
    code = "import sys, gcs_tools; print(*[m for m in sys.modules if m.startswith(('numpy', 'gcs_tools.'))])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


SHORT = ("flight.duration_s=6", "expect={reference_error_max_m=0.1,reached=false}")


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> list[Path]:
    out = tmp_path_factory.mktemp("runs")
    for name, more in (("one", ()), ("other", ("law.f_m=1.9",))):
        gcs_tools.fly(
            "noisy_state", settings=[*SHORT, *more], in_process=True, out=out / name, seed=1
        )  # fmt: skip
    return [out / "one", out / "other"]


@pytest.mark.computes
def test_a_recording_is_read_by_the_names_of_its_columns(runs):
    recording = gcs_tools.read(runs[0])
    assert recording.plant["state.r_E"].shape == (3000, 3)
    assert "fcu" in recording._repr_html_()


@pytest.mark.computes
def test_a_result_shows_itself_with_its_figure(runs):
    result = gcs_tools.fly(
        "noisy_state", settings=SHORT, in_process=True, out=runs[0], overwrite=True, seed=1
    )  # fmt: skip
    shown = result._repr_html_()
    for text in (
        "noisy_state seed 1, passed",
        "reference_error_rms_settled_m",
        "data:image/png;base64,",
    ):
        assert text in shown


@pytest.mark.computes
def test_flights_are_held_against_a_baseline(runs):
    (held,) = gcs_tools.compare(runs[1], runs[0], exact=True)
    assert not held.passed and held.changed == {"law.f_m": ["1.9", "2.0"]}
    assert gcs_tools.compare(runs[0], runs[0])[0].passed


@pytest.mark.computes
def test_an_airframe_is_checked():
    assert gcs_tools.airframe("hexa").flies


@pytest.mark.slow
def test_a_campaign_is_flown_and_goes_on(tmp_path):
    (tmp_path / "c.toml").write_text(
        'title = "Noise."\nmission = "gust_step"\nflights = 4\nset = { "flight.duration_s" = 6.0 }\n'
        '[draw]\n"plant.mass_kg" = { uniform = [0.95, 1.05], relative = true }\n'
        "[success]\nreference_error_max_m = 0.1\n"
    )
    found: Any = None
    for _ in range(2):
        found = gcs_tools.campaign(tmp_path / "c.toml", out=tmp_path / "out", jobs=1)
    assert found.passed and found.flights.num_rows == 4
    assert "4 of 4" in found._repr_html_()


def test_hints_can_be_resolved():
    assert get_type_hints(gcs_tools.fly)["return"].__name__ == "Result"
