"""Whether the vehicle flew the setpoints that its mission asked for, and reached those that stand.

What is reached is looked at by the truth, and what was flown by what the controller tells: a
setpoint that it limits or refuses is another one there than the mission's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from gcs_tools.judging.metrics import SETTLE_S
from gcs_tools.missions.asked import Asked
from gcs_tools.missions.flight_table import Flight
from gcs_tools.recording.table import Table

_COMPARED = (
    *(f"{vector}.{axis}" for vector in ("r_c", "v_c", "a_c") for axis in "xyz"),
    "psi_dot_c",
)
_HALF_US = 0.5e-6
CLEAR = 0.05  # m above the ground: a vehicle that is told to go lower lands
_ROUNDED, _ROUNDED_PART = 1e-3, 2e-7  # what the wire's float32 makes of a number, and of its size


@dataclass(frozen=True)
class Standing:
    """A setpoint that stood for SETTLE_S or longer, or was to be held, and where the vehicle was in the end."""

    since_s: float
    until_s: float  # the next setpoint's time, or the end of the flight
    place: Vec3  # m, E
    away_m: float  # the true vehicle, at the last tick of that time; infinite: no number
    grounded: str = ""  # `grounded`

    def __str__(self) -> str:
        """What a pilot has to know of one that was not reached."""
        away = f"{self.away_m:.3g} m" if self.away_m < math.inf else "not at any finite distance"
        why = f", {self.grounded}," if self.grounded else ""
        return (
            f"the setpoint of {self.since_s:g} s at {coordinates(self.place)}{why} was not reached: "
            f"at {self.until_s:g} s the vehicle was {away} away"
        )


@dataclass(frozen=True)
class Changed:
    """A setpoint that the vehicle flew as another one: limited, or refused and the one before kept."""

    at_s: float
    asked: Setpoint
    flown: Setpoint
    grounded: str = ""  # `grounded`

    def __str__(self) -> str:
        """Which it was, and what it was flown as."""
        asked, flown = self.asked, self.flown
        what, made = coordinates(asked.r_c), f"as {coordinates(flown.r_c)}"
        for name, unit in (("v_c", "m/s"), ("a_c", "m/s^2"), ("psi_dot_c", "rad/s")):
            if not _far(asked.r_c, flown.r_c) and _far(getattr(asked, name), getattr(flown, name)):
                what, made = (
                    f"{np.linalg.norm(getattr(setpoint, name)):.3g} {unit}"
                    for setpoint in (asked, flown)
                )
                made = f"at {made}"
                break
        why = f"{self.grounded}, " if self.grounded else ""
        return f"the setpoint of {self.at_s:g} s, {what}, {why}was flown {made}"


def coordinates(r: Vec3) -> str:
    """Coordinates to a centimetre."""
    return f"({', '.join(f'{round(value, 2) + 0.0:g}' for value in r)}) m"


def grounded(flight: Flight, r: Vec3) -> str:
    """What is told of a place (m, E) that is on or below the ground of a mission; empty above it."""
    if r.z >= flight.ground_z_m + CLEAR:
        return ""
    where = "below" if r.z < flight.ground_z_m else "on"
    lands = ": the vehicle lands" if flight.start.on_ground else ""
    return f"which is {where} the ground (flight.ground_z_m is {flight.ground_z_m:g} m{lands})"


def _compared(setpoint: Setpoint) -> list[float]:
    """The numbers of _COMPARED."""
    return [*setpoint.r_c, *setpoint.v_c, *setpoint.a_c, setpoint.psi_dot_c]


def _far(asked: object, flown: object) -> bool:
    """Whether two values are not the same one, rounded on its way."""
    a, b = np.asarray(asked, float), np.asarray(flown, float)
    return bool((np.abs(a - b) > _ROUNDED + _ROUNDED_PART * np.abs(a)).any())


def standing(asked: Asked, plant: Table) -> list[Standing]:
    """Each place of a mission that stood for SETTLE_S, or was to be held, in a flight of which `plant` is the truth."""
    found: list[Standing] = []
    t, r_E = plant["t"], plant["state.r_E"]
    if not len(t):
        return found
    over_s = float(t[-1]) + 1.0 / asked.flight.rate_hz
    for since_s, ends_s, place, held in asked.places():
        until_s = min(ends_s, over_s)
        if until_s - since_s < SETTLE_S - _HALF_US and not held:
            continue
        last = int(np.searchsorted(t, until_s - _HALF_US)) - 1
        with np.errstate(invalid="ignore", over="ignore"):
            away = float(np.linalg.norm(r_E[last] - np.array(place)))
        away = away if math.isfinite(away) else math.inf
        why = grounded(asked.flight, place)
        found.append(Standing(since_s, round(until_s, 6), place, away, why))
    return found


def accepted(flight: Flight, plant: Table, fcu: Table) -> list[Standing]:
    """Each place that the vehicle had accepted as its setpoint, at rest and for SETTLE_S, as `standing`.

    For a flight whose mission asks for nothing itself: a script did.
    """
    fcu = fcu.take(fcu["engaged"] > 0.5)
    t, r_c = fcu["t"], fcu["setpoint.r_c"]
    rests = (fcu["setpoint.v_c"] == 0.0).all(axis=1) & (fcu["setpoint.a_c"] == 0.0).all(axis=1)
    rests &= fcu["setpoint.level"] == 0.0  # an attitude or a rate asks for no place
    found: list[Standing] = []
    if not len(t) or not len(plant):
        return found
    new = (r_c[1:] != r_c[:-1]).any(axis=1) | (rests[1:] != rests[:-1])
    new |= np.diff(t) > SETTLE_S  # disarmed in between
    begins = [0, *(1 + np.flatnonzero(new)).tolist(), len(t)]
    for first, end in pairwise(begins):
        since_s, until_s = float(t[first]), float(t[end - 1]) + 1.0 / flight.rate_hz
        if not rests[first] or until_s - since_s < SETTLE_S - _HALF_US:
            continue
        last = int(np.searchsorted(plant["t"], until_s - _HALF_US)) - 1
        place = Vec3(*r_c[first].tolist())
        with np.errstate(invalid="ignore", over="ignore"):
            away = float(np.linalg.norm(plant["state.r_E"][last] - np.array(place)))
        away = away if math.isfinite(away) else math.inf
        found.append(Standing(since_s, round(until_s, 6), place, away, grounded(flight, place)))
    return found


def changed(asked: Asked, fcu: Table) -> list[Changed]:
    """Setpoints that were flown as others; of those for one place, and of a curve, the first.

    fcu : what the controller told, of a law that was flying or not.
    """
    flies, rate_hz = fcu["engaged"] > 0.5, asked.flight.rate_hz
    ticks = np.rint(fcu["t"][flies] * rate_hz).astype(np.int64)
    sent = list(asked.sent())
    there = np.isin([each.tick for each in sent], ticks)  # in real time some are dropped
    sent = [each for each, is_there in zip(sent, there.tolist(), strict=True) if is_there]
    wanted = np.array([_compared(each.setpoint) for each in sent]).reshape(-1, len(_COMPARED))
    at = np.flatnonzero(flies)[np.searchsorted(ticks, [each.tick for each in sent])]
    made = np.stack([fcu[f"setpoint.{name}"][at] for name in _COMPARED], axis=1)
    off = np.abs(wanted - made) > _ROUNDED + _ROUNDED_PART * np.abs(wanted)
    found: list[Changed] = []
    for i in np.flatnonzero(off.any(axis=1)).tolist():
        tick, setpoint = sent[i]
        again = found and (asked.flight.curve is not None or found[-1].asked.r_c == setpoint.r_c)
        if not again:
            r_c, v_c, a_c = (Vec3(*made[i, j : j + 3].tolist()) for j in (0, 3, 6))
            flown = setpoint._replace(r_c=r_c, v_c=v_c, a_c=a_c, psi_dot_c=float(made[i, 9]))
            why = grounded(asked.flight, setpoint.r_c)
            found.append(Changed(tick / rate_hz, setpoint, flown, why))
    return found
