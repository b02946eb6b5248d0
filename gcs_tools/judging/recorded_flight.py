"""The mission of a recording, by its metadata and events."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gcs_tools.judging.metrics import SETTLE_S, EngagedTicks
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.paths import PathError
from gcs_tools.missions.timeline import read_begun, timeline
from gcs_tools.recording.reader import Recording, values_told

_ASKED = (
    "duration_s", "rate_hz", "setpoints", "curve", "items", "ground_z_m", "arena_m", "stream_hz",
    "yaw_deg", "start.position_m", "start.yaw_deg", "start.on_ground",
)  # fmt: skip


def flight_of(metadata: Mapping[str, str]) -> Flight | None:
    """The setpoints and the duration of a mission. None if the vehicle flew none."""
    values, given = values_told(metadata), dict[str, Any]()
    for key in _ASKED:
        if f"flight.{key}" in values:
            table, _, name = key.rpartition(".")
            (given.setdefault(table, {}) if table else given)[name] = values[f"flight.{key}"]
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
        begun = read_begun(flight, recording.events)
        wanted = timeline(flight, begun)
        settled_from_s = wanted.last_change_s + SETTLE_S
    except PathError:  # of a file that is elsewhere
        return EngagedTicks.of(recording.plant, recording.fcu)
    return EngagedTicks.of(recording.plant, recording.fcu, settled_from_s, wanted.positions_at)
