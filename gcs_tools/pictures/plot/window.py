"""What figures are drawn of: the rows of a recording in a window of time, by name."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fcu.kernel.buffers import columns
from fcu.settings import Settings
from fcu.tick import Tick
from gcs_tools.judging.metrics import EngagedTicks, Rows
from gcs_tools.recording.reader import SEEN, Recording
from sitl_plant.physics.types import PlantRecord

ENU = ("east", "north", "up")


class Missing(Exception):
    """What a figure needs and the recording does not have: says what, and why it may be so."""


class Columns:
    """Rows whose columns are asked for by name."""

    def __init__(self, rows: Rows, names: Sequence[str]) -> None:
        self._rows = rows
        self._at = {name: i for i, name in enumerate(names)}

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, name: str) -> Rows:
        return self._rows[:, self._at[name]]

    def axes(self, name: str, of: str = "xyz") -> list[Rows]:
        """The components of a Vec3."""
        return [self[f"{name}.{axis}"] for axis in of]

    def vectors(self, name: str) -> Rows:
        """A Vec3 as (n, 3)."""
        return np.stack(self.axes(name), axis=1)


@dataclass(frozen=True)
class Window:
    """What is shown of a flight. Rows are those from `t_from` to `t_to` (s, both included)."""

    flight: (
        EngagedTicks  # ticks at which the law was flying; what is settled is of the whole flight
    )
    plant: Columns  # PlantRecord, at those ticks
    fcu: Columns  # Tick, at those ticks
    taken_over_s: float  # when the law first flew, also before the window; infinite: never
    params: Rows | None
    reports: dict[str, Columns]  # by topic, every tick
    before: dict[str, Columns]  # the same, of the last tick before the window, if there is one
    metadata: dict[str, str]

    @classmethod
    def of(cls, recording: Recording, t_from: float | None, t_to: float | None) -> Window:
        """What `recording` has from t_from to t_to; None: from the start, to the end."""
        whole = EngagedTicks.of(recording.plant, recording.fcu)
        flight = whole.window(t_from, t_to)
        low, high = -np.inf if t_from is None else t_from, np.inf if t_to is None else t_to
        reports, before = {}, {}
        for topic in SEEN:
            rows = recording.reports.get(topic.name)
            if rows is None:
                continue
            names = ["t", *columns(topic.carries)]
            inside = (rows[:, 0] >= low - 1e-6) & (rows[:, 0] <= high + 1e-6)
            reports[topic.name] = Columns(rows[inside], names)
            before[topic.name] = Columns(rows[rows[:, 0] < low - 1e-6][-1:], names)
        return cls(
            flight=flight,
            plant=Columns(flight.plant, columns(PlantRecord)),
            fcu=Columns(flight.fcu, columns(Tick)),
            taken_over_s=float(whole.t[0]) if len(whole.t) else np.inf,
            params=recording.params,
            reports=reports,
            before=before,
            metadata=recording.metadata,
        )

    @property
    def t(self) -> Rows:
        """Simulation time of the ticks at which the law was flying, s. Raises Missing."""
        if not len(self.flight.t):
            raise Missing("the law was not flying at any tick that is recorded on both sides")
        return self.flight.t

    @property
    def told(self) -> dict[str, float]:
        """What law and guard were told, by column of Settings. Raises Missing."""
        if self.params is None:
            raise Missing("the law's parameters (/fcu/params) were not recorded")
        return dict(zip(columns(Settings), self.params.tolist(), strict=True))

    @property
    def settled(self) -> Any:
        """bool (n,): which ticks count as settled; all of them if none does."""
        late = self.flight.t >= self.flight.settle_from_s
        return late if late.any() else np.ones(len(late), bool)

    @property
    def settled_from_s(self) -> float:
        """The first time of `settled`. Raises Missing."""
        return float(self.t[self.settled][0])

    def report(self, topic: str) -> Columns:
        """What is recorded of a topic. Raises Missing."""
        rows = self.reports.get(topic)
        if rows is None or not len(rows):
            raise Missing(f"{topic} is not in the recording")
        return rows

    def truth(self, key: str) -> list[float] | None:
        """Numbers of the plant that the recording's metadata names, as `plant.drag`."""
        written, _, _origin = self.metadata.get(key, "").rpartition(" (")
        try:
            value = ast.literal_eval(written)
        except (ValueError, SyntaxError):
            return None
        return [float(v) for v in value] if isinstance(value, list) else None
