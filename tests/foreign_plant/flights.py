"""Flights of a campaign on the simulator in C: drawn by their seeds, and flown in one of ten modes.

A flight is drawn by its seed alone: each hundred seeds in a row have every airframe in every mode twice, once
in a computed wind and once in a wind that answers. Mass, inertia, drag, rotor lag, limits of speed and
acceleration, and setpoints are drawn. Whatever is known of a flight has crossed the link: the truth of the
simulator, and what the vehicle says.
"""

from __future__ import annotations

import json
import math
import random
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import IO, Any

from fcu.laws import loader
from gcs_tools.flight import forking
from gcs_tools.flight.scenario import scenario
from gcs_tools.judging.envelope import arrives_s
from gcs_tools.missions.mission import from_tables, with_airframe
from tests.foreign_plant.computed_winds import Computed
from tests.foreign_plant.fly import POSITION, VELOCITY, Flight, anew, vehicle_lines
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
ORBIT, TAKE_OFF = 34, 22  # commands
MOST_M_S2 = 0.5  # of a circle that is flown next
FOLLOWS_M = 8.0  # FLW_TGT_DST, as shipped
SLOPE_DEG = 8.0  # of the ground beyond 3 m from the start
LAGS = 0.4, 1.6  # of the lag in the airframe's file
HALVES = 8  # by which what is refused is made smaller
# what limits modes that lead the vehicle: its least drawn and greatest value
LIMITS = {
    "MPC_XY_CRUISE": (5.0, 20.0), "MPC_XY_VEL_MAX": (12.0, 20.0), "MPC_Z_VEL_MAX_UP": (3.0, 8.0),
    "MPC_TKO_SPEED": (3.0, 5.0), "MPC_Z_VEL_MAX_DN": (1.5, 4.0), "MPC_ACC_HOR": (3.0, 8.0),
    "MPC_ACC_UP_MAX": (3.0, 6.0), "FLW_TGT_MAX_VEL": (5.0, 20.0),
}  # fmt: skip

# what the simulator says in the end
TOLD = "t", "lost", "touchdown_m_s", "contacts", "disarmed_s", "cut_m", "fcu_exit"

Found = dict[str, Any]
Place = tuple[float, float, float]


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
