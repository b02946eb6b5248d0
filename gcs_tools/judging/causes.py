"""Why a flight saturated or ended before its time, in sentences, and which command says more.

Which failsafe kept it from its setpoints; which limit of the actuators, since when and for how long; the wind and the mass of the truth against
what the guard believes in; and whether the guard held it back on its way to a setpoint that it missed.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from typing import Any

import numpy as np

from fcu.interface.files.input_file import written
from gcs_tools.judging.failsafes import Failsafe
from gcs_tools.judging.metrics import EngagedTicks, blocks, is_up
from gcs_tools.judging.setpoint_checks import Standing
from gcs_tools.missions.flight_table import Flight
from gcs_tools.missions.mission import Mission, Value, is_foreseen
from gcs_tools.missions.trajectory import last_change_s, positions_at
from gcs_tools.recording.table import Rows

ALLOCATED = (
    "torque",
    "yaw",
)  # limits of the allocation: of these alone a flight that passes is not told
_LIMITS = {
    "thrust": "the thrust command",
    "tilt": "the tilt command",
    "torque": "the torque about roll and pitch",
    "yaw": "the torque about yaw",
}
FOLLOWS_M = 5.0  # from its reference model: so near a vehicle follows its setpoint
EARLY = ("diverged", "crashed")  # endings
LITTLE = 0.01  # of the ticks that a setpoint stands: so few are no cause
_FOUND_S = 0.5  # before a failsafe acts its cause may have begun
_APART_S = 0.5  # ticks at a limit that are no farther apart are one stretch


def causes(
    mission: Mission, flight: EngagedTicks, ended: str, passed: bool, values: Mapping[str, Value],
    missed: Standing | None = None, keeper: Failsafe | None = None,
) -> list[str]:  # fmt: skip
    """Sentences. None of a flight that ended in time, saturated next to nothing and missed no setpoint.

    The first names a number that was not finite, if the law computed one.
    flight : all of it.  ended : how.  passed : whether its expectations are met.  values : in force.
    missed : the setpoint that was missed by most.  keeper : the failsafe that kept the vehicle from its
    setpoints. It is told first, and what followed from it is left out.
    """
    stays_up = [] if passed else _not_landed(mission, flight, ended)
    if not len(flight.t):
        return stays_up
    broken = flight.first_not_finite()
    is_kept = keeper is not None and (missed is None or missed.until_s > keeper.time_s)
    slowed = [] if missed is None or ended in EARLY or is_kept else _slowed(mission, flight, missed)
    return (
        ([] if broken is None else [str(broken)])
        + ([] if keeper is None else [_kept(keeper)])
        + slowed
        + ([] if keeper is not None else _not_arrived(mission, flight, ended))
        + stays_up
        + _fell(mission, flight, ended)
        + _limits_and_ending(mission, flight, ended, passed, values, keeper)
    )


def _kept(keeper: Failsafe) -> str:
    """Name the failsafe that kept the vehicle from its setpoints."""
    return (
        f"The failsafe {keeper.name} acted at {keeper.time_s:.2f} s ({keeper.action}): from then on the vehicle"
        " did not fly to its setpoints."
    )


def _fell(mission: Mission, flight: EngagedTicks, ended: str) -> list[str]:
    """Tell when and where rotors were stopped in the air."""
    if ended != "fell":
        return []
    height = float(flight.plant["state.r_E"][-1, 2]) - mission.flight.ground_z_m
    when = f"at {flight.t[-1]:.2f} s and a height of {height:.3g} m"
    return [f"The rotors were stopped in flight, {when}."]


def _not_arrived(mission: Mission, flight: EngagedTicks, ended: str) -> list[str]:
    """Where a vehicle was that should have arrived and did not in the time there was."""
    arrive = mission.flight.arrive
    if arrive is None or ended != "time" or mission.expectations().get("ended") != "arrived":
        return []
    there = positions_at(mission.flight, flight.t[-1:])[0]
    last = flight.plant["state.r_E"][flight.t >= last_change_s(mission.flight)]
    if not len(last):
        return ["The vehicle had not arrived: it flew no longer when the last setpoint was sent."]
    away = np.linalg.norm(last - there, axis=1)
    return [
        f"The vehicle had not arrived when the time was over: it was {away[-1]:.3g} m from the last"
        f" setpoint, at the nearest {away.min():.3g} m (flight.arrive: within {arrive.within_m:g} m for"
        f" {arrive.for_s:g} s)."
    ]


def _not_landed(mission: Mission, flight: EngagedTicks, ended: str) -> list[str]:
    """Name the place of a vehicle that a script should have landed and did not."""
    if mission.flight.script is None or ended != "script":
        return []
    if flight.is_grounded.all():
        return ["The vehicle never left the ground."]
    height = flight.plant["state.r_E"][-1, 2] - mission.flight.ground_z_m
    where = (
        "on the ground, and armed" if flight.is_grounded[-1] else f"at a height of {height:.3g} m"
    )
    return [f"The vehicle was {where} when the flight was over: a script has to land it."]


def _slowed(mission: Mission, flight: EngagedTicks, missed: Standing) -> list[str]:
    """That the guard held the vehicle back on its way to a setpoint that it did not reach."""
    part = flight.metric("governed_fraction", missed.since_s, missed.until_s)
    if part is None or part < LITTLE or missed.grounded:
        return []
    look = f" How long it may take: {envelope_command(mission)}" if is_foreseen(mission) else ""
    return [
        f"The guard slowed the flight to the setpoint of {missed.since_s:g} s for {100.0 * part:.0f} % of the"
        f" time that it stood.{look}"
    ]


def _limits_and_ending(
    mission: Mission, flight: EngagedTicks, ended: str, passed: bool, values: Mapping[str, Value],
    keeper: Failsafe | None,
) -> list[str]:  # fmt: skip
    looked_at = ~flight.is_grounded
    if keeper is not None:
        looked_at &= flight.t < keeper.time_s - _FOUND_S
    limited = {}
    for name in _LIMITS:
        if (column := f"outputs.saturation.{name}") in flight.fcu:
            up = is_up(flight.fcu, column)
            up &= looked_at
            if up.any():
                limited[name] = up
    early = ended in EARLY
    if not early and (not limited or (passed and set(limited) <= set(ALLOCATED))):
        return []
    if ended == "diverged" and not limited and (far := _beyond(mission.flight, flight)):
        return [far]
    found = [_ending(mission.flight, flight, ended)] if early else []
    if keeper is not None and not limited:
        return found
    if limited:
        end = "until the rotors stopped" if ended == "fell" else "to the end"
        each = "; ".join(_stretch(_LIMITS[name], flight.t, on, end) for name, on in limited.items())
        found.append(f"At a limit: {each}.")
    found.append(_air(flight, values))
    found += _mass(flight, values)
    if mission.flown.guard is not None and not mission.controller and is_foreseen(mission):
        found.append(f"What uses up the margin: {envelope_command(mission)}")
    return found


def envelope_command(mission: Mission) -> str:
    """The command that looks at what was flown."""
    changed = []
    for path, option in mission.changed.items():
        value: Any = mission.given
        for key in path:
            value = value[key]
        if option == "--airframe":
            changed.append(f"--airframe {shlex.quote(str(value))}")
        elif path[0] != "expect":
            changed.append(f"--set {shlex.quote('.'.join(map(str, path)) + '=' + written(value))}")
    return " ".join(["gcs envelope", shlex.quote(mission.source), *changed])


def _ending(asked: Flight, flight: EngagedTicks, ended: str) -> str:
    """When and where it was over."""
    r, over_s = flight.plant["state.r_E"], float(flight.t[-1])
    if ended == "crashed":
        return f"The vehicle hit the ground, or lay on its side there, at {over_s:.2f} s."
    with np.errstate(over="ignore", invalid="ignore"):
        away = float(np.linalg.norm(r[-1] - r[0]))
    if far := _beyond(asked, flight):
        return far
    where = f"{away:.3g} m from its start" if math.isfinite(away) else "nowhere: not a number"
    return (
        f"The flight diverged at {over_s:.2f} s: {where} (flight.arena_m is {asked.arena_m:g} m)."
    )


def _beyond(asked: Flight, flight: EngagedTicks) -> str:
    """Of a flight that passed the end of its arena, while the vehicle did as it was told; else empty."""
    if asked.items:  # all of them lie within it
        return ""
    start, over_s = flight.plant["state.r_E"][0], float(flight.t[-1])
    far = float(np.linalg.norm(positions_at(asked, flight.t[-1:])[0] - start))
    if far <= asked.arena_m or not flight.reference_error[-1] <= FOLLOWS_M:
        return ""
    return (
        f"The flight ended as diverged at {over_s:.2f} s, since it left its arena: the vehicle followed its"
        f" setpoint, {far:.4g} m from the start, and flight.arena_m is {asked.arena_m:g} m. To fly there,"
        f" raise it: --set flight.arena_m={_above(far):g}"
    )


def _above(far: float) -> float:
    """A round number (m) with a tenth to spare."""
    step = 10.0 ** (math.floor(math.log10(far)) - 1)
    return math.ceil(1.1 * far / step) * step


def _stretch(what: str, t: Rows, on: Any, end: str) -> str:
    """The first and the last time at which a limit was met, and in what part of the flight it was.

    end : words for a stretch that ends with the last tick.
    """
    times = t[on]
    parts = [f"first at {times[0]:.2f} s", f"last at {times[-1]:.2f} s"]
    if times[0] == times[-1]:
        parts = [f"at {times[0]:.2f} s"]
    gaps = np.flatnonzero(np.diff(times) > _APART_S)
    since = float(times[gaps[-1] + 1] if len(gaps) else times[0])
    if t[-1] - times[-1] <= _APART_S and since < times[-1]:
        parts = ["" if since == times[0] else parts[0], f"from {since:.2f} s {end}"]
    part = 100.0 * float(np.mean(on))
    share = f"{part:.0f} %" if part >= 1.0 else "below 1 %"
    return f"{what} {', '.join(filter(None, parts))} ({share} of the flight)"


def _air(flight: EngagedTicks, values: Mapping[str, Value]) -> str:
    greatest, rate = _greatest_air(flight)
    believed = values.get("law.guard_wind_m_s")
    if believed is None:
        return f"The wind reached {greatest:.1f} m/s."
    within = "within" if greatest <= believed.value else "more than"
    text = f"The wind reached {greatest:.1f} m/s, {within} the {believed.value:.3g} m/s believed"
    rate_believed = values["law.guard_wind_rate_m_s2"].value
    if rate > rate_believed:
        text += f"; it changed by up to {rate:.3g} m/s^2 ({rate_believed:.3g} believed)"
    return f"{text} (law.guard_wind_m_s)."


def _greatest_air(flight: EngagedTicks) -> tuple[float, float]:
    """Return the greatest speed (m/s) of the air, and of its change (m/s^2)."""
    greatest, step, dt = 0.0, 0.0, 1.0
    for block in blocks(len(flight.t)):
        ticks = slice(max(block.start - 1, 0), block.stop)  # and the one before them
        v_air = flight.plant.take(ticks)["v_air_E"]
        greatest = max(greatest, float(np.sqrt((v_air * v_air).sum(axis=1)).max()))
        changes = np.linalg.norm(np.diff(v_air, axis=0), axis=1)
        step = max(step, float(changes.max(initial=0.0)))
        dt = float(np.diff(flight.t[ticks]).min(initial=dt))
    return greatest, step / dt


def _mass(flight: EngagedTicks, values: Mapping[str, Value]) -> list[str]:
    believed = values.get("law.guard_mass_kg")
    if believed is None:
        return []
    least, most = believed.value
    m = [part.plant["m"] for part in flight.parts()]
    ends = min(float(of.min()) for of in m), max(float(of.max()) for of in m)
    off = [value for value in ends if not least <= value <= most]
    if not off:
        return []
    return [
        f"The mass was {off[0]:g} kg; {least:g} to {most:g} kg are believed (law.guard_mass_kg)."
    ]
