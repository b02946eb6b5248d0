"""TOML files that a person wrote: their tables, and messages that name file and line."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from fcu.interface.files import input_file
from fcu.interface.files.input_file import MIB, TomlError
from fcu.interface.files.toml_lines import KeyPath, lines, nearest

MOST_BYTES = MIB // 4  # of a file of tables and keys, if a room does not say another size


class FileError(ValueError):
    """A file that cannot be read as TOML: file, line if known, and what was expected."""


@dataclass(frozen=True)
class TomlFile:
    """A file that has been read."""

    source: str  # the file, as messages name it
    text: str
    tables: dict[str, Any]

    @cached_property
    def lines(self) -> Mapping[KeyPath, int]:
        """Line of each table, key and array element."""
        return lines(self.text)

    @cached_property
    def sha256(self) -> str:
        """The hash of the text, in hex."""
        return digest(self.text)

    def where(self, *path: str | int) -> str:
        """`FILE:LINE` of a key, or of the closest thing that holds it. `FILE` where nothing does."""
        return place(self.source, self.lines, path)


def place(source: str, found: Mapping[KeyPath, int], path: KeyPath) -> str:
    """`FILE:LINE` of a key, of the lines of a file. `FILE` where nothing holds the key."""
    line = nearest(found, path)
    return source if line is None else f"{source}:{line}"


def digest(text: str) -> str:
    """The hash of a text, in hex."""
    return hashlib.sha256(text.encode()).hexdigest()


def text_of(path: Path, most: int = MOST_BYTES, source: str | None = None) -> str:
    """The text of a regular file of at most `most` bytes. Raises FileError.

    source : the file as messages name it, if not by its path.
    """
    source = source or input_file.plain(str(path))
    try:
        return input_file.text(path, most)
    except OSError as error:
        raise FileError(f"{source}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{source}: expected UTF-8 text ({error.reason})") from error


def parsed(text: str, source: str) -> TomlFile:
    """The tables of a text. Raises FileError."""
    try:
        return TomlFile(source, text, input_file.toml(text))
    except TomlError as error:
        where = source if error.line is None else f"{source}:{error.line}"
        raise FileError(f"{where}: {error}") from error


def read(path: Path, most: int = MOST_BYTES, source: str | None = None) -> TomlFile:
    """A TOML file of at most `most` bytes. Raises FileError.

    source : the file as messages name it, if not by its path.
    """
    source = source or input_file.plain(str(path))
    return parsed(text_of(path, most, source), source)
