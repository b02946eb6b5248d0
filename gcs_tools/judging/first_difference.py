"""The place where two flights of one mission part: the first tick at which a recorded value differs, to the bit.

What differs at that tick is told in the order in which a tick computes it, so that the first is nearest
to the cause: what the simulator did, what was measured, asked for, estimated, demanded and commanded.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs_tools.recording import reader
from gcs_tools.recording.table import Table

MOST = 3  # columns that are told of each kind

# beginning of a column's name -> what it is, in the order of a tick
_SIMULATOR = (
    ("v_air_E", "wind"), ("w_air_B", "wind"), ("m", "mass"), ("J", "inertia"), ("battery", "battery"),
    ("", "motion"),
)  # fmt: skip
_CONTROLLER = (
    ("measured", "measurement"), ("setpoint", "setpoint"), ("guard", "guard"),
    ("state.reference", "reference"), ("outputs.reference", "reference"), ("state", "estimate"),
    ("internals", "demand"), ("outputs", "demand"), ("command", "command"), ("", "controller"),
)  # fmt: skip
_ORDER = (
    "setpoint", "wind", "mass", "inertia", "motion", "measurement", "guard", "reference", "estimate",
    "demand", "command", "battery", "controller",
)  # fmt: skip


@dataclass(frozen=True)
class Differing:
    """One recorded value that two flights differ in at a tick."""

    kind: str  # setpoint, wind, estimate, ...
    name: str  # as recordings name it
    value: float
    baseline: float

    def __str__(self) -> str:
        """The value now, and that of the baseline."""
        return f"{self.name} {self.value!r}, was {self.baseline!r}"


@dataclass(frozen=True)
class Parted:
    """The first tick at which two flights differ."""

    t: float  # simulation time, s
    kinds: tuple[str, ...]  # of what differs there, nearest to the cause first
    values: tuple[Differing, ...]  # up to MOST of each kind
    only: str = ""  # one flight ends here: "" if neither, else which

    def __str__(self) -> str:
        """One sentence."""
        if self.only:
            return f"{self.only} goes on at {self.t:.3f} s, where the other has ended"
        first = "; ".join(str(each) for each in self.values if each.kind == self.kinds[0])
        rest = f"; then {', '.join(self.kinds[1:])}" if self.kinds[1:] else ""
        return f"differs first at {self.t:.3f} s, in the {self.kinds[0]}: {first}{rest}"


def first_difference(run: Path, baseline: Path) -> Parted | None:
    """The first tick at which two recordings differ. None if all that both hold is the same, to the bit.

    Columns that one of them does not have are left out. Raises RecordingError.
    """
    one, other = reader.read(run), reader.read(baseline)
    found = [
        parted
        for table, past, kinds in (
            (one.plant, other.plant, _SIMULATOR),
            (one.fcu, other.fcu, _CONTROLLER),
        )
        if (parted := _parted(table, past, kinds)) is not None
    ]
    if not found:
        return None
    t = min(each.t for each in found)
    here = [each for each in found if each.t == t]
    kinds = sorted({kind for each in here for kind in each.kinds}, key=_ORDER.index)
    values = tuple(
        value for kind in kinds for each in here for value in each.values if value.kind == kind
    )
    return Parted(t, tuple(kinds), values, "" if values else here[0].only)


def _parted(table: Table, past: Table, kinds: tuple[tuple[str, str], ...]) -> Parted | None:
    names = [name for name in table.names if name in past.names]
    length = min(len(table), len(past))
    a = np.column_stack([table[name][:length] for name in names])
    b = np.column_stack([past[name][:length] for name in names])
    differs = (a != b) & ~(np.isnan(a) & np.isnan(b))
    rows = np.flatnonzero(differs.any(axis=1))
    if not len(rows):
        if len(table) == len(past):
            return None
        longer, only = (
            (table, "this flight") if len(table) > length else (past, "the baseline's flight")
        )
        return Parted(float(longer["t"][length]), (), (), only)
    row = int(rows[0])
    found: dict[str, list[Differing]] = {}
    for at in np.flatnonzero(differs[row]).tolist():
        kind = next(kind for begins, kind in kinds if _begins(names[at], begins))
        found.setdefault(kind, []).append(
            Differing(kind, names[at], float(a[row, at]), float(b[row, at]))
        )
    t = min(float(a[row, names.index("t")]), float(b[row, names.index("t")]))
    return Parted(t, tuple(found), tuple(each for kind in found.values() for each in kind[:MOST]))


def _begins(name: str, begins: str) -> bool:
    return not begins or name == begins or name.startswith((f"{begins}.", f"{begins}_"))
