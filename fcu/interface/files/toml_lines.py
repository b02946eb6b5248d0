"""Lines of a TOML text, by key and array element.

`tomllib` parses TOML and forgets where it was. A message about a mission file should name
the line. This walks a text that `tomllib` has accepted already, so it only has to find
its way, not to judge.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping

KeyPath = tuple[str | int, ...]

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_KEY = re.compile(r"""[A-Za-z0-9_-]+|"(?:\\.|[^"\\\n])*"|'[^'\n]*'""")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}'  # a multi-line string may end with quotes of its own
    r"|'''.*?'{3,5}"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'[^'\n]*'",
    re.DOTALL,
)
_BARE = re.compile(r"[^,\]}#\n]*")


class _Walk:
    """One pass over the text. `found` fills up as it goes."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.found: dict[KeyPath, int] = {}
        self._seen = 0  # up to where lines are counted: a note may be of before it
        self._line = 1  # of that place
        self.lengths: dict[KeyPath, int] = {}  # of arrays of tables, so far

    def take(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.at)
        if match is None:
            raise ValueError(f"cannot find the way at offset {self.at}")
        self.at = match.end()
        return match.group()

    def takes(self, mark: str) -> bool:
        if not self.text.startswith(mark, self.at):
            return False
        self.at += len(mark)
        return True

    def note(self, path: KeyPath) -> None:
        if self.at >= self._seen:
            self._line += self.text.count("\n", self._seen, self.at)
        else:
            self._line -= self.text.count("\n", self.at, self._seen)
        self._seen = self.at
        self.found.setdefault(path, self._line)

    def key(self) -> KeyPath:
        names: list[str | int] = []
        while True:
            self.take(_SPACE)
            name = self.take(_KEY)
            if name[0] in "\"'":
                name = next(iter(tomllib.loads(f"{name} = 0")))
            names.append(name)
            self.take(_SPACE)
            if not self.takes("."):
                return tuple(names)

    def within(self, names: KeyPath) -> KeyPath:
        """`names` with the index of the latest element after each array of tables."""
        path: KeyPath = ()
        for name in names:
            path = (*path, name)
            if path in self.lengths:
                path = (*path, self.lengths[path] - 1)
        return path

    def header(self) -> KeyPath:
        of_array = self.takes("[")
        names = self.key()
        parent, last = self.within(names[:-1]), names[-1]
        if of_array:
            array = (*parent, last)
            self.note(array)
            self.lengths[array] = self.lengths.get(array, 0) + 1
        path = self.within(names)
        self.note_all(path)
        self.take(re.compile(r"\]+"))
        return path

    def note_all(self, path: KeyPath, start: int = 0) -> None:
        for length in range(start + 1, len(path) + 1):
            self.note(path[:length])

    def pair(self, table: KeyPath) -> None:
        self.take(_SPACE)
        at = self.at
        path = (*table, *self.key())
        end, self.at = self.at, at
        self.note_all(path, len(table))
        self.at = end
        self.takes("=")
        self.take(_SPACE)
        self.value(path)

    def value(self, path: KeyPath) -> None:
        if self.takes("["):
            index = 0
            self.take(_BLANK)
            while not self.takes("]"):
                self.note((*path, index))
                self.value((*path, index))
                index += 1
                self.take(_BLANK)
                self.takes(",")
                self.take(_BLANK)
        elif self.takes("{"):
            self.take(_BLANK)
            while not self.takes("}"):
                self.pair(path)
                self.take(_BLANK)
                self.takes(",")
                self.take(_BLANK)
        elif self.text[self.at] in "\"'":
            self.take(_STRING)
        else:
            self.take(_BARE)


def lines(text: str) -> dict[KeyPath, int]:
    """Line number (from 1) of every table, key and array element of a valid TOML text.

    A path is made of keys and indices: `("flight", "setpoints", 0, "at_s")`.
    """
    walk = _Walk(text)
    table: KeyPath = ()
    walk.take(_BLANK)
    while walk.at < len(text):
        if walk.takes("["):
            table = walk.header()
        else:
            walk.pair(table)
        walk.take(_BLANK)
    return walk.found


def nearest(found: Mapping[KeyPath, int], path: KeyPath) -> int | None:
    """Line of `path`, or of the closest thing that holds it. None where nothing does."""
    for length in range(len(path), 0, -1):
        if path[:length] in found:
            return found[path[:length]]
    return None
