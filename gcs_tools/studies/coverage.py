"""How much of what is safe the guard admits when it refuses: steps and sequences, in the wind that blows.

    python -m gcs_tools.studies.coverage                 the tables of docs/paper.md
    python -m gcs_tools.studies.coverage --sequences     the same of sequences of six points
    python -m gcs_tools.studies.coverage --random 1000   the largest admitted step, flown, anywhere in the beliefs
    python -m gcs_tools.studies.coverage --arrivals      how long steps of 2, 10 and 30 m take that are governed

A vehicle hovers in a wind that blows so as to push its demand at the nearest limit, and is told to be
elsewhere. *Safe* is the largest step that neither saturates nor fails to arrive (`attack.verdict`), when
it is flown as the policy flies it, refused or not. *Admitted* is the largest that the look ahead admits
then and there: by what is believed alone, by what is demanded at that moment alone, by both. Each
admitted step is flown: one that is not safe is *unsound*. Without noise or delay.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from fcu.guard.admission import BEGINNING, Buffer, ahead
from fcu.guard.arrival import ARRIVED_M
from fcu.guard.present import Beginning
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.rows import column_of, slice_of
from fcu.process.tick import Remembered, Tick, beginning
from gcs_tools.campaigns.flights import each
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.judging.envelope import WAYS
from gcs_tools.missions.mission import from_tables
from gcs_tools.studies.attack.draws import Attack, Numbers, anywhere, between, ends, scaled
from gcs_tools.studies.attack.flight import AttackFlown, fly
from gcs_tools.studies.attack.verdict import verdict
from gcs_tools.studies.attack.wind import PUSHING, SQUARE, TURNING, Gust

HOVER_S = 3.0  # before what is asked
STEPS_M, MOST_S = (2.0, 10.0, 30.0), 60.0  # of steps that are timed, and how long they may take
MOST_M = 60.0  # of a search: the largest step
FINE, ROUGH = 0.01, 0.03  # its relative accuracy
CONDITIONS = ("prior", "present", "both")
STILL = Vec3(0.0, 0.0, 0.0)
TOLD = column_of(Beginning, "present.told")
R = slice_of(Tick, "measured.r_E")
STATE, GUARD, SEEN = (slice_of(Tick, of) for of in ("state", "guard_state", "measured"))


class CoverageWorld(NamedTuple):
    """What is true."""

    mass: float  # kg
    drag: tuple[float, float, float]  # N/(m/s)^2
    gust: Gust
    lag: float = 0.05  # s


class Case(NamedTuple):
    """A world, a law and what is believed, and where to."""

    world: CoverageWorld
    law: Mapping[str, Any]  # of a mission
    way: tuple[float, float, float]
    at_s: float = HOVER_S


def pushing(speed: float, rate: float) -> Gust:
    """The wind that drives the demand at its nearest limit."""
    return Gust(kind=PUSHING, speed=speed, rate=rate, every=1.0, along=Vec3(1.0, 0.0, 0.0))


def worlds(rate: float) -> list[CoverageWorld]:
    """Twelve: the masses, half and all of the drag, half and all of the wind."""
    return [
        CoverageWorld(m, (c, c, c), pushing(w, rate))
        for m, c, w in product((7.0, 8.0, 9.0), (0.075, 0.15), (6.0, 12.0))
    ]


def scene_of(
    case: Case, sent: Sequence[tuple[float, Vec3]], lasts_s: float | None = None
) -> Scenario:
    """A hover, and from `at_s` on what is `sent`: after how long (s), where to (m, E).

    lasts_s : after the last of it. None: as long as the reference model takes to settle.
    """
    world = case.world
    after = sent[-1][0] if sent else 0.0
    if lasts_s is None:
        lasts_s = 14.0 / min(case.law["f_m"], 1.4) + 4.0
    tables = {
        "title": "Steps.",
        "flight": {
            "duration_s": case.at_s + after + lasts_s,
            "ground_z_m": -1e4,
            "arena_m": 1e4,
            "setpoints": [
                [0.0, 0.0, 0.0, 0.0], *([case.at_s + at, *r] for at, r in sent)
            ],
        },
        "law": {"guard": "refuse", "J_hat_0": 0.3, **case.law},
        "plant": {
            "mass_kg": world.mass, "drag": list(world.drag), "rotor_lag_s": world.lag,
        },
        "expect": {},
    }  # fmt: skip
    return scenario(from_tables("coverage", tables))


def flown(case: Case, scene: Scenario, **how: bool) -> tuple[AttackFlown, bool]:
    """The flight, and whether it saturated nothing from `at_s` on and has arrived."""
    found = fly(scene, case.world.gust, np.zeros((scene.ticks, 12)), **how)
    told = Attack(Numbers(*[0.0] * len(Numbers._fields)), {}, scene, case.world.gust, np.zeros((0, 12)), "", "")  # fmt: skip
    return found, not verdict(told, found, case.at_s).contradicts


def to(case: Case, far: float) -> list[tuple[float, Vec3]]:
    """A step of `far` (m)."""
    return [(0.0, Vec3(*(far * x for x in case.way)))]


def safe(case: Case, far: float) -> bool:
    """Whether a step of `far` (m) is."""
    return flown(case, scene_of(case, to(case, far)), refuses=False)[1]


def largest(holds: Callable[[float], bool], most: float, close: float = FINE) -> float:
    """The largest value for which something holds that holds below; 0 for none."""
    low, high = 0.0, 0.25
    while holds(high):
        if high >= most:
            return most
        low, high = high, min(2.0 * high, most)
    while high - low > close * high and high > 0.02:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


class Look(NamedTuple):
    """What the guard looks ahead with, in a hover that is flown."""

    guard: Buffer
    law: Buffer
    begins: Buffer  # Beginning

    def admits(self, condition: str, setpoint: Setpoint) -> bool:
        """By one of CONDITIONS."""
        begins, law = self.begins.copy(), self.law.copy()
        if condition == "prior":
            begins[TOLD] = 0.0
        way = np.array([[math.inf, *to_buffer(setpoint)]])
        return bool(ahead(self.guard, law, way, begins, float(condition != "present")) >= 0.0)


def look_of(case: Case) -> Look:
    """As a vehicle looks ahead in the moment of the step."""
    scene = scene_of(case, [])
    scene = replace(scene, ticks=round(case.at_s * scene.rate_hz))
    row = flown(case, scene)[0].fcu[-1]
    remembered, begins = np.zeros(size(Remembered)), np.zeros(BEGINNING)
    remembered[:] = np.concatenate([row[STATE], row[GUARD]])
    measured = np.ascontiguousarray(row[SEEN])
    assert len(measured) == size(VehicleState)
    beginning(to_buffer(scene.settings), remembered, measured, begins)
    return Look(to_buffer(scene.guard), to_buffer(scene.law), begins)


class CoverageFound(NamedTuple):
    """Of one case: the largest steps, m."""

    safe: float
    prior: float
    present: float
    both: float
    unsound: bool  # the admitted step, flown, is not safe


def found(case: Case) -> CoverageFound:
    """Look and fly."""
    look = look_of(case)

    def admitted(condition: str) -> float:
        def holds(far: float) -> bool:
            return look.admits(condition, Setpoint(to(case, far)[0][1], STILL, STILL, 0.0, 0.0))

        return largest(holds, MOST_M)

    steps = {condition: admitted(condition) for condition in CONDITIONS}
    sound = steps["both"] == 0.0 or safe(case, steps["both"])
    return CoverageFound(largest(lambda far: safe(case, far), MOST_M), **steps, unsound=not sound)


def cases(rate: float, law: Mapping[str, Any], masses: float | None = None) -> list[Case]:
    """12 worlds x 3 f_m x 3 directions.  masses : how far off the truth mass is believed to be."""
    made = []
    for world, f_m, way in product(worlds(rate), (0.7, 1.4, 2.8), WAYS.values()):
        told = {"f_m": f_m, "m_hat_0": world.mass, "guard_wind_rate_m_s2": rate, **law}
        if masses is not None:
            told["guard_mass_kg"] = [(1.0 - masses) * world.mass, (1.0 + masses) * world.mass]
        made.append(Case(world, told, way))
    return made


def ratio(of: Sequence[CoverageFound], condition: str) -> float:
    """Part of what is safe that is admitted, on average."""
    return float(np.mean([getattr(f, condition) / f.safe for f in of if f.safe > 0.0]))


def ratio_of_sums(of: Sequence[CoverageFound], condition: str) -> float:
    """Metres that are admitted over metres that are safe, of all cases together."""
    return float(sum(getattr(f, condition) for f in of) / sum(f.safe for f in of))


# --- what certainty costs in time


def arrives_s(case: Case, far: float) -> float:
    """Time (s) from a step until the vehicle stays within ARRIVED_M of its end, or inf."""
    scene = scene_of(case, to(case, far), MOST_S)
    rows = fly(scene, case.world.gust, np.zeros((scene.ticks, 12))).fcu
    away = np.linalg.norm(rows[:, R] - np.array([far * x for x in case.way]), axis=1)
    begun = round(case.at_s * scene.rate_hz)
    outside = np.flatnonzero(away[begun:] > ARRIVED_M)
    after = int(outside[-1]) + 1 if len(outside) else 0
    return after / scene.rate_hz if begun + after < len(rows) else math.inf


class Arrivals(NamedTuple):
    """How long a governed step takes in twelve worlds, s."""

    way: str
    far_m: float
    median_s: float
    greatest_s: float


def arrivals(name: str, far: float) -> Arrivals:
    """Fly a step in each world, with gusts of 20 m/s^2 and the law as shipped."""
    law = {"guard": "govern", "guard_wind_rate_m_s2": 20.0}
    took = [
        arrives_s(Case(world, law | {"m_hat_0": world.mass}, WAYS[name]), far)
        for world in worlds(20.0)
    ]
    return Arrivals(name, far, float(np.median(took)), max(took))


# --- sequences


def points(case: Case, seed: int) -> list[tuple[float, Vec3]]:
    """Six points about the hover, each up to 1 m away, at 0.3 to 3 times 1/f_m."""
    random, f_m = np.random.default_rng(seed), case.law["f_m"]
    at = np.cumsum([0.0, *(random.uniform(0.3, 3.0, 5) / f_m)])
    return [(float(t), Vec3(*(random.uniform() * anywhere(random)).tolist())) for t in at]


def scaled_by(k: float, sent: Sequence[tuple[float, Vec3]]) -> list[tuple[float, Vec3]]:
    """All of a sequence, k times as far."""
    return [(at, k * r) for at, r in sent]


def sequence(case: Case, seed: int) -> CoverageFound:
    """The largest scales of a sequence: safe, and all of it admitted in the air, one after the other."""
    sent = points(case, seed)

    def admitted(told: bool) -> float:
        def holds(k: float) -> bool:
            scene = scene_of(case, scaled_by(k, sent))
            return bool(flown(case, scene, told=told)[0].admitted.all())

        return largest(holds, MOST_M, ROUGH)

    def arrives(k: float) -> bool:
        return flown(case, scene_of(case, scaled_by(k, sent)), refuses=False)[1]

    prior, both = admitted(False), admitted(True)
    sound = both == 0.0 or arrives(both)
    return CoverageFound(largest(arrives, MOST_M, ROUGH), prior, math.nan, both, unsound=not sound)


def numbered(asked: Sequence[Case], k: int) -> CoverageFound:
    """The sequence number k, in its case."""
    return sequence(asked[k], k)


# --- anywhere in the beliefs


def anywhere_in(seed: int) -> Case:
    """A world, a law and a way drawn from the beliefs: a wind that pushes, squares or turns."""
    random = np.random.default_rng([7, seed])
    u = random.uniform(size=16)
    rate = (5.0, 20.0)[int(u[0] < 0.5)]
    speed = ends(u[1], 0.0, 12.0)
    gust = Gust(
        kind=(PUSHING, SQUARE, TURNING)[int(3.0 * u[2])],
        speed=speed,
        rate=rate,
        every=scaled(u[3], 0.3, 4.0),
        along=Vec3(*anywhere(random).tolist()),
    )
    mass = ends(u[4], 7.0, 9.0)
    drag = (ends(u[5], 0.0, 0.15), ends(u[6], 0.0, 0.15), ends(u[7], 0.0, 0.15))
    law: dict[str, Any] = {
        "f_m": scaled(u[8], 0.4, 2.8), "zeta_m": between(u[9], 0.6, 1.2),
        "gamma": scaled(u[10], 1000.0, 5000.0), "m_hat_0": between(u[11], 7.0, 9.0),
        "guard_wind_rate_m_s2": rate,
    }  # fmt: skip
    if u[12] < 0.5:  # believed to within 3 %
        law["guard_mass_kg"] = [max(0.97 * mass, 0.1), 1.03 * mass]
    x, y, z = anywhere(random).tolist()
    return Case(
        CoverageWorld(mass, drag, gust, between(u[13], 0.03, 0.08)),
        law,
        (x, y, z),
        2.0 + 3.0 * u[14],
    )


class Tried(NamedTuple):
    """The largest admitted step, flown."""

    far: float  # m
    more: bool  # than what is believed alone would admit
    unsound: bool


def tried(seed: int) -> Tried:
    """Of a case drawn."""
    case = anywhere_in(seed)
    look = look_of(case)

    def admitted(condition: str) -> float:
        def holds(far: float) -> bool:
            return look.admits(condition, Setpoint(to(case, far)[0][1], STILL, STILL, 0.0, 0.0))

        return largest(holds, MOST_M)

    far = admitted("both")
    return Tried(far, far > 1.02 * admitted("prior"), far > 0.0 and not safe(case, far))


BELIEFS: tuple[tuple[str, float, float | None], ...] = (
    ("gusts of 20 m/s², 7 to 9 kg", 20.0, None),
    ("5 m/s², 7 to 9 kg", 5.0, None),
    ("20 m/s², mass ± 3 %", 20.0, 0.03),
    ("5 m/s², mass ± 3 %", 5.0, 0.03),
)


@click.command()
@click.option("--sequences", is_flag=True, help="sequences of six points in place of steps")
@click.option("--random", "n", type=click.IntRange(1), help="how many admitted steps to fly, anywhere in the beliefs")  # fmt: skip
@click.option("--arrivals", "timed", is_flag=True, help="how long governed steps take, in place of what is admitted")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="a JSON object on standard output")
def main(sequences: bool, n: int | None, timed: bool, as_json: bool) -> None:
    """Print what part of what is safe is admitted; exit 1 if something admitted is not safe."""
    log = Console(stderr=True)
    if timed:
        steps = list(product(WAYS, STEPS_M))
        took = list(each(lambda step: arrivals(*step), steps, "steps", log))
        if as_json:
            click.echo(json.dumps([row._asdict() for row in took]))
        else:
            shown = Table("way", "step, m", "median, s", "greatest, s", box=None)
            for row in took:
                shown.add_row(row.way, f"{row.far_m:g}", f"{row.median_s:.2f}", f"{row.greatest_s:.2f}")  # fmt: skip
            Console().print(shown)
        sys.exit(0 if all(math.isfinite(row.greatest_s) for row in took) else 1)
    if n is not None:
        told = [tried(0), *each(tried, range(1, n), "admitted steps", log)]
        unsound = [k for k, t in enumerate(told) if t.unsound]
        said = {"flown": n, "more": sum(t.more for t in told), "unsound": unsound}
        click.echo(json.dumps(said) if as_json else f"{said}")
        sys.exit(1 if unsound else 0)
    table = Table("belief", "cases", *CONDITIONS, "ratio of sums", "unsound", box=None)
    out: dict[str, list[dict[str, Any]]] = {}
    for name, rate, masses in BELIEFS:
        asked = cases(rate, {}, masses)
        if sequences:
            asked = [case for case in asked if case.way == WAYS["up"]]  # they go anywhere
            numbers = range(len(asked))
            of = list(each(partial(numbered, asked), numbers, name, log))
        else:
            of = list(each(found, asked, name, log))
        out[name] = [f._asdict() for f in of]
        table.add_row(
            name, str(len(of)), *(f"{ratio(of, c):.2f}" for c in CONDITIONS),
            f"{ratio_of_sums(of, 'both'):.2f}", str(sum(f.unsound for f in of)),
        )  # fmt: skip
    if as_json:
        click.echo(json.dumps(out))
    else:
        Console().print(table)
    sys.exit(1 if any(f["unsound"] for of in out.values() for f in of) else 0)


if __name__ == "__main__":
    main()
