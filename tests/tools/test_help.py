"""Help that fits a terminal of 80 columns."""

from __future__ import annotations

import click
import pytest

from gcs_tools.cli.program import main
from tests.command_line import gcs


@pytest.mark.parametrize("name", ["", *main.list_commands(click.Context(main))])
def test_no_line_of_help_is_longer_than_a_terminal_is_wide(name: str) -> None:
    said = gcs(*name.split(), "--help")
    assert said.exit_code == 0
    assert [line for line in said.output.splitlines() if len(line) > 80] == []
