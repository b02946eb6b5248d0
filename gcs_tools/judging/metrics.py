"""Numbers that say how a flight went, over all of it or over a window of time.

Position errors are of the plant's true position against the reference model (34), command
errors against the commanded position r_c; both are euclidean norms. A metric counts the control
ticks at which the law was flying. One that has no sample, or that a sample which is not finite
would make meaningless, has no value: None, so that results stay finite and a limit on it fails.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fcu.kernel.buffers import columns
from fcu.laws.mmrac.types import Tick
from sitl_plant.physics.types import PlantRecord

Rows = np.ndarray[Any, np.dtype[np.float64]]

SETTLE_S = 5.0  # from a change of setpoint, or take-over, to where settled metrics begin
FINAL_S = 1.0  # length of the last part of a flight that position_final_m looks at
_HALF_US = 0.5e-6  # ticks fall on whole microseconds: a window's ends are met by rounding

_TICK = columns(Tick)
_PLANT = columns(PlantRecord)


def _columns(names: list[str], value: str) -> list[int]:
    """Columns of a Vec3 of the row, by its dotted name."""
    return [names.index(f"{value}.{axis}") for axis in "xyz"]


_T, _ENGAGED = _TICK.index("t"), _TICK.index("engaged")
_TRUE_R, _R_M, _R_C = (
    _columns(_PLANT, "state.r_E"),
    _columns(_TICK, "internals.r_m"),
    _columns(_TICK, "setpoint.r_c"),
)
_V_C, _A_C = _columns(_TICK, "setpoint.v_c"), _columns(_TICK, "setpoint.a_c")
_THRUST = _TICK.index("internals.T_c")
_MARGIN, _MARGIN_TILT, _CONDITION = (
    _TICK.index(f"internals.{name}") for name in ("margin", "margin_tilt", "margin_condition")
)
_TILT = [_TICK.index(f"internals.angles_c.{axis}") for axis in "xy"]


def settle_from(fcu: Rows) -> float:
    """Simulation time (s) from which a flight counts as settled.

    SETTLE_S after the last step of a position setpoint, or after take-over if there was none:
    a moving setpoint (one with a velocity or an acceleration) makes no step. Infinite for a
    flight in which the law never flew.
    """
    flying = fcu[fcu[:, _ENGAGED] > 0.5]
    if not len(flying):
        return math.inf
    taken_over = np.flatnonzero(flying[:, _ENGAGED] < 1.5)
    resting = (flying[:, _V_C + _A_C] == 0.0).all(axis=1)
    moved = (flying[1:, _R_C] != flying[:-1, _R_C]).any(axis=1)
    steps = 1 + np.flatnonzero(moved & resting[1:] & resting[:-1])
    last = max([0, *taken_over.tolist(), *steps.tolist()])
    return float(flying[last, _T]) + SETTLE_S


@dataclass(frozen=True)
class EngagedTicks:
    """A flight's ticks at which the law was flying, and the errors at each."""

    t: Rows  # s
    position_error: Rows  # m, against the reference model; not finite where either is not
    command_error: Rows  # m, against the command
    plant: Rows  # rows of PlantRecord, at the same ticks as
    fcu: Rows  # rows of Tick
    settle_from_s: float

    @classmethod
    def of(cls, plant: Rows, fcu: Rows, settle_from_s: float | None = None) -> EngagedTicks:
        """Join the rows of plant and flight controller that belong to one time.

        plant : float64 (n, size(PlantRecord)).  fcu : float64 (m, size(Tick)).
        settle_from_s : from where settled metrics count; by default `settle_from(fcu)`.
        """
        fcu = fcu[fcu[:, _ENGAGED] > 0.5]
        _, of_plant, of_fcu = np.intersect1d(
            np.rint(plant[:, 0] * 1e6), np.rint(fcu[:, _T] * 1e6), return_indices=True
        )
        plant, fcu = plant[of_plant], fcu[of_fcu]
        true_r = plant[:, _TRUE_R]
        return cls(
            t=fcu[:, _T],
            position_error=_distance(true_r, fcu[:, _R_M]),
            command_error=_distance(true_r, fcu[:, _R_C]),
            plant=plant,
            fcu=fcu,
            settle_from_s=settle_from(fcu) if settle_from_s is None else settle_from_s,
        )

    def window(self, t_from: float | None, t_to: float | None) -> EngagedTicks:
        """The ticks from t_from to t_to (s, both included); None: from the start, to the end."""
        low = 0 if t_from is None else np.searchsorted(self.t, t_from - _HALF_US)
        high = len(self.t) if t_to is None else np.searchsorted(self.t, t_to + _HALF_US)
        inside = slice(int(low), int(high))
        return EngagedTicks(
            self.t[inside],
            self.position_error[inside],
            self.command_error[inside],
            self.plant[inside],
            self.fcu[inside],
            self.settle_from_s,
        )

    def metric(
        self, name: str, t_from: float | None = None, t_to: float | None = None
    ) -> float | None:
        """One metric over a window. Raises KeyError for a name that is not one of METRICS."""
        value = METRICS[name](self.window(t_from, t_to))
        return value if math.isfinite(value) else None

    def metrics(self) -> dict[str, float | None]:
        """Every metric over the whole flight."""
        return {name: self.metric(name) for name in METRICS}


def _distance(a: Rows, b: Rows) -> Rows:
    """Euclidean distance, row by row, of (n, 3) arrays; without overflow short of infinity."""
    with np.errstate(invalid="ignore", over="ignore"):
        d = a - b
        norm: Rows = np.hypot(np.hypot(d[:, 0], d[:, 1]), d[:, 2])
    return norm


def _rms(error: Rows) -> float:
    """Root of the mean square; NaN without samples or with one that is not finite."""
    if not len(error) or not np.isfinite(error).all():
        return math.nan
    largest = float(error.max())
    return largest * math.sqrt(float(np.mean((error / largest) ** 2))) if largest > 0.0 else 0.0


def _greatest(values: Rows) -> float:
    """The greatest of the finite values; NaN without any."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if len(finite) else math.nan


def _least(values: Rows) -> float:
    """The least of the finite values; NaN without any."""
    return -_greatest(-values)


def _final(flight: EngagedTicks) -> float:
    """The worst position error of the last second; NaN if one is not finite."""
    if not len(flight.t):
        return math.nan
    return float(flight.position_error[flight.t >= flight.t[-1] - FINAL_S - _HALF_US].max())


def _settled(flight: EngagedTicks) -> EngagedTicks:
    return flight.window(flight.settle_from_s, None)


def _fraction(column: str) -> Callable[[EngagedTicks], float]:
    """The part of the ticks at which a flag of the internals is up; NaN if it is not known."""
    at = _TICK.index(f"internals.{column}")

    def part(flight: EngagedTicks) -> float:
        flag = flight.fcu[:, at]
        known = len(flag) > 0 and not np.isnan(flag).any()
        return float(np.mean(flag > 0.5)) if known else math.nan

    return part


METRICS: dict[str, Callable[[EngagedTicks], float]] = {
    "position_rms_m": lambda f: _rms(f.position_error),
    "position_rms_settled_m": lambda f: _rms(_settled(f).position_error),
    "position_max_m": lambda f: _greatest(f.position_error),
    "position_final_m": _final,
    "command_rms_m": lambda f: _rms(f.command_error),
    "command_rms_settled_m": lambda f: _rms(_settled(f).command_error),
    "thrust_saturated_fraction": _fraction("thrust_saturated"),
    "tilt_saturated_fraction": _fraction("tilt_saturated"),
    "rotor_saturated_fraction": _fraction("rotor_saturated"),
    "governed_fraction": _fraction("governed"),
    "margin_min_n": lambda f: _least(f.fcu[:, _MARGIN]),
    "margin_tilt_min_deg": lambda f: math.degrees(_least(f.fcu[:, _MARGIN_TILT])),
    "margin_condition_min_n": lambda f: _least(f.fcu[:, _CONDITION]),
    "thrust_max_n": lambda f: _greatest(f.fcu[:, _THRUST]),
    "tilt_max_deg": lambda f: math.degrees(_greatest(np.abs(f.fcu[:, _TILT]).ravel())),
    "nonfinite_samples": lambda f: float(np.sum(~np.isfinite(f.position_error))),
}


def metrics(plant: Rows, fcu: Rows, settle_from_s: float | None = None) -> dict[str, float | None]:
    """Every metric of a flight (rows as for EngagedTicks.of); None for one without a value."""
    return EngagedTicks.of(plant, fcu, settle_from_s).metrics()


def metric(
    name: str,
    plant: Rows,
    fcu: Rows,
    t_from: float | None = None,
    t_to: float | None = None,
    settle_from_s: float | None = None,
) -> float | None:
    """One metric of a flight from t_from to t_to (s); None for one without a value."""
    return EngagedTicks.of(plant, fcu, settle_from_s).metric(name, t_from, t_to)
