"""Many flights on the simulator in C, from inside what `fcu` believes: python -m tests.foreign_plant.campaign

Airframe, mode, mass, inertia, drag, rotor lag, wind and setpoints are drawn. Whatever is known of a flight has
crossed the link: the truth of the simulator, and what the vehicle says.

*Saturated*: between take-off and landing the thrust or the tilt is at its limit by the truth, or the
vehicle says so of a rotor, ten times a second: a torque that is short for less may go unseen. *Lost*: the simulator says it. *Not arrived*: at the end of the mode the vehicle is more than
0.5 m from the place that it was sent to, or stays armed after the landing. *In landing*: the thrust or
the tilt is at its limit there, or it never ended.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from gcs_tools.campaigns.statistics import interval
from tests.foreign_plant.computed_winds import Computed, read
from tests.foreign_plant.fly import POSITION, VELOCITY, Flight, compile_plant, vehicle_lines
from tests.process.conftest import claimed_instance

AIRFRAMES = ("s1000", "hexa", "quad", "x8", "racer")
POLICIES = ("warn", "govern", "refuse")  # of MR_GUARD, in its order
WINDS = (
    "sine", "turn", "bang", "gust", "against-velocity", "with-velocity", "against-thrust",
    "with-thrust",
)  # fmt: skip
FOLDER = Path(__file__).parents[2] / "fcu" / "airframes"
HEIGHT_M, NEAR_M = 8.0, 0.5
TRANSIENT_S = 3.0  # after take-over: the estimates begin
ORBIT, MOST_M_S2 = 34, 0.5  # a command, and the acceleration to the middle: more may be denied
LAGS = 0.4, 1.6  # of the lag in the airframe's file

Found = dict[str, Any]


def believed(airframe: str) -> tuple[float, float]:
    """Return the greatest wind (m/s) and its greatest rate (m/s^2) that `gcs airframe` tells."""
    words = [sys.executable, "-m", "gcs_tools", "airframe", airframe, "--json"]
    told = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
    values = {each["key"]: each["value"] for each in told["gains"]}
    return values["guard_wind_m_s"], values["guard_wind_rate_m_s2"]


def drawn(
    seed: int,
    number: int,
    beliefs: dict[str, tuple[float, float]],
    computed: Sequence[Computed] = (),
) -> Found:
    """Return what makes flight `number` of a seed.

    computed : of which every second flight takes the wind, and the vehicle that it is worst for.
    """
    by = random.Random(f"{seed} {number}")

    def ends(low: float, high: float) -> float:
        """Either end of a belief in half of the flights, and between in the others."""
        return by.choice((low, high)) if by.random() < 0.5 else by.uniform(low, high)

    airframe = by.choice(AIRFRAMES)
    tables = tomllib.loads((FOLDER / f"{airframe}.toml").read_text())
    wind, rate = beliefs[airframe]
    mode = by.choice(tuple(MODES))
    made = {
        "number": number,
        "airframe": airframe,
        "mode": mode,
        "mass_kg": ends(*tables["vehicle"]["mass_kg"]),
        "drag": ends(0.0, min(tables["air"]["drag"])),
        "lag_s": ends(*(k * tables["rotors"]["lag_s"] for k in LAGS)),
        "inertia_kg_m2": [ends(*axis) for axis in tables["vehicle"]["inertia_kg_m2"]],
        "wind": by.choice(WINDS),
        "wind_m_s": wind * (1.0 if by.random() < 0.5 else by.uniform(0.3, 1.0)),
        "wind_rate_m_s2": rate,
        "period_s": 10.0 ** by.uniform(-0.3, 1.0),
        "axis_deg": by.uniform(0.0, 360.0),
        "vertical": by.random() < 0.3,
        "seed": by.getrandbits(30),
    }
    for_it = [c for c in computed if c.airframe == airframe and c.manoeuvre in MANOEUVRES[mode]]
    if number % 2 and for_it:
        one = by.choice(for_it)
        made |= {"wind": "series", "wind_m_s": wind, "of": [one.manoeuvre, one.limit]}
        made |= {"samples": one.samples} | one.vehicle
    return made


def _steps(flight: Flight, by: random.Random) -> tuple[float, float, float]:
    """Send places up to 12 m away, one after the other, and return the last."""
    place = (0.0, 0.0, -HEIGHT_M)
    for k in range(4):
        north, east = (by.uniform(-12.0, 12.0) for _ in "ne")
        place = (north, east, -by.uniform(4.0, 20.0))
        here = place
        if k == 0:
            flight.offboard(lambda _, here=here: (POSITION, *here))
        flight.stream(by.choice((1.0, 3.0, 8.0)), lambda _, here=here: (POSITION, *here))
    flight.stream(25.0, lambda _: (POSITION, *place), every=0.4)
    return place


def _reversals(flight: Flight, by: random.Random) -> tuple[float, float, float]:
    """Send places to and fro, each before the last is reached."""
    away, every = by.uniform(1.0, 10.0), by.uniform(0.4, 3.0)
    angle = by.uniform(0.0, 2.0 * math.pi)
    place = (away * math.cos(angle), away * math.sin(angle), -HEIGHT_M)

    def asked(t: float) -> tuple[int, float, float, float]:
        side = -1.0 if t // every % 2 else 1.0
        return (POSITION, side * place[0], side * place[1], place[2])

    flight.offboard(asked)
    flight.stream(12.0, asked, every=0.1)
    flight.stream(20.0, lambda _: (POSITION, *place), every=0.4)
    return place


def _velocities(flight: Flight, by: random.Random) -> None:
    """Send velocities, also beyond the limits."""
    first = True
    for _ in range(5):
        v = (by.uniform(-9.0, 9.0), by.uniform(-9.0, 9.0), by.uniform(-3.0, 0.5))
        if first:
            flight.offboard(lambda _, v=v: (VELOCITY, *v))
        first = False
        flight.stream(by.choice((0.6, 1.6, 4.0)), lambda _, v=v: (VELOCITY, *v))
    flight.stream(6.0, lambda _: (VELOCITY, 0.0, 0.0, 0.0))


def _hold(flight: Flight, by: random.Random) -> tuple[float, float, float]:
    """Stay in mode Hold where the take-off ended."""
    flight.go(15.0)
    return (0.0, 0.0, -HEIGHT_M)


def _orbit(flight: Flight, by: random.Random) -> None:
    """Fly circles about where the vehicle is."""
    nan = float("nan")
    radius = by.uniform(2.0, 12.0)
    speed = by.uniform(1.0, min(6.0, math.sqrt(MOST_M_S2 * radius)))
    turns = by.choice((-1.0, 1.0))
    assert flight.command(ORBIT, turns * radius, speed, 0.0, 0.0, nan, nan, nan) == 0
    flight.go(20.0)
    flight.command_mode("hold")
    flight.go(4.0)


MODES: dict[str, Callable[[Flight, random.Random], tuple[float, float, float] | None]] = {
    "steps": _steps,
    "reversals": _reversals,
    "velocities": _velocities,
    "hold": _hold,
    "orbit": _orbit,
}


# whose computed winds a mode is flown in; all of them take off and land
MANOEUVRES = {
    "steps": ("level", "climb", "descent"),
    "reversals": ("reversal",),
    "velocities": ("level", "climb", "descent"),
    "hold": ("hover", "landing"),
    "orbit": ("turn",),
}


def fly(program: Path, policy: str, made: Found) -> Found:
    """Fly one, take-off to landing, and return what came of it."""
    by = random.Random(made["seed"])
    options: Found = {
        "wind": made["wind"], "wind-max": made["wind_m_s"], "wind-rate": made["wind_rate_m_s2"],
        "wind-period": made["period_s"], "wind-axis": made["axis_deg"],
        "wind-vertical": int(made["vertical"]), "seed": made["seed"], "arena": 400,
    }  # fmt: skip
    airframe = FOLDER / f"{made['airframe']}.toml"
    vehicle = vehicle_lines(airframe, made["mass_kg"])
    drag = made["drag"] if isinstance(made["drag"], list) else [made["drag"]] * 3
    vehicle += f"lag {made['lag_s']}\ninertia {' '.join(map(str, made['inertia_kg_m2']))}\n"
    vehicle += f"drag {' '.join(map(str, drag))}\n"
    with tempfile.TemporaryDirectory() as name, claimed_instance() as instance:
        if samples := made.pop("samples", None):
            options["wind-series"] = Path(name) / "wind.txt"
            lines = "\n".join(" ".join(map(str, sample)) for sample in samples)
            options["wind-series"].write_text(lines + "\n")
        flight = Flight(program, made["airframe"], vehicle, Path(name), instance, options)
        found = made | {"policy": policy, "saturated": False, "arrived": True, "disarmed": False}
        try:
            flight.set("MR_GUARD", float(POLICIES.index(policy)))
            flight.go(0.5)
            flight.take_off(HEIGHT_M, TRANSIENT_S)
            before = flight.truth["at_limit"]
            flight.values.clear()
            flight.go_until(lambda: flight.mode >> 24 != 2, 60.0)  # take-off
            place = MODES[made["mode"]](flight, by)
            after = flight.truth["at_limit"]
            told = max(flight.values.get("saturated", [0.0]))
            found["saturated"] = after[1:] != before[1:] or told > 0.0
            found["told"] = told
            if place is not None:
                found["off_m"] = math.dist(flight.truth["at"], place)
                found["arrived"] = found["off_m"] < NEAR_M
            flight.command_mode("land")
            flight.go_until(lambda: not flight.armed, 120.0)
            found["disarmed"] = True
            found["saturated_landing"] = flight.truth["at_limit"][1:] != after[1:]
        except (AssertionError, RuntimeError, TimeoutError) as error:
            found["why"] = str(error)[:300]
        finally:
            verdict = flight.close()
    found["arrived"] = found["arrived"] and found["disarmed"]
    return found | {key: verdict.get(key) for key in ("lost", "touchdown_m_s", "contacts")}


def table(found: list[Found]) -> str:
    """Return the counts with their intervals, and a line for each airframe and mode."""
    n, lines = len(found), []
    for what, counted in (
        ("saturated", sum(each["saturated"] for each in found)),
        ("lost", sum(bool(each["lost"]) for each in found)),
        ("not arrived", sum(not each["arrived"] for each in found)),
        ("in landing", sum(each.get("saturated_landing", True) for each in found)),
    ):
        low, high = interval(counted, n)
        lines.append(f"{what:12} {counted:5} of {n}, {100.0 * low:.2f} to {100.0 * high:.2f} %")
    flown = Counter((each["airframe"], each["mode"]) for each in found)
    bad = Counter(
        (each["airframe"], each["mode"])
        for each in found
        if each["saturated"] or each["lost"] or not each["arrived"]
    )
    lines += [f"{a:6} {m:10} {bad[a, m]:4} of {n}" for (a, m), n in sorted(flown.items())]
    return "\n".join(lines)


def main() -> int:
    """Fly them, a line of JSON each in a file, and print a table."""
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--flights", type=int, default=100)
    words.add_argument("--first", type=int, default=0, help="number of the first flight")
    words.add_argument("--seed", type=int, default=1)
    words.add_argument("--policy", choices=POLICIES, default="govern")
    words.add_argument("--computed", type=Path, help="of `computed_winds`: half fly in these winds")
    words.add_argument("--out", type=Path, default=Path("foreign.jsonl"), help="added to")
    words.add_argument("-j", "--jobs", type=int, default=1)
    given = words.parse_args()
    beliefs = {airframe: believed(airframe) for airframe in AIRFRAMES}
    numbers = range(given.first, given.first + given.flights)
    computed = read(given.computed) if given.computed else []
    made = [drawn(given.seed, number, beliefs, computed) for number in numbers]
    found: list[Found] = []
    with tempfile.TemporaryDirectory() as name, given.out.open("a", buffering=1) as out:
        program = compile_plant(Path(name))
        with ProcessPoolExecutor(given.jobs) as pool:
            for each in pool.map(partial(fly, program, given.policy), made):
                found.append(each)
                out.write(f"{json.dumps(each)}\n")
    print(table(found))
    return any(each["saturated"] or each["lost"] or not each["arrived"] for each in found)


if __name__ == "__main__":
    sys.exit(main())
