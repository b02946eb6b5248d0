"""How much of a flight is kept: every tick, some of them, or none.

A light recording holds a hundred ticks a second and the last one, each with all that a full one has
of it. Figures, replay and views need no more; the bytes of a trajectory do.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from fcu.interface.event_log import Event
from gcs_tools.recording.schema import Kinds
from gcs_tools.recording.table import Rows
from gcs_tools.recording.writer import RecordingWriter

FULL, LIGHT, NONE = MODES = ("full", "light", "none")
LIGHT_HZ = 100.0  # ticks kept a second of simulation time
EVERY = "every"  # of metadata: one tick in so many is recorded

Add = Callable[[Rows], None]


class LightRecording(RecordingWriter):
    """Writes some of the ticks that it is given."""

    def __init__(
        self, path: Path, metadata: dict[str, str], kinds: Kinds, rate_hz: float
    ) -> None:  # fmt: skip
        """`rate_hz`: control ticks a second. Raises RecordingError."""
        self._rate_hz = rate_hz
        self._every = max(1, round(rate_hz / LIGHT_HZ))
        self._last: dict[Add, Rows] = {}  # what was not kept so far, and how it would be
        super().__init__(path, metadata | {EVERY: str(self._every)}, kinds)

    def add_plant(self, rows: Rows) -> None:
        """Some of them."""
        self._thin(super().add_plant, rows)

    def add_fcu(self, rows: Rows) -> None:
        """Some of them."""
        self._thin(super().add_fcu, rows)

    def _thin(self, add: Add, rows: Rows) -> None:
        """Hand on the rows of the ticks that are kept, whoever's they are."""
        if not len(rows):
            return
        kept = np.rint(rows[:, 0] * self._rate_hz).astype(np.int64) % self._every == 0
        add(rows[kept])
        self._last.pop(add, None)
        if not kept[-1]:
            self._last[add] = rows[-1:].copy()

    def close(self) -> None:
        """Write the last tick, and close as any recording."""
        last, self._last = self._last, {}
        for add, rows in last.items():
            add(rows)
        super().close()


class NoRecording(AbstractContextManager["NoRecording"]):
    """Writes nothing; as RecordingWriter."""

    written = 0, 0

    def add_plant(self, rows: Rows) -> None:
        """Forget them."""

    def add_fcu(self, rows: Rows) -> None:
        """Forget them."""

    def set_params(self, row: Rows, t: float = 0.0) -> None:
        """Forget them."""

    def event(self, event: Event) -> None:
        """Forget it."""

    def __exit__(self, *error: object) -> None:
        """Nothing to close."""


Recorder = RecordingWriter | NoRecording


def recorder(
    mode: str, path: Path, metadata: dict[str, str], kinds: Kinds, rate_hz: float
) -> Recorder:
    """What records a flight in a mode, one of MODES. Raises RecordingError, ValueError."""
    if mode == LIGHT:
        return LightRecording(path, metadata, kinds, rate_hz)
    if mode == NONE:
        return NoRecording()
    if mode != FULL:
        raise ValueError(f"record {mode!r}: expected one of {', '.join(MODES)}")
    return RecordingWriter(path, metadata, kinds)
