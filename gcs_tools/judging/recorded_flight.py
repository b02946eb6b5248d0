"""What a recording's mission asked for, as its metadata have it."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

from gcs_tools.judging.metrics import SETTLE_S, EngagedTicks
from gcs_tools.missions.asked import asked, read_begun
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.paths import PathError
from gcs_tools.recording.reader import Recording

_ASKED = (
    "duration_s", "rate_hz", "setpoints", "curve", "items", "ground_z_m", "arena_m", "stream_hz",
    "yaw_deg", "start.position_m", "start.yaw_deg", "start.on_ground",
)  # fmt: skip


def flight_of(metadata: Mapping[str, str]) -> Flight | None:
    """The setpoints and the duration of a mission; None of a vehicle that flew none."""
    given: dict[str, Any] = {}
    for key in _ASKED:
        told = metadata.get(f"flight.{key}") or metadata.get(f"values.flight.{key}", "")
        written, _, _origin = told.rpartition(" (")
        try:
            value = ast.literal_eval(written)
        except (ValueError, SyntaxError):
            continue
        table, _, name = key.rpartition(".")
        (given.setdefault(table, {}) if table else given)[name] = value
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
    try:
        begun = read_begun(flight, [(event.t, event.text) for event in recording.events])
        wanted = asked(flight, begun)
        settled_from_s = wanted.last_change_s + SETTLE_S
    except PathError:  # of a file that is elsewhere
        return EngagedTicks.of(recording.plant, recording.fcu)
    return EngagedTicks.of(recording.plant, recording.fcu, settled_from_s, wanted.positions_at)
