"""What is drawn: the rows of a flight by the names of their columns, live or from a recording.

Nothing here knows where rows come from. Whoever receives them appends them, in the thread that
draws; frames and units are those of PlantRecord and Tick.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import believed
from fcu.kernel.buffers import columns
from fcu.law.types import LawParams, Tick
from gcs_tools.layout import Rows
from gcs_tools.recording import RecordingError, read
from sitl_plant.physics.types import PlantRecord

WINDOW_S = 60.0  # of a live flight that is kept and drawn
HALF_US = 0.5e-6  # ticks fall on whole microseconds: a time is met by rounding
GEAR_M = 0.3  # from the centre of mass to the ground it stands on, until a recording says more

_AXES = ("x", "y", "z")
_ROTORS = tuple(f"r{i}" for i in range(1, 9))


def _parts(name: str, of: Sequence[str] = _AXES) -> list[str]:
    return [f"{name}.{part}" for part in of]


# the columns that are drawn; a minute of whole rows at 1000 Hz would be 100 MB
PLANT = [
    *_parts("state.r_E"), *_parts("state.v_E"), *_parts("state.q_EB", "wxyz"),
    *_parts("state.Omega", _ROTORS), *_parts("v_air_E"), *_parts("f_D_E"), "m", *_parts("J"),
    "on_ground",
]  # fmt: skip
FCU = [
    "engaged", "setpoint.level", *_parts("setpoint.r_c"), *_parts("state.s_v_hat"), "state.m_hat",
    *_parts("state.J_hat"), *_parts("internals.r_m"), *_parts("internals.v_til"),
    *_parts("internals.w_til"), "internals.T_c", "internals.T_achieved",
    *_parts("internals.angles_c"),
]  # fmt: skip
WIND = _parts("v_air_E")


class History:
    """Rows of one topic, oldest first: all of them, or those of the newest `keep_s` seconds."""

    def __init__(
        self, names: Sequence[str], wanted: Sequence[str], keep_s: float = math.inf
    ) -> None:
        """names : columns of the rows appended, `t` (s) among them.  wanted : those to keep."""
        kept = ["t", *wanted]
        self._from = [list(names).index(name) for name in kept]
        self._at = {name: i for i, name in enumerate(kept)}
        self._keep_s = keep_s
        self._data = np.empty((len(kept), 1024))  # a column after the other: each is read whole
        self._first = self._end = 0

    def __len__(self) -> int:
        return self._end - self._first

    def __getitem__(self, name: str) -> Rows:
        """One column, (n,). Good until the next `append`."""
        return self._data[self._at[name], self._first : self._end]

    def vector(self, name: str, of: Sequence[str] = _AXES) -> Rows:
        """The parts of a Vec3, Quat or Rotors, (n, parts)."""
        return np.stack([self[part] for part in _parts(name, of)], axis=-1)

    def append(self, rows: Rows) -> None:
        """Append rows, float64 (n, len(names)). Where time goes back, a new flight begins."""
        if not len(rows):
            return
        new = rows[:, self._from].T
        last = self._data[0, self._end - 1] if len(self) else -math.inf
        back = np.flatnonzero(np.diff(new[0], prepend=last) < 0.0)
        if len(back):
            self._first = self._end = 0
            new = new[:, back[-1] :]
        self._make_room(new.shape[1])
        self._data[:, self._end : self._end + new.shape[1]] = new
        self._end += new.shape[1]
        if self._keep_s < math.inf:
            oldest = self._data[0, self._end - 1] - self._keep_s
            self._first += int(np.searchsorted(self["t"], oldest - HALF_US))

    def _make_room(self, n: int) -> None:
        """For n columns behind the last: by dropping what is past, by growing if that is little."""
        if self._end + n <= self._data.shape[1]:
            return
        rows, size = self._data, self._data.shape[1]
        if 2 * (len(self) + n) > size:
            rows = np.empty((len(self._data), 2 * (len(self) + n)))
        kept = self._data[:, self._first : self._end].copy()
        rows[:, : kept.shape[1]] = kept
        self._data, self._first, self._end = rows, 0, kept.shape[1]

    def index(self, t: float) -> int | None:
        """The last row at or before t (s), if there is one."""
        i = int(np.searchsorted(self["t"], t + HALF_US, side="right")) - 1
        return i if i >= 0 else None

    def at(self, t: float) -> Moment | None:
        """The last row at or before t (s), if there is one."""
        i = self.index(t)
        return None if i is None else Moment(self, i)


class Moment:
    """One row of a history."""

    def __init__(self, history: History, i: int) -> None:
        self._history, self._i = history, i

    def __getitem__(self, name: str) -> float:
        return float(self._history[name][self._i])

    def vector(self, name: str, of: Sequence[str] = _AXES) -> Rows:
        """The parts of a Vec3, Quat or Rotors."""
        return np.array([self[part] for part in _parts(name, of)])


class Limits(NamedTuple):
    """What the controller keeps to, or believes it does. SI units, rad."""

    T_min: float
    T_max: float
    phi_star: float  # of roll and of pitch
    Omega_max: float

    @classmethod
    def of(cls, params: Rows) -> Limits:
        """Those of a row of LawParams."""
        told = dict(zip(columns(LawParams), params.tolist(), strict=True))
        return cls(*(told[name] for name in cls._fields))

    @classmethod
    def believed(cls) -> Limits:
        """Those of the airframe file, as long as a flight has not said others."""
        rotors, limits = believed()
        return cls(
            float(limits["thrust_min_n"]), float(limits["thrust_max_n"]),
            math.radians(float(limits["tilt_max_deg"])), rotors.Omega_max,
        )  # fmt: skip


@dataclass
class Flight:
    """A flight as far as it is known: the histories of its topics and what belongs to it."""

    title: str
    plant: History
    fcu: History
    wind: History  # the wind estimate; without rows where nobody publishes one
    limits: Limits = field(default_factory=Limits.believed)
    ground_z: float | None = None  # m; None until it is known
    status: str = ""  # mode and armed, in words, where a topic says them

    @property
    def span(self) -> tuple[float, float] | None:
        """From the first to the last time (s) of which the vehicle's state is known."""
        t = self.plant["t"]
        return (float(t[0]), float(t[-1])) if len(t) else None

    def find_ground(self) -> None:
        """Learn the height of the ground from a vehicle that stands on it."""
        standing = np.flatnonzero(self.plant["on_ground"] > 0.5)
        if self.ground_z is None and len(standing):
            self.ground_z = float(self.plant["state.r_E.z"][standing[0]]) - GEAR_M


def live(title: str, keep_s: float = WINDOW_S) -> Flight:
    """A flight whose rows are still to come: of PlantRecord, of Tick, and of t and WIND."""
    return Flight(
        title,
        History(columns(PlantRecord), PLANT, keep_s),
        History(columns(Tick), FCU, keep_s),
        History(["t", *WIND], WIND, keep_s),
    )


def recorded(path: Path) -> Flight:
    """The flight of a recording. Raises RecordingError if it cannot be read or is empty."""
    recording = read(path)
    if not len(recording.plant):
        raise RecordingError(f"{path}: nothing was recorded of this flight")
    flight = live(recording.metadata.get("title") or path.name, keep_s=math.inf)
    flight.plant.append(recording.plant)
    flight.fcu.append(recording.fcu)
    if recording.params is not None:
        flight.limits = Limits.of(recording.params)
    flight.ground_z = _ground_z(recording.metadata)
    flight.find_ground()
    return flight


def _ground_z(metadata: dict[str, Any]) -> float | None:
    """The mission's, of which the recording says "-10.0 (default)"."""
    try:
        return float(metadata["flight.ground_z_m"].split()[0])
    except (KeyError, IndexError, ValueError):
        return None
