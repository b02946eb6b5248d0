"""What is counted of a flight. The definitions stand in the README, and were written before flying."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from fcu.guard import admission, arrival, margin, noise, wrench
from fcu.guard.parameters import REFUSE
from fcu.kernel.algebra import Vec3
from fcu.kernel.rows import column
from fcu.process.tick import Tick
from gcs_tools.flight.scenario import Scenario
from gcs_tools.gusts import worst_wind
from gcs_tools.gusts.limits import outputs, torque_room
from gcs_tools.studies.attack.draws import Attack
from gcs_tools.studies.attack.flight import AttackFlown, Rows
from sitl_plant.physics.types import PlantRecord

LOST_M = 50.0  # from the setpoint in force when the flight ends
LAST_S = 1.0  # so long it stays there

DEFINITIONS = """
transient: until the control difference of take-over has faded (foreseen.transient_s), 0.5 s at least.
force: after it the thrust or tilt flag is up, or the demanded force is beyond what can be reached.
torque: after it the flag of roll and pitch torque is up.  saturated: force or torque.
lost: the flight ended early, or ends more than 50 m from the setpoint in force.
arrived: within 0.3 m of that setpoint for the whole last second.
late: farther than 0.3 m from it at any time after that which the guard states when it is accepted.
yaw: after the transient the flag of yaw torque is up; counted, and contradicts nothing.
told: a sign against a belief is up at any time (guard.contradicted); counted as well.
m z: the control difference over what (30) and noise allow for it, at most; contradicts nothing by itself.
A flight contradicts the guard if it is saturated, lost or late, or has not arrived.
"""

Flags = np.ndarray[Any, np.dtype[np.bool_]]


class VerdictLimits(NamedTuple):
    """At each tick: which limits are met, and how far the others are."""

    force: Flags  # thrust or tilt at a limit, or the demand beyond them
    torque: Flags  # roll and pitch torque given up, or thrust for it
    yaw: Flags
    margin: Rows  # N, from the demanded force to the nearest limit
    room: Rows  # N, of total thrust, before roll and pitch torque meet a rotor's limit


class Verdict(NamedTuple):
    """What came of one flight."""

    setpoints: str
    wind: str
    force: bool
    torque: bool
    yaw: bool
    lost: bool
    arrived: bool
    margin_n: float  # least after the transient
    room_n: float  # least after the transient
    rotors: float  # part of the ticks after the transient with torque or yaw given up
    difference: float  # the control difference m z, over what the guard allows for it, at most
    admitted: float  # part of the setpoints
    end_m: float  # from the setpoint in force, at the end
    first_s: float | None  # when it first saturates
    told: bool  # whether anything seems not as believed
    took: float  # from the last setpoint until it stays within 0.3 m, over the time that is stated
    held: bool  # hover has room for a gust and the noise that is believed
    chance: float  # at most so probable it is that white noise as believed saturates; 1 if not held

    @property
    def contradicts(self) -> bool:
        """Whether this flight contradicts the guard."""
        return self.saturated or self.lost or self.late or not self.arrived

    @property
    def late(self) -> bool:
        """Whether it took longer than the guard states."""
        return self.took > 1.0

    @property
    def saturated(self) -> bool:
        """Force or torque."""
        return self.force or self.torque

    @property
    def least_n(self) -> float:
        """What an attack wants to have least, N."""
        return min(self.margin_n, self.room_n)


def transient_s(scene: Scenario) -> float:
    """How long (s) after take-over a flight is not judged."""
    return worst_wind.transient_s(scene)


def held(scene: Scenario) -> bool:
    """Whether hover leaves the force and the torque that gust and noise take, as they are believed."""
    still, (law, guard) = Vec3(0.0, 0.0, 0.0), scene.settings
    force = margin.condition(margin.known(guard, law), still, still, 0.0)
    return bool(force >= 0.0 and wrench.spare(guard, law) >= 0.0)


def chance(scene: Scenario) -> float:
    """At most so probable it is that a flight's noise goes beyond what is kept for it."""
    if not noise.amounts(scene.guard).any():
        return 0.0
    if not held(scene):
        return 1.0
    white = scene.guard.gaussian > 0.5
    return noise.probability(scene.law, scene.ticks / scene.rate_hz) if white else 0.0


def room(scene: Scenario, rows: Rows) -> Rows:
    """float64[n]: by how much (N) total thrust may move before roll and pitch take it from a rotor.

    Below zero the allocation has moved it, or has given up torque (`allocation.allocate`).
    """
    return torque_room(scene, outputs(rows))


def limits(scene: Scenario, rows: Rows) -> VerdictLimits:
    """Of rows of a law's Tick."""
    up = {
        of: column(Tick, rows, f"outputs.saturation.{of}") > 0.5
        for of in ("thrust", "tilt", "torque", "yaw")
    }
    margin = column(Tick, rows, "guard.margin.force")
    return VerdictLimits(
        force=up["thrust"] | up["tilt"] | (margin < 0.0) | ~np.isfinite(margin),
        torque=up["torque"],
        yaw=up["yaw"],
        margin=margin,
        room=room(scene, rows),
    )


def difference(scene: Scenario, flown: AttackFlown) -> Rows:
    """float64[n]: |m z| over what the guard allows for it, (30) and noise.

    m z is the force that the law demands, less the one that it would demand with the true mass and drag:
    T_0 - m (f_c + s_v_hat) + f_D.  s_v_hat is that of the tick before, with which the demand was made.
    """
    rows, (law, guard) = flown.fcu, scene.settings
    s_v_hat = column(Tick, rows, "state.estimates.s_v_hat")
    f_c = column(Tick, rows, "internals.demand.f_c") + np.concatenate([s_v_hat[:1], s_v_hat[:-1]])
    m, f_D = (column(PlantRecord, flown.plant, name) for name in ("m", "f_D_E"))
    m_z = column(Tick, rows, "internals.demand.T_0") - m[:, None] * f_c + f_D
    known = margin.known(guard, law)
    speed = np.linalg.norm(column(Tick, rows, "measured.v_E"), axis=1)
    left = sum(column(Tick, rows, f"guard_state.{name}") for name in margin.Doubted._fields)
    allowed = left + known.z_0 + known.z_1 * speed + known.noise
    return np.asarray(np.linalg.norm(m_z, axis=1) / allowed)


def away(rows: Rows) -> Rows:
    """float64[n]: from the setpoint in force, carried along its velocity, m."""
    off = column(Tick, rows, "measured.r_E") - column(Tick, rows, "setpoint.r_c")
    return np.asarray(np.linalg.norm(off, axis=1))


def took(attack: Attack, flown: AttackFlown) -> float:
    """From the last setpoint accepted until the vehicle stays near it, over what the guard states."""
    scene, rows = attack.scene, flown.fcu
    accepted = np.flatnonzero(flown.admitted > 0.5)
    k = int(scene.sent_at[accepted[-1]]) if len(accepted) else 0
    if k >= len(rows):
        return np.inf
    before = max(k - 1, 0)
    off = column(Tick, rows, "setpoint.r_c")[k] - column(Tick, rows, "outputs.reference.r_m")[k]
    behind = column(Tick, rows, "setpoint.v_c")[k] - column(Tick, rows, "outputs.reference.v_m")[k]
    a_m = column(Tick, rows, "guard_state.a_m")[before]
    moves = column(Tick, rows, "setpoint.v_c")[k]
    if scene.guard.policy == REFUSE:
        stated = _looked_s(attack, rows, k, accepted[-1] if len(accepted) else 0)
    else:
        stated = _stated_s(scene, off, behind, a_m, moves)
    outside = np.flatnonzero(away(rows[k:]) >= arrival.ARRIVED_M)
    if not len(outside):
        return 0.0
    return float((outside[-1] + 1) / scene.rate_hz / stated)


def _looked_s(attack: Attack, rows: Rows, k: int, accepted: int) -> float:
    """The time (s) that the look ahead at a setpoint, accepted at tick k, sees it reached in."""
    scene, before = attack.scene, max(k - 1, 0)
    begins = np.concatenate([
        column(Tick, rows, "outputs.reference.r_m")[before],
        column(Tick, rows, "outputs.reference.v_m")[before],
        column(Tick, rows, "guard_state.a_m")[before],
    ])  # fmt: skip
    look = admission.Look(scene.guard, scene.law)
    return look.tightest([(scene.sent[accepted], math.inf)], begins).arrives


def _stated_s(scene: Scenario, off: Rows, behind: Rows, a_m: Rows, moves: Rows) -> float:
    """The time (s) that is stated for a way that is governed."""
    far, speed, acceleration, fast = (
        float(np.linalg.norm(each)) for each in (off, behind, a_m, moves)
    )
    return float(
        arrival.at_most_s(
            scene.guard, scene.law, far, speed, acceleration, fast, -off[2], -moves[2]
        )
    )


def verdict(attack: Attack, flown: AttackFlown, from_s: float | None = None) -> Verdict:
    """What came of a flight.  from_s : judged from then on (s); None: after the transient."""
    scene, rows = attack.scene, flown.fcu
    begun = round((transient_s(scene) if from_s is None else from_s) * scene.rate_hz)
    met = limits(scene, rows[begun:])
    whole = len(rows) == scene.ticks
    last = away(rows[-round(LAST_S * scene.rate_hz) :])
    end_m = float(last[-1]) if len(last) else 0.0
    saturated = np.flatnonzero(met.force | met.torque)
    return Verdict(
        setpoints=attack.setpoints,
        wind=attack.wind,
        force=bool(met.force.any()),
        torque=bool(met.torque.any()),
        yaw=bool(met.yaw.any()),
        lost=not whole or not end_m <= LOST_M,
        arrived=whole and bool((last < arrival.ARRIVED_M).all()),
        margin_n=least(met.margin),
        room_n=least(met.room),
        rotors=float((met.torque | met.yaw).mean()) if len(met.yaw) else 1.0,
        difference=float(difference(scene, flown)[begun:].max(initial=0.0)),
        admitted=float(flown.admitted.mean()),
        end_m=end_m,
        first_s=float((begun + saturated[0]) / scene.rate_hz) if len(saturated) else None,
        told=bool((column(Tick, rows, "guard.contradicted") > 0.5).any()),
        took=took(attack, flown),
        held=held(scene),
        chance=chance(scene),
    )


def least(values: Rows) -> float:
    """The least of them; none is the worst there can be."""
    found = float(values.min()) if len(values) else -np.inf
    return found if np.isfinite(found) else -np.inf
