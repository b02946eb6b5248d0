"""When the vehicle of a mission has arrived, and a recording that ends with that tick."""

from __future__ import annotations

import numpy as np

from fcu.kernel.rows import column
from gcs_tools.flight.processes import Rows, Take
from gcs_tools.flight.scenario import Scenario
from sitl_plant.physics.types import PlantRecord


def stands_from(scene: Scenario) -> int:
    """The tick from which on every setpoint of the mission is in the same place as its last."""
    places = np.array([setpoint.r_c for setpoint in scene.sent])
    elsewhere = np.flatnonzero((places != places[-1]).any(axis=1))
    first = int(elsewhere[-1]) + 1 if len(elsewhere) else 0
    return int(scene.sent_at[first])


class Arrival:
    """Looks for the tick at which the vehicle has been near its last setpoint for long enough."""

    def __init__(self, scene: Scenario) -> None:
        self._rate_hz = scene.rate_hz
        self._tick = scene.kinds.tick
        self._within_m, self._held = scene.arrive or (-1.0, 0)  # nothing is nearer than that
        self._there = np.array(scene.sent[-1].r_c)
        self._last = stands_from(scene)
        self._near_since = -1  # tick; negative: it is not near

    def time_s(self, plant: Rows, fcu: Rows) -> float | None:
        """The time of arrival, if it is one of these rows', which follow those seen before.

        Of ticks that only one side has, nothing is known.
        """
        t, of_plant, of_fcu = np.intersect1d(plant[:, 0], fcu[:, 0], return_indices=True)
        r_E = column(PlantRecord, plant[of_plant], "state.r_E")
        flies = column(self._tick, fcu[of_fcu], "engaged") > 0.0
        ticks = np.rint(t * self._rate_hz).astype(np.int64)
        near = np.linalg.norm(r_E - self._there, axis=1) <= self._within_m
        near &= flies & (ticks >= self._last)
        for time_s, tick, is_near in zip(t.tolist(), ticks.tolist(), near.tolist(), strict=True):
            if not is_near:
                self._near_since = -1
                continue
            if self._near_since < 0:
                self._near_since = tick
            if tick - self._near_since + 1 >= self._held:
                return float(time_s)
        return None


def arrival(scene: Scenario, plant: Rows, fcu: Rows) -> float | None:
    """The time (s) of the tick at which the vehicle had arrived, in the rows so far; None: not yet."""
    return None if scene.arrive is None else Arrival(scene).time_s(plant, fcu)


class UntilArrival:
    """Hands rows on, to be recorded, up to the tick of arrival, and drops those behind it.

    The flight goes on until somebody looks; what is recorded must not depend on when that is. Rows
    of one side wait for those of the other.
    """

    def __init__(self, scene: Scenario, record: tuple[Take, Take]) -> None:
        """`record`: takes plant rows, takes fcu rows."""
        self._arrival = Arrival(scene) if scene.arrive is not None else None
        self._record = record
        self._waiting: list[list[Rows]] = [[], []]
        self._arrived = False

    def add_plant(self, rows: Rows) -> None:
        """Some more of the plant's."""
        self._add(0, rows)

    def add_fcu(self, rows: Rows) -> None:
        """Some more of the flight controller's."""
        self._add(1, rows)

    def _add(self, which: int, rows: Rows) -> None:
        if self._arrival is None:
            self._record[which](rows)
        elif not self._arrived and len(rows):
            self._waiting[which].append(rows)
            if all(self._waiting):
                self._hand_on(self._arrival)

    def _hand_on(self, arrival: Arrival) -> None:
        plant, fcu = (np.concatenate(rows) for rows in self._waiting)
        until = min(plant[-1, 0], fcu[-1, 0])
        known = [rows[rows[:, 0] <= until] for rows in (plant, fcu)]
        arrived_s = arrival.time_s(known[0], known[1])
        for record, rows in zip(self._record, known, strict=True):
            record(rows if arrived_s is None else rows[rows[:, 0] <= arrived_s])
        self._arrived = arrived_s is not None
        rest = [rows[rows[:, 0] > until] for rows in (plant, fcu)]
        self._waiting = [[rows] if len(rows) else [] for rows in rest]

    def finish(self) -> None:
        """The flight is over: hand on what one side alone has told, of one that did not arrive."""
        waiting, self._waiting = self._waiting, [[], []]
        if not self._arrived:
            for record, batches in zip(self._record, waiting, strict=True):
                for rows in batches:
                    record(rows)
