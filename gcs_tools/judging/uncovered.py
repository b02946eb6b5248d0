"""What the guard's condition does not cover of a mission: one row for each, in one table.

A row has a name, how it is found (with the numbers that show it), a sentence of these numbers, and what to do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, NamedTuple

from fcu.guard import foreseen, margin, noise, wrench
from fcu.guard.stability import LAGS, recovers, rotor_lag
from fcu.process.settings import Settings
from gcs_tools.flight.scenario import Scenario
from gcs_tools.judging.belief_check import inertias
from gcs_tools.missions.mission import Mission
from gcs_tools.missions.timeline import PLANS

TOLD_APART = 1.3  # greatest over least mass believed, for which the condition's constants are
NOISES = {  # key -> what it is of, unit
    "guard_noise_position_m": ("position", "m"),
    "guard_noise_velocity_m_s": ("velocity", "m/s"),
    "guard_noise_attitude_rad": ("attitude", "rad"),
    "guard_noise_rate_rad_s": ("body rates", "rad/s"),
}


class Uncovered(NamedTuple):
    """One thing that the condition does not cover."""

    name: str
    said: str  # a sentence without its full stop
    numbers: tuple[Any, ...]  # that the sentence has: what is so, and what is believed
    remedy: str  # what to do about it; empty: nothing in the mission does


class MissionWind(NamedTuple):
    """The mission's own wind: the greatest of all its parts at once."""

    speed_m_s: float
    rate_m_s2: float
    of: str  # of what it is made along the way; empty without layers


class Case:
    """A mission and its scene, with the numbers that rows look at."""

    def __init__(
        self, mission: Mission, scene: Scenario, settings: Settings, air: MissionWind
    ) -> None:
        self.mission, self.scene, self.air = mission, scene, air
        self.law, self.guard = settings

    @cached_property
    def is_noisy(self) -> bool:
        """Tell whether any noise is believed."""
        return bool(noise.amounts(self.guard).any())

    @cached_property
    def spare_n_m(self) -> float:
        """Torque of roll and pitch that hover leaves in the gusts that are believed."""
        return float(wrench.spare(self.guard, self.law))

    @cached_property
    def calm_n_m(self) -> float:
        """Torque that it leaves in no wind."""
        return float(wrench.spare(self.guard._replace(w_max=0.0), self.law))

    @cached_property
    def sinking_m_s(self) -> float:
        """By how much a wind from below may exceed the one believed."""
        return float(margin.sinking(margin.known(self.guard, self.law)))

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the mission's items."""
        return tuple(leg.kind for leg in self.scene.legs)


Numbers = tuple[Any, ...]


class Row(NamedTuple):
    """One row of the table."""

    name: str
    find: Callable[[Case], Iterable[Numbers]]  # the numbers of each; nothing: it is covered
    said: str  # formatted with them
    remedy: str = ""


def _if(found: bool, *numbers: Any) -> list[Numbers]:
    return [numbers] if found else []


def _noises(c: Case) -> Iterable[Numbers]:
    # of a spread, for it to be within a bound
    times, spread = (1.0, "a spread") if c.guard.gaussian > 0.5 else (noise.SIGMAS, "six times a spread")  # fmt: skip
    sizes = noise.amounts(c.guard).tolist()
    for (key, (what, unit)), has, told in zip(
        NOISES.items(), c.scene.world.noise, sizes, strict=True
    ):
        if times * has > told * (1.0 + 1e-6):
            yield what, spread, has, unit, key, told


ROWS = (
    Row("wind", lambda c: _if(c.air.speed_m_s > c.guard.w_max, c.air.speed_m_s, c.air.of, c.guard.w_max),
        "its wind, up to {0:.3g} m/s{1}, is beyond guard_wind_m_s {2:.3g}", "set law.guard_wind_m_s"),
    Row("wind_step", lambda c: _if(c.mission.wind.step_at_s is not None),
        "its wind steps, faster than any guard_wind_rate_m_s2"),
    Row("wind_rate", lambda c: _if(c.mission.wind.step_at_s is None and c.air.rate_m_s2 > c.guard.w_dot_max,
                                   c.air.rate_m_s2, c.guard.w_dot_max),
        "its wind, changing by up to {0:.3g} m/s^2, is beyond guard_wind_rate_m_s2 {1:.3g}", "set law.guard_wind_rate_m_s2"),
    Row("mass", lambda c: [(mass, c.guard.m_min, c.guard.m_max)
                           for mass in dict.fromkeys((c.scene.world.params.m, c.scene.world.params.m_after))
                           if not c.guard.m_min <= mass <= c.guard.m_max],
        "its mass, {0:.3g} kg, is not in guard_mass_kg [{1:.3g}, {2:.3g}]", "set law.guard_mass_kg"),
    Row("inertia", lambda c: [(said,) for said in inertias(c.mission)], "{0}"),
    Row("drag", lambda c: _if(max(c.scene.world.params.c_D) > c.guard.c_D, max(c.scene.world.params.c_D), c.guard.c_D),
        "its drag, {0:.3g} N/(m/s)^2, is beyond guard_drag {1:.3g}", "set law.guard_drag"),
    Row("noise", _noises, "its noise of {0}, {1} of {2:.3g} {3}, is beyond {4} {5:.3g}", "set law.guard_noise_..."),
    Row("delay", lambda c: _if(c.scene.world.delay_ticks / c.scene.rate_hz > c.guard.delay_s + 1e-9,
                               c.scene.world.delay_ticks / c.scene.rate_hz, c.guard.delay_s),
        "its delay, {0:.3g} s, is beyond guard_delay_s {1:.3g}", "set law.guard_delay_s"),
    Row("mass_range", lambda c: _if(c.guard.m_max > TOLD_APART * c.guard.m_min, c.guard.m_min, c.guard.m_max),
        "guard_mass_kg [{0:.3g}, {1:.3g}] is wider than the 30 % for which the condition is derived", "narrow law.guard_mass_kg"),
    Row("mass_bounds", lambda c: _if(c.scene.law.bounds.m_min > c.guard.m_min or c.scene.law.bounds.m_max < c.guard.m_max,
                                     c.scene.law.bounds.m_min, c.scene.law.bounds.m_max),
        "the mass estimate is kept in [{0:.3g}, {1:.3g}] kg, which does not hold all of guard_mass_kg"
        " (set bounds.m_min and bounds.m_max too)"),
    Row("rotor_loss", lambda c: _if(bool(c.mission.plant.rotor_loss)), "it loses a rotor, which no condition knows"),
    Row("faults", lambda c: _if(bool(c.mission.plant.faults)),
        "it has faults to order ([[plant.faults]]), which no condition knows"),
    Row("plan", lambda c: _if(is_plans(c.kinds)), "take-off, descent, jumps and returns of the plan are not looked at"),
    Row("items", lambda c: _if(bool(c.kinds) and not is_plans(c.kinds)),
        "each item is looked at from rest where the one before ends, at times that are foreseen; take-off,"
        " landing and the way home, which the vehicle leads itself, are not"),
    Row("printed_law", lambda c: _if(c.law.achieved < 0.5),
        "it flies the printed law, which winds up when it saturates: the condition is that of the law with"
        " what was achieved"),
    Row("torque", lambda c: _if(c.calm_n_m < 0.0 and not c.is_noisy, LAGS[1] * rotor_lag(c.law)),
        "with rotor lags up to {0:.3g} s and the masses of guard_mass_kg these gains leave roll and pitch no torque"
        " for the slowest change of the reference: torque may saturate"),
    Row("gusts", lambda c: _if(c.calm_n_m >= 0.0 > c.spare_n_m and not c.is_noisy, -c.spare_n_m),
        "the gusts that are believed (guard_wind_m_s, guard_wind_rate_m_s2) take {0:.1f} N m more than roll and"
        " pitch have in hover"),
    Row("wind_from_below", lambda c: _if(c.sinking_m_s < 0.0, c.guard.w_max + c.sinking_m_s, c.guard.w_max),
        "in a wind from below above {0:.1f} m/s (guard_wind_m_s {1:g}) roll and pitch are unstable with these"
        " gains, or nearly"),
    Row("quick_reference", lambda c: _if(float(foreseen.lags(c.law)) > foreseen.QUICKEST and c.law.achieved > 0.5,
                                         float(foreseen.lags(c.law)), foreseen.QUICKEST),
        "its reference model is too quick for attitude and rates (2 zeta_m f_m (1/c_angle + 1/c_rate) is {0:.2g},"
        " above {1:g}): torque of roll and pitch may saturate", "lower law.f_m"),
    Row("recovery", lambda c: _if(c.sinking_m_s >= 0.0
                                  and not recovers(c.law, c.guard, c.guard.c_D * c.guard.w_max**2), c.guard.w_max),
        "once a rotor has been at a limit, in wind near guard_wind_m_s {0:g}, as a take-over there may bring"
        " about, roll and pitch need not settle again with these gains"),
)  # fmt: skip


def is_plans(kinds: tuple[str, ...]) -> bool:
    """Tell whether a mission has items, and all of them are plans."""
    return bool(kinds) and all(kind in PLANS for kind in kinds)


def uncovered(
    mission: Mission, scene: Scenario, settings: Settings, air: MissionWind
) -> tuple[Uncovered, ...]:
    """All that the condition does not cover, in the order of the table."""
    case = Case(mission, scene, settings, air)
    return tuple(
        Uncovered(row.name, row.said.format(*numbers), numbers, row.remedy)
        for row in ROWS
        for numbers in row.find(case)
    )
