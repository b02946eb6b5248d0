"""Help that fits a terminal of 80 columns, and says which instances there are."""

from __future__ import annotations

import click
import pytest
from click.testing import CliRunner

from fcu.__main__ import main as fcu
from gcs_tools.cli.program import main
from sitl_plant.__main__ import main as plant
from tests.command_line import gcs


@pytest.mark.parametrize("name", ["", *main.list_commands(click.Context(main))])
def test_no_line_of_help_is_longer_than_a_terminal_is_wide(name: str) -> None:
    said = gcs(*name.split(), "--help")
    assert said.exit_code == 0
    _fits(said.output)


def test_a_speed_that_is_refused_is_not_offered() -> None:
    said = gcs("test", "--help").output
    assert "--speed N " in said
    assert "max" not in said
    assert "max" not in gcs("test", "--speed", "x", "a.py").output
    assert "N|max" in gcs("fly", "--help").output
    assert ", or max" in gcs("fly", "--speed", "x", "hover").output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("campaign paper_noise --flights abc", "'abc': expected a whole number >= 1"),
        ("campaign paper_noise --seed -1", "'-1': expected a whole number from 0 to 9007199254740991"),
        ("record --for 0", "'0': expected a number > 0"),
        ("test --duration x tests", "'x': expected a number from 0.01 to 3600"),
    ],
)  # fmt: skip
def test_a_number_that_is_refused_comes_with_those_that_are_expected(words: str, said: str) -> None:
    done = gcs(*words.split())
    assert done.exit_code == 2
    assert said in done.stderr


@pytest.mark.parametrize("program", [fcu, plant])
def test_nor_is_one_of_the_other_programs(program: click.Command) -> None:
    said = CliRunner().invoke(program, ["--help"])
    assert said.exit_code == 0
    _fits(said.output)


def _fits(text: str) -> None:
    assert [line for line in text.splitlines() if len(line) > 80] == []
    if "--instance" in text:
        assert "0 to 9" in " ".join(text.split()).partition("--instance")[2]
