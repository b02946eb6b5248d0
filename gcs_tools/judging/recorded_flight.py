"""What a recording's mission asked for, as its metadata have it."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from functools import partial

from gcs_tools.judging.metrics import SETTLE_S, EngagedTicks
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.trajectory import last_change_s, positions_at
from gcs_tools.recording.reader import Recording

_ASKED = "duration_s", "setpoints", "curve"


def flight_of(metadata: Mapping[str, str]) -> Flight | None:
    """The setpoints and the duration of a mission; None of a vehicle that flew none."""
    given = {}
    for key in _ASKED:
        told = metadata.get(f"flight.{key}") or metadata.get(f"values.flight.{key}", "")
        written, _, _origin = told.rpartition(" (")
        try:
            given[key] = ast.literal_eval(written)
        except (ValueError, SyntaxError):
            continue
    try:
        return Flight.model_validate(given)
    except ValueError:
        return None


def engaged_ticks(recording: Recording) -> EngagedTicks:
    """The ticks of a recording, with the errors that `gcs fly` would find.

    Without a mission the setpoint error is from the setpoint that the vehicle flew.
    """
    flight = flight_of(recording.metadata)
    if flight is None:
        return EngagedTicks.of(recording.plant, recording.fcu)
    settled_from_s = last_change_s(flight) + SETTLE_S
    return EngagedTicks.of(
        recording.plant, recording.fcu, settled_from_s, partial(positions_at, flight)
    )
