"""Several flights side by side: their metrics, and what differs in what they were flown with.

A flight is a run's folder, its result.json, or a recording. The numbers of a folder are those of its
result.json, which counts every tick; of another version's, or without one, those of its recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from gcs_tools.judging import result
from gcs_tools.judging.metrics import METRICS
from gcs_tools.judging.recorded_flight import engaged_ticks
from gcs_tools.recording import reader

RECORDING, RESULT = "flight.mcap", "result.json"
_TABLES = "flight.", "law.", "wind.", "plant."
_VERSION = "version."  # of a recording's metadata


class CompareError(ValueError):
    """A flight that cannot be compared: which, and why."""


@dataclass(frozen=True)
class ComparedFlight:
    """One of the flights."""

    name: str  # of its run, with as much of its path as tells it from the others
    path: Path
    mission: str
    passed: bool | None  # None: a recording does not say
    metrics: dict[str, float | None]
    values: dict[str, str]  # dotted key -> value in force, as text
    trajectory_sha256: str  # empty: not known
    seed: int | None = None  # of its draws; None: a recording does not say
    ended: str = ""  # how the flight ended; empty: a recording does not say
    versions: dict[str, str] = field(default_factory=dict)  # of what flew it
    missed: tuple[str, ...] = ()  # expectations, as sentences
    by_wall: bool = False  # by a script that kept the clock of the wall

    @property
    def why(self) -> str:
        """Expectations that it missed, or else how it ended."""
        return "; ".join(self.missed) or self.ended


@dataclass(frozen=True)
class Spread:
    """One metric of all flights that have a value."""

    least: float
    mean: float
    most: float
    most_of: str  # the flight with the greatest


def flown(path: Path) -> ComparedFlight:
    """One flight. Raises CompareError."""
    found = path / RESULT if path.is_dir() else path
    if found.suffix == ".json":
        try:
            return _of_result(path, found)
        except result.ResultError as error:
            if not (path / RECORDING).is_file():
                raise CompareError(str(error)) from error
    try:
        return _of_recording(path, path / RECORDING if path.is_dir() else path)
    except reader.RecordingError as error:
        raise CompareError(str(error)) from error


def _of_result(path: Path, file: Path) -> ComparedFlight:
    read = result.read(file)
    values = {key: str(value.value) for key, value in read.values.items()}
    name = file.resolve().parent.name
    sha = read.trajectory_sha256
    return ComparedFlight(
        name, path, read.mission, read.passed, dict(read.metrics), values, sha, read.seed,
        read.error or read.ended, dict(read.versions),
        tuple(str(each) for each in read.expectations if each.is_missed) if not read.error else (),
        read.script is not None and read.script.by_wall,
    )  # fmt: skip


def _of_recording(path: Path, file: Path) -> ComparedFlight:
    recording = reader.read(file)
    told = recording.metadata
    in_force = reader.values_told(told)
    values = {key: str(value) for key, value in in_force.items() if key.startswith(_TABLES)}
    values |= {key: told[key] for key in (reader.AIRFRAME,) if key in told}
    name = file.resolve().parent.name if file.name == RECORDING else file.stem
    metrics = engaged_ticks(recording).metrics()
    seed = told.get("seed", "")
    versions = {
        key.removeprefix(_VERSION): value for key, value in told.items() if key.startswith(_VERSION)
    }
    return ComparedFlight(
        name, path, told.get("mission", ""), None, metrics, values, "",
        int(seed) if seed.isdecimal() else None, "", versions,
    )  # fmt: skip


def below(path: Path) -> list[Path]:
    """The run at a path, or all runs in the folders below it. Raises CompareError if there is none."""
    if path.is_file() or (path / RESULT).is_file() or (path / RECORDING).is_file():
        return [path]
    # a run that was killed has left no result
    found = sorted({each.parent for name in (RESULT, RECORDING) for each in path.rglob(name)})
    if not found:
        raise CompareError(f"{path}: expected a run, or a folder with runs: no {RESULT} is there")
    return found


def all_flown(paths: Sequence[Path]) -> list[ComparedFlight]:
    """Each of them, with a name that no other has. Raises CompareError."""
    found = [flown(path) for path in paths]
    names = distinct([_place(each.path) for each in found])
    return [replace(each, name=name) for each, name in zip(found, names, strict=True)]


def _place(path: Path) -> Path:
    """The folder of a run, or a recording without its suffix."""
    path = path.resolve()
    return path.parent if path.name in (RECORDING, RESULT) else path.with_suffix("")


def distinct(paths: Sequence[Path]) -> list[str]:
    """The shortest ends of paths that tell them apart. Equal paths are numbered."""
    longest = max((len(path.parts) for path in paths), default=1)
    names = [path.name for path in paths]
    for length in range(1, longest + 1):
        names = ["/".join(path.parts[-length:]).removeprefix("//") for path in paths]
        if len(set(names)) == len(set(paths)):
            break
    return [
        name if names.count(name) == 1 else f"{name} ({names[: i + 1].count(name)})"
        for i, name in enumerate(names)
    ]


def shown(flights: Sequence[ComparedFlight]) -> list[str]:
    """The metrics that one of the flights has a value of."""
    return [name for name in METRICS if any(f.metrics.get(name) is not None for f in flights)]


def difference(name: str, first: ComparedFlight, other: ComparedFlight) -> float | None:
    """The other's metric minus the first's; None where one has none."""
    a, b = first.metrics.get(name), other.metrics.get(name)
    return None if a is None or b is None else b - a


def spread(name: str, flights: Sequence[ComparedFlight]) -> Spread:
    """Of a metric that one has a value of, at least."""
    known = [(value, f.name) for f in flights if (value := f.metrics.get(name)) is not None]
    values = [value for value, _ in known]
    most, of = max(known)
    return Spread(min(values), sum(values) / len(values), most, of)


def unequal(flights: Sequence[ComparedFlight]) -> dict[str, list[str]]:
    """Key -> what each flight was flown with, where that differs; empty: a flight has no such key."""
    keys = dict.fromkeys(key for f in flights for key in f.values)
    told = {key: [f.values.get(key, "") for f in flights] for key in keys}
    return {key: values for key, values in told.items() if len(set(values)) > 1}
