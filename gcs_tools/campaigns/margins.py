"""How much a law stands before the vehicle is lost: delay, lag of the rotors, mass, wind.

Each quantity grows by a factor until a flight is lost; bisection finds where. Losing need not be
monotonic: what is found is the first loss on the way up, to the accuracy of the procedure.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from typing import Any, NamedTuple

from rich.console import Console

from gcs_tools.campaigns import score
from gcs_tools.campaigns.entrant import Entrant, EntrantError, scene
from gcs_tools.campaigns.flights import each
from gcs_tools.campaigns.procedure import Procedure
from gcs_tools.campaigns.seed_draws import Stream, sampled
from gcs_tools.missions.mission import Mission, MissionError, load, with_values

UNITS = {"delay": "s", "lag": "s", "mass": "kg", "wind": "m/s"}
_OF_WIND = ("steady_m_s", "amplitude_m_s", "step_m_s", "rotation_amplitude_rad_s")


class Margin(NamedTuple):
    """The greatest value with which nothing was lost, and the least with which something was."""

    airframe: str
    law: str
    quantity: str
    unit: str
    held: float | None  # None: lost already with the least that was tried
    lost: float | None  # None: not lost with the most that was tried


def margins(
    entrants: Sequence[Entrant], procedure: Procedure, console: Console | None = None
) -> list[Margin]:
    """Of every entrant, every quantity. Raises EntrantError, LawError, MissionError."""
    work = [(entrant, quantity) for entrant in entrants for quantity in UNITS]
    ended = threading.Event()
    found = each(lambda of: margin(*of, procedure, ended), work, "margins", console, ended.set)
    return list(found)


def margin(
    entrant: Entrant, quantity: str, procedure: Procedure, ended: threading.Event | None = None
) -> Margin:
    """Where an entrant loses the vehicle. Raises EntrantError, LawError, MissionError.

    ended : when set, nobody asks any more: no further flight begins, and CancelledError is raised.
    """
    how = procedure.margins
    mission = entrant.mission(load(how.mission))
    flights = [
        sampled(mission, procedure.draws, Stream.TEST, seed) for seed in range(how.seeds + 1)
    ]

    size = _size(mission, quantity)

    def holds(x: float) -> bool:
        for flight in flights:
            if ended is not None and ended.is_set():
                raise CancelledError
            if _is_lost(changed(flight, quantity, x, size), procedure):
                return False
        return True

    first, most = getattr(how, "delay_s" if quantity == "delay" else quantity)
    tick = 1.0 / mission.flight.rate_hz if quantity == "delay" else 0.0
    held, lost = between(holds, first, most, how.factor, how.accuracy, tick)
    told = [None if x is None else size * x for x in (held, lost)]
    return Margin(entrant.airframe, entrant.label, quantity, UNITS[quantity], told[0], told[1])


def between(
    holds: Callable[[float], bool], first: float, most: float, factor: float, accuracy: float,
    apart: float = 0.0,
) -> tuple[float | None, float | None]:  # fmt: skip
    """The greatest value found that holds, and the least that does not, from `first` up to `most`.

    accuracy : relative; values that are no more than `apart` apart are told apart no further.
    """
    held, lost, x = None, None, first
    while lost is None:
        if not holds(x):
            lost = x
        else:
            held = x
            if x >= most:
                return held, None
            x = min(factor * x, most)
    while held is not None and lost - held > max(accuracy * held, apart):
        middle = math.sqrt(held * lost)
        held, lost = (middle, lost) if holds(middle) else (held, middle)
    return held, lost


def _is_lost(mission: Mission, procedure: Procedure) -> bool:
    try:
        return bool(score.fly(scene(mission), mission, procedure.objective.far_m).lost)
    except MissionError as error:
        raise EntrantError(str(error)) from error


def changed(mission: Mission, quantity: str, x: float, size: float) -> Mission:
    """A drawn mission with more of a quantity: a delay (s) added, its wind times x, or lag or mass x sizes.

    size : of the mission as written, s or kg: what is told of a margin is what every seed flew with.
    """
    if quantity == "delay":
        values: dict[str, Any] = {"plant.delay_s": min(mission.plant.delay_s + x, 0.5)}
    elif quantity == "wind":
        wind = mission.wind
        values = {f"wind.{key}": [x * v for v in getattr(wind, key)] for key in _OF_WIND}
    else:
        values = {{"mass": "plant.mass_kg", "lag": "plant.rotor_lag_s"}[quantity]: x * size}
    return with_values(mission, values, "margin")


def _size(mission: Mission, quantity: str) -> float:
    """What one of the quantity is, in its unit, of the mission as written."""
    if quantity == "delay":
        return 1.0
    if quantity == "wind":
        wind = mission.wind
        parts = zip(wind.steady_m_s, wind.amplitude_m_s, wind.step_m_s, strict=True)
        return math.hypot(*(sum(map(abs, axis)) for axis in parts))
    params = scene(mission).world.params
    return float(params.m if quantity == "mass" else params.airframe.rotor_lag)
