"""What an attack draws: plant, wind, setpoints and law, all within what the guard believes.

A flight is made of numbers between 0 and 1 (`Numbers`). A campaign draws them from a seed and the
number of the flight; a search chooses them. The same numbers are the same flight, to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.guard import foreseen, governor, margin, noise, stability, wrench
from fcu.guard.stability import unstable
from fcu.interface.airframe import believed
from fcu.interface.messages import Setpoint
from fcu.kernel.algebra import Vec3
from gcs_tools.campaigns.flights import Random
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.missions.mission import from_tables, load, override
from gcs_tools.studies.attack.wind import KINDS, OWN, Gust
from sitl_plant.physics.wind.layers import FieldLayer, Layers
from sitl_plant.physics.wind.packed_field import opened

Array = np.ndarray[Any, np.dtype[np.float64]]
Tables = dict[str, Any]

POLICIES = ("govern", "refuse")
SETPOINTS = ("step", "descent", "reversal", "stream", "moving", "random")
NOISES = ("none", "bounded", "gaussian")

FIRST_S, ATTACK_S = 2.0, 12.0  # when the setpoints of an attack begin, and for how long they come
STREAM_S = 0.05  # between two setpoints of a stream
NEAREST_M = 0.1  # of the last setpoint: a reference model that is so near has settled
ASIDE_M, BELOW_M = (
    400.0,
    450.0,
)  # that a field reaches beyond a flight's beginning: a moving setpoint that is not followed by another leads far
TRIES = 1000  # draws of one flight, all refused by the rule of gains: nothing to fly
WIND_M_S, WIND_M_S2 = 12.0, 20.0  # the greatest guard_wind_m_s, guard_wind_rate_m_s2
MORE_S = 16.0  # s: given to each flight beyond that; what is governed may overshoot, what was swept along settles late


class NoFlightError(ValueError):
    """Nothing can be flown: every draw has gains that are not stable."""


class Numbers(NamedTuple):
    """What makes one flight, each from 0 to 1; `tables`, `gust_of` and `script` say what of it."""

    f_m: float
    zeta_m: float
    gamma: float
    c_angle: float
    c_rate: float
    believed_wind: float
    J_hat_0: float
    m_hat_0: float
    rate: float
    heading: float
    mass: float
    J_x: float
    J_y: float
    J_z: float
    drag_x: float
    drag_y: float
    drag_z: float
    lag: float
    wind: float
    wind_speed: float
    wind_every: float
    wind_share: float
    wind_height: float
    wind_azimuth: float
    setpoints: float
    height: float
    azimuth: float
    far: float
    speed: float
    every: float
    times: float
    yaw_steps: float
    yaw: float
    seed: float


class How(NamedTuple):
    """How all flights of a campaign are flown."""

    policy: str = "govern"
    noise: str = "none"
    part: float = 1.0  # of the amounts of noisy_state
    unknown: bool = False  # the guard believes in no noise
    as_shipped: bool = False  # the law as it is, whatever was drawn of it
    settings: Mapping[tuple[str, ...], Any] = {}  # of a mission, over what was drawn
    field: str = ""  # a packed field of wind of up to 1 m/s, in place of the drawn winds


@dataclass(frozen=True)
class Attack:
    """One flight, ready to be flown."""

    numbers: Numbers
    tables: Tables  # the mission, but for its setpoints
    scene: Scenario
    gust: Gust
    noise: Array  # float64[ticks, 12]
    setpoints: str  # of SETPOINTS
    wind: str  # of KINDS


# --- from a number to a value


def between(u: float, low: float, high: float) -> float:
    """Evenly."""
    return low + u * (high - low)


def scaled(u: float, low: float, high: float) -> float:
    """Evenly in the logarithm."""
    return float(low * (high / low) ** u)


def ends(u: float, low: float, high: float) -> float:
    """One half evenly, a quarter at either end."""
    return between(min(max(2.0 * u - 0.5, 0.0), 1.0), low, high)


def one_of(u: float, choices: Sequence[Any]) -> Any:
    """One of several, each as often."""
    return choices[min(int(u * len(choices)), len(choices) - 1)]


def direction(height: float, azimuth: float) -> Array:
    """float64[3] of length 1: straight down, level or straight up in half of the cases."""
    z = float(np.interp(height, (0.0, 0.15, 0.4, 0.6, 0.85, 1.0), (-1.0, -1.0, 0.0, 0.0, 1.0, 1.0)))
    a, aside = between(azimuth, -math.pi, math.pi), math.sqrt(1.0 - z * z)
    return np.array([aside * math.cos(a), aside * math.sin(a), z])


def anywhere(random: Random) -> Array:
    """float64[3] of length 1."""
    v = random.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


# --- law, plant and air


@cache
def airframe() -> Mapping[str, Any]:
    """What is believed of the vehicle: the tables of its file."""
    return believed()[1]


@cache
def noise_table() -> Tables:
    """`plant.noise` of the mission noisy_state: one sigma, or the bound."""
    return dict(load("noisy_state").plant.noise.model_dump())


def noise_of_plant(how: How) -> Tables:
    """`plant.noise` of a campaign: its part of that."""
    return {name: how.part * amount for name, amount in noise_table().items()}


def noise_belief(how: How) -> Tables:
    """[law], as far as the guard is to believe in the noise that is drawn."""
    if how.noise == "none" or how.unknown:
        return {}
    amount = noise_of_plant(how)
    return {
        "guard_noise": how.noise,
        "guard_noise_position_m": amount["position_m"],
        "guard_noise_velocity_m_s": amount["velocity_m_s"],
        "guard_noise_attitude_rad": math.radians(amount["attitude_deg"]),
        "guard_noise_rate_rad_s": amount["rate_rad_s"],
    }


def law_table(n: Numbers) -> Tables:
    """[law], where it is drawn."""
    masses, axes = airframe()["vehicle"]["mass_kg"], airframe()["vehicle"]["inertia_kg_m2"]
    c_angle = scaled(n.c_angle, 4.0, 13.0)
    c_rate = between(n.c_rate, 1.6, 2.6) * c_angle
    return {
        "f_m": scaled(n.f_m, 0.4, 3.0),
        "zeta_m": between(n.zeta_m, 0.6, 1.2),
        "gamma": scaled(n.gamma, 500.0, 5000.0),
        "c_angle": [c_angle, c_angle, 3.0],
        "c_rate": [c_rate, c_rate, 6.0],
        "guard_wind_m_s": wind_of(n),
        "J_hat_0": between(n.J_hat_0, float(np.min(axes)), float(np.max(axes))),
        "m_hat_0": between(n.m_hat_0, min(masses), max(masses)),
    }


def wind_of(n: Numbers) -> float:
    """The greatest wind that is believed, m/s: in half of the flights less than by default."""
    return WIND_M_S * min(2.0 * n.believed_wind, 1.0)


def plant_table(n: Numbers) -> Tables:
    """[plant]."""
    vehicle, drag = airframe()["vehicle"], airframe()["air"]["drag"]
    inertia = zip((n.J_x, n.J_y, n.J_z), vehicle["inertia_kg_m2"], strict=True)
    return {
        "mass_kg": ends(n.mass, *vehicle["mass_kg"]),
        "inertia_kg_m2": [ends(u, *axis) for u, axis in inertia],
        "drag": [
            ends(u, 0.0, c) for u, c in zip((n.drag_x, n.drag_y, n.drag_z), drag, strict=True)
        ],
        "rotor_lag_s": between(n.lag, 0.02, 0.08),
    }


def wind_table(n: Numbers, greatest: float) -> Tables:
    """[wind] of an own wind, up to the greatest (m/s): steady, and a sinusoid whose rate is within the belief."""
    speed = ends(n.wind_speed, 0.0, greatest)
    steady = n.wind_share * speed * direction(n.wind_height, n.wind_azimuth)
    other = np.random.default_rng(seed_of(n) + 1)
    amplitude = (1.0 - n.wind_share) * speed * anywhere(other)
    fastest = WIND_M_S2 / max(float(np.linalg.norm(amplitude)), 1e-9)
    frequency = np.minimum(other.uniform(0.5, 1.0, 3) / scaled(n.wind_every, 0.3, 4.0), fastest)
    return {
        "steady_m_s": steady.tolist(),
        "amplitude_m_s": amplitude.tolist(),
        "frequency_rad_s": frequency.tolist(),
        "rotation_amplitude_rad_s": other.uniform(0.0, 0.7, 3).tolist(),  # as the paper's
        "rotation_frequency_rad_s": other.uniform(0.0, 2.5, 3).tolist(),
    }


def gust_of(n: Numbers, greatest: float) -> Gust:
    """The wind that answers, up to the greatest (m/s); two thirds blow along the way to the first setpoint."""
    along = direction(n.wind_height, n.wind_azimuth)
    if n.wind_share < 2.0 / 3.0:
        along = direction(n.height, n.azimuth)
    return Gust(
        kind=float(one_of(n.wind, range(len(KINDS)))),
        speed=ends(n.wind_speed, 0.0, greatest),
        rate=WIND_M_S2,
        every=scaled(n.wind_every, 0.3, 4.0),
        along=Vec3(*along.tolist()),
    )


# --- setpoints


def seed_of(n: Numbers) -> int:
    """Of what is too much for numbers of its own: random points, further yaw steps, noise."""
    return int(n.seed * 2.0**32)


class Script(NamedTuple):
    """What is asked for, from FIRST_S on."""

    at: list[float]  # s
    r: list[Array]  # m, E
    v: list[Array]  # m/s, E


def step(n: Numbers, law: Any, random: Random) -> Script:
    """One step of 0.2 to 40 m."""
    return Script([0.0], [scaled(n.far, 0.2, 40.0) * direction(n.height, n.azimuth)], [])


def descent(n: Numbers, law: Any, random: Random) -> Script:
    """20 to 100 m straight down."""
    return Script([0.0], [np.array([0.0, 0.0, -scaled(n.far, 20.0, 100.0)])], [])


def reversal(n: Numbers, law: Any, random: Random) -> Script:
    """A step of 0.1 to 20 m, reversed one to eight times at a part of 1/f_m."""
    to = scaled(n.far, 0.1, 20.0) * direction(n.height, n.azimuth)
    every = between(n.every, 0.1, 3.0) / law.f_m
    times = min(1 + round(between(n.times, 0.5, 8.49)), 1 + int(ATTACK_S / every))
    return Script([k * every for k in range(times)], [to * (-1.0) ** k for k in range(times)], [])


def circle(n: Numbers, random: Random, moving: bool) -> Script:
    """Positions on a circle of 0.5 to 10 m at 1 to 9 m/s; with their velocity, if they are `moving`."""
    R, speed = scaled(n.far, 0.5, 10.0), between(n.speed, 1.0, 9.0)
    first = direction(n.height, n.azimuth)
    second = np.cross(first, anywhere(random))
    second /= np.linalg.norm(second)
    at = np.arange(0.0, ATTACK_S, STREAM_S).tolist()
    turn = np.outer(at, [speed / R])
    r = [*(R * (np.cos(turn) * first + np.sin(turn) * second) - R * first)]
    v = [*(speed * (-np.sin(turn) * first + np.cos(turn) * second))] if moving else []
    return Script([*at, ATTACK_S], [*r, r[-1]], [*v, np.zeros(3)] if moving else [])


def points(n: Numbers, law: Any, random: Random) -> Script:
    """Points up to 20 m away, one every 0.05 to 2 s."""
    far, every, at = scaled(n.far, 0.1, 20.0), scaled(n.every, 0.05, 2.0), [0.0]
    while at[-1] < ATTACK_S:
        at.append(at[-1] + every * random.uniform(0.5, 1.5))
    return Script(at, [far * random.uniform() * anywhere(random) for _ in at], [])


SCRIPTS: dict[str, Callable[[Numbers, Any, Random], Script]] = {
    "step": step,
    "descent": descent,
    "reversal": reversal,
    "stream": lambda n, law, random: circle(n, random, moving=False),
    "moving": lambda n, law, random: circle(n, random, moving=True),
    "random": points,
}


def yaws(n: Numbers, kind: str, count: int, random: Random) -> list[float]:
    """Yaw (rad) of each setpoint: in half of the flights it steps, the first time with the first."""
    now, after = between(n.heading, -math.pi, math.pi), []
    for k in range(count):
        often = 0.05 if kind in ("stream", "moving") else 0.5
        if n.yaw_steps >= 0.5 and k == 0:
            now = between(n.yaw, -math.pi, math.pi)
        elif n.yaw_steps >= 0.5 and random.uniform() < often:
            now = float(random.uniform(-math.pi, math.pi))
        after.append(now)
    return after


def sent(n: Numbers, kind: str, law: Any) -> tuple[list[float], list[Setpoint]]:
    """When (s) which setpoints are sent: one where the vehicle is, then those of the attack."""
    random = np.random.default_rng(seed_of(n))
    asked = SCRIPTS[kind](n, law, random)
    still = Vec3(0.0, 0.0, 0.0)
    velocities = [Vec3(*v.tolist()) for v in asked.v] or [still] * len(asked.at)
    turned = zip(asked.r, velocities, yaws(n, kind, len(asked.at), random), strict=True)
    first = Setpoint(still, still, still, between(n.heading, -math.pi, math.pi), 0.0)
    rest = [Setpoint(Vec3(*r.tolist()), v, still, psi, 0.0) for r, v, psi in turned]
    return [0.0, *(FIRST_S + at for at in asked.at)], [first, *rest]


def settles_s(guard: Any, law: Any, far: float) -> float:
    """How long (s) it may take to get `far` (m), at the speed that is governed, and to settle there."""
    slowest = law.f_m * (law.zeta_m - math.sqrt(max(law.zeta_m**2 - 1.0, 0.0)))
    known = margin.known(guard, law)
    top, brake = governor.speeds(known)
    top, a = min(top, max(margin.sinking(known), governor.SLOWEST)), brake / governor.BRAKING
    v = min(top, math.sqrt(a * far))
    return float(math.log(max(far / NEAREST_M, 10.0)) / slowest + far / v + v / a)


# --- a flight


def merged(tables: Tables, settings: Mapping[tuple[str, ...], Any]) -> Tables:
    """The tables with values, by the path of their key, put over theirs."""
    for (*names, last), value in settings.items():
        table = tables
        for name in names:
            table = table.setdefault(name, {})
        table[last] = value
    return tables


def parsed(settings: Sequence[str]) -> dict[tuple[str, ...], Any]:
    """Settings TABLE.KEY=VALUE of a mission by their path. Raises MissionError."""
    flight = {"duration_s": 1.0, "setpoints": [[0.0, 0.0, 0.0, 0.0]]}
    mission = from_tables("--set", {"title": "Drawn.", "flight": flight})
    found: dict[tuple[str, ...], Any] = {}
    for setting in settings:
        mission = override(mission, setting)
    for path in mission.changed:
        value: Any = mission.given
        names = tuple(map(str, path))
        for name in names:
            value = value[name]
        found[names] = value
    return found


def tables(n: Numbers, how: How) -> Tables:
    """The mission that the numbers make, but for its setpoints and how long it takes."""
    own = one_of(n.wind, range(len(KINDS))) == OWN
    plant = plant_table(n)
    if how.noise != "none":
        plant["noise"] = noise_of_plant(how)
    drawn: Tables = {
        "title": "Drawn.",
        "flight": {
            "duration_s": 60.0,
            "rate_hz": 500 if how.as_shipped else one_of(n.rate, (250, 500)),
            "seed": seed_of(n),
            "ground_z_m": -1e4,
            "arena_m": 1e4,
            "start": {"yaw_deg": math.degrees(between(n.heading, -math.pi, math.pi))},
            "setpoints": [[0.0, 0.0, 0.0, 0.0]],
        },
        "law": {**({} if how.as_shipped else law_table(n)), **noise_belief(how)},
        "plant": plant,
        "wind": wind_table(n, WIND_M_S if how.as_shipped else wind_of(n)) if own else {},
        "expect": {},
    }
    return merged(merged(drawn, how.settings), {("law", "guard"): how.policy})


def noise_of(scene: Scenario, kind: str) -> Array:
    """float64[ticks, 12] of the reports: none, within one sigma, or of that sigma."""
    if kind == "gaussian":
        return scene.noise(scene.ticks)
    if kind == "none":
        return np.zeros((scene.ticks, len(scene.world.noise_scale)))
    random = np.random.default_rng(int(scene.world.seed))
    scale = scene.world.noise_scale
    return random.uniform(-1.0, 1.0, (scene.ticks, len(scale))) * scale


def flies_there(scene: Scenario) -> bool:
    """Whether hover leaves force and torque for the gusts that are believed, tilts steer there and follow."""
    law, guard = scene.settings
    guard = guard._replace(**noise.NOT_YET)
    still = Vec3(0.0, 0.0, 0.0)
    fits = margin.condition(margin.known(guard, law), still, still, 0.0) >= 0.0
    recovers = stability.recovers(law, guard, guard.c_D * guard.w_max**2)
    follows = foreseen.lags(law) <= foreseen.QUICKEST
    return bool(fits and wrench.spare(guard, law) >= 0.0 and recovers and follows)


def lifted(n: Numbers) -> Numbers:
    """What a descent is flown for: a light vehicle with all of the drag, in a wind mostly from below."""
    return n._replace(
        height=1.0,
        mass=0.5 * n.mass,
        drag_z=1.0,
        wind=0.4 * n.wind,
        wind_speed=1.0,
        wind_share=n.wind_share**0.25,
        wind_height=between(n.wind_height, 0.7, 1.0),
    )


def place_in(n: Numbers, how: How) -> FieldLayer:
    """A place of the field from which no setpoint leads out of it, and the greatest wind there."""
    b = opened(Path(how.field)).field.bounds
    low = np.array([b[0] + ASIDE_M, b[2] + ASIDE_M, b[4] + BELOW_M])
    high = np.array([b[1] - ASIDE_M, b[3] - ASIDE_M, b[5] - ASIDE_M])
    at = low + np.array([n.wind_share, n.wind_azimuth, n.wind_height]) * (high - low)
    greatest = ends(n.wind_speed, 0.0, WIND_M_S if how.as_shipped else wind_of(n))
    return FieldLayer(str(how.field), (at[0], at[1], at[2]), scale=max(greatest, 1e-3))


def attack(n: Numbers, how: How) -> Attack | None:
    """The flight that the numbers make; None if a vehicle would refuse its gains, or `gcs envelope` would
    say of hover that they are not certain there, whatever noise there is (`flies_there`).
    """
    kind, drawn_as = one_of(n.setpoints, SETPOINTS), n
    if kind == "descent":
        n = lifted(n)
    in_field = n
    if how.field:
        n = n._replace(wind=0.0, wind_speed=0.0)  # no wind of its own
    given = tables(n, how)
    scene = scenario(from_tables("drawn", given))
    if how.field:
        scene = replace(scene, layers=Layers(field=place_in(in_field, how)))
    law = scene.law
    if unstable(law, scene.guard) or not (how.as_shipped or flies_there(scene)):
        return None
    times, setpoints = sent(n, kind, law)
    farthest = max(math.dist(s.r_c, (0.0, 0.0, 0.0)) for s in setpoints)
    far = farthest if kind == "descent" else 2.0 * farthest
    ticks = np.round(np.array(times) * scene.rate_hz).astype(np.int64)
    duration_s = times[-1] + settles_s(scene.guard, law, far) + MORE_S
    scene = replace(
        scene,
        ticks=round(duration_s * scene.rate_hz),
        sent_at=ticks,
        sent=tuple(setpoints),
    )
    return Attack(
        numbers=drawn_as,
        tables=given,
        scene=scene,
        gust=gust_of(n, WIND_M_S if how.as_shipped else wind_of(n)),
        noise=noise_of(scene, how.noise),
        setpoints=kind,
        wind="field" if how.field else one_of(n.wind, KINDS),
    )


def sampled_attack(seed: int, number: int, how: How) -> Attack:
    """Flight `number` of a seed: the first draw whose gains are stable. Raises NoFlightError."""
    random = np.random.default_rng([seed, number])
    for _ in range(TRIES):
        found = attack(Numbers(*random.uniform(size=len(Numbers._fields)).tolist()), how)
        if found is not None:
            return found
    raise NoFlightError(f"flight {number}: {TRIES} draws, none with stable gains")
