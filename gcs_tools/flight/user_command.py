"""A command of a user's: its words, the values in braces, and its process on a leash."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from fcu.interface.files.spelling import closest
from gcs_tools.flight.processes import SUSPENDED, Child, is_stopped

_WORD = re.compile(r"\{([a-z_]+)\}")
_OPEN = re.compile(r"\{([a-z_]+)(?![a-z_}])")
SCRIPT_WORDS = ("url", "mavsdk_url", "tcp_url", "port", "instance", "system_id", "out", "speed")
PYTHON = ("python", "python3")  # the Python that runs this program


class CommandError(ValueError):
    """A command that cannot be run: what is wrong, and what was expected."""


def command_words(text: str, names: Collection[str], folder: Path = Path()) -> tuple[str, ...]:
    """The words of a command line that runs in `folder`. Raises CommandError.

    names : what may stand in braces.
    """
    try:
        words = tuple(shlex.split(text))
    except ValueError as error:
        raise CommandError(f"{text!r}: {error}") from error
    if not words:
        raise CommandError("expected a command, got nothing")
    if (sign := _shell_sign(text)) is not None:
        raise CommandError(
            f"{sign!r}: no shell runs this command. Quote it if it is a part of a word, or have a shell run all:"
            " sh -c '...'"
        )
    if "\0" in text or text != text.encode(errors="replace").decode():
        raise CommandError(f"{text!r}: expected text without null characters")
    _is_there(words, folder)
    for name in (name for word in words for name in _WORD.findall(word)):
        close = closest(name, names)
        if name not in names and close is not None:
            raise CommandError(
                f"{{{name}}}: did you mean {{{close}}}? Expected one of {', '.join(names)}"
            )
    for name in (name for word in words for name in _OPEN.findall(word)):
        if name in names:
            raise CommandError(f"{{{name}: expected a closing brace, {{{name}}}")
    return words


def _shell_sign(text: str) -> str | None:
    """The first sign outside quotes that means something to a shell alone. None: there is none."""
    lexer = shlex.shlex(text, posix=False, punctuation_chars=";<>|&")
    lexer.whitespace_split, lexer.commenters = True, ""
    try:
        return next((word for word in lexer if not word.strip(";<>|&")), None)
    except ValueError:  # quotes within quotes, which this reader of words does not follow
        return None


def _is_there(words: Sequence[str], folder: Path) -> None:
    """Raises CommandError if the program, or the file that is Python's to run, is not there."""
    if words[0] in PYTHON:
        file = words[1] if len(words) > 1 else ""
        if file.endswith(".py") and not _WORD.search(file) and not (folder / file).is_file():
            raise CommandError(f"{file}: no such file in {folder.absolute()}")
        return
    program = (folder / words[0]).absolute()
    if shutil.which(str(program) if "/" in words[0] else words[0]) is not None:
        return
    if program.is_file():
        way = (
            f"./{words[0]}"
            if os.access(program, os.X_OK)
            else f"chmod +x {words[0]}, or python {words[0]}"
        )
        if "/" not in words[0] or not os.access(program, os.X_OK):
            raise CommandError(f"{words[0]}: this file is not run by its name alone: {way}")
    if "/" in words[0]:
        raise CommandError(f"{words[0]}: no such program in {folder.absolute()}")
    raise CommandError(f"{words[0]}: no such program (a file needs its path)")


def names_one_of(words: Sequence[str], names: Collection[str]) -> bool:
    """True if a command is told one of these values."""
    return any(f"{{{name}}}" in word for word in words for name in names)


def filled(words: Sequence[str], told: Mapping[str, str]) -> list[str]:
    """A command with its values in place. What else stands in braces stays."""
    return [_WORD.sub(lambda found: told.get(found[1], found[0]), word) for word in words]


def with_python(words: Sequence[str]) -> list[str]:
    """A command whose `python` is the Python that runs this program, with its packages."""
    return [sys.executable, *words[1:]] if words[0] in PYTHON else list(words)


class Leashed(Child):
    """The process of a command, which ends with its starter and leaves no process behind."""

    def __init__(
        self, name: str, words: Sequence[str], folder: Path, log: Path, lifeline: int
    ) -> None:
        """`folder`: where it runs. `lifeline`: a file descriptor, which is closed on our side."""
        arguments = [str(lifeline), str(folder), *words]
        super().__init__(name, "gcs_tools.flight.leash", arguments, log, (lifeline,))
        self._pid = 0

    def outcome(self) -> dict[str, Any] | None:
        """The leash's report of a command that has ended. None: it runs. Empty: the leash was killed."""
        return None if self.process.poll() is None else self._last_said()

    def pid(self) -> int:
        """The process of the command. 0: it has not begun."""
        for line in self.heard():
            self._pid = line.get("pid", self._pid)
        return self._pid

    def how_it_is(self) -> str:
        """The reason why the command does not answer, as far as it is seen from outside. Empty: not seen."""
        return f"its process {SUSPENDED}" if self.pid() and is_stopped(self._pid) else ""
