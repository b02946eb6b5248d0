"""Many flights on the simulator in C, from inside what `fcu` believes: python -m tests.foreign_plant.campaign

A flight is drawn by its seed alone: each hundred seeds in a row have every airframe in every mode twice, once
in a computed wind and once in a wind that answers. Mass, inertia, drag, rotor lag, limits of speed and
acceleration, and setpoints are drawn. Whatever is known of a flight has crossed the link: the truth of the
simulator, and what the vehicle says. Each policy flies the same draws.

*Saturated*: from 3 s after take-over until it lands, the thrust or the tilt is at its limit by the truth, or a
rotor is, its share of yaw's torque left out (`told`: the vehicle says so, of yaw too). *Lost*: the simulator says it. *Not
arrived*: at the end of the mode the vehicle is more than 0.5 m from the place that it was sent to, or still
moves in modes that have none, or stays armed after the landing. *Late*: of a step from rest whose arrival is
announced (`gcs envelope`), the vehicle is not within 0.3 m 1.1 times as long after it, or leaves again.
*In landing*: the same limits from the moment at which it is told to land. *Landing*: rotors that still turn 3 s
after the contact, or that were cut above 0.05 m once it was told to land (of a return: below 3 m at home), or a vehicle that tips over. The ground rises or falls by up to
8 degrees in half of the flights, from 3 m about the start on. Under `warn` nobody holds the
vehicle: what part of these flights saturates says how hard the draws are.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import hashlib
import json
import math
import multiprocessing
import os
import random
import stat
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import IO, Any

from fcu.interface.files import input_file
from fcu.laws import loader
from gcs_tools.campaigns.statistics import interval
from gcs_tools.flight import forking
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.envelope import arrives_s
from gcs_tools.missions.mission import from_tables, with_airframe
from tests.foreign_plant.computed_winds import Computed, WindsError, read
from tests.foreign_plant.fly import POSITION, VELOCITY, Flight, anew, compile_plant, vehicle_lines
from tests.process.conftest import claimed_instance

AIRFRAMES = ("s1000", "hexa", "quad", "x8", "racer")
POLICIES = ("warn", "govern", "refuse")  # of MR_GUARD, in its order
ANSWERING = ("against-velocity", "with-velocity", "against-thrust", "with-thrust")
FOLDER = Path(__file__).parents[2] / "fcu" / "airframes"
HEIGHT_M, NEAR_M, STILL_M_S = 8.0, 0.5, 0.25
REST_S = 45.0  # within which a vehicle that was fast has to be at rest
NEAR_HOME_M = 2.5  # a return that begins within two metres of home lands there
TRANSIENT_S = 3.0  # after take-over: the estimates begin
LANDS_M = 3.0  # above the ground at home, where a return is a landing
LATE, STAYS_S = 1.1, 2.0  # of the announced time, and for how long it then has to stay
ORBIT, TAKE_OFF, MOST_M_S2 = (
    34,
    22,
    0.5,
)  # commands, and the acceleration of a circle that is flown next
FOLLOWS_M = 8.0  # FLW_TGT_DST, as shipped
SLOPE_DEG = 8.0  # of the ground beyond 3 m from the start
LATE_S, CUT_M = (
    3.0,
    0.05,
)  # from the contact to rotors that are stopped; above the ground with rotors cut
LAGS = 0.4, 1.6  # of the lag in the airframe's file
HALVES = 8  # by which what is refused is made smaller
# what limits modes that lead the vehicle: its least drawn and greatest value
LIMITS = {
    "MPC_XY_CRUISE": (5.0, 20.0), "MPC_XY_VEL_MAX": (12.0, 20.0), "MPC_Z_VEL_MAX_UP": (3.0, 8.0),
    "MPC_TKO_SPEED": (3.0, 5.0), "MPC_Z_VEL_MAX_DN": (1.5, 4.0), "MPC_ACC_HOR": (3.0, 8.0),
    "MPC_ACC_UP_MAX": (3.0, 6.0), "FLW_TGT_MAX_VEL": (5.0, 20.0),
}  # fmt: skip
WRONG_USE, DIED = 2, 3  # exit codes
MOST_BYTES = 1 << 30  # of a file that is added to
BEGINS = b'{"seed": '  # what a line of it begins with
# what a flight of a file has, from which it is counted
NEEDED = (
    "seed", "policy", "airframe", "mode", "wind", "saturated", "saturated_landing", "lost", "arrived", "late",
    "fingerprint",
)  # fmt: skip

Found = dict[str, Any]
Place = tuple[float, float, float]


class CampaignError(ValueError):
    """A file that is not added to, and why."""


def believed(airframe: str) -> tuple[float, float]:
    """Return the greatest wind (m/s) and its greatest rate (m/s^2) that `gcs airframe` tells."""
    words = [sys.executable, "-m", "gcs_tools", "airframe", airframe, "--json"]
    told = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
    values = {each["key"]: each["value"] for each in told["gains"]}
    return values["guard_wind_m_s"], values["guard_wind_rate_m_s2"]


def drawn(
    seed: int, beliefs: dict[str, tuple[float, float]], computed: Sequence[Computed] = ()
) -> Found:
    """Return what makes the flight of a seed.

    computed : of which every second flight takes the wind, and the vehicle that it is worst for.
    """
    by = random.Random(f"flight {seed}")

    def ends(low: float, high: float) -> float:
        """Either end of a belief in half of the flights, and between in the others."""
        return by.choice((low, high)) if by.random() < 0.5 else by.uniform(low, high)

    n, modes = len(AIRFRAMES), tuple(MODES)
    airframe, mode = AIRFRAMES[seed % n], modes[seed // n % len(modes)]
    tables = tomllib.loads((FOLDER / f"{airframe}.toml").read_text())
    wind, rate = beliefs[airframe]
    made = {
        "seed": seed,
        "airframe": airframe,
        "mode": mode,
        "mass_kg": ends(*tables["vehicle"]["mass_kg"]),
        "drag": ends(0.0, min(tables["air"]["drag"])),
        "lag_s": ends(*(k * tables["rotors"]["lag_s"] for k in LAGS)),
        "inertia_kg_m2": [ends(*axis) for axis in tables["vehicle"]["inertia_kg_m2"]],
        "wind": by.choice(ANSWERING),
        "wind_m_s": wind * (1.0 if by.random() < 0.75 else by.uniform(0.3, 1.0)),
        "wind_rate_m_s2": rate,
        "period_s": 1.0,
        "axis_deg": by.uniform(0.0, 360.0),
        "vertical": by.random() < 0.5,
        "slope_deg": by.choice((0.0, by.uniform(-SLOPE_DEG, SLOPE_DEG))),
        "limits": {
            name: most if by.random() < 0.75 else round(by.uniform(least, most), 3)
            for name, (least, most) in LIMITS.items()
        },
    }
    of_it = [each for each in computed if each.airframe == airframe]
    for_it = [each for each in of_it if each.manoeuvre in MANOEUVRES[mode]] or of_it
    if seed // (n * len(modes)) % 2 and for_it:
        one = by.choice(for_it)
        made |= {"wind": "series", "wind_m_s": wind, "of": [one.manoeuvre, one.limit]}
        made |= {"samples": one.samples} | one.vehicle
    return made


def announced_s(made: Found, policy: str, before: Place, to: Place) -> float | None:
    """Return the time (s) after which a step from rest is said to have arrived, or None."""
    law, setpoint = {"guard": policy}, [0.0, to[1], to[0], -to[2]]
    start = {"position_m": [before[1], before[0], -before[2]]}
    flight = {"duration_s": 60.0, "ground_z_m": -1e4, "start": start, "setpoints": [setpoint]}
    tables = {"title": "A step.", "law": law, "flight": flight, "expect": {}}
    mission = with_airframe(from_tables("step", tables), made["airframe"])
    return arrives_s(scenario(mission))


def _flies(flight: Flight, mask: int, there: Place, here: Place = (0.0, 0.0, 0.0)) -> Place | None:
    """Send a setpoint, nearer by halves while it is refused, and return what is flown of it."""
    for k in range(HALVES):
        a, b, c = (h + (t - h) * 0.5**k for h, t in zip(here, there, strict=True))
        if flight.takes(mask, a, b, c):
            return a, b, c
    return None


def _begun(flight: Flight, mask: int, there: Place, here: Place) -> Place:
    """Begin a stream, with a nearer setpoint where this one is refused, and return what is flown."""
    for k in range(HALVES):
        a, b, c = (h + (t - h) * 0.5**k for h, t in zip(here, there, strict=True))
        if flight.offboard(lambda _, a=a, b=b, c=c: (mask, a, b, c)) == 0:
            return a, b, c
    raise RuntimeError("no stream could begin")


def _rush(flight: Flight, by: random.Random) -> None:
    """Fly as fast as a script may ask for, in half of the flights: what follows begins from there."""
    v = by.uniform(4.0, 15.0)
    angle, up = by.uniform(0.0, 2.0 * math.pi), by.uniform(-3.0, 1.0)
    seconds, rushes = by.choice((0.6, 1.5, 3.0)), by.random() < 0.75
    if rushes:
        there = (v * math.cos(angle), v * math.sin(angle), up)
        asked = _begun(flight, VELOCITY, there, (0.0, 0.0, 0.0))
        flight.stream(seconds, lambda _: (VELOCITY, *asked))


def _steps(flight: Flight, by: random.Random, made: Found, policy: str) -> Place:
    """Send places up to 40 m away, one after the other, and time a last one from rest."""
    here: Place = (0.0, 0.0, -HEIGHT_M)
    for k in range(4):
        north, east = (by.uniform(-28.0, 28.0) for _ in "ne")
        there = (north, east, -by.uniform(4.0, 30.0))
        there = here if k == 3 else there
        before = here
        here = _begun(flight, POSITION, there, here) if k == 0 else (
            _flies(flight, POSITION, there, here) or here
        )  # fmt: skip
        long_s = 25.0 if k == 3 else by.choice((1.0, 3.0, 8.0))
        flight.stream(long_s, lambda _, here=here: (POSITION, *here), every=0.4)
        made.setdefault("asked", []).append([*before, *here])
    far, angle = by.uniform(1.0, 30.0), by.uniform(0.0, 2.0 * math.pi)
    down = max(min(here[2] + by.choice((0.0, -0.5, 0.5)) * far, -4.0), -40.0)
    there = (here[0] + far * math.cos(angle), here[1] + far * math.sin(angle), down)
    flown = _flies(flight, POSITION, there, here)
    if flown is None:
        return here
    said = announced_s(made, policy, here, flown)
    made["announced_s"] = said
    flight.line(f"goal {flown[0]} {flown[1]} {flown[2]} 0.3")
    flight.stream(LATE * said if said else 20.0, lambda _: (POSITION, *flown), every=0.4)
    made["arrived_s"] = flight.truth["arrived_s"]
    flight.line(f"goal {flown[0]} {flown[1]} {flown[2]} 0.3")
    flight.stream(STAYS_S, lambda _: (POSITION, *flown), every=0.4)
    stays = flight.truth["arrived_s"] is not None and flight.truth["off_most_m"] <= 0.3
    made["late"] = said is not None and not stays
    flight.line("no goal")
    return flown


def _reversals(flight: Flight, by: random.Random, made: Found, policy: str) -> Place:
    """Send places to and fro, each before the last is reached."""
    away, every = by.uniform(2.0, 20.0), by.uniform(0.4, 3.0)
    angle = by.uniform(0.0, 2.0 * math.pi)
    place = (away * math.cos(angle), away * math.sin(angle), -HEIGHT_M)
    other = (-place[0], -place[1], place[2])
    middle = (0.0, 0.0, -HEIGHT_M)
    here = _begun(flight, POSITION, place, middle)
    end, k = flight.t + 10.0, 0
    while flight.t < end and not flight.truth.get("lost"):
        k += 1
        here = _flies(flight, POSITION, other if k % 2 else place, middle) or here
        flight.stream(every, lambda _, here=here: (POSITION, *here), every=min(every, 0.4))
    for _ in range(40):
        flight.takes(POSITION, *place)
        flight.go(0.4)
    return flight.echo[1] if flight.echo[0] == POSITION else here  # type: ignore[return-value]


def _velocities(flight: Flight, by: random.Random, made: Found, policy: str) -> None:
    """Send velocities, also beyond the limits."""
    none = (0.0, 0.0, 0.0)
    for k in range(5):
        v = (by.uniform(-13.0, 13.0), by.uniform(-13.0, 13.0), by.uniform(-4.0, 0.5))
        asked = _begun(flight, VELOCITY, v, none) if k == 0 else (
            _flies(flight, VELOCITY, v) or none
        )  # fmt: skip
        flight.stream(by.choice((0.6, 1.6, 4.0)), lambda _, v=asked: (VELOCITY, *v))
    flight.stream(8.0, lambda _: (VELOCITY, *none))


def _rests(flight: Flight) -> bool:
    """Return whether the vehicle is at rest, by the truth."""
    return math.hypot(*flight.truth["velocity"]) < STILL_M_S


def _away(flight: Flight, made: Found, place: Place) -> None:
    """Go to a place by DO_REPOSITION, as fast as it is granted."""
    _granted(flight, partial(flight.reposition, *place))
    flight.go(2.0)
    flight.go_until(lambda: math.dist(flight.truth["at"], place) < NEAR_M, 90.0)
    for name, value in made["limits"].items():
        flight.set(name, value)


def _takeoff(flight: Flight, by: random.Random, made: Found, policy: str) -> None:
    """Take off again, in the air and at speed, to a greater height."""
    _rush(flight, by)
    flight.set("MIS_TAKEOFF_ALT", by.uniform(12.0, 40.0))
    nan = float("nan")
    assert flight.command(TAKE_OFF, 0, 0, 0, nan, nan, nan, nan) == 0
    flight.go(1.0)
    flight.go_until(lambda: flight.mode >> 24 != 2, 90.0)
    flight.go(4.0)


def _landing(flight: Flight, by: random.Random, made: Found, policy: str) -> None:
    """Land where the ground may not be as high as at the start, half of the time from speed."""
    angle, away = by.uniform(0.0, 2.0 * math.pi), by.uniform(0.0, 16.0)
    high = (away * math.cos(angle), away * math.sin(angle), -by.uniform(6.0, 20.0))
    _away(flight, made, high)
    if by.random() < 0.5:
        _rush(flight, by)


def _return(flight: Flight, by: random.Random, made: Found, policy: str) -> None:
    """Return from afar, and from speed."""
    angle, away = by.uniform(0.0, 2.0 * math.pi), by.uniform(5.0, 30.0)
    there = (away * math.cos(angle), away * math.sin(angle), -by.uniform(5.0, 25.0))
    _away(flight, made, there)
    _rush(flight, by)
    assert flight.command_mode("return") == 0
    over, end = flight.truth["at"], flight.t + 240.0  # a wind may drag it once it has come down
    told: list[float] = []  # what is cut where it stands on the ground is none of the flight's
    while flight.armed and not flight.truth.get("lost"):
        assert flight.t < end, "still armed 240 s after it was told to return"
        truth = flight.go(0.5)
        if truth["high"] < LANDS_M and math.hypot(*truth["at"][:2]) < NEAR_HOME_M:
            flight.line("landing")
        if not truth["touching"]:
            over, told = flight.truth["at"], list(flight.values.get("saturated", []))
    flight.values["saturated"] = [0.0, *told]
    made["off_m"] = math.hypot(*over[:2])
    assert made["off_m"] < NEAR_HOME_M, f"{made['off_m']:.2f} m off its home when it came down"


def _reposition(flight: Flight, by: random.Random, made: Found, policy: str) -> Place:
    """Be sent to two places, the second before the first is reached, from speed."""
    _rush(flight, by)
    place: Place = (0.0, 0.0, -HEIGHT_M)
    for _ in range(2):
        place = (by.uniform(-35.0, 35.0), by.uniform(-35.0, 35.0), -by.uniform(5.0, 25.0))
        _granted(flight, partial(flight.reposition, *place))
        flight.go(by.choice((2.0, 4.0)))
    flight.go_until(lambda: math.dist(flight.truth["at"], place) < NEAR_M, 90.0)
    flight.go(4.0)
    return place


def _granted(flight: Flight, ask: Callable[[], int]) -> None:
    """Ask, with less speed and acceleration while it is denied."""
    limits = {"MPC_XY_CRUISE": 5.0, "MPC_ACC_HOR": 3.0, "MPC_ACC_UP_MAX": 3.0, "MPC_Z_VEL_MAX_UP": 3.0,
              "MPC_Z_VEL_MAX_DN": 1.5}  # fmt: skip
    for k in range(HALVES):
        if ask() == 0:
            return
        if k == 0:
            flight.command_mode("hold")  # slower from here on
        for name, value in limits.items():
            flight.set(name, max(value * 0.6**k, 0.5))
        flight.go(0.2)
    raise AssertionError(f"denied: {flight.texts[-2:]}")


def _hold(flight: Flight, by: random.Random, made: Found, policy: str) -> None:
    """Hold, from speed."""
    _rush(flight, by)
    assert flight.command_mode("hold") == 0
    flight.go(15.0)


def _orbit(flight: Flight, by: random.Random, made: Found, policy: str) -> None:
    """Fly circles about where the vehicle is, from speed."""
    nan = float("nan")
    radius, turns = by.uniform(2.0, 12.0), by.choice((-1.0, 1.0))
    most = flight_limit(made, "MPC_ACC_HOR")
    speed = by.uniform(0.5, 1.0) * math.sqrt(most * radius)
    _rush(flight, by)
    parts = iter(
        [speed, *(min(speed, math.sqrt(MOST_M_S2 * radius)) * 0.6**k for k in range(HALVES))]
    )

    def ask() -> int:
        return flight.command(ORBIT, turns * radius, next(parts), 0.0, 0.0, nan, nan, nan)

    _granted(flight, ask)
    flight.go(20.0)
    flight.command_mode("hold")
    flight.go(6.0)


def _follow(flight: Flight, by: random.Random, made: Found, policy: str) -> None:
    """Follow a target that turns, jumps and stops."""
    _rush(flight, by)
    at = [by.uniform(-15.0, 15.0), by.uniform(-15.0, 15.0)]
    flight.target(*at, (0.0, 0.0))
    assert flight.command_mode("follow") == 0
    every, speed = 0.5, (0.0, 0.0)
    for k in range(24):
        if k % 4 == 0:
            v, angle = by.uniform(2.0, 14.0), by.uniform(0.0, 2.0 * math.pi)
            speed = (v * math.cos(angle), v * math.sin(angle))
        if k % 12 == 5:
            at = [x + by.uniform(-12.0, 12.0) for x in at]
        flight.target(*at, speed)
        flight.go(every)
        at = [x + every * u for x, u in zip(at, speed, strict=True)]
    for _ in range(16):
        flight.target(*at, (0.0, 0.0))
        flight.go(1.0)
    north, east, _ = flight.truth["at"]
    made["off_m"] = abs(math.dist((north, east), at) - FOLLOWS_M)
    assert made["off_m"] < NEAR_M, f"{made['off_m']:.2f} m off its place beside the target"


def flight_limit(made: Found, name: str) -> float:
    """Return a limit that was drawn."""
    return float(made["limits"][name])


MODES: dict[str, Callable[[Flight, random.Random, Found, str], Place | None]] = {
    "steps": _steps,
    "reversals": _reversals,
    "velocities": _velocities,
    "takeoff": _takeoff,
    "landing": _landing,
    "return": _return,
    "reposition": _reposition,
    "hold": _hold,
    "orbit": _orbit,
    "follow": _follow,
}
MOVING = ("landing", "velocities", "return")  # whether they are at rest at their end is not asked

# whose computed winds a mode is flown in, where there are any
MANOEUVRES = {
    "steps": ("level", "climb", "descent"),
    "reversals": ("reversal",),
    "velocities": ("level", "climb", "descent"),
    "takeoff": ("climb",),
    "landing": ("landing", "descent"),
    "return": ("descent", "landing", "level"),
    "reposition": ("level", "climb", "descent"),
    "hold": ("hover",),
    "orbit": ("turn",),
    "follow": ("turn", "level"),
}


def forked(words: list[str], log: IO[str]) -> Any:
    """Start `fcu` as a copy of this process, or anew where this one may not be copied.

    It is the same program with the same options, and binds its own ports.
    """
    if not (forking.can_fork() and forking.load(loader.load("mmrac"))):
        return anew(words, log)
    return forking.fork_program("fcu", words, log.fileno(), log.fileno(), ())


def limits_met(flight: Flight) -> tuple[int, int, int]:
    """Count the ticks at a limit so far, by the truth: thrust, tilt, a rotor but for yaw."""
    _, thrust, tilt = flight.truth["at_limit"]
    return thrust, tilt, flight.truth["but_yaw"]


def fly(
    program: Path, policy: str, made: Found, start: Callable[[list[str], IO[str]], Any] = forked
) -> Found:
    """Fly one, take-off to landing, and return what came of it."""
    made = dict(made)
    by = random.Random(f"way {made['seed']}")
    options: Found = {
        "wind": made["wind"], "wind-max": made["wind_m_s"], "wind-rate": made["wind_rate_m_s2"],
        "wind-period": made["period_s"], "wind-axis": made["axis_deg"],
        "wind-vertical": int(made["vertical"]), "seed": made["seed"], "arena": 2000,
        "ground-slope": made["slope_deg"],
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
        flight = Flight(
            program, made["airframe"], vehicle, Path(name), instance, options, start
        )  # fmt: skip
        found = made | {"policy": policy, "saturated": True, "arrived": False, "disarmed": False}
        found |= {"late": False, "saturated_landing": True, "why": ""}
        try:
            for key, value in made["limits"].items():
                flight.set(key, value)
            flight.set("MR_GUARD", float(POLICIES.index(policy)))
            flight.go(0.5)
            flight.take_off(HEIGHT_M, TRANSIENT_S)
            before = limits_met(flight)
            flight.values.clear()
            flight.go_until(lambda: flight.mode >> 24 != 2, 60.0)  # take-off
            try:
                place, arrived = MODES[made["mode"]](flight, by, found, policy), True
                if place is None and made["mode"] not in MOVING:
                    flight.go_until(lambda: _rests(flight), REST_S)
            except AssertionError as error:
                place, arrived, found["why"] = None, False, str(error)[:300]
            after = limits_met(flight)
            told = max(flight.values.get("saturated", [0.0]))
            found["cut"] = [b - a for a, b in zip(before, after, strict=True)]  # ticks
            found["saturated"], found["told"] = after != before, told
            if place is not None:
                found["off_m"] = math.dist(flight.truth["at"], place)
                arrived = arrived and found["off_m"] < NEAR_M
            found["arrived"] = arrived
            if flight.armed:
                flight.command_mode("land")
                flight.go_until(lambda: not flight.armed, 180.0)
            found["disarmed"] = True
            landing = limits_met(flight)
            found["cut_landing"] = [b - a for a, b in zip(after, landing, strict=True)]
            found["saturated_landing"] = landing != after
        except (AssertionError, RuntimeError, TimeoutError) as error:
            found["why"] = found["why"] or str(error)[:300]
        finally:
            found["texts"] = flight.texts[-6:]
            verdict = flight.close()
    found["arrived"] = found["arrived"] and found["disarmed"]
    return found | {key: verdict.get(key) for key in TOLD}


COUNTED: dict[str, Callable[[Found], bool]] = {
    "saturated": lambda each: bool(each["saturated"]),
    "in landing": lambda each: bool(each["saturated_landing"]),
    "lost": lambda each: bool(each["lost"]),
    "not arrived": lambda each: not each["arrived"],
    "late": lambda each: bool(each["late"]),
    "landing": lambda each: bool(landing_faults(each)),
}


def landing_faults(found: Found) -> list[str]:
    """Return what was wrong with the landing: not disarmed in time, rotors cut in the air, tipped over."""
    took, faults = found.get("disarmed_s"), []
    if took is None or took > LATE_S:
        faults.append("late to disarm")
    if (found.get("cut_m") or 0.0) > CUT_M:
        faults.append("cut in the air")
    if found.get("lost") in ("tipped", "impact"):
        faults.append(found["lost"])
    return faults


TOLD = (
    "t",
    "lost",
    "touchdown_m_s",
    "contacts",
    "disarmed_s",
    "cut_m",
    "fcu_exit",
)  # of the verdict


def kept(found: Found) -> bool:
    """Return whether a flight is as promised."""
    return not any(counts(found) for counts in COUNTED.values())


def shares(found: list[Found]) -> str:
    """Return the counts of flights, each with the interval that holds 95 %, in percent."""
    cells = []
    for what, counts in COUNTED.items():
        of = [each for each in found if each.get("announced_s")] if what == "late" else found
        many = sum(map(counts, of))
        low, high = interval(many, len(of)) if of else (0.0, 1.0)
        cells.append(f"{many} of {len(of)} ({100.0 * low:.2f} to {100.0 * high:.2f})")
    return " | ".join(cells)


def table(found: list[Found]) -> str:
    """Return the counts of each policy, airframe, mode and kind of wind."""
    lines = [f"| | {' | '.join(COUNTED)} |", f"|---|{'--:|' * len(COUNTED)}"]
    for policy in sorted({each["policy"] for each in found}):
        flown = [each for each in found if each["policy"] == policy]
        lines.append(f"| **{policy}** | {shares(flown)} |")
        for key, kinds in (("airframe", AIRFRAMES), ("mode", tuple(MODES)), ("wind", WINDS)):
            for kind in kinds:
                if some := [each for each in flown if (each["wind"] == "series" if kind == COMPUTED else
                                                       each["wind"] != "series" if kind == ANSWERS else each[key] == kind)]:  # fmt: skip
                    lines.append(f"| {kind} | {shares(some)} |")
    return "\n".join(lines)


COMPUTED, ANSWERS = WINDS = ("computed winds", "winds that answer")


def fingerprint(computed: Path | None) -> dict[str, str]:
    """Return what a campaign is of, each in a few digits: law, guard, modes and landings, airframe files, simulator, winds."""
    laws = Path(loader.__file__).parent
    of = {
        "law": [*sorted(laws.glob("*.py")), *sorted((laws / "mmrac").glob("*.py"))],
        "guard": sorted((laws.parent / "guard").glob("*.py")),
        "vehicle": sorted((laws.parent / "vehicle").glob("*.py")),
        "airframes": [FOLDER / f"{name}.toml" for name in AIRFRAMES],
        "simulator": [Path(__file__).with_name("plant.c")],
        "winds": [computed] if computed else [],
    }
    return {
        what: hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:12]
        for what, paths in of.items()
    }


def flown_before(data: bytes, source: Path, made_of: dict[str, str]) -> tuple[list[Found], int]:
    """Return the flights of a file that is added to, and how many bytes they take.

    After them there may be one that was cut short. Raises CampaignError for a file of something else.
    """
    found, size = [], 0
    for number, line in enumerate(data.splitlines(keepends=True), start=1):
        where, is_whole = f"{source}: line {number}", line.endswith(b"\n")
        if not is_whole and (line.startswith(BEGINS) or BEGINS.startswith(line)):
            break
        try:
            row = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise CampaignError(f"{where} is no flight of a campaign") from error
        if not isinstance(row, dict) or not is_whole:
            raise CampaignError(f"{where} is no flight of a campaign")
        if lacking := [key for key in NEEDED if key not in row]:
            raise CampaignError(f"{where} has no {lacking[0]}: it is no flight of such a campaign")
        known = {"policy": POLICIES, "airframe": AIRFRAMES, "mode": tuple(MODES)}
        if not isinstance(row["seed"], int) or any(row[key] not in of for key, of in known.items()):
            raise CampaignError(f"{where} is no flight of a campaign")
        told = row["fingerprint"] if isinstance(row["fingerprint"], dict) else {}
        for what, of_it in made_of.items():
            if told.get(what) != of_it:
                raise CampaignError(
                    f"{where} was flown with another {what}: name a new file (--out)"
                )
        found.append(row)
        size += len(line)
    return found, size


@contextlib.contextmanager
def opened(path: Path, made_of: dict[str, str]) -> Iterator[tuple[list[Found], IO[str]]]:
    """Yield the flights of a file, and the file to add to, which no other campaign has meanwhile.

    Nothing is written to a file of something else. Raises CampaignError, OSError.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC
    descriptor = os.open(path, flags | os.O_NONBLOCK, 0o644)  # a pipe would wait
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise CampaignError(f"{path}: expected a regular file, not a device or a pipe")
    with open(descriptor, "a+", encoding="utf-8", buffering=1) as out:
        try:
            fcntl.flock(out, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise CampaignError(f"{path}: another process adds to this file") from error
        found, size = flown_before(input_file.content(path, MOST_BYTES), path, made_of)
        if size < os.fstat(descriptor).st_size:
            os.ftruncate(descriptor, size)
        yield found, out


def counted(found: list[Found], asked: Sequence[tuple[str, int]]) -> list[Found]:
    """Return the flights of these policies and seeds, each once."""
    first = {(each["policy"], each["seed"]): each for each in reversed(found)}
    return [first[key] for key in asked if key in first]


def fly_all(asked: Sequence[tuple[str, Found]], program: Path, jobs: int) -> Iterator[Found]:
    """Fly each by its policy, `jobs` at a time, in processes that have loaded `fcu`."""
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"))
    try:
        yield from pool.map(_fly, [(program, policy, made) for policy, made in asked])
    finally:
        pool.shutdown(cancel_futures=True)


def _fly(one: tuple[Path, str, Found]) -> Found:
    """Fly one, in a process of the pool."""
    return fly(*one)


def _number(least: int) -> Callable[[str], int]:
    """Return what reads a whole number of an option, of `least` or more."""

    def whole(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least:
            raise argparse.ArgumentTypeError(
                f"expected a whole number of {least} or more, got {text}"
            )
        return value

    return whole


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly what is asked and not yet flown, and print the table. Exit codes: 1 not as promised, 2 wrong use, 3 a process died."""
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--flights", type=_number(1), default=100, help="of each policy")
    words.add_argument("--policy", choices=POLICIES, action="append", help="default: all of them")
    words.add_argument("--first-seed", type=_number(0), default=1, help="of these flights, in a row")  # fmt: skip
    words.add_argument("--computed", type=Path, help="of `computed_winds`: half fly in these winds")
    words.add_argument("--out", type=Path, default=Path("foreign.jsonl"), help="added to; what it has is not flown again")  # fmt: skip
    words.add_argument("-j", "--jobs", type=_number(1), default=1)
    given = words.parse_args(arguments)
    try:
        return _flown(given)
    except (CampaignError, WindsError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return WRONG_USE
    except OSError as error:
        print(f"Error: {error.filename or given.out}: {error.strerror or error}", file=sys.stderr)
        return WRONG_USE
    except BrokenProcessPool:
        print("Error: a process that flew has died: start again, what it flew is flown anew", file=sys.stderr)  # fmt: skip
        return DIED


def _flown(given: argparse.Namespace) -> int:
    """Fly what is asked and not yet flown. Raises CampaignError, WindsError, OSError, BrokenProcessPool."""
    computed = read(given.computed) if given.computed else []
    made_of = fingerprint(given.computed)
    policies = [each for each in POLICIES if each in (given.policy or POLICIES)]
    seeds = range(given.first_seed, given.first_seed + given.flights)
    asked = [(policy, seed) for seed in seeds for policy in policies]
    with opened(given.out, made_of) as (found, out), tempfile.TemporaryDirectory() as name:
        has = {(each["policy"], each["seed"]) for each in found}
        if rest := [key for key in asked if key not in has]:
            beliefs = {airframe: believed(airframe) for airframe in AIRFRAMES}
            made = [(policy, drawn(seed, beliefs, computed)) for policy, seed in rest]
            for each in fly_all(made, compile_plant(Path(name)), given.jobs):
                found.append(each | {"fingerprint": made_of})
                out.write(f"{json.dumps(found[-1])}\n")
    flown = counted(found, asked)
    print(table(flown))
    return any(not kept(each) for each in flown if each["policy"] != "warn")


if __name__ == "__main__":
    sys.exit(main())
