"""The folder of a run: made, used by one runner at a time, and emptied if it holds runs alone."""

from __future__ import annotations

import json
import os
import shutil
import stat
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from fnmatch import fnmatch
from pathlib import Path

try:
    import fcntl
except ImportError:  # not on Windows, where nobody is kept out
    fcntl = None  # type: ignore[assignment]

RUNS, RESULT, RECORDING = Path("runs"), "result.json", "flight.mcap"
MARKS = (
    RESULT,
    "settings.json",
    "world.json",
    RECORDING,
)  # one of these is in every run's folder
KNOWN = (
    *MARKS, "about.json", "flight.png", "flight-*.png", "flight-*.svg", "flight-*.pdf", ".result.json.*",
    *(f"{who}.{kind}" for who in ("fcu", "plant", "publisher", "controller", "script") for kind in ("log", "jsonl")),
)  # fmt: skip
LOGS = "fcu.log", "plant.log", "script.log"  # of every flight of a script
RESERVED = RECORDING, "flight.png"  # names that a script may give to no file of its own
BLOCK_BYTES = 1 << 20  # read at a time
LONGEST = 50  # characters of a mission's name in that of its run's folder


class UsageError(ValueError):
    """A mission, a setting or a folder that cannot be used: which, and what was expected."""

    def __init__(self, why: str, of: Mapping[str, str] | None = None) -> None:
        """`of`: where several missions are rejected, the reason of each."""
        super().__init__(why)
        self.of = of or {}


@contextmanager
def alone_in(out: Path | None) -> Iterator[None]:
    """Keep other runners out of a folder within the block. It is made if it is not there.

    The lock ends with the process, however that ends. Raises UsageError where another runner has it.
    """
    if out is None or fcntl is None:
        yield
        return
    try:
        if out.exists() and not out.is_dir():
            raise UsageError(f"--out {out}: this is a file (name a new or an empty folder)")
        out.mkdir(parents=True, exist_ok=True)
        folder = os.open(out, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise UsageError(f"{out}: cannot make the run's folder: {error.strerror}") from error
    try:
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise UsageError(
                f"--out {out}: another run is being written there (name another)"
            ) from error
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(folder)


def new_folder(out: Path | None, name: str) -> Path:
    """An empty folder for a run: `out`, or a new one in runs/. Raises UsageError."""
    try:
        if out is None:
            stamp = time.strftime("%Y%m%d-%H%M%S")
            for n in range(1000):
                folder = RUNS / f"{stamp}-{name[:LONGEST]}{f'-{n}' if n else ''}"
                try:
                    folder.mkdir(parents=True)
                    return folder
                except FileExistsError:
                    continue
        assert out is not None
        if out.exists() and not out.is_dir():
            raise UsageError(f"--out {out}: this is a file (name a new or an empty folder)")
        out.mkdir(parents=True, exist_ok=True)
        if any(out.iterdir()):
            raise UsageError(
                f"--out {out}: the folder is not empty (name a new or an empty one, or replace the run in"
                " it: --overwrite)"
            )
        return out
    except OSError as error:
        where = RUNS if out is None else out
        raise UsageError(f"{where}: cannot make the run's folder: {error.strerror}") from error


def emptied(out: Path) -> None:
    """Remove what earlier runs left in a folder. Raises UsageError for one that holds anything else."""
    try:
        if not out.exists() or not any(out.iterdir()):
            return
        runs = [out] if _is_run(out) else list(out.iterdir())
        if strange := next((each for run in runs for each in _strange(run)), None):
            raise UsageError(
                f"--out {out}: {strange} was not left by a run: nothing is removed (name a new or an"
                " empty folder)"
            )
        for run in runs:
            for path in run.iterdir():
                if path.is_dir():
                    shutil.rmtree(path)
                else:
                    path.unlink()
            if run != out:
                run.rmdir()
    except OSError as error:
        raise UsageError(f"--out {out}: cannot be emptied: {error.strerror}") from error


class Kept:
    """The folder of a run and files in it, which are to be there still when the flight is over.

    A script of a user's may remove them, or put others or links in their place. What is written then would go
    elsewhere.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._whole = ExitStack()
        self._held = {folder: self._open(folder)}  # open, so that no other file gets its number
        self._written: dict[Path, Callable[[], tuple[int, int]]] = {}
        self._since_ns = time.time_ns()
        self._was_link = folder.is_symlink()

    def __enter__(self) -> Kept:
        return self

    def __exit__(self, *_: object) -> None:
        self._whole.close()

    def hold(self, name: str, written: Callable[[], tuple[int, int]]) -> None:
        """Hold a file of the folder, if it is there.

        written : gives how many bytes were written to it in all, and their CRC-32.
        """
        path = self._folder / name
        if path.is_file():
            self._held[path], self._written[path] = self._open(path), written

    def spoilt(self, logs: Sequence[str]) -> str:
        """Sentence about what was removed or replaced. Empty if all is there.

        logs : names of files that were written there, too.
        """
        for path, held in self._held.items():
            if not _is_same(path, held) or (
                path == self._folder and path.is_symlink() > self._was_link
            ):
                return f"the script removed or replaced {path}"
        names = sorted(os.listdir(self._folder))
        for name in (name for name in names if any(fnmatch(name, each) for each in KNOWN)):
            path = self._folder / name
            if path.is_symlink():
                return f"the script put a link in the place of {path}"
            if not stat.S_ISREG(path.lstat().st_mode):  # a FIFO would be waited for without end
                return f"the script put something that is no file in the place of {path}"
            # a figure is drawn into it, and a recording that was not wanted would be read as the flight's
            if name in RESERVED and path not in self._held:
                return (
                    f"the script wrote {path}, a name that is kept for the run (name it otherwise)"
                )
        for name in logs:
            if name not in names:
                return f"the script removed {self._folder / name}"
        return ""

    def changed(self) -> str:
        """Sentence about a file that holds other bytes than were written. Empty if there is none."""
        for path, written in self._written.items():
            size, crc = written()
            found, at = 0, 0
            try:
                if os.fstat(self._held[path]).st_size != size:  # one with a hole may be of any size
                    return f"the script changed {path}"
                while block := os.pread(self._held[path], BLOCK_BYTES, at):
                    found, at = zlib.crc32(block, found), at + len(block)
            except OSError as error:
                return f"{path}: {error.strerror}"
            if found != crc:
                return f"the script changed {path}"
        return ""

    def remove(self, name: str) -> None:
        """Remove a file or a link from the folder, wherever that is now, and from one put in its place.

        There only what was made since: a script may have moved a folder of the user's there.
        """
        with suppress(OSError):
            os.unlink(name, dir_fd=self._held[self._folder])
        with suppress(OSError):
            there = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            self._whole.callback(os.close, there)
            if os.stat(name, dir_fd=there, follow_symlinks=False).st_ctime_ns >= self._since_ns:
                os.unlink(name, dir_fd=there)

    def _open(self, path: Path) -> int:
        file = os.open(path, os.O_RDONLY)
        self._whole.callback(os.close, file)
        return file


def _is_same(path: Path, held: int) -> bool:
    """True if a path leads to the file that is held open."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(held))
    except OSError:
        return False


def _is_run(folder: Path) -> bool:
    return any((folder / name).is_file() for name in MARKS)


def _strange(run: Path) -> Iterator[Path]:
    """Everything in the folder of a run that is not of a run. The folder itself if it is of none."""
    if run.is_symlink() or not run.is_dir() or not (_is_run(run) or not any(run.iterdir())):
        yield run
        return
    by_script = _left_by_its_script(run)
    for path in run.iterdir():
        known = path.is_file() and any(fnmatch(path.name, name) for name in KNOWN)
        if path.is_symlink() or not (known or path.name in by_script):
            yield path


def left_by_script(run: Path) -> list[str]:
    """Names of what a script has left in the folder of its run."""
    names = (path.name for path in run.iterdir() if not path.is_symlink())
    left = (name for name in names if not any(fnmatch(name, each) for each in KNOWN))
    return sorted(os.fsencode(name).decode("utf-8", "backslashreplace") for name in left)


def _left_by_its_script(run: Path) -> set[str]:
    """The names that the result of a run lists as left by its script. Empty if it cannot be read."""
    try:
        script = json.loads((run / RESULT).read_bytes())["script"]
        return {name for name in script["files"] if isinstance(name, str)}
    except (OSError, ValueError, KeyError, TypeError):
        return set()
