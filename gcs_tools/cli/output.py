"""How a command says what it found, and why it ended."""

from __future__ import annotations

import codecs
import errno
import json
import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from io import TextIOWrapper
from pathlib import Path
from typing import IO, Any

import click

from fcu.interface.files.input_file import plain
from gcs_tools.exit_codes import INFRASTRUCTURE

# for who cannot show them; any other character is a question mark there
PLAIN = {"≤": "<=", "≥": ">=", "×": "x", "±": "+-", "·": ".", "°": " deg", "²": "^2", "µ": "u"}


class Failure(click.ClickException):
    """What ended a command, in words, and its exit code."""

    def __init__(self, why: object, exit_code: int = INFRASTRUCTURE) -> None:
        super().__init__(plain(str(why), kept="\n"))
        self.exit_code = exit_code  # type: ignore[misc]


def report_rejected(
    missions: Iterable[str], error: Exception, path: Path | None, are_scripts: bool = False
) -> None:
    """Write a JUnit report of missions of which none can be flown. Without a path, nothing.

    error : why. Its `of`, if it has one, maps a mission to a reason of its own. What cannot be written is
    left out, for the error is told anyway.
    """
    if path is None:
        return
    from gcs_tools.flight.run import versions
    from gcs_tools.judging import result

    of = getattr(error, "of", {})
    with suppress(result.ResultError):
        none = [result.rejected(name, of.get(name, str(error)), versions()) for name in missions]
        result.junit(none, path, are_scripts)


def print_json(content: Any) -> None:
    """On standard output, finite numbers only."""
    print_line(json.dumps(content, allow_nan=False, indent=2))


def print_line(text: str) -> None:
    """On standard output, or nowhere once nobody reads it."""
    try:
        print(text, flush=True)
    except OSError as error:
        if not is_unread(error):
            raise
        silence(sys.stdout)


def write_anywhere() -> None:
    """From here on what a terminal or a file cannot encode is written in plainer characters."""
    codecs.register_error("m-mrac-plain", _plain)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="m-mrac-plain")


def _plain(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    text = error.object[error.start : error.end]
    return "".join(PLAIN.get(character, "?") for character in text), error.end


def is_unread(error: OSError) -> bool:
    """Whether nobody reads a stream any more: its pipe has no reader, or its terminal is closed."""
    return isinstance(error, BrokenPipeError) or error.errno == errno.EIO


def silence(stream: IO[str]) -> None:
    """Let a stream whose reader is gone end in nothing, also what it has still buffered."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
