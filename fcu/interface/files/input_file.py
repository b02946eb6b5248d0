"""Files that a person names: regular files of a bounded size, and TOML of a bounded depth.

A name may stand for anything: a device that never ends, a pipe that nobody writes to, a link to
itself, gigabytes of nothing. All of these are rejected before they cost time or memory.
"""

from __future__ import annotations

import errno
import json
import os
import re
import stat
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

MIB = 1 << 20
LONG = 60  # characters of a value in a message
DEEPEST = 32  # tables and arrays within one another, names with dots between them
MARK = "\ufeff"  # a byte order mark, which TOML does not know

# What is not to be searched for dots: strings and comments. Possessive: nothing is tried twice. A string that does
# not end is one too, up to the end of its line or of the file: a search from each quote takes the square.
_APART = re.compile(
    r'"""(?:[^"\\]++|\\.|"(?!""))*+(?:"{3,5}+)?+'
    r"|'''(?:[^']++|'(?!''))*+(?:'{3,5}+)?+"
    r'|"(?:[^"\\\n]++|\\[^\n])*+"?+'
    r"|'[^'\n]*+'?+"
    r"|#[^\n]*+",
    re.DOTALL,
)
# From the begin of a word alone: from each of its letters it takes the square of its length.
_DOTTED = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{DEEPEST}}}")


def shown(value: Any) -> str:
    """A value of a file as TOML writes it, on one line and cut where it is long, for a message."""
    return shortened(plain(written(value)))


def plain(text: str, kept: str = "") -> str:
    """A text of a file for a message. What a terminal would act on is escaped.

    kept : characters that are left as they are, as the end of a line.
    """
    return "".join(
        c if c.isprintable() or c in kept else c.encode("unicode_escape").decode() for c in text
    )


class PlainError(ValueError):
    """An error about a file, whose names and values stand in its message. What a terminal would act on is escaped."""

    KEPT = ""  # characters that stay as they are: the end of a line, where a message has several

    def __str__(self) -> str:
        return plain(super().__str__(), self.KEPT)


def shortened(text: str) -> str:
    """A text for a message, cut where it is long."""
    return text if len(text) <= LONG else f"{text[: LONG - 3]}..."


def written(value: Any) -> str:
    """A value as TOML has it on one line, in full. A table stands inside braces."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {written(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(written, value)) + "]"
    if isinstance(value, str | bool | None):
        return json.dumps(value, ensure_ascii=False)
    return str(value)


class TomlError(ValueError):
    """A text that is no TOML, or more than is read: why, and its line (None: not known)."""

    def __init__(self, why: str, line: int | None = None) -> None:
        super().__init__(why)
        self.line = line


def opened(path: Path) -> BinaryIO:
    """A regular file, open for reading. Raises OSError for anything else, without waiting."""
    # a pipe would wait for who writes to it
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC | getattr(os, "O_NONBLOCK", 0))
    except ValueError as error:
        raise OSError(errno.EINVAL, f"no file has such a name ({error})", str(path)) from error
    try:
        mode = os.fstat(fd).st_mode
        if stat.S_ISDIR(mode):
            raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            raise OSError(
                errno.EINVAL,
                "expected a regular file, not a device or a pipe, which may never end: save it as a file",
                str(path),
            )
        return os.fdopen(fd, "rb")
    except BaseException:
        os.close(fd)
        raise


def content(path: Path, most: int) -> bytes:
    """Content of a regular file. Raises OSError, also when that is more than `most` bytes."""
    with opened(path) as file:
        data = file.read(most + 1) if os.fstat(file.fileno()).st_size <= most else None
    if data is None or len(data) > most:
        size = f"{most // MIB} MiB" if most >= MIB else f"{most >> 10} KiB"
        raise OSError(errno.EFBIG, f"larger than {size}, the most that is read", str(path))
    return data


def text(path: Path, most: int) -> str:
    """The UTF-8 text of a regular file, each line ended by a line feed.

    Raises OSError as `content` does, UnicodeDecodeError.
    """
    return content(path, most).decode().replace("\r\n", "\n")


def toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises TomlError."""
    if text.startswith(MARK):
        raise TomlError("expected UTF-8 without a byte order mark (save the file without it)", 1)
    # the same length, so that lines can be counted: tomllib takes the square of a name's parts
    bare = _APART.sub(_without_dots, text)
    if dotted := _DOTTED.search(bare):
        line = bare.count("\n", 0, dotted.start()) + 1
        raise TomlError(f"expected at most {DEEPEST} names with dots between them", line)
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        at = re.search(r" \(at (?:line (\d+), column \d+|end of document)\)", str(error))
        line = int(at[1]) if at and at[1] else len(text.splitlines())
        raise TomlError(str(error)[: at and at.start()], line) from error
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:  # of Python's limits: 4300 digits
        raise TomlError("expected whole numbers of at most 64 bits") from error
    _check_values(tables)
    return tables


def _without_dots(found: re.Match[str]) -> str:
    """As many characters and lines as a string or a comment."""
    return re.sub(r"[^\n]", " " if found[0].startswith("#") else "x", found[0])


def _too_deep() -> TomlError:
    return TomlError(f"expected at most {DEEPEST} tables and arrays within one another")


def _check_values(tables: dict[str, Any]) -> None:
    """Raise TomlError for what is too deep, and for integers beyond TOML's 64 bits."""
    level: list[Any] = [tables]
    for _ in range(DEEPEST + 1):
        values = [
            value for each in level for value in (each.values() if isinstance(each, dict) else each)
        ]
        if any(isinstance(value, int) and value.bit_length() > 64 for value in values):
            raise TomlError("expected whole numbers of at most 64 bits")
        level = [value for value in values if isinstance(value, dict | list)]
        if not level:
            return
    raise _too_deep()
