"""What is drawn: the columns of a flight by name, live or from a recording.

Nothing here knows where rows come from. Whoever receives them appends them, a topic at a time and
in the thread that draws. Names, frames and units are those of PlantRecord, Tick and Report.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import believed
from fcu.mavlink.px4_modes import AutoMode, MainMode
from gcs_tools.recording.reader import RecordingError, read
from gcs_tools.recording.schema import TICK_TOPICS, TRUTH
from gcs_tools.recording.table import Rows, Table

WINDOW_S = 60.0  # of a live flight that is kept and drawn
HALF_US = 0.5e-6  # ticks fall on whole microseconds: a time is met by rounding
GEAR_M = 0.3  # from the centre of mass to the ground it stands on

Series = tuple[Rows, Rows]  # times, s, and values

XYZ = ("x", "y", "z")
ROTORS = tuple(f"r{i}" for i in range(1, 9))


def parts(name: str, of: Sequence[str] = XYZ) -> list[str]:
    """The columns of a Vec3, or of a Quat or Rotors."""
    return [f"{name}.{part}" for part in of]


# of each topic what is drawn: a minute of whole rows at 1000 Hz would be 100 MB
DRAWN = {
    "/plant/truth": [
        *parts("state.r_E"), *parts("state.v_E"), *parts("state.q_EB", "wxyz"),
        *parts("state.Omega", ROTORS), *parts("v_air_E"), *parts("f_D_E"), "m", *parts("J"),
        "on_ground",
    ],
    "/fcu/setpoint": ["setpoint.level", *parts("setpoint.r_c")],
    "/fcu/outputs": [
        *parts("outputs.reference.r_m"), "outputs.T_c", "outputs.T_achieved",
        *parts("outputs.angles_c"),
    ],
    "/fcu/law": [
        "engaged", *parts("state.estimates.s_v_hat"), "state.estimates.m_hat",
        *parts("state.estimates.J_hat"),
    ],
    "/fcu/internals": [
        *parts("internals.prediction.v_til"), *parts("internals.prediction.w_til"),
    ],
    "/fcu/wind": parts("wind.v_air_E"),
    "/fcu/status": ["status.armed", "status.main_mode", "status.sub_mode", "status.failsafe"],
}  # fmt: skip


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

    def index(self, t: float) -> int:
        """The last row at or before t (s); -1 without one."""
        return int(np.searchsorted(self["t"], t + HALF_US, side="right")) - 1


class Limits(NamedTuple):
    """What the controller keeps to, or believes it does. SI units, rad."""

    T_min: float
    T_max: float
    phi_star: float  # of roll and of pitch
    Omega_max: float
    achieved: float  # 1: gravity is known to the prediction; 0, as printed: s_v_hat finds it
    g: float

    @classmethod
    def of(cls, params: Mapping[str, float]) -> Limits:
        """Those of a law's parameters, by name; of what it does not have, not a number."""

        def told(name: str) -> float:
            return params.get(f"law.{name}", math.nan)

        return cls(
            T_min=told("limits.T_min"), T_max=told("limits.T_max"),
            phi_star=told("limits.phi_star"), Omega_max=told("rotors.Omega_max"),
            achieved=told("achieved"), g=told("g"),
        )  # fmt: skip

    @classmethod
    def believed(cls) -> Limits:
        """Those of the airframe file, as long as a flight has not said others."""
        rotors, tables = believed()
        limits = tables["limits"]
        return cls(
            float(limits["thrust_min_n"]), float(limits["thrust_max_n"]),
            math.radians(float(limits["tilt_max_deg"])), rotors.Omega_max, 1.0, 9.81,
        )  # fmt: skip


class FlightHistory:
    """A flight as far as it is known: a history for each topic, and what belongs to them."""

    def __init__(
        self, title: str, keep_s: float = WINDOW_S, kept: Mapping[str, list[str]] | None = None
    ) -> None:
        """keep_s : the newest seconds that are kept; infinite for a flight that is over.

        kept : by topic, the columns that are; None: DRAWN.
        """
        kept = DRAWN if kept is None else kept
        self.title = title
        self.limits = Limits.believed()
        self.ground_z: float | None = None  # m; None until it is known
        self._topics = {topic: TopicHistory(names, keep_s) for topic, names in kept.items()}
        self._of = {name: self._topics[topic] for topic, names in kept.items() for name in names}

    def append(self, topic: str, rows: Table) -> None:
        """Append rows of a topic, if it is drawn."""
        if topic in self._topics:
            self._topics[topic].append(rows)
        if topic == TRUTH and self.ground_z is None:
            self._find_ground()

    def _find_ground(self) -> None:
        """Learn the height of the ground from a vehicle that stands on it."""
        t, standing = self.series("on_ground")
        if len(t) and standing[-1] > 0.5:
            self.ground_z = float(self._of["state.r_E.z"]["state.r_E.z"][-1]) - GEAR_M

    @property
    def span(self) -> tuple[float, float] | None:
        """From the first to the last time (s) of which the vehicle's state is known."""
        t = self._topics[TRUTH]["t"]
        return (float(t[0]), float(t[-1])) if len(t) else None

    def series(self, name: str) -> Series:
        """A column and its times."""
        history = self._of[name]
        return history["t"], history[name]

    def drag_over_mass(self, axis: str) -> Series:
        """The truth of s_v_hat, m/s^2: as printed, gravity is in it."""
        t, force = self.series(f"f_D_E.{axis}")
        down = self.limits.g if axis == "z" and self.limits.achieved < 0.5 else 0.0
        return t, force / self.along(t, "m") - down

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
        end = self._of[f"{name}.x"].index(until) + 1
        return np.stack([self.series(part)[1][:end] for part in parts(name)], axis=1)

    def value(self, name: str, t: float) -> float:
        """A column in its last row at or before t (s); NaN without one."""
        history = self._of[name]
        i = history.index(t)
        return float(history[name][i]) if i >= 0 else math.nan

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
    flight = FlightHistory(recording.metadata.get("title") or path.name, keep_s=math.inf)
    flight.ground_z = ground_z(recording.metadata)
    if recording.params is not None:
        flight.limits = Limits.of(recording.params)
    flight.append(TRUTH, recording.plant)
    for topic in TICK_TOPICS:
        flight.append(topic.name, recording.fcu)
    for name, rows in recording.reports.items():
        flight.append(name, rows)
    return flight


def ground_z(values: Any) -> float | None:
    """The height of the ground (m) in a mission's values, which say "-10.0 (default)"."""
    try:
        return float(values["flight.ground_z_m"].split()[0])
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):
        return None
