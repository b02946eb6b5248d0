"""`gcs` without a process of its own, for what needs none: a start costs as much as a short flight."""

from __future__ import annotations

from typing import Any

from click.testing import CliRunner, Result

from gcs_tools.cli.program import main


def gcs(*arguments: Any) -> Result:
    """What a command line does; what is raised and not told fails the test."""
    return CliRunner().invoke(main, [*map(str, arguments)], catch_exceptions=False)
