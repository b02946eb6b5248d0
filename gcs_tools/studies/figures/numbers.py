"""The numbers that docs/paper.md quotes, measured from the flights of its figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs_tools.recording.table import Rows
from gcs_tools.studies.figures.cases import CASES, FigureFlight

Value = float | str | None  # None: without meaning for that flight

FIRST_S = 1.0  # the first second, in which a step from rest may saturate
LOCKED_S = 2.0  # from which a flight that diverges never leaves its limits again
SETTLED_S = 5.0
THERE_M = 0.5  # of the setpoint: within it the vehicle has arrived
GONE = 0.05  # of an initial error: below it the error has gone
MILLI = 1e3


@dataclass(frozen=True)
class Quantity:
    """One row of a table: what is measured of each flight."""

    key: str  # with its unit
    figure: int  # of the paper
    label: str
    measure: Callable[[FigureFlight], Value]
    digits: int  # after the point
    unit: str
    of_diverged: bool = False  # a flight that diverged has it too

    def of(self, flown: FigureFlight) -> Value:
        """Measured, in `unit`; None for what has no meaning or is not finite."""
        if flown.ended and not self.of_diverged:
            return None
        value = self.measure(flown)
        return None if isinstance(value, float) and not math.isfinite(value) else value

    def said(self, value: Value) -> str:
        """As printed."""
        if value is None:
            return "–"
        if isinstance(value, str):
            return value
        return f"{value:.{self.digits}f}{'' if self.unit == '°' else ' '}{self.unit}"


def _metric(
    name: str, t_from: float | None = None, scale: float = 1.0
) -> Callable[[FigureFlight], Value]:
    def measure(flown: FigureFlight) -> Value:
        value = flown.flight.metric(name, t_from)
        return None if value is None else scale * value

    return measure


def late(flown: FigureFlight, t_from: float) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """bool (n,): the ticks from t_from (s) on."""
    return flown.t >= t_from - 1e-6


def norm(parts: Sequence[Rows]) -> Rows:
    """Euclidean norm of components, each (n,)."""
    return np.sqrt(sum(np.square(part) for part in parts))


def angle_errors(flown: FigureFlight, axes: str) -> list[Rows]:
    """Angle minus its command, rad, the short way round, each (n,)."""
    pairs = zip(
        flown.fcu.axes("outputs.angles", axes), flown.fcu.axes("outputs.angles_c", axes),
        strict=True,
    )  # fmt: skip
    return [(flown_to - asked + math.pi) % (2.0 * math.pi) - math.pi for flown_to, asked in pairs]


def differences(flown: FigureFlight, name: str, other: str) -> list[Rows]:
    """One Vec3 of the law's rows minus another, each component (n,)."""
    return [
        a - b for a, b in zip(flown.fcu.axes(name), flown.fcu.axes(other), strict=True)
    ]  # fmt: skip


def _rms(
    parts: Callable[[FigureFlight], list[Rows]], scale: float
) -> Callable[[FigureFlight], Value]:
    """RMS of a vector's length from SETTLED_S on, scaled."""

    def measure(flown: FigureFlight) -> Value:
        size = norm(parts(flown))[late(flown, SETTLED_S)]
        return scale * math.sqrt(float(np.mean(size * size)))

    return measure


def _thrust(which: Callable[[Rows], Rows]) -> Callable[[FigureFlight], Value]:
    return lambda flown: float(which(flown.fcu["outputs.T_c"][late(flown, FIRST_S)]))


def gone_from(flown: FigureFlight) -> float | None:
    """Time (s) from which the distance stays below GONE of what it was at first; None: never."""
    error = flown.flight.reference_error
    return _below_from(flown, error, GONE * float(error[0]))


def there_from(flown: FigureFlight) -> float | None:
    """Time (s) from which the vehicle stays within THERE_M of the setpoint; None: never."""
    return _below_from(flown, flown.flight.setpoint_error, THERE_M)


def _below_from(flown: FigureFlight, error: Rows, limit: float) -> float | None:
    above = np.flatnonzero(~(error < limit))
    if not len(above):
        return float(flown.t[0])
    return None if above[-1] + 1 == len(error) else float(flown.t[above[-1] + 1])


def ended(flown: FigureFlight) -> str:
    """How a flight ended, in words."""
    last = float(flown.t[-1])
    if flown.ended:
        return f"{flown.ended} after {last:.0f} s"
    return f"flew all {flown.duration_s:.0f} s"


def _at_limit(figure: int, which: str, t_from: float | None, diverged: bool = False) -> Quantity:
    when = "of the flight" if t_from is None else f"from {t_from:.0f} s on"
    named = {"thrust": "thrust", "tilt": "roll or pitch", "rotor": "one of the rotors"}[which]
    window = "" if t_from is None else f"_from_{t_from:.0f}_s"
    return Quantity(
        f"{which}_at_limit{window}_percent", figure, f"{named} at a limit, {when}",
        _metric(f"{which}_saturated_fraction", t_from, 100.0), 0 if diverged else 1, "%", diverged,
    )  # fmt: skip


def _distances(figure: int) -> tuple[Quantity, ...]:
    return (
        Quantity("reference_error_rms_m", figure, "distance from the reference, RMS", _metric("reference_error_rms_m"), 2, "m"),
        Quantity("reference_error_rms_settled_m", figure, "the same, from 5 s on", _metric("reference_error_rms_settled_m"), 2, "m"),
        Quantity("reference_error_final_m", figure, "the same, worst of the last second", _metric("reference_error_final_m"), 2, "m"),
    )  # fmt: skip


def _there(figure: int) -> Quantity:
    return Quantity(
        "within_0_5_m_of_setpoint_s", figure, "within 0.5 m of the setpoint from", there_from, 1, "s"
    )  # fmt: skip


QUANTITIES: dict[str, tuple[Quantity, ...]] = {
    "nominal": (
        *_distances(1),
        _there(1),
        _at_limit(2, "thrust", None),
        _at_limit(2, "thrust", FIRST_S),
        Quantity("thrust_max_from_1_s_n", 2, "greatest thrust from 1 s on", _thrust(np.max), 0, "N"),
        Quantity("thrust_min_from_1_s_n", 2, "least thrust from 1 s on", _thrust(np.min), 0, "N"),
        _at_limit(2, "rotor", FIRST_S),
        _at_limit(3, "tilt", None),
        _at_limit(3, "tilt", FIRST_S),
        Quantity("tilt_max_from_1_s_deg", 3, "greatest roll or pitch command from 1 s on", _metric("tilt_max_deg", FIRST_S), 1, "°"),
        Quantity("tilt_error_rms_settled_deg", 3, "roll and pitch off their commands, RMS from 5 s on", _rms(lambda f: angle_errors(f, "xy"), 180.0 / math.pi), 1, "°"),
        Quantity("yaw_error_rms_settled_deg", 3, "yaw off its command, RMS from 5 s on", _rms(lambda f: angle_errors(f, "z"), 180.0 / math.pi), 2, "°"),
        Quantity("velocity_prediction_rms_settled_mm_s", 4, "velocity off its prediction, RMS from 5 s on", _rms(lambda f: f.fcu.axes("internals.prediction.v_til"), MILLI), 1, "mm/s"),
        Quantity("velocity_reference_rms_settled_m_s", 4, "velocity off the reference, RMS from 5 s on", _rms(lambda f: differences(f, "measured.v_E", "outputs.reference.v_m"), 1.0), 2, "m/s"),
        Quantity("rate_prediction_rms_settled_mrad_s", 5, "body rate off its prediction, RMS from 5 s on", _rms(lambda f: f.fcu.axes("internals.prediction.w_til"), MILLI), 1, "mrad/s"),
        Quantity("rate_command_rms_settled_rad_s", 5, "body rate off its command, RMS from 5 s on", _rms(lambda f: differences(f, "measured.w_B", "outputs.w_c"), 1.0), 2, "rad/s"),
        Quantity("m_hat_final_kg", 4, "mass estimate at the end (the mass is 8 kg)", lambda f: float(f.fcu["state.estimates.m_hat"][-1]), 1, "kg"),
    ),
    "wrong_start": (
        Quantity("reference_error_first_m", 6, "distance from the reference at the start", lambda f: float(f.flight.reference_error[0]), 2, "m"),
        Quantity("reference_error_gone_s", 6, "below 5 % of that from", gone_from, 1, "s"),
        Quantity("reference_error_max_from_5_s_m", 6, "greatest distance from 5 s on", _metric("reference_error_max_m", SETTLED_S), 2, "m"),
        Quantity("reference_error_final_m", 6, "greatest distance in the last second", _metric("reference_error_final_m"), 2, "m"),
        _there(6),
        _at_limit(7, "thrust", None),
        _at_limit(7, "thrust", FIRST_S),
        _at_limit(8, "tilt", None),
        _at_limit(8, "tilt", FIRST_S),
    ),
    "fast": (
        _at_limit(9, "thrust", None, True),
        _at_limit(9, "thrust", FIRST_S, True),
        _at_limit(9, "thrust", LOCKED_S, True),
        _at_limit(10, "tilt", None, True),
        _at_limit(10, "tilt", FIRST_S, True),
        _at_limit(10, "tilt", LOCKED_S, True),
        Quantity("ended", 11, "the flight", ended, 0, "", True),
        *_distances(11),
        _there(11),
        Quantity("reference_error_max_m", 11, "greatest distance from the reference", _metric("reference_error_max_m"), 2, "m"),
    ),
}  # fmt: skip


def measured(flights: dict[str, list[FigureFlight]]) -> dict[str, dict[str, dict[str, Value]]]:
    """Group, title of a case, key: the number. Unrounded, for machines."""
    return {
        group: {
            flown.case.title: {
                "command": flown.command,
                **{quantity.key: quantity.of(flown) for quantity in QUANTITIES[group]},
            }
            for flown in flights[group]
        }
        for group in CASES
    }  # fmt: skip


def table(group: str, flights: Sequence[FigureFlight]) -> list[list[str]]:
    """A head and rows, as printed: figure, quantity, one column a case, last the command."""
    rows = [["Fig.", "measured", *(flown.case.title for flown in flights)]]
    for quantity in QUANTITIES[group]:
        values = [quantity.said(quantity.of(flown)) for flown in flights]
        rows.append([str(quantity.figure), quantity.label, *values])
    return rows
