"""A picture on file: whole, or not at all."""

from __future__ import annotations

import os
from pathlib import Path


def write(path: Path, picture: bytes) -> None:
    """Put a picture at `path`; on a full disk what was there before stays, and nothing else.

    Raises OSError, which names the file.
    """
    target = path.resolve()  # what a link points to is replaced, not the link
    part = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        if target.exists() and not target.is_file():
            target.write_bytes(picture)  # a device cannot be replaced
            return
        try:
            with part.open("xb") as file:
                file.write(picture)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, target)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:  # of a full disk: without the name of the file
        raise OSError(error.errno, error.strerror, str(path)) from error
