"""Files that are written whole, or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO


@dataclass
class Part:
    """A file that has not its name yet."""

    file: BinaryIO
    path: Path
    target: Path

    def put_in_place(self, mode: int | None = None) -> None:
        """Give the file its name, on the disk. Raises OSError.

        mode : its permissions. None: those of the file that it replaces, or those of a new file.
        """
        if mode is None and self.target.exists() and not self.target.is_symlink():
            mode = self.target.stat().st_mode & 0o777
        if mode is not None:
            os.chmod(self.path, mode)
        self.file.flush()
        os.fsync(self.file.fileno())
        os.replace(self.path, self.target)
        if os.name == "posix":  # the name too must reach the disk
            folder = os.open(self.target.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


@contextmanager
def part(path: Path, follow: bool = True) -> Iterator[Part]:
    """A new file beside `path`, which `put_in_place` puts there. Otherwise nothing is left of it.

    follow : replace the file that a link points to. Otherwise replace the link: in a folder that somebody
        else may have made, a link could lead anywhere.

    Raises OSError.
    """
    target = path.resolve() if follow else path.parent.resolve() / path.name
    beside = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    with beside.open("xb") as file:
        try:
            yield Part(file, beside, target)
        finally:
            beside.unlink(missing_ok=True)


def write(path: Path, data: bytes, follow: bool = True) -> None:
    """Put bytes at `path`. On a full disk what was there before stays, and nothing else.

    follow : as for `part`. A pipe or a device, which cannot be replaced, is written to. Otherwise nothing but a
        file is written.

    Raises OSError, which names the file.
    """
    try:
        if follow and path.exists() and not path.is_file():
            path.write_bytes(data)
            return
        with part(path, follow) as new:
            new.file.write(data)
            new.put_in_place()
    except OSError as error:  # of a full disk: without the name of the file
        raise OSError(error.errno, error.strerror, str(path)) from error
