"""The file that a campaign on the simulator in C adds its flights to: a line of JSON each.

A file of something else is refused and left as it is, and one process at a time adds to a file.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

from fcu.interface.files import input_file
from fcu.laws import loader
from tests.foreign_plant.flights import AIRFRAMES, FOLDER, MODES, POLICIES, Found

MOST_BYTES = 1 << 30  # of a file that is added to
BEGINS = b'{"seed": '  # what a line of it begins with
# what a flight of a file has, from which it is counted
NEEDED = (
    "seed", "policy", "airframe", "mode", "wind", "saturated", "saturated_landing", "lost", "arrived", "late",
    "fingerprint",
)  # fmt: skip


class CampaignError(ValueError):
    """A file that is not added to, and why."""


def fingerprint(computed: Path | None) -> dict[str, str]:
    """Return what a campaign is of, each in a few digits: law, guard, modes and landings, airframe files, simulator, winds."""
    laws = Path(loader.__file__).parent
    of = {
        "law": [*sorted(laws.glob("*.py")), *sorted((laws / "mmrac").glob("*.py"))],
        "guard": sorted((laws.parent / "guard").glob("*.py")),
        "vehicle": sorted((laws.parent / "vehicle").glob("*.py")),
        "airframes": [FOLDER / f"{name}.toml" for name in AIRFRAMES],
        "simulator": [Path(__file__).with_name("plant.c")],
        "winds": [computed] if computed else [],
    }
    return {
        what: hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:12]
        for what, paths in of.items()
    }


def flown_before(data: bytes, source: Path, made_of: dict[str, str]) -> tuple[list[Found], int]:
    """Return the flights of a file that is added to, and how many bytes they take.

    After them there may be one that was cut short. Raises CampaignError for a file of something else.
    """
    found, size = [], 0
    for number, line in enumerate(data.splitlines(keepends=True), start=1):
        where, is_whole = f"{source}: line {number}", line.endswith(b"\n")
        if not is_whole and (line.startswith(BEGINS) or BEGINS.startswith(line)):
            break
        try:
            row = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise CampaignError(f"{where} is no flight of a campaign") from error
        if not isinstance(row, dict) or not is_whole:
            raise CampaignError(f"{where} is no flight of a campaign")
        if lacking := [key for key in NEEDED if key not in row]:
            raise CampaignError(f"{where} has no {lacking[0]}: it is no flight of such a campaign")
        known = {"policy": POLICIES, "airframe": AIRFRAMES, "mode": tuple(MODES)}
        if not isinstance(row["seed"], int) or any(row[key] not in of for key, of in known.items()):
            raise CampaignError(f"{where} is no flight of a campaign")
        told = row["fingerprint"] if isinstance(row["fingerprint"], dict) else {}
        for what, of_it in made_of.items():
            if told.get(what) != of_it:
                raise CampaignError(
                    f"{where} was flown with another {what}: name a new file (--out)"
                )
        found.append(row)
        size += len(line)
    return found, size


@contextlib.contextmanager
def opened(path: Path, made_of: dict[str, str]) -> Iterator[tuple[list[Found], IO[str]]]:
    """Yield the flights of a file, and the file to add to, which no other campaign has meanwhile.

    Nothing is written to a file of something else. Raises CampaignError, OSError.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC
    descriptor = os.open(path, flags | os.O_NONBLOCK, 0o644)  # a pipe would wait
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise CampaignError(f"{path}: expected a regular file, not a device or a pipe")
    with open(descriptor, "a+", encoding="utf-8", buffering=1) as out:
        try:
            fcntl.flock(out, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise CampaignError(f"{path}: another process adds to this file") from error
        found, size = flown_before(input_file.content(path, MOST_BYTES), path, made_of)
        if size < os.fstat(descriptor).st_size:
            os.ftruncate(descriptor, size)
        yield found, out


def counted(found: list[Found], asked: Sequence[tuple[str, int]]) -> list[Found]:
    """Return the flights of these policies and seeds, each once."""
    first = {(each["policy"], each["seed"]): each for each in reversed(found)}
    return [first[key] for key in asked if key in first]
