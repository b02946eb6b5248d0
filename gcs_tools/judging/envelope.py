"""What the condition says of a mission before it flies: margin, limits, what eats it, what helps.

Three conditions, from strong to weak: the exact set of what the actuators reach, along the way
that the reference model lays down (what the guard uses: fcu/guard/README.md, "The condition and the
guard"); the largest ball about hover; and the paper's (31), with the origin at the target. Each is
sufficient: that one fails predicts nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fcu.guard import admission, arrival, foreseen, margin, noise, wrench
from fcu.guard.hover import Air, ball_budget, theorem_budget
from fcu.guard.parameters import GOVERN, REFUSE, WARN
from fcu.guard.stability import LAGS, rotor_lag, unstable
from fcu.interface.files.input_file import written
from fcu.interface.messages import Setpoint
from fcu.interface.parameter import ParameterError
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import to_buffer
from fcu.process.settings import PARAMETERS, Settings, derived
from gcs_tools.flight.scenario import Scenario, scenario
from gcs_tools.judging.layers_check import layers_wind
from gcs_tools.judging.preflight_check import Unflyable, looks, refusal, unflyable
from gcs_tools.judging.uncovered import NOISES, MissionWind, Uncovered, is_plans, uncovered
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.mission import Mission, setpoint_at
from gcs_tools.missions.timeline import timeline

Rows = np.ndarray[Any, np.dtype[np.float64]]

LOOK_S = 0.005  # step of the look ahead
MOST, CLOSE = 1e3, 1e-3  # of a search: the largest value, and its relative accuracy
SMALLER = 0.98  # what is tried next of a value that almost would do
SLOWEST_M_S = 0.1  # that a guard is taken to fly
STILL = Vec3(0.0, 0.0, 0.0)
WAYS = {"up": (0.0, 0.0, 1.0), "to the side": (1.0, 0.0, 0.0), "down": (0.0, 0.0, -1.0)}


class Terms(NamedTuple):
    """What the room in hover goes to, N; what is left is the margin of the condition."""

    hover: float  # from hover to the nearest limit, of the worse mass
    acceleration: float  # what the way demands
    speed: float  # drag of the vehicle's own speed, and what it adds to the wind's
    wind: float  # drag of the greatest wind, in hover
    learning: float  # the control difference that lasts: estimates that lag behind the wind
    tracking: float  # what closing the error that they leave adds
    doubt: float  # a change of the demand, made with a mass that is not known
    noise: float  # what noise of the measurement takes
    steering: float  # what a tilt needs to steer in a wind from below

    @property
    def left(self) -> float:
        """The margin."""
        return self.hover - sum(self[1:])

    @property
    def largest(self) -> str:
        """Name of the term that takes most."""
        return max(self._fields[1:], key=lambda name: float(getattr(self, name)))


@dataclass(frozen=True)
class Reach:
    """The largest of something, by each condition; None where a condition has nothing to say."""

    what: str
    unit: str
    exact: float
    ball: float | None = None
    theorem: float | None = None


@dataclass(frozen=True)
class Change:
    """One change with which the condition would hold for the mission as it stands otherwise."""

    what: str
    now: float
    would_do: float | None  # None: no value of it alone would
    unit: str
    settings: tuple[
        str, ...
    ] = ()  # with which it is made, as --set takes them; none: no value would


@dataclass(frozen=True)
class Arrival:
    """How long the way to a setpoint takes at most, from rest at the one before it, while beliefs hold."""

    at_s: float
    position_m: Vec3
    stands_s: float  # until the next one, or the end
    within_s: float | None  # of arrival.ARRIVED_M; None: not stated


@dataclass(frozen=True)
class PlanMargin:
    """The least margin on the way to an item of a plan, as the vehicle looks at it before it takes the plan."""

    item: int  # from 0
    command: str
    margin_n: float
    at_s: float  # from the begin of the plan, without holds
    acceleration: Vec3  # m/s^2, E, that is demanded there
    velocity: Vec3  # m/s, E


@dataclass(frozen=True)
class Belief:
    """Something that is believed, while which the condition means what it says."""

    what: str
    value: str  # as a person writes it
    unit: str
    key: str  # of the parameter, or of the airframe file


@dataclass(frozen=True)
class Noise:
    """What noise takes of the torque about a level axis, in hover of the mass that lacks it most."""

    there_n_m: float  # that hover leaves
    gust_n_m: float  # what a gust takes, and the least jerk
    noise_n_m: float
    left_n_m: float
    force_n: float  # what it takes of the force
    per_hour: float | None  # at most so probable it is that it saturates; None: it is not white
    lack: str  # which belief takes most, and what would do; empty: nothing lacks


@dataclass(frozen=True)
class Envelope:
    """What is known of a mission before it flies."""

    mission: str
    title: str
    guard: str
    holds: bool
    margin_n: float  # least along the mission's way
    at_s: float
    terms: Terms
    reach: tuple[Reach, ...]
    changes: tuple[Change, ...]
    transient_s: float  # after take-over; the condition does not count it
    arrives_s: (
        float | None
    )  # from rest at its first setpoint at most; None: no way to go, or no guard
    unstated: str  # why no arrival is stated, where the guard would else state one; empty: it is
    arrivals: tuple[Arrival, ...]  # of setpoints that stand still, where the guard governs
    can_be_governed: bool  # by a guard that is told to
    governed: bool  # the guard will govern what does not fit, and hover has room to
    refused: str  # the setpoint that the vehicle would refuse, as `gcs fly` says it; empty: none
    unstable: (
        str  # the channel that is unstable with the gains, which a vehicle refuses; empty: none
    )
    remarks: tuple[str, ...]  # sentences of what is not covered
    uncovered: tuple[Uncovered, ...]  # the same as rows: name, numbers, what to do
    unflyable: tuple[Unflyable, ...]  # setpoints that cannot be flown as written
    beliefs: tuple[Belief, ...]
    noise: Noise | None  # None: none is believed
    plan: tuple[PlanMargin, ...] = ()  # of each item of a plan to which the vehicle flies
    wind_within: str = (
        ""  # that the wind of a mission with layers is believed; empty: it is not, or it has none
    )

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            **asdict(self), "terms": {**self.terms._asdict(), "left": self.terms.left},
            "uncovered": [each._asdict() for each in self.uncovered],
        }  # fmt: skip


def terms(settings: Settings, a: Vec3, v: Vec3, left: float) -> Terms:
    """Where the room goes at acceleration a (m/s^2, E) and velocity v (m/s, E), with `left` (N) left.

    What is not accounted for otherwise is a mass that is not known; or, where that is what ends first,
    tilts that steer.
    """
    known = margin.known(settings.guard, settings.law)
    f_v = margin.dragging(known, v)
    hover, moved = margin.room(known, STILL, STILL), margin.room(known, a, STILL)
    wind = known.c_D * known.w_max**2
    learning = margin.difference(known, math.hypot(*v))
    own = moved - margin.room(known, a, f_v) + margin.allowance(known, v, 0.0) - learning - wind
    own = own - known.noise
    tracking = foreseen.closed(settings.law) * learning
    spent = (hover - moved) + own + wind + learning + tracking + known.noise
    rest = hover - spent - left
    steers = left < float(margin.steering(known, v)) - 1e-9
    doubt, steering = (rest, 0.0) if steers else (0.0, rest)
    return Terms(hover, hover - moved, own, wind, learning, tracking, doubt, known.noise, steering)


def way(scene: Scenario, settings: Settings | None = None, scale: float = 1.0) -> Rows:
    """The mission's way, ungoverned: rows of `foreseen.along`. `scale`: of its setpoints."""
    guard, law = (settings or scene.settings).guard, (settings or scene.settings).law
    start = scene.begin
    sent = np.array([to_buffer(_scaled(s, start.r_E, scale)) for s in scene.sent])
    rows = np.empty((math.ceil(scene.planned_ticks * scene.period_us * 1e-6 / LOOK_S), 8))
    foreseen.along(
        guard, law._replace(h=LOOK_S), scene.sent_at / scene.rate_hz, sent,
        start.r_E, start.v_E, rows,
    )  # fmt: skip
    return rows


def _along(scene: Scenario) -> tuple[Rows, Rows, Rows]:
    """Times (s, (n,)), places and velocities (m, m/s, (n, 3), E) of the mission's way, no faster than its guard flies it."""
    v = way(scene)[:, 5:8]
    places = np.array(scene.begin.r_E) + LOOK_S * np.cumsum(v, axis=0)
    slower = np.ones(len(v))
    if scene.guard.policy == GOVERN:
        most = max(speed(scene.settings, along, "").exact for along in WAYS.values())
        slower = np.maximum(np.linalg.norm(v, axis=1) / max(most, SLOWEST_M_S), 1.0)
    return LOOK_S * np.cumsum(slower), places, v / slower[:, None]


def tightest(
    scene: Scenario, settings: Settings | None = None, scale: float = 1.0
) -> admission.Tightest:
    """Where the mission's way holds the condition by least: as asked, or as a vehicle that refuses sees it.

    By that the first setpoint that it refuses: what comes after is another flight.
    settings : in place of its own.  scale : of its setpoints.
    """
    settings = settings or scene.settings
    if settings.guard.policy == REFUSE:
        start = scene.begin.r_E
        least = None
        for each in looks(scene, settings, lambda setpoint: _scaled(setpoint, start, scale)):
            point = each.tightest._replace(at=each.at_s + each.tightest.at)
            least = point if least is None or point.margin < least.margin else least
            if least.margin < 0.0:
                break
        assert least is not None  # a mission has a setpoint
        return least
    rows = way(scene, settings, scale)
    row = rows[rows[:, 1].argmin()].tolist()
    return admission.Tightest(row[1], row[0], Vec3(*row[2:5]), Vec3(*row[5:8]))


def _scaled(setpoint: Setpoint, start: Vec3, scale: float) -> Setpoint:
    if scale == 1.0:
        return setpoint
    return setpoint._replace(
        r_c=start + scale * (setpoint.r_c - start), v_c=scale * setpoint.v_c,
        a_c=scale * setpoint.a_c,
    )  # fmt: skip


def largest(holds: Callable[[float], bool], most: float = MOST) -> float | None:
    """The largest value from 0 to `most` for which something holds that holds below; None: for none."""
    if not holds(1e-6):
        return None
    low, high = 0.0, min(1.0, most)
    while holds(high):
        if high >= most:
            return most
        low, high = high, min(2.0 * high, most)
    while high - low > CLOSE * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def step(settings: Settings, along: tuple[float, float, float], what: str) -> Reach:
    """The largest step (m) from rest."""
    law, guard = settings
    coarse = law._replace(h=LOOK_S)
    air = Air(guard.w_max, guard.w_dot_max, guard.c_D)
    # the error of tracking, and of a jump with a mass not known: printed, (31) leaves both out
    lasting = margin.difference(margin.known(guard, law), 0.0)
    learning = lasting * (1.0 + float(foreseen.closed(law))) + guard.noise_force
    masses = (guard.m_min, guard.m_max)

    def exact(far: float) -> bool:
        there = Setpoint(Vec3(*(far * x for x in along)), STILL, STILL, 0.0, 0.0)
        return bool(foreseen.least(guard, coarse, there, STILL, STILL)[0] >= 0.0)

    def uncertain(far: float) -> float:
        return float(learning + margin.FORGOTTEN * guard.m_max * law.f_m**2 * far)

    def ball(far: float) -> bool:
        return all(ball_budget(law, m, air, far, uncertain(far)).holds for m in masses)

    def theorem(far: float) -> bool:
        return all(theorem_budget(law, m, air, far, uncertain(far)).holds for m in masses)

    # what tilts need to steer, on such a way, is in the exact set's alone: no other reaches farther
    most = largest(exact) or 0.0
    return Reach(
        what, "m", most, min(largest(ball) or 0.0, most), min(largest(theorem) or 0.0, most)
    )


def _steps_of(scene: Scenario) -> tuple[Reach, ...]:
    """The largest step the way of the mission's first, if it has one."""
    r, to = scene.begin.r_E, scene.sent[0].r_c
    jump = (to.x - r.x, to.y - r.y, to.z - r.z)
    far = math.hypot(*jump)
    if far < 0.05:
        return ()
    x, y, z = jump
    what = f"step the way of ({x:.3g}, {y:.3g}, {z:.3g})"
    return (step(scene.settings, (x / far, y / far, z / far), what),)


def speed(settings: Settings, along: tuple[float, float, float], what: str) -> Reach:
    """The largest steady speed (m/s)."""
    known = margin.known(settings.guard, settings.law)
    adds = float(foreseen.closed(settings.law))

    def exact(v: float) -> bool:
        more = adds * margin.difference(known, v)
        return bool(margin.condition(known, STILL, Vec3(*(v * x for x in along)), more) >= 0.0)

    def ball(v: float) -> bool:
        drag = known.c_D * (v + known.w_max) ** 2 + (1.0 + adds) * margin.difference(known, v)
        steers = margin.steering(known, Vec3(0.0, 0.0, -v)) >= 0.0
        return bool(drag + known.noise <= margin.room(known, STILL, STILL) and steers)

    return Reach(what, "m/s", largest(exact) or 0.0, largest(ball) or 0.0)


def with_guard(settings: Settings, **fields: float) -> Settings:
    """The settings with other beliefs."""
    return settings._replace(guard=settings.guard._replace(**fields))


def wind(settings: Settings) -> Reach:
    """The greatest wind (m/s) in which hover has room."""

    def exact(w: float) -> bool:
        known = margin.known(settings.guard._replace(w_max=w), settings.law)
        more = float(foreseen.closed(settings.law)) * margin.difference(known, 0.0)
        return bool(margin.condition(known, STILL, STILL, more) >= 0.0)

    most = largest(exact) or 0.0
    return Reach("wind, in hover", "m/s", most, most)  # of a point, the ball is the set


def changes(flight: Flight, scene: Scenario) -> tuple[Change, ...]:
    """What, changed alone, would make the condition hold for the mission."""
    settings, (law, guard) = scene.settings, scene.settings

    middle = 0.5 * (guard.m_min + guard.m_max)
    known = derived(with_guard(settings, m_min=middle, m_max=middle))

    def slower(f_m: float) -> Flown:
        return scene, derived(settings._replace(law=law._replace(f_m=max(f_m, 0.05)))), 1.0

    def most(changed: Callable[[float], Flown], now: float) -> float | None:
        """By the whole way, which is quick; what that finds has to hold for each look along it."""
        value = largest(lambda x: way(*changed(x))[:, 1].min() >= 0.0, now)
        while value and tightest(*changed(value)).margin < 0.0:
            value = SMALLER * value if value > CLOSE * now else None
        return value

    def change(what: str, now: float, would_do: float | None, unit: str, *keys: tuple[str, Any]) -> Change:  # fmt: skip
        made = () if would_do is None else tuple(f"{key}={written(value)}" for key, value in keys)
        return Change(what, now, would_do, unit, made)

    part = most(lambda k: (scene, settings, k), 1.0)
    f_m = most(slower, law.f_m)
    wind = most(lambda w: (scene, with_guard(settings, w_max=w), 1.0), guard.w_max)
    mass = 0.0 if tightest(scene, known).margin >= 0.0 else None
    found = (
        change("setpoint distances, factor", 1.0, part, "",
               *_nearer(flight, scene, math.floor(1000.0 * (part or 0.0)) / 1000.0)),
        change("f_m", law.f_m, f_m, "rad/s", ("law.f_m", f_m)),
        change("guard_wind_m_s", guard.w_max, wind, "m/s", ("law.guard_wind_m_s", wind)),
        change("width of guard_mass_kg", guard.m_max - guard.m_min, mass, "kg",
               ("law.guard_mass_kg", [middle, middle])),
    )  # fmt: skip
    curve = flight.curve
    if curve is None:
        return found
    pace = most(lambda k: (_paced(flight, scene, k), settings, 1.0), 1.0)
    key, now = "speed_max_m_s", curve.speed_max_m_s
    would_do = pace and now and pace * now
    unit = "m/s"
    if curve.period_s is not None:
        key, now, unit = "period_s", curve.period_s, "s"
        would_do = pace and now / pace
    assert now is not None  # the table has one of the two
    named = f"flight.curve.{key}"
    return (*found, change(named, now, would_do or None, unit, (named, would_do)))


Flown = tuple[Scenario, Settings, float]  # what is flown, by which settings, and its scale


def _nearer(flight: Flight, scene: Scenario, part: float) -> list[tuple[str, Any]]:
    """The keys of a mission, and their values, whose setpoints are nearer to the start; none of items.

    part : of their distances, and of the speed of those that move.
    """
    start = scene.world.start.r_E

    def moved(place: Iterable[float]) -> list[float]:
        return [round(r + part * (x - r), 6) for r, x in zip(start, place, strict=True)]

    if flight.items:  # when each begins depends on how far it is: not the same factor
        return []
    curve = flight.curve
    if curve is None:
        each = [[timed.at_s, *moved(timed.position_m)] for timed in flight.setpoints]
        return [("flight.setpoints", each)]
    found: list[tuple[str, Any]] = [
        ("flight.curve.size_m", [round(part * x, 6) for x in curve.size_m])
    ]
    if curve.speed_max_m_s is not None:
        found.append(("flight.curve.speed_max_m_s", round(part * curve.speed_max_m_s, 6)))
    if curve.centre_m != tuple(start):
        found.append(("flight.curve.centre_m", moved(curve.centre_m)))
    return found


def _paced(flight: Flight, scene: Scenario, pace: float) -> Scenario:
    """The same with its curve flown at `pace` of its speed, above 0."""
    assert flight.curve is not None
    speed, period = flight.curve.speed_max_m_s, flight.curve.period_s
    made = {"speed_max_m_s": speed and pace * speed, "period_s": period and period / pace}
    paced = flight.model_copy(update={"curve": flight.curve.model_copy(update=made)})
    times = (k / scene.rate_hz for k in scene.sent_at.tolist())
    return replace(scene, sent=tuple(setpoint_at(paced, t) for t in times))


def arrives_s(scene: Scenario) -> float | None:
    """From rest within 0.3 m of the first setpoint after at most so long (s), while the beliefs hold.

    None: there is no way to go, nobody governs it, or a wind as believed may keep it farther off.
    """
    law, guard = scene.settings
    far = math.dist(scene.begin.r_E, scene.sent[0].r_c)
    keeps = margin.condition(margin.known(guard, law), STILL, STILL, 0.0) > 0.0
    if far < arrival.ARRIVED_M or guard.policy == WARN or not keeps:
        return None
    if guard.policy == REFUSE:
        first = next(iter(looks(scene, scene.settings))).tightest
        return first.arrives if first.margin >= 0.0 and math.isfinite(first.arrives) else None
    speed = math.hypot(*scene.sent[0].v_c)
    down = scene.begin.r_E.z - scene.sent[0].r_c.z
    found = float(arrival.at_most_s(guard, law, far, speed, 0.0, speed, down, -scene.sent[0].v_c.z))
    return found if math.isfinite(found) else None


def unstated(scene: Scenario) -> str:
    """Why no arrival is stated, in a sentence; empty where one is, and where no guard states any.

    The tracking error that a wind as believed leaves grows as 1/f_m^2: large vehicles follow slowly,
    and arrival means the same distance for all.
    """
    law, guard = scene.settings
    keeps = margin.condition(margin.known(guard, law), STILL, STILL, 0.0) > 0.0
    off_m = float(arrival.off_at_most(guard, law))
    if guard.policy == WARN or not keeps or off_m < arrival.ARRIVED_M:
        return ""

    def is_near(w: float) -> bool:
        believed = derived(with_guard(scene.settings, w_max=w)).guard
        return float(arrival.off_at_most(believed, law)) < arrival.ARRIVED_M

    calm = math.floor(10.0 * (largest(is_near, guard.w_max) or 0.0)) / 10.0
    less = f"; with guard_wind_m_s {calm:g} it is stated" if calm > 0.0 else ""
    return (
        f"a wind as believed (guard_wind_m_s {guard.w_max:.3g}) may keep the vehicle {off_m:.2f} m off its"
        f" reference, and arrived means within {arrival.ARRIVED_M:g} m{less}"
    )


def arrivals(flight: Flight, scene: Scenario) -> tuple[Arrival, ...]:
    """Of each setpoint that stands still, where the guard governs and hover has room to."""
    law, guard = scene.settings
    keeps = margin.condition(margin.known(guard, law), STILL, STILL, 0.0) > 0.0
    if guard.policy != GOVERN or not keeps or flight.items:  # an item waits for its end
        return ()
    found, before = [], scene.begin.r_E
    for at_s, until_s, r, _ in timeline(flight).places():
        far, down = math.dist(before, r), before.z - r.z
        within = float(arrival.at_most_s(guard, law, far, 0.0, 0.0, 0.0, down, 0.0))
        stands_s = min(until_s, flight.duration_s) - at_s
        found.append(Arrival(at_s, r, stands_s, within if math.isfinite(within) else None))
        before = r
    return tuple(found)


def beliefs(mission: Mission, settings: Settings) -> tuple[Belief, ...]:
    """All that the guard counts on, as it stands."""
    guard, rotors, lag = settings.guard, settings.law.rotors, rotor_lag(settings.law)
    kind = "Gaussian, sigma" if guard.gaussian > 0.5 else "a bound"
    told = dict(zip(NOISES, noise.amounts(guard).tolist(), strict=True))
    return (
        Belief("mass", f"{guard.m_min:g} to {guard.m_max:g}", "kg", "guard_mass_kg"),
        Belief("inertia, level; yaw", f"{guard.J_tilt:g}; {guard.J_yaw:g}", "kg m^2",
               "vehicle.inertia_kg_m2"),
        Belief("thrust coefficient", _spread(rotors.c_T[: rotors.n]), "N/(rad/s)^2", "rotors.thrust_coefficient"),
        Belief("drag of any body axis", f"{guard.c_D:g}", "N/(m/s)^2", "guard_drag"),
        Belief("wind", f"{guard.w_max:g}", "m/s", "guard_wind_m_s"),
        Belief("its rate", f"{guard.w_dot_max:g}", "m/s^2", "guard_wind_rate_m_s2"),
        Belief("rotor lag", f"{LAGS[0] * lag:.3g} to {LAGS[1] * lag:.3g}", "s", "rotor_lag_s"),
        Belief("delay to the rotor", f"{guard.delay_s:g}", "s", "guard_delay_s"),
        Belief("amounts of noise are", kind, "", "guard_noise"),
        *(Belief(f"noise of {what}", f"{told[key]:.3g}", unit, key)
          for key, (what, unit) in NOISES.items()),
        Belief("control rate", f"{mission.flight.rate_hz:g}", "Hz", "flight.rate_hz"),
    )  # fmt: skip


def _spread(values: Sequence[float]) -> str:
    """One number, or the least and the greatest."""
    least, most = min(values), max(values)
    return f"{least:g}" if least == most else f"{least:g} to {most:g}"


_FIELDS = ("noise_r", "noise_v", "noise_q", "noise_w")


def fits(settings: Settings) -> bool:
    """Whether hover leaves the force and the torque that gust and noise take."""
    known = margin.known(settings.guard, settings.law)
    force = margin.condition(known, STILL, STILL, 0.0)
    return bool(force >= 0.0 and wrench.spare(settings.guard, settings.law) >= 0.0)


def noise_of(settings: Settings) -> Noise | None:
    """What the noise that is believed takes; None if none is, or of the printed law, not worked out."""
    law, guard = settings
    if not noise.amounts(guard).any() or law.achieved < 0.5:
        return None
    T = (
        min(
            (guard.m_min, guard.m_max),
            key=lambda m: wrench.spare(guard._replace(m_min=m, m_max=m), law),
        )
        * law.g
    )
    there, taken = float(wrench.tilting(guard, law.rotors, T)), float(wrench.disturbed(guard, T))
    left = float(wrench.spare(guard, law))
    held = fits(settings)
    white = guard.gaussian > 0.5
    return Noise(
        there_n_m=there,
        gust_n_m=there - taken - left,
        noise_n_m=taken,
        left_n_m=left,
        force_n=guard.noise_force,
        per_hour=noise.probability(law, 3600.0) if white and held else None,
        lack="" if held else lack(settings),
    )


def lack(settings: Settings) -> str:
    """Which belief takes most of what hover has for noise, how much of it, or which gain, would do."""
    law, guard = settings

    def alone(field: str) -> float:
        others = {name: 0.0 for name in _FIELDS if name != field}
        only = derived(settings._replace(guard=guard._replace(**others))).guard
        return float(wrench.disturbed(only, guard.m_min * law.g))

    field = max(_FIELDS, key=alone)
    key = list(NOISES)[_FIELDS.index(field)]
    now = float(getattr(guard, field))

    def smaller(amount: float) -> bool:
        return fits(derived(with_guard(settings, **{field: amount})))

    row = next(row for row in PARAMETERS if row.key == "gamma")

    def softer(gamma: float) -> bool:
        changed = derived(row.put(settings, (gamma,)))
        return fits(changed) and not unstable(changed.law, changed.guard)

    would = []
    if amount := largest(smaller, now):
        would.append(f"{key} {now:.3g} -> {amount:.2g}")
    lower = next((g for g in law.gamma * 0.9 ** np.arange(1, 40) if softer(float(g))), None)
    if lower is not None:
        would.append(f"gamma {law.gamma:g} -> {lower:.0f}")
    if not would:
        return f"{key} takes most; neither less of it nor a lower gamma is enough alone"
    return f"{key} takes most; enough is {' or '.join(would)}"


def mission_wind(mission: Mission, scene: Scenario) -> MissionWind:
    """The mission's own wind. Of layers that at the places of its way."""
    wind = mission.wind
    swing, rate = np.array(wind.amplitude_m_s), np.array(wind.frequency_rad_s)
    steady = np.abs(wind.steady_m_s) + np.abs(swing)
    most = float(np.linalg.norm(np.maximum(steady, steady + np.abs(wind.step_m_s))))
    fastest = float(np.linalg.norm(swing * rate))
    if wind.samples is not None:
        t, air = wind.samples[:, 0], wind.samples[:, 1:]
        most += float(np.linalg.norm(air, axis=1).max())
        changes = np.linalg.norm(np.diff(air, axis=0), axis=1) / np.diff(t)
        fastest += float(changes.max(initial=0.0))
    if scene.layers is None:
        return MissionWind(most, fastest, "")
    layers = layers_wind(mission, scene.layers, *_along(scene))
    said = f" along its way ({', '.join(layers.parts)})"
    return MissionWind(most + layers.speed_m_s, fastest + layers.rate_m_s2, said)


def within(of: MissionWind, scene: Scenario) -> str:
    """The sentence that the wind of a mission with layers is believed. Empty: it is not, or it has no layers."""
    guard = scene.guard
    if not of.of or of.speed_m_s > guard.w_max or of.rate_m_s2 > guard.w_dot_max:
        return ""
    return (
        f"its wind, up to {of.speed_m_s:.3g} m/s{of.of}, changing by up to {of.rate_m_s2:.3g} m/s^2, is within"
        f" guard_wind_m_s {guard.w_max:.3g} and guard_wind_rate_m_s2 {guard.w_dot_max:.3g}"
    )


def envelope(mission: Mission, plan: tuple[PlanMargin, ...] = ()) -> Envelope:
    """What the condition says of a mission.  plan : the margins along its plan, if it has one.

    Raises ParameterError and AirframeError as flying it does, and for a law without a condition.
    """
    if mission.flown.settings.Settings is not Settings:
        raise ParameterError(
            f"[law] module: {mission.flown.name}: expected mmrac, of which alone a condition is known"
        )
    scene = scenario(mission)
    law, guard = settings = scene.settings
    worst = tightest(scene)
    if plan:
        least = min(plan, key=lambda each: each.margin_n)
        if least.margin_n < worst.margin:
            worst = admission.Tightest(
                least.margin_n, least.at_s, least.acceleration, least.velocity
            )
    holds = worst.margin >= 0.0
    air = mission_wind(mission, scene)
    told = uncovered(mission, scene, settings, air)
    plans_alone = is_plans(tuple(leg.kind for leg in scene.legs))
    channel = unstable(law, guard)
    if channel and guard.delay_s > 0.0:
        channel += f" (with guard_delay_s {guard.delay_s:g})"
    known = margin.known(guard, law)
    at_rest = margin.condition(known, STILL, STILL, 0.0)
    return Envelope(
        mission=mission.name,
        title=mission.title,
        guard=("warn", "govern", "refuse")[int(guard.policy)],
        holds=holds and not channel,
        margin_n=worst.margin,
        at_s=worst.at,
        terms=terms(settings, worst.a_d, worst.v, worst.margin),
        reach=(
            *_steps_of(scene),
            *(step(settings, along, f"step {name}") for name, along in WAYS.items()),
            *(speed(settings, along, f"steady speed {name}") for name, along in WAYS.items()),
            wind(settings),
        ),
        changes=() if holds or plan else changes(mission.flight, scene),
        transient_s=float(foreseen.transient_s(guard, law)),
        arrives_s=arrives_s(scene),
        unstated=unstated(scene),
        arrivals=arrivals(mission.flight, scene),
        can_be_governed=bool(at_rest > 0.0 and law.achieved > 0.5 and guard.policy != GOVERN),
        governed=guard.policy == GOVERN and not (holds or channel) and bool(at_rest > 0.0),
        refused="" if plans_alone else refusal(scene),
        unstable=channel,
        remarks=tuple(each.said for each in told),
        uncovered=told,
        wind_within=within(air, scene),
        unflyable=() if plans_alone else unflyable(mission, scene),
        beliefs=beliefs(mission, settings),
        noise=noise_of(settings),
        plan=plan,
    )
