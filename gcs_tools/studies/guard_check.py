"""The condition and the guard against flights: nothing inside may saturate, all must arrive.

    python -m gcs_tools.studies.guard_check               flies 2000 random flights, each under two policies
    python -m gcs_tools.studies.guard_check --flights N   as many; --json for machines

Everything that the guard is told to believe is drawn within its beliefs: mass, drag, wind and its
rate. So are two setpoints, the reference model, the adaptation gain, inertia, the rotors' lag, the
heading and the control rate. Each is flown as asked (`warn`) and governed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import click
import numpy as np
from rich.console import Console
from rich.table import Table as Shown

from fcu.guard import foreseen
from fcu.guard.stability import unstable
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from fcu.process.settings import Settings
from gcs_tools.campaigns.flights import LawFlight, LawFlightOrder, Random, accepted_draws, flown
from gcs_tools.flight.law_flights import Keep
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import from_tables
from gcs_tools.recording.table import Table

SATURATED = ("outputs.saturation.thrust", "outputs.saturation.tilt", "guard.margin.force")
ROTORS = ("outputs.saturation.torque", "outputs.saturation.yaw")
KEPT = Keep(
    plant=(), law=(*SATURATED, *ROTORS, "guard.margin.condition", "measured.r_E", "setpoint.r_c")
)
SECOND_S, END_S = 45.0, 95.0  # when the second setpoint comes, and the flight ends
LAST_S, NEAR = 1.0, 0.3  # s, m: arrived
COARSE_S = 0.005  # step of the look ahead


class GuardFlight(NamedTuple):
    """One flight: what the condition said of its two ways, and what came of them."""

    inside: tuple[bool, bool]  # up to the end of each of the two ways, ungoverned
    saturated: tuple[bool, bool]  # thrust or tilt at a limit, after the transient of take-over
    at_start: bool  # or within it
    rotors: bool  # the allocation gave something up after the transient
    arrived: tuple[bool, bool]
    condition: float  # N, least after the transient
    transient_s: float


def draw(random: Random) -> dict[str, Any]:
    """A mission's tables, drawn within what the guard believes by default."""
    direction = random.normal(size=(2, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    far = np.exp(random.uniform(np.log(0.5), np.log(40.0), 2))
    first = direction[0] * far[0]
    second = first + direction[1] * far[1]
    frequency = random.uniform(0.2, 2.0, 3)
    air = random.normal(size=(2, 3))
    air /= np.abs(air).sum(axis=0) + 1e-9
    most = np.linalg.norm(np.abs(air).sum(axis=0))
    air *= random.uniform(0.0, 12.0) / most
    rate = float(np.linalg.norm(air[1] * frequency))
    frequency *= min(1.0, 20.0 / max(rate, 1e-9))
    return {
        "title": "Drawn.",
        "flight": {
            "duration_s": END_S,
            "rate_hz": int(random.choice([250, 500])),
            "ground_z_m": -1e4,
            "arena_m": 1e4,
            "yaw": {
                "amplitude_rad": float(random.uniform(0.0, 0.5)),
                "frequency_rad_s": float(random.uniform(0.0, 0.5)),
            },
            "yaw_deg": float(random.uniform(-20.0, 20.0)),
            "setpoints": [[0.0, *first.tolist()], [SECOND_S, *second.tolist()]],
        },
        "law": {
            "f_m": float(np.exp(random.uniform(np.log(0.4), np.log(3.0)))),
            "zeta_m": float(random.uniform(0.6, 1.2)),
            "gamma": float(np.exp(random.uniform(np.log(500.0), np.log(5000.0)))),
            "J_hat_0": float(random.uniform(0.1, 0.5)),
            "m_hat_0": float(random.uniform(7.0, 9.0)),
        },
        "plant": {
            "mass_kg": float(random.uniform(7.0, 9.0)),
            "inertia_kg_m2": (
                np.array([0.3245, 0.3245, 0.4616]) * random.uniform(0.8, 1.2, 3)
            ).tolist(),
            "drag": random.uniform(0.05, 0.15, 3).tolist(),
            "rotor_lag_s": float(random.uniform(0.03, 0.08)),
        },
        "wind": {
            "steady_m_s": air[0].tolist(),
            "amplitude_m_s": air[1].tolist(),
            "frequency_rad_s": frequency.tolist(),
            "rotation_amplitude_rad_s": random.uniform(0.0, 0.7, 3).tolist(),
            "rotation_frequency_rad_s": random.uniform(0.0, 2.5, 3).tolist(),
        },
        "expect": {},
    }


def saturated(law: Table) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """At which ticks thrust or tilt is at a limit, or the demand beyond what can be reached.

    The law keeps a demand off the ground before it clips it, so its flags alone miss some.
    """
    thrust, tilt, margin = (law[name] for name in SATURATED)
    return np.asarray((np.maximum(thrust, tilt) > 0.5) | (margin < 0.0))


def foreseen_n(settings: Settings, sent: Sequence[Setpoint]) -> list[float]:
    """The least condition (N) on the way to each setpoint, from rest at the one before."""
    coarse = settings.law._replace(h=COARSE_S)
    still = Vec3(0.0, 0.0, 0.0)
    starts = [still, *(s.r_c for s in sent)]
    return [
        foreseen.least(settings.guard, coarse, s, r, still)[0]
        for s, r in zip(sent, starts, strict=False)
    ]


def look(flight: LawFlight) -> GuardFlight:
    """What came of a flight of two setpoints."""
    scene, law = flight.scene, flight.law
    rate = scene.rate_hz
    transient = max(float(foreseen.transient_s(scene.guard, scene.law)), 0.3)
    settled, second = round(transient * rate), round(SECOND_S * rate)
    last = round(LAST_S * rate)
    limited = saturated(law)
    ways = (slice(settled, second), slice(second, None))  # adaptation begins once
    ends = (slice(second - last, second), slice(-last, None))
    whole = flight.lasted
    away = np.linalg.norm(law["measured.r_E"] - law["setpoint.r_c"], axis=1)
    reachable = foreseen_n(scene.settings, [scene.sent[0], scene.sent[-1]])
    return GuardFlight(
        inside=(reachable[0] >= 0.0, min(reachable) >= 0.0),
        saturated=(bool(limited[ways[0]].any()), bool(limited[ways[1]].any()) or not whole),
        at_start=bool(limited[:settled].any()),
        rotors=any(bool((law[of][settled:] > 0.5).any()) for of in ROTORS),
        arrived=(
            whole and bool((away[ends[0]] < NEAR).all()),
            whole and bool((away[ends[1]] < NEAR).all()),
        ),
        condition=float(law["guard.margin.condition"][settled:].min()),
        transient_s=transient,
    )


def pair(tables: dict[str, Any]) -> list[LawFlightOrder[GuardFlight]]:
    """The same drawn flight as it is asked, and governed."""
    warn, govern = (
        from_tables("drawn", {**tables, "law": {**tables["law"], "guard": policy}})
        for policy in ("warn", "govern")
    )
    return [LawFlightOrder(scenario(warn), look), LawFlightOrder(scenario(govern), look)]


class Check(NamedTuple):
    """What a number of flights showed. Ways are counted: each flight has two."""

    flights: int
    ways_inside: int
    inside_saturated: int
    governed_saturated: int  # flights, from their first tick on
    governed_rotors: int  # flights, after the transient
    governed_arrived: int  # ways
    warned_saturated: int  # ways outside the condition that did saturate
    warned_lost: int  # ways outside that did not arrive
    condition_least_n: float  # of the governed flights, after the transient
    transient_most_s: float
    redrawn: int  # that the rule of gains refused


WORDS = {
    "flights": "flown, each as asked and governed",
    "ways_inside": "as asked, ways (two a flight) for which the condition holds",
    "inside_saturated": "  of these that saturate after the transient",
    "governed_saturated": "governed flights that saturate, from the first tick on",
    "governed_rotors": "governed flights with a rotor at its limit after the transient",
    "governed_arrived": "governed, ways at whose end it is there (two a flight)",
    "warned_saturated": "as asked, ways outside the condition that saturate",
    "warned_lost": "as asked, ways outside the condition that do not arrive",
    "condition_least_n": "governed, least condition after the transient, N",
    "transient_most_s": "longest transient, s",
    "redrawn": "drawn again, since their gains are not stable",
}


def stable(tables: dict[str, Any]) -> bool:
    """Whether the gains of a draw are, wherever it flies to."""
    still = {"rate_hz": tables["flight"]["rate_hz"], "setpoints": [[0.0, 0.0, 0.0, 0.0]]}
    scene = scenario(from_tables("drawn", {**tables, "flight": {**still, "duration_s": 1.0}}))
    return not unstable(scene.law, scene.guard)


def check(n: int, seed: int = 1, console: Console | None = None) -> Check:
    """Fly `n` draws under both policies."""
    draws, refused = accepted_draws(draw, stable, n, seed)
    pairs = list(flown(pair, draws, KEPT, console=console))
    warned, governed = ([p[i] for p in pairs] for i in (0, 1))
    ways = [
        (inside, saturated, arrived)
        for f in warned
        for inside, saturated, arrived in zip(f.inside, f.saturated, f.arrived, strict=True)
    ]
    return Check(
        flights=n,
        ways_inside=sum(inside for inside, _, _ in ways),
        inside_saturated=sum(inside and saturated for inside, saturated, _ in ways),
        governed_saturated=sum(any(f.saturated) or f.at_start for f in governed),
        governed_rotors=sum(f.rotors for f in governed),
        governed_arrived=sum(sum(f.arrived) for f in governed),
        warned_saturated=sum(not inside and saturated for inside, saturated, _ in ways),
        warned_lost=sum(not inside and not arrived for inside, _, arrived in ways),
        condition_least_n=min(f.condition for f in governed),
        transient_most_s=max(f.transient_s for f in governed),
        redrawn=refused,
    )


def holds(found: Check) -> bool:
    """Whether nothing inside saturated, nothing governed did, and all governed arrived."""
    return (
        found.inside_saturated == 0
        and found.governed_saturated == 0
        and found.governed_arrived == 2 * found.flights
    )


@click.command()
@click.option("--flights", "n", default=2000, show_default=True, type=click.IntRange(1), help="how many are drawn")  # fmt: skip
@click.option(
    "--seed", default=1, show_default=True, type=click.IntRange(0), help="of what is drawn"
)
@click.option("--json", "as_json", is_flag=True, help="a JSON object on standard output")
def main(n: int, seed: int, as_json: bool) -> None:
    """Fly random flights as asked and governed; exit 1 if the guard did not hold."""
    found = check(n, seed, Console(stderr=True))
    if as_json:
        click.echo(json.dumps({**found._asdict(), "holds": holds(found)}, indent=2))
    else:
        table = Shown("of flights of two setpoints each", "", box=None)
        for name, value in found._asdict().items():
            table.add_row(WORDS[name], f"{value:.4g}")
        Console().print(table)
        click.echo("the guard held" if holds(found) else "the guard did not hold")
    sys.exit(0 if holds(found) else 1)


if __name__ == "__main__":
    main()
