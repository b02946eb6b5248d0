"""Listeners that come late hear of the plan in force, not of the last event alone."""

from __future__ import annotations

from fcu.interface.event_log import Event
from gcs_tools.live import samples
from gcs_tools.live.publisher import PublishedVehicle
from gcs_tools.recording import events
from gcs_tools.recording.plans import PlanHistory


def items(first, last, total, kind="Mission"):
    one = ("NAV_WAYPOINT", 3.0, 0.0, 0.0, 0.0, "nan", 0.0, 0.0, 5.0, 1.0, 1.0, 2.0, 5.0)
    values = (kind, float(first), float(last), float(total), *(last - first + 1) * one)
    return Event(1.0, "debug", "items", "fcu", "PLAN_ITEMS", values)


def latest(told):
    """The answer to a question for the last events, after these."""
    vehicle = PublishedVehicle.__new__(PublishedVehicle)
    vehicle._plan, vehicle._last = {}, {}
    for number, event in enumerate(told):
        vehicle._keep(event, number, round(event.t * 1e9), events.encode(event))
    ((sample, _),) = vehicle._last.values()
    return events.decode(events.schema(), samples.unpack(sample).ticks)


def test_the_plan_in_force_is_kept_with_the_last_event():
    at = Event(3.0, "debug", "at", "fcu", "PLAN_AT", (2.0, 3.0, 1.0))
    last = Event(9.0, "info", "Armed", "fcu", "ARMED", ())
    old = [
        items(0, 15, 32),
        items(16, 31, 32),
        Event(2.0, "debug", "", "fcu", "PLAN_AT", (0.0, 32.0, -1.0)),
    ]
    found = latest(
        [
            *old,
            items(0, 2, 3),
            items(0, 0, 1, "Rally points"),
            at,
            *20 * [last._replace(text="x")],
            last,
        ]
    )
    assert found[-1].text == "Armed"
    assert len(found) == 4
    seen = PlanHistory(found).at(10.0)
    assert (len(seen.mission), seen.current, len(seen.rally)) == (3, 2, 1)
