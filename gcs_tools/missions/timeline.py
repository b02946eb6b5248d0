"""What a mission asked for over the time of a flight: positions, and what was sent when.

A mission of setpoints or of a curve says that beforehand; of one of items the flight does, as each
begins when the one before is done. Frame: Earth East-North-Up; SI.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from fcu.interface.event_log import Event
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from gcs_tools.judging.metrics import SETTLE_S
from gcs_tools.missions.cache_key import CacheKey
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.items import Follow, GoTo, Hold, Land, Plan, Return, TakeOff
from gcs_tools.missions.paths import Path
from gcs_tools.missions.trajectory import (
    last_change_s,
    positions_at,
    setpoint_at,
    setpoint_times,
)

Rows = np.ndarray[Any, np.dtype[np.float64]]

_STILL = Vec3(0.0, 0.0, 0.0)


class Place(NamedTuple):
    """A place that was asked for, at rest."""

    since_s: float
    until_s: float  # infinite: to the end
    r: Vec3
    held: bool = False  # it was an item's to stay there


class Sent(NamedTuple):
    """A setpoint, and the tick at which it was sent."""

    tick: int
    setpoint: Setpoint


class Timeline(Protocol):
    """What was asked for over the time of a flight."""

    @property
    def flight(self) -> Flight:
        """The table that asks."""

    def positions_at(self, t: Rows) -> Rows:
        """Positions (n, 3), m, at times (n,), s; not a number where no place is asked for."""

    @property
    def last_change_s(self) -> float:
        """When the position last stepped, s."""

    def places(self) -> Iterable[Place]:
        """Those at rest, in turn; what is asked for again is one."""

    def sent(self) -> Sequence[Sent]:
        """Setpoints as the script sends them."""


@dataclass(frozen=True)
class Timed:
    """Asked by the clock."""

    flight: Flight

    def positions_at(self, t: Rows) -> Rows:
        """As Asked has it."""
        return positions_at(self.flight, t)

    @property
    def last_change_s(self) -> float:
        """As Asked has it."""
        return last_change_s(self.flight)

    def places(self) -> Iterable[Place]:
        """As Asked has it."""
        stands: list[tuple[float, tuple[float, float, float]]] = []
        for timed in self.flight.setpoints:
            if not stands or timed.position_m != stands[-1][1]:
                stands.append((timed.at_s, timed.position_m))
        return [
            Place(at_s, stands[i][0] if i < len(stands) else math.inf, Vec3(*r))
            for i, (at_s, r) in enumerate(stands, start=1)
        ]

    def sent(self) -> Sequence[Sent]:
        """As Asked has it."""
        return _sent(cache_key(self.flight))


def cache_key(flight: Flight) -> CacheKey[Flight]:
    """A key that is equal for what asks the same, whatever its seed; not of items, which follow files."""
    assert not flight.items
    return CacheKey(flight, flight.model_dump_json(exclude={"seed"}))


@lru_cache(maxsize=16)
def _sent(asks: CacheKey[Flight]) -> tuple[Sent, ...]:
    flight = asks.of
    return tuple(Sent(k, setpoint_at(flight, k / flight.rate_hz)) for k in setpoint_times(flight))


class Leg(NamedTuple):
    """One thing that a script has the vehicle do: an item, or a part of one."""

    item: int  # of [[flight.items]], from 0
    kind: str  # take_off, go_to, path, hold, land, return
    psi: float  # yaw command, rad; of what the vehicle leads itself that of before
    place: Vec3 | None = None  # m, E, at its end; None: where it began, or on the ground
    path: Path | None = None
    height: float = 0.0  # m, of a take-off, above the ground
    within: float = 0.0  # m
    for_s: float = 0.0


LANDS = ("land", "return", "plan_down")  # legs that end with the rotors stopped
PLANS = ("plan", "plan_down")  # an uploaded plan, that ends in the air, or on the ground
ITEM_BEGUN = "ITEM_BEGUN"  # its values: item from 1, of how many, its kind, the leg's, place


def legs(flight: Flight) -> tuple[Leg, ...]:
    """What the items of a mission have the vehicle do; of setpoints or a curve nothing."""
    psi = math.radians(flight.start.yaw_deg if flight.yaw_deg is None else flight.yaw_deg)
    place = None if flight.start.on_ground else Vec3(*flight.start.position_m)
    found: list[Leg] = []
    for i, item in enumerate(flight.items):
        if isinstance(item, GoTo | Follow) and item.yaw_deg is not None:
            psi = math.radians(item.yaw_deg)
        match item:
            case TakeOff():
                place = None
                found.append(Leg(i, item.kind, psi, height=item.height_m, within=item.within_m))
            case GoTo():
                place = Vec3(*item.position_m)
                found.append(Leg(i, item.kind, psi, place, within=item.within_m))
            case Follow():
                path = item.path
                first, last = path.at(np.array([0.0, path.duration_s])).r.tolist()
                found.append(Leg(i, "go_to", psi, Vec3(*first), within=item.within_m))
                place = Vec3(*last)
                found.append(Leg(i, "path", psi, place, path, within=item.within_m))
            case Hold():
                found.append(Leg(i, item.kind, psi, place, for_s=item.for_s))
            case Plan():
                place = None
                found.append(Leg(i, "plan_down" if item.plan.lands else item.kind, psi))
            case Land() | Return():
                place = None
                found.append(Leg(i, item.kind, psi))
    return tuple(found)


class PlanProgress(NamedTuple):
    """The item of a plan, from 0, at which the vehicle is, of how many, and whether all are done."""

    item: int
    total: int
    is_complete: bool


class Begun(NamedTuple):
    """A leg that was begun in a flight."""

    leg: int  # of `legs`
    tick: int
    place: Vec3 | None  # m, E: where to be at its end; a take-off's is above where it began
    plan: PlanProgress | None = None  # as it was asked last; None: it is no plan

    def event(self, flight: Flight) -> Event:
        """The event of a recording that tells it: `read_begun` reads that."""
        leg = legs(flight)[self.leg]
        kind = flight.items[leg.item].kind
        what = kind if kind == leg.kind or leg.kind == "path" else f"{kind}, to its begin"
        where = "" if self.place is None else f": to ({', '.join(map(repr, self.place))}) m"
        text = f"item {leg.item + 1} of {len(flight.items)}, {what}{where}"
        values = (leg.item + 1, len(flight.items), kind, leg.kind, *(self.place or ()))
        return Event(self.tick / flight.rate_hz, "info", text, code=ITEM_BEGUN, values=values)


def read_begun(flight: Flight, told: Iterable[Event]) -> tuple[Begun, ...]:
    """The legs of a flight from the events of its recording."""
    number = {(leg.item + 1, leg.kind): n for n, leg in enumerate(legs(flight))}
    found = []
    for event in told:
        if event.code == ITEM_BEGUN:
            item, _, _, kind, *place = event.values
            if (leg := number.get((item, kind))) is not None:
                r = Vec3(*place) if place else None
                found.append(Begun(leg, round(event.t * flight.rate_hz), r))
    return tuple(found)


@dataclass(frozen=True)
class Itinerary:
    """Asked item by item, as a flight went."""

    flight: Flight
    begun: tuple[Begun, ...]

    def _spans(self) -> Iterable[tuple[Leg, Begun, int | None]]:
        """Each leg that was begun, and the tick at which the next one was."""
        all_legs = legs(self.flight)
        for i, each in enumerate(self.begun, start=1):
            end = self.begun[i].tick if i < len(self.begun) else None
            yield all_legs[each.leg], each, end

    def positions_at(self, t: Rows) -> Rows:
        """As Asked has it."""
        found = np.full((len(t), 3), math.nan)
        ticks = np.rint(t * self.flight.rate_hz)
        for leg, begun, _ in self._spans():
            after = ticks >= begun.tick
            if leg.path is not None:
                since = t[after] - begun.tick / self.flight.rate_hz
                found[after] = leg.path.at(np.maximum(since, 0.0)).r
            else:
                found[after] = math.nan if begun.place is None else np.array(begun.place)
        return found

    @property
    def last_change_s(self) -> float:
        """As Asked has it."""
        since = [place.since_s for place in self.places()]
        return since[-1] if since else 0.0

    def places(self) -> Iterable[Place]:
        """As Asked has it."""
        rate = self.flight.rate_hz
        found: list[Place] = []
        for leg, begun, end in self._spans():
            until = math.inf if end is None else end / rate
            since = begun.tick / rate + (0.0 if leg.path is None else leg.path.duration_s)
            if begun.place is None or since > until:
                continue
            held = leg.kind == "hold"
            if found and found[-1].r == begun.place and found[-1].until_s == since:
                found[-1] = found[-1]._replace(until_s=until, held=held or found[-1].held)
            else:
                found.append(Place(since, until, begun.place, held))
        return found

    def sent(self) -> Sequence[Sent]:
        """As Asked has it."""
        found: list[Sent] = []
        for leg, begun, end in self._spans():
            if begun.tick == end:  # it was there already: what follows was sent, too
                continue
            if leg.kind == "go_to" and begun.place is not None:
                found.append(Sent(begun.tick, at_rest(begun.place, leg.psi)))
            elif leg.path is not None:
                found += [
                    Sent(k, on_path(leg, (k - begun.tick) / self.flight.rate_hz))
                    for k in path_ticks(leg, begun.tick, self.flight)
                    if end is None or k < end
                ]
        return found


def at_rest(r: Vec3, psi: float) -> Setpoint:
    """The setpoint of a place."""
    return Setpoint(r, _STILL, _STILL, psi, 0.0)


def on_path(leg: Leg, since_s: float) -> Setpoint:
    """The setpoint of a leg along a path, so long after its begin."""
    assert leg.path is not None
    r, v, a = (Vec3(*each[0].tolist()) for each in leg.path.at(np.array([since_s])))
    return Setpoint(r, v, a, leg.psi, 0.0)


def path_ticks(leg: Leg, begin: int, flight: Flight) -> Iterable[int]:
    """The ticks at which the setpoints of a path are sent: its begin, each period, its end."""
    assert leg.path is not None
    end = begin + math.ceil(leg.path.duration_s * flight.rate_hz)
    rate, every = flight.rate_hz, flight.stream_hz
    for i in range(-(-(end - begin) * every // rate)):
        yield begin - (-i * rate // every)  # in whole numbers, the first tick at or after
    yield end


def timeline(flight: Flight, begun: tuple[Begun, ...] = ()) -> Timeline:
    """What a flight was asked for. `begun`: the legs of its items, if it has items."""
    return Itinerary(flight, begun) if flight.items else Timed(flight)


# --- before the flight

_CRUISE = 5.0  # m/s, of the times below


def foreseen(flight: Flight) -> tuple[Vec3, list[Sent]]:
    """Where its setpoints begin, from rest, and what is sent when, as far as that is known before.

    Each leg is given the time to settle. What the vehicle leads itself, take-off, landing and the way
    home, is not looked at before a flight: from a take-off it goes on in its place, at rest.
    """
    rate, all_legs = flight.rate_hz, legs(flight)
    x, y, z = flight.start.position_m
    here = begin = Vec3(x, y, flight.ground_z_m if flight.start.on_ground else z)
    begun: list[Begun] = []
    k = 0
    for i, leg in enumerate(all_legs):
        place = leg.place
        if leg.kind == "take_off":
            place = Vec3(here.x, here.y, flight.ground_z_m + leg.height)
            begin = begin if i else place
        begun.append(Begun(i, k, place))
        to = here if place is None else place
        moves_s = math.dist(to, here) / _CRUISE if leg.path is None else leg.path.duration_s
        k += math.ceil((leg.for_s or moves_s + SETTLE_S) * rate)
        here = to
    sent = list(Itinerary(flight, tuple(begun)).sent())
    if not sent or sent[0].tick > 0:
        sent.insert(0, Sent(0, at_rest(begin, all_legs[0].psi)))
    return begin, sent
