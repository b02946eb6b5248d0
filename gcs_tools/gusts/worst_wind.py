"""The wind that brings each limit nearest, within what is believed of the air: computed, not drawn.

A flight is flown at the ends of what is believed of the vehicle, in winds that are steady, turn, or are sums of
sines. Where one of them brought a limit nearest, the search begins: the flight is linearised about what it did
(`responses`), a linear program finds the wind that brings the limit nearest at that time (`program`), that wind is
flown, and so again until nothing is gained. On the way it is moved in time, to where in the flight it is worst.
What is told is flown, so it is attained. That nothing is worse is not certain, since far from a flight the loop is
not linear.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fcu.guard import foreseen
from fcu.kernel.rows import column
from fcu.process.tick import Tick
from gcs_tools.campaigns.flights import each
from gcs_tools.flight.resumption import Resumption
from gcs_tools.flight.scenario import Scenario
from gcs_tools.gusts import air, program
from gcs_tools.gusts.air import Bounds
from gcs_tools.gusts.ends import End, at, ends
from gcs_tools.gusts.limits import LIMITS, facets, outputs, rooms
from gcs_tools.gusts.responses import KNOT_S, knots, response

if TYPE_CHECKING:
    from rich.console import Console

Rows = np.ndarray[Any, np.dtype[np.float64]]

TRANSIENT_S = 0.5  # after take-over, at least: nothing is judged in it
ROUNDS = 10  # of linearising and flying, at most
GAINED_N = 0.1  # of a round: with less it is the last
FIRST_ROUNDS = 3  # of each search: then the best of a limit alone goes on
# of the greatest speed: how far the first wind may be from that of the begin
BEGUN = {"thrust_up": 1.0, "thrust_down": 1.0, "tilt": 1.0, "torque": 1.0 / 3.0}
NARROWED, WIDENED, NEARER = 1.0 / 3.0, 2.0, 4  # how far the next may be, and tries of a round
EARLIEST_S = 1.5  # a wind has so long, at least, to bring a limit near
FAR_S, NEAR_S = (
    0.4,
    0.1,
)  # steps by which a wind is moved in time: over its part, then about the best
# that are searched from a flight
FACETS = {"thrust_up": 1, "thrust_down": 1, "tilt": 1, "torque": 2}
SUMS = 12  # drawn sums of sines
SEED = 1
INSIDE = 1.0 - 1e-6  # part of the bounds: what is rounded stays within them


class Begin(NamedTuple):
    """A flight of which a search may begin, and how near it came."""

    end: End
    name: str  # of the wind
    wind: Rows  # float64[ticks, 3]
    rooms: Rows  # float64[parts, 4], least of each part of the flight, N


@dataclass(frozen=True)
class Worst:
    """How near a limit comes in one part of a flight."""

    limit: str  # of LIMITS
    part: int  # of the flight, from 1
    from_s: float
    to_s: float
    at_s: float  # when it is nearest
    still_n: float  # room in still air, of the worst end, N
    drawn_n: float  # in sums of sines
    begun_n: float  # in the wind that the search began with
    begun: str  # which that was
    computed_n: float  # in the wind that was computed
    end: End
    rounds: int
    saturated: bool  # a limit was met in that flight, after the transient
    samples: Rows  # float64[n, 4], s and m/s, E: the wind


class Least(NamedTuple):
    """Of one flight in a part of it: how near a limit, and when."""

    room: float  # N
    tick: int
    saturated: bool


def transient_s(scene: Scenario) -> float:
    """How long (s) after take-over a flight is not judged."""
    return max(float(foreseen.transient_s(scene.guard, scene.law)), TRANSIENT_S)


def parts_of(scene: Scenario, n: int) -> list[tuple[int, int]]:
    """The first tick of each of n parts of a flight after its transient, and the first after it."""
    first = min(round(transient_s(scene) * scene.rate_hz), scene.ticks - 1)
    edges = np.linspace(first, scene.ticks, n + 1).round().astype(int).tolist()
    return [(a, b) for a, b in itertools.pairwise(edges) if b > a]


class Vehicle:
    """One end of the beliefs, flown in any wind."""

    def __init__(self, scene: Scenario, end: End) -> None:
        """Raises LawError."""
        self.scene = at(scene, end)
        self.flight = Resumption(self.scene)

    def fly(self, wind: Rows, until: int) -> Rows:
        """float64[n, 4]: the rooms at each tick before `until`, or fewer if the flight ends earlier."""
        self.flight.air[:] = wind
        self.flight.resume(self.flight.begin)
        self.flight.fly(until)
        return rooms(self.scene, outputs(self.flight.law_rows[: self.flight.tick]))

    def judged(self, room: Rows, part: tuple[int, int]) -> Least:
        """How near a limit came in a part of the flight just flown.  room : float64[n], N, of its ticks."""
        first = part[0]
        found = room[first:]
        if not len(found):
            return Least(-np.inf, first, True)
        k = int(found.argmin())
        rows = self.flight.law_rows[first : first + len(found)]
        met = sum(
            (column(Tick, rows, f"outputs.saturation.{of}") for of in ("thrust", "tilt", "torque")),
            np.zeros(len(rows)),
        )
        return Least(float(found[k]), first + k, bool((met > 0.5).any()) or float(found[k]) < 0.0)


def begins(scene: Scenario, n: int, sums: int, seed: int) -> Callable[[End], list[Begin]]:
    """A function that flies the winds a search may begin with, at an end of the beliefs. Still air comes first."""
    bounds, t = bounds_of(scene), np.arange(scene.ticks) / scene.rate_hz
    parts = parts_of(scene, n)

    def fly(end: End) -> list[Begin]:
        vehicle, found = Vehicle(scene, end), []
        winds = [("still", np.zeros((scene.ticks, 3))), *air.family(bounds, t, sums, seed)]
        for name, wind in winds:
            room = vehicle.fly(wind, scene.ticks)
            least = [
                room[a:b].min(axis=0) if len(room) > a else np.full(len(LIMITS), -np.inf)
                for a, b in parts
            ]
            found.append(Begin(end, name, wind, np.array(least)))
        return found

    return fly


def bounds_of(scene: Scenario) -> Bounds:
    """The greatest wind that the guard is told to believe in."""
    return Bounds(INSIDE * float(scene.guard.w_max), INSIDE * float(scene.guard.w_dot_max))


@dataclass(frozen=True)
class Search:
    """A search for the worst wind of one facet of a limit, and how far it has come."""

    begin: Begin
    limit: str  # of LIMITS
    part: tuple[int, int]
    tick: int  # at which the facet is brought nearest
    facet: int  # of `limits.facets`
    wind: Rows  # float64[ticks, 3]
    value: float  # of the facet at the tick, N
    found: Least  # of the limit, in its part, in the worst wind that was flown
    worst: Rows  # float64[ticks, 3], that wind
    by: float  # m/s: how far the next wind may be from this one
    keeps: (
        bool  # the wind before the window that is computed stays as it was; else it is steady there
    )
    rounds: int = 0
    over: bool = False  # nothing more is gained


def searches(
    scene: Scenario, begin: Begin, limit: str, part: tuple[int, int], n: int
) -> list[Search]:
    """Searches that begin with a flight, for the n facets that promise most. Raises LawError."""
    bounds, vehicle = bounds_of(scene), Vehicle(scene, begin.end)
    room = vehicle.fly(begin.wind, part[1])[:, LIMITS.index(limit)]
    first = max(part[0], min(round(EARLIEST_S * scene.rate_hz), part[1] - 1))
    if len(room) <= first or bounds.speed <= 0.0:
        return []
    tick = first + int(room[first:].argmin())
    found = vehicle.judged(room, part)
    of = knots(tick, 1.0 / scene.rate_hz, None)
    answer = response(vehicle.flight, begin.wind[of.at], of, tick)
    promised = []
    for i, facet in enumerate(facets(vehicle.scene, limit, answer.out)):
        value, by_wind = facet.value(answer.out), answer.by_wind @ facet.gradient
        if np.isfinite(by_wind).all():
            gain = program.smoothed(by_wind, KNOT_S, bounds)
            promised.append(
                (round(value - gain - float((by_wind * begin.wind[of.at]).sum()), 6), i, value)
            )
    return [
        Search(
            begin, limit, part, tick, i, begin.wind, value, found, begin.wind, BEGUN[limit] * bounds.speed, keeps
        )
        for _, i, value in sorted(promised)[:n]
        for keeps in ((False, True) if begin.name == "turning" else (False,))
    ]  # fmt: skip


def gone_on(scene: Scenario, search: Search, rounds: int) -> Search:
    """The search after so many rounds more, at most: linearise, solve, fly what the program found.

    A wind that is no worse than foreseen by half is tried again nearer to the last. Never less bad than
    before. Raises LawError, ProgramError.
    """
    bounds, h = bounds_of(scene), 1.0 / scene.rate_hz
    vehicle = Vehicle(scene, search.begin.end)
    for _ in range(rounds):
        if search.over or search.found.room < 0.0:  # it has met the limit
            break
        of = knots(search.tick, h, search.wind if search.keeps else None)
        here = program.within(search.wind[of.at], of.apart, bounds)
        answer = response(vehicle.flight, here, of, search.tick)
        facet = facets(vehicle.scene, search.limit, answer.out)[search.facet]
        by_wind, by, value = answer.by_wind @ facet.gradient, search.by, search.value
        if not np.isfinite(by_wind).all():
            return replace(search, over=True)
        for _ in range(NEARER):
            there = program.least(by_wind, of.apart, bounds, here, by, of.head is not None)
            wind = of.air(there, scene.ticks)
            room = vehicle.fly(wind, search.part[1])[:, LIMITS.index(search.limit)]
            if len(room) <= search.tick:
                return replace(
                    search, worst=wind, found=vehicle.judged(room, search.part), over=True
                )
            out = outputs(vehicle.flight.law_rows[search.tick : search.tick + 1])[0]
            value = facets(vehicle.scene, search.limit, out)[search.facet].value(out)
            found = vehicle.judged(room, search.part)
            if found.room < search.found.room:
                search = replace(search, found=found, worst=wind)
            if value < search.value:
                break
            by *= NARROWED
        gained = search.value - value
        if gained > 0.0:
            search = replace(search, wind=wind, value=value)
        search = replace(
            search,
            by=min(WIDENED * by, bounds.speed),
            rounds=search.rounds + 1,
            over=gained < GAINED_N,
        )
    return search


def moved(scene: Scenario, search: Search) -> Search:
    """The search with its wind moved in time, to where in its part of the flight that is worst.

    A linear program keeps to the moment at which it began. Raises LawError.
    """
    if search.found.room < 0.0:  # it has met the limit
        return search
    vehicle, of = Vehicle(scene, search.begin.end), LIMITS.index(search.limit)
    far, near = (round(step_s * scene.rate_hz) for step_s in (FAR_S, NEAR_S))
    tick = search.found.tick
    first = min(max(search.part[0], round(EARLIEST_S * scene.rate_hz)), tick)

    def flown(k: int) -> Least:
        room = vehicle.fly(_later(search.worst, k), search.part[1])[:, of]
        return vehicle.judged(room, search.part)

    earliest = -((tick - first) // far) * far
    found = {k: flown(k) for k in range(earliest, search.part[1] - tick, far)}
    about = min(found, key=lambda k: (found[k].room, abs(k)))
    found |= {k: flown(k) for k in range(about - far + near, about + far, near)}
    k = min(found, key=lambda k: (found[k].room, abs(k)))
    least, wind = found[k], _later(search.worst, k)
    if least.room >= search.found.room:
        return search
    search = replace(search, found=least, worst=wind)
    if len(vehicle.fly(wind, least.tick + 1)) <= least.tick:  # it ended there
        return replace(search, over=True)
    out = outputs(vehicle.flight.law_rows[least.tick : least.tick + 1])[0]
    values = [facet.value(out) for facet in facets(vehicle.scene, search.limit, out)]
    facet = int(np.argmin(values))
    return replace(search, tick=least.tick, facet=facet, value=values[facet], wind=wind, over=False)


def _later(wind: Rows, k: int) -> Rows:
    """A wind (float64[ticks, 3]) that comes k ticks later. Where it has no samples, its first or last one stays."""
    return wind[np.clip(np.arange(len(wind)) - k, 0, len(wind) - 1)]


def worst_winds(
    scene: Scenario,
    n: int = 4,
    limits: Sequence[str] = LIMITS,
    sums: int = SUMS,
    seed: int = SEED,
    console: Console | None = None,
) -> list[Worst]:
    """The worst wind for each limit in each of n parts of a flight, by limit, then by time.

    scene : a flight of `law_alone`.  sums, seed : of what is drawn.  console : shows how far it is.
    Raises LawError, ProgramError.
    """
    fly = begins(scene, n, sums, seed)
    flown = [b for of_end in each(fly, ends(scene), "flying", console) for b in of_end]
    parts = parts_of(scene, n)
    asked = [
        (limit, k, begin)
        for limit in limits
        for k in range(len(parts))
        for begin in _apart(flown, k, LIMITS.index(limit))
    ]

    def first(one: tuple[str, int, Begin]) -> list[Search]:
        limit, k, begin = one
        begun = searches(scene, begin, limit, parts[k], FACETS[limit])
        return [gone_on(scene, search, FIRST_ROUNDS) for search in begun]

    best: dict[tuple[str, int], Search] = {}
    for (limit, k, _), found in zip(asked, each(first, asked, "computing", console), strict=True):
        for search in found:
            if (limit, k) not in best or search.found.room < best[limit, k].found.room:
                best[limit, k] = search
    rest = list(best)
    ended = each(
        lambda key: gone_on(scene, moved(scene, best[key]), ROUNDS - FIRST_ROUNDS), rest,
        "going on", console,
    )  # fmt: skip
    return [_told(scene, flown, k, search) for (_, k), search in zip(rest, ended, strict=True)]


def _told(scene: Scenario, flown: Sequence[Begin], k: int, search: Search) -> Worst:
    """The result of a search of part k, beside the flights that it could begin with."""
    of, least = LIMITS.index(search.limit), search.found
    still, drawn = (
        min((b.rooms[k, of] for b in flown if b.name == name), default=np.inf)
        for name in ("still", "sines")
    )
    first, until = (float(edge / scene.rate_hz) for edge in search.part)
    return Worst(
        limit=search.limit, part=k + 1, from_s=first, to_s=until, at_s=float(least.tick / scene.rate_hz),
        still_n=float(still), drawn_n=float(drawn), begun_n=float(search.begin.rooms[k, of]),
        begun=search.begin.name, computed_n=least.room, end=search.begin.end,
        rounds=search.rounds, saturated=least.saturated,
        samples=air.samples(search.worst, 1.0 / scene.rate_hz),
    )  # fmt: skip


def _apart(flown: Sequence[Begin], k: int, of: int) -> Iterator[Begin]:
    """Flights that a search of part k begins with: the worst, of its vehicle the worst in each other kind of
    wind, and the worst of another vehicle.
    """

    def nearness(i: int) -> tuple[float, int]:
        return float(flown[i].rooms[k, of]), i

    order = [flown[i] for i in sorted(range(len(flown)), key=nearness)]
    order = order[:1] + [begin for begin in order[1:] if begin.name != "still"]
    worst = order[0]
    yield worst
    kinds = {worst.name}
    for begin in order:
        if begin.end == worst.end and begin.name not in kinds:
            kinds.add(begin.name)
            yield begin
    yield from [begin for begin in order if begin.end != worst.end][:1]
