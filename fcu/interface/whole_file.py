"""Files that are written whole, or not at all."""

from __future__ import annotations

import os
from pathlib import Path


def write(path: Path, data: bytes, follow: bool = True) -> None:
    """Put bytes at `path`. On a full disk what was there before stays, and nothing else.

    follow : replace the file that a link points to. Otherwise replace the link: in a folder that somebody
        else may have made, a link could lead anywhere.

    Raises OSError, which names the file.
    """
    target = path.resolve() if follow else path.parent.resolve() / path.name
    part = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        if target.exists() and not target.is_file():
            target.write_bytes(data)  # a device cannot be replaced
            return
        try:
            with part.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, target)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:  # of a full disk: without the name of the file
        raise OSError(error.errno, error.strerror, str(path)) from error
