"""What is drawn: the columns of a flight by name, live or from a recording.

Nothing here knows where rows come from. Whoever receives them appends them, a topic at a time and
in the thread that draws. Names, frames and units are those of PlantRecord, Tick and Report.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.airframe import AirframeError
from fcu.interface.files.input_file import TomlError
from fcu.mavlink.px4_modes import AutoMode, MainMode
from gcs_tools.pictures.quantities import DERIVED, XYZ, Quantity, ShownLimits, kept, parts, told
from gcs_tools.recording.plans import PlanHistory
from gcs_tools.recording.reader import AIRFRAME_FILE, RecordingError, read, values_told
from gcs_tools.recording.schema import FCU, PLANT_TIMING, STATUS, TIMING, TRUTH, WIND
from gcs_tools.recording.table import HALF_US, Rows, Table
from gcs_tools.wind_fields.buildings import Box, told_boxes

WINDOW_S = 60.0  # of a live flight that is kept and drawn
GEAR_M = 0.3  # from the centre of mass to the ground it stands on

Series = tuple[Rows, Rows]  # times, s, and values

# told by the shell: known also while the law does not fly
SHELL = (TRUTH, WIND, STATUS, TIMING, PLANT_TIMING)


class TopicHistory:
    """Rows of one topic, oldest first: all of them, or those of the newest `keep_s` seconds."""

    def __init__(self, wanted: Sequence[str], keep_s: float = math.inf) -> None:
        """wanted : the columns to keep, beside `t` (s)."""
        kept = ["t", *wanted]
        self._at = {name: i for i, name in enumerate(kept)}
        self._keep_s = keep_s
        self._data = np.empty((len(kept), 1024))  # a column after the other: each is read whole
        self._first = self._end = 0

    def __len__(self) -> int:
        return self._end - self._first

    def __getitem__(self, name: str) -> Rows:
        """One column, (n,). Good until the next `append`."""
        return self._data[self._at[name], self._first : self._end]

    def append(self, rows: Table) -> None:
        """Append rows; what they do not have is not a number. Where time goes back, a new flight begins.

        Raises KeyError of rows without time.
        """
        if not len(rows):
            return
        new = np.full((len(self._at), len(rows)), np.nan)
        for name, i in self._at.items():
            if name in rows.names or name == "t":
                new[i] = rows[name]
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


def row_at(t: Rows, at: float) -> int:
    """The last of the times t at or before `at` (s); -1 without one."""
    return int(np.searchsorted(t, at + HALF_US, side="right")) - 1


def value(series: Series, at: float) -> float:
    """The last value at or before `at` (s); not a number without one."""
    i = row_at(series[0], at)
    return float(series[1][i]) if i >= 0 else math.nan


class FlightHistory:
    """A flight as far as it is known: a history for each topic, and what belongs to them."""

    def __init__(
        self, title: str, topics: Mapping[str, Iterable[str]], keep_s: float = WINDOW_S
    ) -> None:
        """topics : of each the columns, of which those that are shown are kept.

        keep_s : the newest seconds that are kept; infinite for a flight that is over.
        """
        self.title = title
        self.limits = ShownLimits.believed()
        self.ground_z: float | None = None  # m; None until it is known
        self.buildings: list[Box] = []  # of the wind that it flies in
        self.plans = PlanHistory()
        self._is_over = keep_s == math.inf
        self._topics = {topic: TopicHistory(names, keep_s) for topic, names in kept(topics).items()}
        self._topic_of = {name: topic for topic, names in kept(topics).items() for name in names}

    @classmethod
    def of(cls, title: str, tables: Mapping[str, Table], limits: ShownLimits) -> FlightHistory:
        """A flight that is over: the rows of each topic, or of what tells of several."""
        flight = cls(title, {topic: rows.names for topic, rows in tables.items()}, math.inf)
        flight.limits = limits
        for topic, rows in tables.items():
            flight.append(topic, rows)
        return flight

    def append(self, topic: str, rows: Table) -> None:
        """Append rows of a topic, if it is shown."""
        if topic in self._topics:
            self._topics[topic].append(rows)
        if topic == TRUTH and self.ground_z is None:
            self._find_ground()

    def _find_ground(self) -> None:
        """Learn the height of the ground from a vehicle that stands on it."""
        standing, height = (self.series(name)[1] for name in ("on_ground", "state.r_E.z"))
        if len(standing) and len(height) and standing[-1] > 0.5:
            self.ground_z = float(height[-1]) - GEAR_M

    @property
    def span(self) -> tuple[float, float] | None:
        """From the first to the last time (s) of which the vehicle's state is known."""
        t, _ = self.series("state.r_E.x")
        return (float(t[0]), float(t[-1])) if len(t) else None

    def tells(self, names: Iterable[str]) -> bool:
        """Whether all these columns are told."""
        return self._topic_of.keys() >= set(told(names))

    def has_values(self, names: Iterable[str]) -> bool:
        """Whether one of these columns ever has a value, as far as the law flies."""
        return any(np.isfinite(self.flown(name)[1]).any() for name in names)

    def shows(self, quantity: Quantity) -> bool:
        """Whether its columns are told; of a flight that is over, whether one ever has a value."""
        ever = self.tells(quantity.columns)
        return ever and (not self._is_over or self.has_values(quantity.columns))

    def series(self, name: str) -> Series:
        """A column, or one of DERIVED, and its times. Without any of what is not told."""
        if name in DERIVED:
            first, *others = DERIVED[name].columns
            t, values = self.series(first)
            beside = (self.along(t, other) for other in others)
            return t, DERIVED[name].of(self.limits, values, *beside)
        if name not in self._topic_of:
            return np.empty(0), np.empty(0)
        history = self._topics[self._topic_of[name]]
        return history["t"], history[name]

    def flown(self, name: str) -> Series:
        """The same; not a number while the law does not fly, if it is the law that tells it."""
        t, values = self.series(name)
        if all(self._topic_of.get(column) in SHELL for column in told([name])):
            return t, values
        return t, np.where(self.along(t, "engaged") > 0.5, values, np.nan)

    def along(self, t: Rows, name: str) -> Rows:
        """The values of a column at the times t (s, ascending); NaN where it has no row of that time.

        What is a tick late, or lost, is not held against what is not.
        """
        times, values = self.series(name)
        if len(t) == len(times) and np.array_equal(t, times):
            return values
        if not len(times):
            return np.full(len(t), np.nan)
        at = np.searchsorted(times, t + HALF_US, side="right") - 1
        same = (at >= 0) & (np.abs(times[np.maximum(at, 0)] - t) < 2.0 * HALF_US)
        return np.where(same, values[np.maximum(at, 0)], np.nan)

    def way(self, name: str, until: float = math.inf) -> Rows:
        """A Vec3 over time, (n, 3), up to `until` (s)."""
        columns = [self.series(part) for part in parts(name)]
        end = row_at(columns[0][0], until) + 1
        return np.stack([values[:end] for _, values in columns], axis=1)

    def value(self, name: str, t: float) -> float:
        """A column in its last row at or before t (s); NaN without one."""
        return value(self.series(name), t)

    def vector(self, name: str, t: float, of: Sequence[str] = XYZ) -> Rows:
        """The parts of a Vec3, Quat or Rotors in its last row at or before t (s)."""
        return np.array([self.value(part, t) for part in parts(name, of)])

    def status(self, t: float) -> str:
        """Mode and armed, in words; empty where no topic says them."""
        main, sub = self.value("status.main_mode", t), self.value("status.sub_mode", t)
        if math.isnan(main):
            return ""
        mode = next((m.name for m in MainMode if m == main), f"mode {main:.0f}")
        if main == MainMode.AUTO:
            mode = next((m.name for m in AutoMode if m == sub), f"auto {sub:.0f}")
        armed = "armed" if self.value("status.armed", t) > 0.5 else "disarmed"
        failsafe = ", failsafe" if self.value("status.failsafe", t) > 0.5 else ""
        return f"{mode.lower().replace('_', ' ')}, {armed}{failsafe}"


def recorded(path: Path) -> FlightHistory:
    """The flight of a recording. Raises RecordingError if it cannot be read or is empty."""
    recording = read(path)
    if not len(recording.plant):
        raise RecordingError(f"{path}: nothing was recorded of this flight")
    try:
        if text := recording.metadata.get(AIRFRAME_FILE):
            limits = ShownLimits.of_airframe(text)
        else:
            limits = (
                ShownLimits.believed()
                if recording.params is None
                else ShownLimits.of(recording.params)
            )
    except (AirframeError, TomlError) as error:
        raise RecordingError(f"{path}: {error}") from error
    tables = {TRUTH: recording.plant, FCU: recording.fcu, **recording.reports}
    flight = FlightHistory.of(recording.metadata.get("title") or path.name, tables, limits)
    flight.plans = PlanHistory(recording.events)
    if (z := ground_z(values_told(recording.metadata))) is not None:
        flight.ground_z = z
    flight.buildings = told_boxes(recording.metadata)
    return flight


def ground_z(values: Mapping[str, Any]) -> float | None:
    """The height of the ground (m) in the values of a mission."""
    height = values.get("flight.ground_z_m")
    return float(height) if isinstance(height, int | float) else None
