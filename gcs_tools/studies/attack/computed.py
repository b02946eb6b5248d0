"""The spine of the attack: a few manoeuvres, each in the winds that bring it nearest to each of its limits.

The winds are computed (`gcs_tools.gusts`), within what the guard believes of the air, for vehicles at the ends
of what it believes of them. What a manoeuvre asks for begins at FIRST_S. Refusing, it is made smaller by halves
until nothing of it is refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.gusts.ends import at
from gcs_tools.gusts.limits import LIMITS
from gcs_tools.gusts.worst_wind import Worst, worst_winds
from gcs_tools.judging.preflight_check import refusal
from gcs_tools.missions.mission import from_tables
from gcs_tools.studies.attack.draws import (
    FIRST_S,
    STREAM_S,
    Array,
    Attack,
    How,
    Numbers,
    merged,
)
from gcs_tools.studies.attack.flight import fly
from gcs_tools.studies.attack.verdict import Verdict, verdict
from gcs_tools.studies.attack.wind import Gust

LASTS_S = 8.0  # after FIRST_S
HALVES = 12  # by which a manoeuvre is made smaller, at most
OWN_WIND = Gust(kind=0.0, speed=0.0, rate=1.0, every=1.0, along=Vec3(0.0, 0.0, 1.0))
FAST_S, SLOW_M_S, FAST_M_S, LAND_M = 4.0, 0.7, 1.5, 8.0  # of a landing: how it is led down

Asked = list[tuple[float, Array, Array]]  # s from FIRST_S on; position, m, and velocity, m/s, E
NONE = np.zeros(3)


def step(x: float, y: float, z: float) -> Callable[[float, Any], Asked]:
    """One setpoint so many m away."""
    return lambda scale, law: [(0.0, scale * np.array([x, y, z]), NONE)]


def landing(scale: float, law: Any) -> Asked:
    """A place that moves down as a vehicle leads itself to the ground, fast at first, without the ground."""
    found: Asked = []
    for t in np.arange(0.0, LASTS_S, STREAM_S):
        fast = min(t, FAST_S)
        z = -scale * (FAST_M_S * fast + SLOW_M_S * (t - fast))
        v = -scale * (FAST_M_S if t < FAST_S else SLOW_M_S)
        found.append((float(t), np.array([0.0, 0.0, z]), np.array([0.0, 0.0, v])))
    return found


def turning(scale: float, law: Any) -> Asked:
    """A level circle of 5 m at 4 m/s, streamed with its velocity."""
    R, speed, found = 5.0 * scale, 4.0 * math.sqrt(scale), []
    for t in np.arange(0.0, LASTS_S, STREAM_S):
        a = speed / R * t
        r = R * np.array([math.sin(a), 1.0 - math.cos(a), 0.0])
        found.append((float(t), r, speed * np.array([math.cos(a), math.sin(a), 0.0])))
    return found


def reversal(scale: float, law: Any) -> Asked:
    """A level step of 10 m, reversed each 1.5/f_m."""
    every = 1.5 / law.f_m
    return [(k * every, scale * np.array([10.0 * (-1.0) ** k, 0.0, 0.0]), NONE) for k in range(6)]


MANOEUVRES: dict[str, Callable[[float, Any], Asked]] = {
    "hover": step(0.0, 0.0, 0.0),
    "level": step(40.0, 0.0, 0.0),
    "climb": step(0.0, 0.0, 30.0),
    "descent": step(0.0, 0.0, -30.0),
    "landing": landing,
    "turn": turning,
    "reversal": reversal,
}


class Spine(NamedTuple):
    """A limit of a manoeuvre in the worst wind for it."""

    manoeuvre: str
    scale: float  # of the manoeuvre, below 1 where more of it is refused
    worst: Worst
    verdict: Verdict  # of the attack, on the flight in that wind


def made(name: str, how: How, scale: float = 1.0) -> tuple[dict[str, Any], Scenario]:
    """The tables and the scene of a manoeuvre. Raises MissionError."""
    tables = merged(
        {
            "title": "Computed.",
            "flight": {
                "duration_s": FIRST_S + LASTS_S,
                "ground_z_m": -1e4,
                "arena_m": 1e4,
                "setpoints": [[0.0, 0.0, 0.0, 0.0]],
            },
            "law": {},
            "plant": {},
            "wind": {},
            "expect": {},
        },
        {**how.settings, ("law", "guard"): how.policy},
    )
    scene = scenario(from_tables("computed", tables))
    asked = MANOEUVRES[name](scale, scene.law)
    first = scene.sent[0]
    sent = [
        Setpoint(Vec3(*r.tolist()), Vec3(*v.tolist()), Vec3(0.0, 0.0, 0.0), first.psi_c, 0.0)
        for _, r, v in asked
    ]
    ticks = [0, *(round((FIRST_S + t) * scene.rate_hz) for t, _, _ in asked)]
    return tables, replace(scene, sent_at=np.array(ticks, dtype=np.int64), sent=(first, *sent))


def admitted(name: str, how: How) -> tuple[float, dict[str, Any], Scenario]:
    """The largest scale of a manoeuvre of which nothing is refused, by halves, and the scene."""
    scale = 1.0
    for _ in range(HALVES):
        tables, scene = made(name, how, scale)
        if how.policy != "refuse" or not refusal(scene):
            break
        scale *= 0.5
    return scale, tables, scene


def spine(
    how: How,
    names: Sequence[str],
    console: Console | None = None,
    limits: Sequence[str] = LIMITS,
) -> list[Spine]:
    """Each limit of each manoeuvre in the worst wind for it. Raises LawError."""
    found = []
    for name in names:
        scale, tables, scene = admitted(name, how)
        law_alone.warm_up(scene)
        for worst in worst_winds(scene, 1, limits, console=console):
            there = replace(at(scene, worst.end), wind=worst.samples)
            numbers = Numbers(*[0.5] * len(Numbers._fields))
            noise = np.zeros((scene.ticks, len(scene.world.noise_scale)))
            flown = Attack(numbers, tables, there, OWN_WIND, noise, name, "computed")
            said = verdict(flown, fly(there, OWN_WIND, noise))
            found.append(Spine(name, scale, worst, said))
    return found


def contradicts(found: Sequence[Spine]) -> bool:
    """True if a flight saturated or was lost. None is asked to have arrived when it ends."""
    return any(each.verdict.saturated or each.verdict.lost for each in found)


def content(found: Sequence[Spine]) -> list[dict[str, Any]]:
    """For programs."""
    return [
        {
            "manoeuvre": each.manoeuvre,
            "scale": each.scale,
            "limit": each.worst.limit,
            "at_s": each.worst.at_s,
            "room_still_n": each.worst.still_n,
            "room_sines_n": each.worst.drawn_n,
            "room_n": each.worst.computed_n,
            "saturated": each.verdict.saturated,
            "lost": each.verdict.lost,
            **each.worst.end.plant,
        }
        for each in found
    ]


def table(policy: str, found: Sequence[Spine]) -> Table:
    """For people: room in still air, in sums of sines, and in the worst wind, N, a limit a column."""
    shown = Table(title=f"{policy}: room in still air, sums of sines, worst wind, N", box=None, title_justify="left")  # fmt: skip
    shown.add_column("")
    for limit in LIMITS:
        shown.add_column(limit.replace("_", " "), justify="right")
    for name in dict.fromkeys(each.manoeuvre for each in found):
        row = {each.worst.limit: each for each in found if each.manoeuvre == name}
        scale = next(iter(row.values())).scale
        cells = [
            f"{of.worst.still_n:.0f} {of.worst.drawn_n:.0f} {of.worst.computed_n:.1f}"
            + ("!" if of.verdict.saturated or of.verdict.lost else "")
            for of in (row[limit] for limit in LIMITS)
        ]
        shown.add_row(name if scale == 1.0 else f"{name} x {scale:g}", *cells)
    return shown
