"""A mission turned into what is flown: the law's parameters, the plant's world, the setpoints.

Both ways of flying start from here, so they cannot differ in what they fly.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fcu.guard.gains import FLY, unstable
from fcu.interface.airframe import AirframeFile
from fcu.interface.faults import LINK, OF_AUTOPILOT, SPECS, Fault, Kind, fault, hears
from fcu.interface.messages import Setpoint, VehicleState
from fcu.interface.parameter import flat
from fcu.interface.status_texts import words
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import to_buffer
from fcu.laws.loader import Law
from fcu.mavlink.setpoints import nonsense, setpoint_through_the_wire
from gcs_tools.flight.asleep import AVAILABLE
from gcs_tools.flight.user_command import SCRIPT_WORDS, CommandError, command_words
from gcs_tools.judging.metrics import SETTLE_S
from gcs_tools.missions.cache_key import CacheKey
from gcs_tools.missions.flight_table import AFTER_SCRIPT_S, HELD, Flight
from gcs_tools.missions.mission import Mission, MissionError
from gcs_tools.missions.timeline import Leg, Sent, cache_key, foreseen, legs, timeline
from gcs_tools.recording.schema import UNTOLD, Kinds
from sitl_plant.physics import tick
from sitl_plant.physics.wind.layers import Layers
from sitl_plant.physics.world import World, world

# Parameters with which a mission's vehicle starts, unless the mission says otherwise: a flight ends with the
# error of its law. A vehicle that is up for somebody (gcs up, fcu) flies on by px4.
OF_MISSIONS = {"MR_LAW_ACT": 0.0}


@dataclass(frozen=True)
class Scenario:
    """One flight, ready to be flown."""

    flown: Law
    airframe: AirframeFile  # as it is believed
    settings: Any  # of the law, and of its guard; None: a controller of somebody else's flies
    world: World
    wind: (
        np.ndarray[Any, np.dtype[np.float64]] | None
    )  # float64[n, 4], s and m/s, E, added to the world's
    layers: Layers | None  # of the wind, beside these
    faults: tuple[Fault, ...]  # that the simulator is ordered to have
    ticks: int
    period_us: int
    sent_at: np.ndarray[Any, np.dtype[np.int64]]  # ticks at which setpoints are sent
    sent: tuple[Setpoint, ...]  # what the script sends at them
    arrive: tuple[float, int] | None  # within m of the setpoint, for ticks: the flight is over
    begin: VehicleState  # where the first setpoint is flown from; of items, after a take-off
    planned_ticks: (
        int  # until the setpoints are over; of items as far as is known before the flight
    )
    flight: Flight  # the table
    legs: tuple[Leg, ...] = ()  # of a mission of items: what is sent, and when, is foreseen only
    controller: tuple[
        str, ...
    ] = ()  # command of a process in place of fcu; empty: fcu flies `flown`
    script: tuple[
        str, ...
    ] = ()  # command of a script that flies the vehicle; empty: the runner does
    folder: Path = Path()  # where it runs
    pace: float | None = 1.0  # simulated seconds per second, of a script. None: its time is held
    after_script_s: float = 0.0  # simulation time that the flight goes on after its script
    parameters: Mapping[str, float] = field(
        default_factory=dict
    )  # the vehicle's, by MAVLink's names
    flies_unstable: bool = False  # gains that the rule of stability refuses are flown, for a study

    @property
    def unstable(self) -> str:
        """The channel for which a vehicle refuses to start with these gains. Empty if it flies them."""
        if self.settings is None or self.flies_unstable:
            return ""
        key = self.flown.identity, to_buffer(self.settings).tobytes().hex()
        return _unstable(self.flown, CacheKey(self.settings, *key))

    def hears(self, tick: int) -> bool:
        """Return true if the vehicle hears the setpoint that is sent at a tick."""
        return hears(self.faults, tick * self.period_us)

    @property
    def kinds(self) -> Kinds:
        """What is told of the flight."""
        return UNTOLD if self.controller else Kinds.of(self.flown)

    @property
    def law(self) -> Any:
        """The law's parameters."""
        return self.settings.law

    @property
    def guard(self) -> Any:
        """The guard's parameters; without a guard, nothing."""
        return self.settings.guard

    @property
    def rate_hz(self) -> float:
        """Control ticks a second."""
        return self.world.rate_hz

    @cached_property
    def setpoints(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """float64[m, 19]: the setpoints as the vehicle decodes them."""
        return _rows(setpoint_through_the_wire(each) for each in self.sent)

    def noise(self, n: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        """float64[n, 12] noise on the reported state, or float64[0, 12] for none."""
        scale = self.world.noise_scale
        if not scale.any():
            return np.zeros((0, tick.NOISE))
        return np.random.default_rng(int(self.world.seed)).standard_normal((n, tick.NOISE)) * scale


class _Script(NamedTuple):
    """What is sent, and as what the vehicle decodes it."""

    begin: Vec3 | None
    sent: tuple[Sent, ...]
    setpoints: np.ndarray[Any, np.dtype[np.float64]]  # (m, size(Setpoint))
    wrong: str  # why no vehicle takes it; else empty


@lru_cache(maxsize=16)
def _shared(asks: CacheKey[Flight]) -> _Script:
    return _script(asks.of)


def _script(flight: Flight) -> _Script:
    begin, sent = foreseen(flight) if flight.items else (None, timeline(flight).sent())
    decoded = [setpoint_through_the_wire(each.setpoint) for each in sent]
    for each, flown in zip(sent, decoded, strict=True):
        if why := nonsense(flown):
            wrong = f"{words(why)}, at {each.tick / flight.rate_hz:g} s"
            return _Script(begin, tuple(sent), _rows(decoded), wrong)
    return _Script(begin, tuple(sent), _rows(decoded), "")


def _rows(setpoints: Iterable[Setpoint]) -> np.ndarray[Any, np.dtype[np.float64]]:
    found = np.array([to_buffer(each) for each in setpoints])
    found.setflags(write=False)
    return found


def scenario(mission: Mission) -> Scenario:
    """What a mission flies.

    Raises ParameterError or AirframeError for what cannot be flown, MissionError for a setpoint that
    no vehicle takes.
    """
    flight = mission.flight
    start = flight.start.model_dump(exclude_none=True)
    script = _script(flight) if flight.items else _shared(cache_key(flight))
    begin, sent, setpoints, wrong = script
    if wrong:
        raise MissionError(f"{mission.source}: [flight] {wrong}")
    ticks = round(flight.duration_s * flight.rate_hz)
    arrive = flight.arrive
    there = world(
        rate_hz=flight.rate_hz,
        seed=flight.seed,
        plant=mission.plant.model_dump(exclude_none=True),
        wind=mission.wind.model_dump(exclude_none=True),
        start=start,
        ground_z_m=flight.ground_z_m,
        arena_m=flight.arena_m,
        airframe=mission.airframe,
    )
    _refuse_lost_ground(mission)
    vehicle = mission.airframe
    made = Scenario(
        flown=mission.flown,
        airframe=vehicle,
        settings=None if mission.controller else _chosen(_law_of(mission)),
        world=there,
        wind=mission.wind.samples,
        layers=mission.wind.layers(flight.seed),
        faults=tuple(fault(each.model_dump()) for each in mission.plant.faults),
        ticks=ticks,
        period_us=round(1e6 / flight.rate_hz),
        sent_at=np.array([each.tick for each in sent], dtype=np.int64),
        sent=tuple(each.setpoint for each in sent),
        arrive=None if arrive is None else (arrive.within_m, round(arrive.for_s * flight.rate_hz)),
        begin=there.start if begin is None else there.start._replace(r_E=begin),
        planned_ticks=max(ticks, sent[-1].tick + round(SETTLE_S * flight.rate_hz))
        if flight.items
        else ticks,
        flight=flight,
        legs=legs(flight),
        controller=mission.controller,
        parameters=mission.parameters,
        **_of_a_script(mission),
        flies_unstable=getattr(mission.law, "unstable_gains", None) == FLY,
    )
    vars(made)["setpoints"] = setpoints
    return made


def refuse_link_faults(mission: Mission) -> None:
    """Raise MissionError for a fault of the plant link, which a flight in process does not have."""
    _refuse_faults(
        mission, LINK, "is a fault of the plant link, which a flight in process does not have: fly it over"
        " the wire (gcs fly without --in-process)",
    )  # fmt: skip


def refuse_faults_of_autopilot(mission: Mission) -> None:
    """Raise MissionError for a fault that an autopilot answers for, which a law alone does not have."""
    why = 'is answered by an autopilot, which a law alone does not have: fly = "vehicle"'
    _refuse_faults(mission, OF_AUTOPILOT, why)


def _refuse_lost_ground(mission: Mission) -> None:
    """Raise MissionError for a lost ground link of a mission whose setpoints another program sends."""
    table = mission.flight
    if table.items or table.script is not None or mission.controller:
        _refuse_faults(
            mission, {Kind.GROUND_LOST}, "needs a mission of setpoints: of items, a script or another"
            " controller take MAV_CMD_INJECT_FAILURE, mavlink_signal off",
        )  # fmt: skip


def _refuse_faults(mission: Mission, kinds: Container[Kind], why: str) -> None:
    for i, each in enumerate(mission.plant.faults):
        if SPECS[each.kind].kind in kinds:
            raise MissionError(f"{mission.source}: [plant] faults[{i}]: {each.kind} {why}")


def _of_a_script(mission: Mission) -> dict[str, Any]:
    """The fields of a Scenario for a mission's script. Raises MissionError."""
    flight = mission.flight
    if flight.script is None:
        return {}
    try:
        words = command_words(flight.script, SCRIPT_WORDS, mission.folder)
    except CommandError as error:
        line = mission.lines.get(("flight", "script"))
        where = mission.source if line is None else f"{mission.source}:{line}"
        raise MissionError(f"{where}: [flight] script: {error}") from error
    if flight.pace == HELD and not AVAILABLE:
        raise MissionError(
            f'{mission.source}: [flight] pace = "{HELD}" needs Linux; "real" or "speed:N" fly here'
        )
    after = AFTER_SCRIPT_S if flight.after_script_s is None else flight.after_script_s
    return {
        "script": words, "folder": mission.folder.absolute(),
        "pace": None if flight.pace == HELD else flight.speed, "after_script_s": after,
    }  # fmt: skip


@lru_cache(maxsize=16)
def _unstable(flown: Law, settings: CacheKey[Any]) -> str:
    return unstable(flown, settings.of)


def with_gains(made: Scenario, mission: Mission, gains: Mapping[str, Any]) -> Scenario:
    """The flight of `mission` with other values of the law's parameters, dotted key -> value.

    Raises ParameterError or AirframeError for what cannot be flown.
    """
    other = replace(made, settings=_settings(mission, gains))
    vars(other)["setpoints"] = made.setpoints  # decoded once for all gains
    return other


def _law_of(mission: Mission) -> CacheKey[Mission]:
    """A key that is equal for missions whose law is told the same."""
    vehicle = mission.airframe.identity, str(mission.airframe.path), str(mission.flight.rate_hz)
    return CacheKey(mission, mission.flown.identity, *vehicle, mission.law.model_dump_json())


@lru_cache(maxsize=16)
def _chosen(law: CacheKey[Mission]) -> Any:
    return _settings(law.of, {})


def _settings(mission: Mission, gains: Mapping[str, Any]) -> Any:
    """What the law is told: its mission's [law] with other `gains`."""
    flown, vehicle = mission.flown.settings, mission.airframe
    tops = {row.key.partition(".")[0] for row in flown.PARAMETERS if row.key}
    chosen = dict(flat(mission.law.model_dump(include=tops, exclude_none=True)))
    rate_hz = mission.flight.rate_hz
    return flown.settings(vehicle.rotors, vehicle.tables, rate_hz, {**chosen, **gains})
