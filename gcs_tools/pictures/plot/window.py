"""What figures are drawn of: the rows of a recording in a window of time, by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs_tools.judging.metrics import EngagedTicks
from gcs_tools.judging.recorded_flight import engaged_ticks
from gcs_tools.pictures.history import FlightHistory
from gcs_tools.pictures.quantities import BY_TITLE, ShownLimits
from gcs_tools.recording.reader import Recording, values_told
from gcs_tools.recording.schema import FCU, TRUTH
from gcs_tools.recording.table import Rows, Table

UNTOLD = "the controller that was flown tells nothing of itself"


class Missing(Exception):
    """What a figure needs and the recording does not have: says what, and why it may be so."""


class _Told(dict[str, float]):
    """A law's parameters."""

    def __missing__(self, name: str) -> float:
        raise Missing(f"the law has no parameter {name}")


@dataclass(frozen=True)
class Window:
    """What is shown of a flight. Rows are those from `t_from` to `t_to` (s, both included)."""

    flight: (
        EngagedTicks  # ticks at which the law was flying; what is settled is of the whole flight
    )
    history: FlightHistory  # of the same: the quantities that are shown
    plant: Table  # the truth, at those ticks
    fcu: Table  # what the controller told, at those ticks
    taken_over_s: float  # when the law first flew, also before the window; infinite: never
    params: dict[str, float] | None  # the law's
    reports: dict[str, Table]  # by topic, every tick
    before: dict[str, Table]  # the same, of the last tick before the window, if there is one
    metadata: dict[str, str]

    @classmethod
    def of(cls, recording: Recording, t_from: float | None, t_to: float | None) -> Window:
        """What `recording` has from t_from to t_to; None: from the start, to the end."""
        whole = engaged_ticks(recording)
        flight = whole.window(t_from, t_to)
        low, high = -np.inf if t_from is None else t_from, np.inf if t_to is None else t_to
        reports, before = {}, {}
        for topic, rows in recording.reports.items():
            t = rows["t"]
            reports[topic] = rows.take((t >= low - 1e-6) & (t <= high + 1e-6))
            before[topic] = rows.take(np.flatnonzero(t < low - 1e-6)[-1:])
        tables = {TRUTH: flight.plant, FCU: flight.fcu, **reports}
        return cls(
            flight=flight,
            history=FlightHistory.of("", tables, ShownLimits.of(recording.params or {})),
            plant=flight.plant,
            fcu=flight.fcu,
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
    def tells(self) -> bool:
        """Whether the controller told of itself."""
        return "outputs.T_c" in self.fcu

    def need(self, *titles: str) -> None:
        """Raise Missing if none of these quantities is known."""
        if not self.tells:
            raise Missing(UNTOLD)
        if not any(self.history.shows(BY_TITLE[title]) for title in titles):
            raise Missing(f"the law that was flown tells no {' and no '.join(titles).lower()}")

    @property
    def told(self) -> dict[str, float]:
        """What the law was told, by name; of a name that it does not have too, raises Missing."""
        if not self.tells:
            raise Missing(UNTOLD)
        if self.params is None:
            raise Missing("the law's parameters (/fcu/params) were not recorded")
        return _Told(self.params)

    @property
    def settled(self) -> Any:
        """bool (n,): which ticks count as settled; all of them if none does."""
        late = self.flight.t >= self.flight.settle_from_s
        return late if late.any() else np.ones(len(late), bool)

    @property
    def settled_from_s(self) -> float:
        """The first time of `settled`. Raises Missing."""
        return float(self.t[self.settled][0])

    def report(self, topic: str) -> Table:
        """What is recorded of a topic. Raises Missing."""
        rows = self.reports.get(topic)
        if (rows is None or not len(rows)) and not self.tells:
            raise Missing(UNTOLD)
        if rows is None or not len(rows):
            raise Missing(f"{topic} is not in the recording")
        return rows

    def truth(self, key: str) -> list[float] | None:
        """Numbers of the plant that the recording's metadata names, as `plant.drag`."""
        value = values_told(self.metadata).get(key)
        return [float(v) for v in value] if isinstance(value, list) else None
