"""Whether the vehicle flew the setpoints that its mission asked for, and reached those that stand.

What is reached is looked at by the truth, and what was flown by what the controller tells: a
setpoint that it limits or refuses is another one there than the mission's.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, pairwise

import numpy as np

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from gcs_tools.judging.metrics import SETTLE_S, Flags, blocks, is_up
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.timeline import Timeline
from gcs_tools.recording.table import HALF_US, Table

_COMPARED = (
    *(f"{vector}.{axis}" for vector in ("r_c", "v_c", "a_c") for axis in "xyz"),
    "psi_dot_c",
)
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
    was_cut: bool = (
        False  # the flight ended badly before it had stood for SETTLE_S: nobody has judged it
    )

    def __str__(self) -> str:
        """What a pilot has to know of one that was not reached."""
        if self.was_cut:
            return (
                f"the setpoint of {self.since_s:g} s at {coordinates(self.place)} was not reached: "
                f"the flight ended at {self.until_s:g} s"
            )
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


def standing(asked: Timeline, plant: Table, was_cut: bool = False) -> list[Standing]:
    """Each place of a mission that stood for SETTLE_S, or was to be held, in a flight of which `plant` is the truth.

    was_cut : the flight ended badly. Places that would have stood, had it gone on, are infinitely far then.
    """
    found: list[Standing] = []
    if not len(plant):
        return found
    over_s = _time(plant, len(plant) - 1) + 1.0 / asked.flight.rate_hz
    for since_s, ends_s, place, held in asked.places():
        until_s = min(ends_s, over_s)
        wanted_s = min(ends_s, asked.flight.duration_s) - since_s
        if was_cut and (held or wanted_s >= SETTLE_S) and until_s - since_s < SETTLE_S - HALF_US:
            found.append(Standing(since_s, round(over_s, 6), place, math.inf, was_cut=True))
            continue
        if until_s - since_s < SETTLE_S - HALF_US and not held:
            continue
        last = _first_from(plant, until_s - HALF_US) - 1
        away, why = _away(plant, last, place), grounded(asked.flight, place)
        found.append(Standing(since_s, round(until_s, 6), place, away, why))
    return found


def accepted(flight: Flight, plant: Table, fcu: Table) -> list[Standing]:
    """Each place that the vehicle had accepted as its setpoint, at rest and for SETTLE_S, as `standing`.

    For a flight whose mission asks for nothing itself: a script did.
    """
    fcu = fcu.take(is_up(fcu, "engaged"))
    t = fcu["t"]
    found: list[Standing] = []
    if not len(t) or not len(plant):
        return found
    rests: Flags = np.empty(len(t), bool)
    new: Flags = np.zeros(len(t), bool)
    for block in blocks(len(t)):
        ticks = fcu.take(slice(max(block.start - 1, 0), block.stop))  # and the one before them
        r_c, still = ticks["setpoint.r_c"], _rests(ticks)
        rests[block] = still[len(still) - (block.stop - block.start) :]
        differs = (r_c[1:] != r_c[:-1]).any(axis=1) | (still[1:] != still[:-1])
        new[block.stop - len(differs) : block.stop] = differs
    new[1:] |= np.diff(t) > SETTLE_S  # disarmed in between
    begins = [0, *np.flatnonzero(new).tolist(), len(t)]
    for first, end in pairwise(begins):
        since_s, until_s = float(t[first]), float(t[end - 1]) + 1.0 / flight.rate_hz
        if not rests[first] or until_s - since_s < SETTLE_S - HALF_US:
            continue
        last = _first_from(plant, until_s - HALF_US) - 1
        place = Vec3(*fcu.take(slice(first, first + 1))["setpoint.r_c"][0].tolist())
        away, why = _away(plant, last, place), grounded(flight, place)
        found.append(Standing(since_s, round(until_s, 6), place, away, why))
    return found


def _rests(fcu: Table) -> Flags:
    """Return at which ticks a place was asked for, at rest. An attitude or a rate asks for none."""
    rests: Flags = fcu["setpoint.level"] == 0.0
    for name in ("setpoint.v_c", "setpoint.a_c"):
        rests &= (fcu[name] == 0.0).all(axis=1)
    return rests


def _time(plant: Table, row: int) -> float:
    """Return the time of a row, s."""
    return float(plant.take(slice(row, row + 1))["t"][0])


def _first_from(plant: Table, t: float) -> int:
    """Return the first row whose time is at least t (s). It reads some rows of a long flight alone."""
    return bisect_left(range(len(plant)), t, key=lambda row: _time(plant, row))


def _away(plant: Table, row: int, place: Vec3) -> float:
    """Return how far (m) the vehicle was from a place, or infinity where that is no number."""
    r_E = plant.take(slice(row, row + 1 or None))["state.r_E"][0]
    with np.errstate(invalid="ignore", over="ignore"):
        away = float(np.linalg.norm(r_E - np.array(place)))
    return away if math.isfinite(away) else math.inf


def changed(
    asked: Timeline, fcu: Table, hears: Callable[[int], bool] = lambda tick: True
) -> list[Changed]:
    """Setpoints that were flown as others; of those for one place, and of a curve, the first.

    fcu : what the controller told, of a law that was flying or not.
    hears : whether the vehicle hears a setpoint that is sent at a tick.
    """
    flying, rate_hz = fcu.take(is_up(fcu, "engaged")), asked.flight.rate_hz
    sent = sorted((each for each in asked.sent() if hears(each.tick)), key=lambda each: each.tick)
    sent_at = np.fromiter((each.tick for each in sent), np.int64, len(sent))
    there: Flags = np.zeros(len(sent), bool)  # in real time some are dropped
    made = np.empty((len(sent), len(_COMPARED)))
    for block in blocks(len(flying)):
        told = flying.take(block)
        ticks = np.rint(told["t"] * rate_hz).astype(np.int64)
        some = slice(*np.searchsorted(sent_at, [ticks[0], ticks[-1] + 1]).tolist())
        row = np.searchsorted(ticks, sent_at[some])
        there[some] = ticks[row] == sent_at[some]
        if len(row):
            made[some] = np.stack([told[f"setpoint.{name}"][row] for name in _COMPARED], axis=1)
    sent = [each for each, is_there in zip(sent, there.tolist(), strict=True) if is_there]
    made = made[there]
    numbers = chain.from_iterable(_compared(each.setpoint) for each in sent)
    wanted = np.fromiter(numbers, float).reshape(-1, len(_COMPARED))
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
