"""Flights in lanes against the same one by one: every row of every flight must be equal to the bit.

    python -m gcs_tools.studies.lanes_check                 draws 1000 flights of 2 s
    python -m gcs_tools.studies.lanes_check --flights N     as many; --width 4 or 8; --json for machines

Drawn are airframe, mission, policy of the guard, mass, inertia, drag, wind, noise, delay, seed, loss of a
rotor, when setpoints take effect, and how long the flight is. Some leave their arena, some hit the ground.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import click
import numpy as np

from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.lanes import WIDTH
from gcs_tools.flight import law_flights
from gcs_tools.flight.run import prepared
from gcs_tools.flight.scenario import Scenario
from sitl_plant.physics.dynamics import CRASHED, DIVERGED
from sitl_plant.physics.world import Noise

BATCH = 64  # flights that are looked at together
BASES = (  # (mission, overrides): a law, an airframe, a policy
    ("paper_nominal", ()),
    ("paper_fast", ()),
    ("paper_fast_governed", ()),
    ("paper_printed_fast", ()),
    ("figure_eight", ()),
    ("noisy_state", ("law.guard=govern",)),
    ("take_off", ()),
    ("airframe_step", ()),
    ("airframe_step", ("airframe=quad",)),
    ("airframe_step", ("airframe=hexa",)),
    ("airframe_step", ("airframe=x8", "law.guard=refuse")),
)
NOISE = 0.01, 0.02, 0.004, 0.01  # m, m/s, rad, rad/s


class LanesFound(NamedTuple):
    """What came of it."""

    flights: int
    ticks: int
    in_lanes: int  # flights
    crashed: int
    diverged: int
    different: tuple[int, ...]  # numbers of the flights of which a row is not the same


@cache
def bases(laws: tuple[str, ...]) -> tuple[Scenario, ...]:
    """What is varied. laws : beside that of the missions."""
    found = [prepared(mission, list(settings))[1] for mission, settings in BASES]
    return (*found, *[prepared("gust_step", [], law=law)[1] for law in laws])


def sampled_scenario(
    number: int, seed: int, duration_s: float, laws: tuple[str, ...] = ()
) -> Scenario:
    """Flight `number` of a seed."""
    random = np.random.default_rng([seed, number])
    scene = bases(laws)[random.integers(len(bases(laws)))]
    world, params = scene.world, scene.world.params
    wind = params.wind

    def scaled(v: Vec3, low: float, high: float) -> Vec3:
        return Vec3(*(np.array(v) * random.uniform(low, high, 3)).tolist())

    wind = wind._replace(
        steady=Vec3(*random.normal(0.0, 3.0, 3).tolist()),
        amplitude=scaled(wind.amplitude, 0.0, 2.0),
        phase=Vec3(*random.uniform(-3.0, 3.0, 3).tolist()) if random.random() < 0.5 else wind.phase,
        step=Vec3(*random.normal(0.0, 4.0, 3).tolist()),
        step_time=float(random.uniform(0.0, 2.0 * duration_s)),
    )
    lost = random.random() < 0.1
    left = Rotors(*[float(random.uniform(0.0, 1.0)) if lost else 1.0] + [1.0] * 7)
    near = random.random() < 0.1  # a wall
    params = params._replace(
        m=float(params.m * random.uniform(0.8, 1.2)),
        J=scaled(params.J, 0.8, 1.2),
        c_D=scaled(params.c_D, 0.5, 1.5),
        loss_time=Rotors(*[float(random.uniform(0.0, duration_s))] * 8)
        if lost
        else params.loss_time,
        effectiveness=left if lost else params.effectiveness,
        arena=float(random.uniform(0.01, 1.0)) if near else params.arena,
        wind=wind,
    )
    if random.random() < 0.15:  # it is too heavy, and sinks on a roof that is near
        roof = world.start.r_E.z - params.ground.gear - float(random.uniform(0.0, 1.0))
        ground = params.ground._replace(z=roof, impact_max=float(random.uniform(0.1, 3.0)))
        params = params._replace(m=10.0 * params.m, ground=ground)
    noise = Noise(*(np.array(NOISE) * random.integers(2) * random.random(4)).tolist())
    world = world._replace(
        params=params, noise=noise, seed=float(random.integers(1_000_000)),
        delay_ticks=float(random.integers(4)) if random.random() < 0.3 else 0.0,
    )  # fmt: skip
    ticks = min(scene.ticks, max(1, round(duration_s * random.uniform(0.3, 1.0) * scene.rate_hz)))
    sent_at = scene.sent_at[scene.sent_at < ticks]
    later = random.integers(0, 20, len(sent_at))
    later[0] = 0
    sent_at = np.minimum(np.maximum.accumulate(sent_at + later), ticks - 1)
    return replace(
        scene, world=world, ticks=ticks, sent_at=sent_at, sent=scene.sent[: len(sent_at)]
    )


def check(
    n: int, seed: int = 1, duration_s: float = 2.0, width: int = WIDTH, laws: Sequence[str] = ()
) -> LanesFound:
    """Fly `n` draws in both ways."""
    different: list[int] = []
    ticks = in_lanes = crashed = diverged = 0
    for first in range(0, n, BATCH):
        numbers = range(first, min(first + BATCH, n))
        scenes = [sampled_scenario(i, seed, duration_s, tuple(laws)) for i in numbers]
        flown = law_flights.fly(scenes, width=width, in_all=law_flights.ALWAYS)
        for i, scene, one in zip(numbers, scenes, flown, strict=True):
            other = law_flights.by_itself(scene)
            same = (one.plant.tobytes(), one.law.tobytes(), one.ticks, one.ended) == (
                other.plant.tobytes(), other.law.tobytes(), other.ticks, other.ended,
            )  # fmt: skip
            different += [] if same else [i]
            ticks, in_lanes = ticks + one.ticks, in_lanes + one.in_lanes
            crashed, diverged = crashed + (one.ended == CRASHED), diverged + (one.ended == DIVERGED)
    return LanesFound(n, ticks, in_lanes, crashed, diverged, tuple(different))


@click.command()
@click.option("--flights", "n", default=1000, show_default=True, type=click.IntRange(1), help="how many are drawn")  # fmt: skip
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="of what is drawn")  # fmt: skip
@click.option("--duration", "duration_s", default=2.0, show_default=True, type=click.FloatRange(0.01), help="longest flight, s")  # fmt: skip
@click.option("--width", default=str(WIDTH), show_default=True, type=click.Choice(["4", "8"]), help="lanes")  # fmt: skip
@click.option("--law", "laws", multiple=True, help="another law, by name or FILE.py")
@click.option("--json", "as_json", is_flag=True, help="a JSON object on standard output")
def main(
    n: int, seed: int, duration_s: float, width: str, laws: tuple[str, ...], as_json: bool
) -> None:
    """Fly random flights in lanes and one by one; exit 1 if a row differs."""
    found = check(n, seed, duration_s, int(width), laws)
    if as_json:
        click.echo(json.dumps(found._asdict(), indent=2))
    else:
        for line in _lines(found):
            click.echo(line)
    sys.exit(1 if found.different else 0)


def _lines(found: LanesFound) -> Iterator[str]:
    yield f"{found.flights} flights of {found.ticks} ticks, {found.in_lanes} in lanes"
    yield f"{found.crashed} hit the ground, {found.diverged} left their arena"
    if found.different:
        yield f"not the same bits: flights {', '.join(map(str, found.different[:20]))}"
    else:
        yield "every row is the same to the bit"


if __name__ == "__main__":
    main()
