"""Numbers that say how a flight went, over all of it or over a window of time.

Both errors are distances of the plant's true position: the reference error from the reference model
(34), which a law may not have, and the setpoint error from the setpoint as the mission asks for it,
whatever the vehicle made of that (limited, governed). A metric counts the control ticks at which the
law was flying. One that has no sample, or that a sample which is not finite
would make meaningless, has no value: None, so that results stay finite and a limit on it fails.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs_tools.recording.table import HALF_US, Indices, Rows, Table

Flags = np.ndarray[Any, np.dtype[np.bool_]]

PARTS = GUARD, REFERENCE = "guard", "reference"  # of a law, which it may be without
SETTLE_S = 5.0  # from a change of setpoint, or take-over, to where settled metrics begin
REACHED_M = (
    0.5  # how near a setpoint that stands that long is to be reached, if a mission does not say
)
BOUNCE_S = 0.5  # in the air for less, between two contacts with the ground, is no flight
JUMP_M = 1e-3  # of a setpoint that moved: farther from where its velocity carries it
FINAL_S = 1.0  # length of the last part of a flight that metrics of its end look at
_OF_A_REFERENCE = "outputs.reference.", "outputs.e_r."
_OF_THE_LAW = "command.", "outputs.", "state.", "internals.", "guard_state.", "guard."
_OF_A_GUARD = "governed_", "margin_", "contradicted_"
_CONTRADICTED = "guard.contradicted."
BLOCK = 1 << 13  # rows that are worked on at once


def settle_from(fcu: Table) -> float:
    """Simulation time (s) from which a flight counts as settled.

    SETTLE_S after the last step of a position setpoint, or after take-over if there was none: a
    setpoint that moves with its velocity and acceleration makes no step, but where it jumps to rest
    it does. Infinite for a flight in which the law never flew.
    """
    fcu = _flying(fcu)
    if not len(fcu):
        return math.inf
    last = 0
    for block in blocks(len(fcu)):
        ticks = fcu.take(slice(max(block.start - 1, 0), block.stop))  # and the one before them
        first = block.start - (len(ticks) - (block.stop - block.start))
        taken_over = np.flatnonzero(ticks["engaged"] < 1.5)
        last = max([last, *(first + taken_over).tolist(), *(first + _steps(ticks)).tolist()])
    return float(fcu.take(slice(last, last + 1))["t"][0]) + SETTLE_S


def _steps(fcu: Table) -> Indices:
    """Return the ticks at which a position setpoint stepped, or jumped to rest."""
    v_c, a_c, r_c = fcu["setpoint.v_c"], fcu["setpoint.a_c"], fcu["setpoint.r_c"]
    resting = (v_c == 0.0).all(axis=1) & (a_c == 0.0).all(axis=1)
    moved = (r_c[1:] != r_c[:-1]).any(axis=1)
    to = 1 + np.flatnonzero(moved & resting[1:])
    t = fcu["t"]
    h = (t[to] - t[to - 1])[:, None]
    carried = r_c[to - 1] + h * v_c[to - 1] + 0.5 * h * h * a_c[to - 1]
    steps: Indices = to[resting[to - 1] | (_distance(r_c[to], carried) > JUMP_M)]
    return steps


def on_ground(plant: Table) -> Flags:
    """Whether the vehicle stood on the ground at each row of a plant's table, or bounced there."""
    touches = is_up(plant, "on_ground") if "on_ground" in plant else np.zeros(len(plant), bool)
    at = np.flatnonzero(touches)
    gaps = np.diff(at) > 1
    if not gaps.any():
        return touches
    bounces = gaps & (np.diff(plant["t"][at]) < BOUNCE_S)
    for i in np.flatnonzero(bounces).tolist():
        touches[at[i] : at[i + 1]] = True
    return touches


def _flying(fcu: Table) -> Table:
    """The ticks at which the law was flying."""
    return fcu.take(is_up(fcu, "engaged"))


def is_up(table: Table, name: str) -> Flags:
    """Return the rows of a table at which a flag is up, bool (n,)."""
    flags: Flags = np.empty(len(table), bool)
    for block in blocks(len(table)):
        flags[block] = table.take(block)[name] > 0.5
    return flags


@dataclass(frozen=True)
class NotFinite:
    """When a law first computed a number that is not finite, and which."""

    time_s: float
    fields: list[str]  # all of that tick, as recordings name them

    def __str__(self) -> str:
        """One sentence."""
        more = f" (and {len(self.fields) - 1} more)" if len(self.fields) > 1 else ""
        return f"{self.fields[0]}{more} was not finite, first at {self.time_s:.3f} s."


@dataclass(frozen=True)
class EngagedTicks:
    """A flight's ticks at which the law was flying, and the errors at each."""

    t: Rows  # s
    reference_error: Rows  # m, from the reference model; not finite where either is not
    has_reference: bool
    setpoint_error: Rows  # m, from the setpoint that was asked for
    is_asked: Flags  # whether a place was asked for: a vehicle that lands has none
    is_grounded: Flags  # whether it stood on the ground, or bounced there
    plant: Table  # the truth, at the same ticks
    fcu: Table  # what the controller told
    settle_from_s: float
    computed: list[int]  # columns of `fcu` that have to be finite

    @classmethod
    def of(
        cls,
        plant: Table,
        fcu: Table,
        settle_from_s: float | None = None,
        asked: Callable[[Rows], Rows] | None = None,
    ) -> EngagedTicks:
        """Join the rows of plant and flight controller that belong to one time.

        settle_from_s : from where settled metrics count; by default `settle_from(fcu)`.
        asked : the position setpoint, float64 (n, 3), m, E, that was asked for at times (n,), s, not
        a number where none was; by default the one that the vehicle flew, which is all that is known
        without a mission.
        """
        grounded = on_ground(plant)
        fcu = _flying(fcu)
        of_plant, of_fcu = _in_common(plant["t"], fcu["t"])
        plant, fcu, grounded = plant.take(of_plant), fcu.take(of_fcu), grounded[of_plant]
        t = fcu["t"]
        n, told = len(t), "outputs.reference.r_m" in fcu  # of a controller that tells of itself
        reference_error, setpoint_error = np.full(n, math.nan), np.empty(n)
        is_asked: Flags = np.zeros(n, dtype=bool)
        has_reference = False
        for block in blocks(n):
            ticks, truth = fcu.take(block), plant.take(block)["state.r_E"]
            wanted = ticks["setpoint.r_c"] if asked is None else asked(t[block])
            if asked is not None or "setpoint.level" not in ticks:
                is_asked[block] = np.isfinite(wanted).all(axis=1) | (asked is None)
            else:  # of attitudes and rates, the place is where the vehicle happened to be
                is_asked[block] = ticks["setpoint.level"] == 0.0
            setpoint_error[block] = _distance(truth, wanted)
            if told:
                reference = ticks["outputs.reference.r_m"]
                has_reference |= not np.isnan(reference).all()
                reference_error[block] = _distance(truth, reference)
        return cls(
            t=t,
            reference_error=reference_error,
            has_reference=has_reference,
            setpoint_error=setpoint_error,
            is_asked=is_asked,
            is_grounded=grounded,
            plant=plant,
            fcu=fcu,
            settle_from_s=settle_from(fcu) if settle_from_s is None else settle_from_s,
            computed=_computed(fcu),
        )

    def law_has(self, part: str) -> bool:
        """True if the law has one of PARTS. Of a law that never flew nothing is ruled out."""
        if not len(self.t):
            return True
        return self.has_reference if part == REFERENCE else "guard.governed" in self.fcu

    def told(self, name: str) -> Rows:
        """A column of what the controller told of each tick; of what it did not, not a number."""
        return self.fcu[name] if name in self.fcu else np.full(len(self.t), math.nan)

    def window(self, t_from: float | None, t_to: float | None) -> EngagedTicks:
        """The ticks from t_from to t_to (s, both included); None: from the start, to the end."""
        low = 0 if t_from is None else np.searchsorted(self.t, t_from - HALF_US)
        high = len(self.t) if t_to is None else np.searchsorted(self.t, t_to + HALF_US)
        return self.take(slice(int(low), int(high)))

    def take(self, which: Any) -> EngagedTicks:
        """Some of the ticks: a slice, or a flag for each."""
        return EngagedTicks(
            self.t[which],
            self.reference_error[which],
            self.has_reference,
            self.setpoint_error[which],
            self.is_asked[which],
            self.is_grounded[which],
            self.plant.take(which),
            self.fcu.take(which),
            self.settle_from_s,
            self.computed,
        )

    def parts(self) -> Iterator[EngagedTicks]:
        """Yield the ticks, some at a time: what is worked out by part needs little memory."""
        for block in blocks(len(self.t)):
            yield self.take(block)

    def first_not_finite(self) -> NotFinite | None:
        """The first number that the law computed and that was not finite. None if all were."""
        bad = np.flatnonzero(~_finite(self))
        if not len(bad):
            return None
        row = self.fcu.rows[bad[0], self.computed]
        names = [self.fcu.names[self.computed[i]] for i in np.flatnonzero(~np.isfinite(row))]
        return NotFinite(float(self.t[bad[0]]), names)

    def metric(
        self, name: str, t_from: float | None = None, t_to: float | None = None
    ) -> float | None:
        """One metric over a window. Raises KeyError for a name that is not one of METRICS."""
        value = METRICS[name](self.window(t_from, t_to))
        return value if math.isfinite(value) else None

    def why_no_value(
        self, name: str, t_from: float | None = None, t_to: float | None = None
    ) -> str:
        """Why a metric has no value over a window, in words."""
        if name not in METRICS:
            return "there is no such metric"
        if not len(self.t):
            return "the law never flew"
        ticks = self.window(t_from, t_to)
        if not len(ticks.t):
            after = "" if t_from is None else f" after {t_from:g} s"
            return f"no tick{after}" + ("" if t_to is None else f" before {t_to:g} s")
        if name not in OF_THE_TRUTH and "outputs.T_c" not in self.fcu:
            return "the controller tells nothing of itself"
        if name.startswith("reference_error_") and not self.has_reference:
            return "this law has no reference model"
        of = _settled(ticks) if "_settled_" in name else ticks
        if name.startswith("setpoint_error_") and len(of.t) and not of.is_asked.any():
            return "no place was asked for"
        if name in ALOFT and ticks.is_grounded.all():
            return "the vehicle was on the ground"
        if "_settled_" in name and not len(_settled(ticks).t):
            return f"the flight counts as settled from {self.settle_from_s:g} s"
        if name.startswith(_OF_A_GUARD) and not self.law_has(GUARD):
            return "this law has no guard"
        return "of numbers that are not finite"

    def metrics(self) -> dict[str, float | None]:
        """Every metric over the whole flight."""
        return {name: self.metric(name) for name in METRICS}


def blocks(n: int) -> Iterator[slice]:
    """Yield slices of n rows, each of BLOCK at most: what is worked out by block needs little memory."""
    for i in range(0, n, BLOCK):
        yield slice(i, min(i + BLOCK, n))


def _in_common(t_plant: Rows, t_fcu: Rows) -> tuple[Any, Any]:
    """Return the rows of plant and flight controller that belong to one time (s), as slices or indices."""
    n = len(t_fcu)
    if n:
        first = int(np.searchsorted(t_plant, t_fcu[0] - HALF_US))
        whole = t_plant[first : first + n]
        if len(whole) == n and all(
            np.array_equal(_microseconds(whole[block]), _microseconds(t_fcu[block]))
            for block in blocks(n)
        ):  # as of every flight without a gap
            return slice(first, first + n), slice(0, n)
    a, b = _microseconds(t_plant), _microseconds(t_fcu)
    _, of_plant, of_fcu = np.intersect1d(a, b, return_indices=True)
    return of_plant, of_fcu


def _microseconds(t: Rows) -> Rows:
    """Return times (s) as whole microseconds, on which ticks fall."""
    return np.rint(t * 1e6)


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
    if largest <= 0.0:
        return 0.0
    return largest * math.sqrt(_sum_of_squares(error, largest) / len(error))


def _sum_of_squares(values: Rows, unit: float) -> float:
    """Return the sum of the squares of values over a unit.

    It is summed in the order in which np.sum has it, which halves what is longer than it adds at once:
    so the sum is the same number.
    """
    n = len(values)
    if n > BLOCK:
        half = n // 2 - n // 2 % 8
        return _sum_of_squares(values[:half], unit) + _sum_of_squares(values[half:], unit)
    squares = values / unit
    squares *= squares
    return float(np.sum(squares))


def _greatest(values: Rows) -> float:
    """The greatest of the finite values; NaN without any."""
    greatest = float(np.max(values, initial=-math.inf, where=np.isfinite(values)))
    return greatest if math.isfinite(greatest) else math.nan


def _least(values: Rows) -> float:
    """The least of the finite values; NaN without any."""
    least = float(np.min(values, initial=math.inf, where=np.isfinite(values)))
    return least if math.isfinite(least) else math.nan


def _final(flight: EngagedTicks, error: Rows) -> float:
    """The worst error of the last second; NaN if one is not finite."""
    if not len(flight.t):
        return math.nan
    return float(error[flight.t >= flight.t[-1] - FINAL_S - HALF_US].max())


def _greatest_told(flight: EngagedTicks, name: str) -> float:
    """The greatest finite value of what the controller told, or NaN without any."""
    found = [_greatest(part.told(name)) for part in flight.parts()]
    return float(np.fmax.reduce(found, initial=math.nan))


def _least_told(flight: EngagedTicks, name: str) -> float:
    """The least finite value of what the controller told, or NaN without any."""
    found = [_least(part.told(name)) for part in flight.parts()]
    return float(np.fmin.reduce(found, initial=math.nan))


def _tilt_max(flight: EngagedTicks) -> float:
    """The greatest commanded roll or pitch, rad, unsigned."""
    names = [f"outputs.angles_c.{axis}" for axis in "xy"]
    ends = [of(flight, name) for name in names for of in (_greatest_told, _least_told)]
    return float(np.fmax.reduce(np.abs(ends)))


def _asked(flight: EngagedTicks) -> EngagedTicks:
    """The ticks at which a place was asked for."""
    return flight if flight.is_asked.all() else flight.take(flight.is_asked)


def aloft(flight: EngagedTicks) -> EngagedTicks:
    """The ticks in the air: on the ground motors idle, and a limit means nothing."""
    return flight.take(~flight.is_grounded) if flight.is_grounded.any() else flight


def _settled(flight: EngagedTicks) -> EngagedTicks:
    return flight.window(flight.settle_from_s, None)


def _fraction(*names: str, in_air: bool = False) -> Callable[[EngagedTicks], float]:
    """The part of the ticks, or of those in the air, at which a flag is up, or one of several.

    NaN if none is known.
    """

    def part(flight: EngagedTicks) -> float:
        if in_air:
            flight = aloft(flight)
        is_known, n = len(flight.t) > 0, 0
        for some in flight.parts():
            flag = np.fmax.reduce([some.told(name) for name in names])
            is_known = is_known and not np.isnan(flag).any()
            n += int(np.count_nonzero(flag > 0.5))
        return n / len(flight.t) if is_known else math.nan

    return part


def _contradicted(flight: EngagedTicks) -> float:
    """The part of the ticks in the air at which something contradicts what the guard believes."""
    signs = [name for name in flight.fcu.names if name.startswith(_CONTRADICTED)]
    return _fraction(*signs, in_air=True)(flight) if signs else math.nan


def _energy(flight: EngagedTicks) -> float:
    """What the battery gave from the first tick to the last, J."""
    if "battery.energy_J" not in flight.plant or not len(flight.t):
        return math.nan
    first, last = (flight.plant.take(at)["battery.energy_J"] for at in (slice(1), slice(-1, None)))
    return float(last[0] - first[0])


def _nonfinite(flight: EngagedTicks) -> float:
    """Ticks at which the error is not finite, or a number that the law computes."""
    error = flight.reference_error if flight.has_reference else flight.setpoint_error
    is_known = np.isfinite(error) | ~(flight.is_asked | flight.has_reference)
    return float(np.sum(~(is_known & _finite(flight))))


def _finite(flight: EngagedTicks) -> Flags:
    """Return at which ticks every number that the law computes is finite."""
    finite: Flags = np.full(len(flight.t), True)
    names = [flight.fcu.names[at] for at in flight.computed]
    for block in blocks(len(finite)):
        ticks = flight.fcu.take(block)
        for name in names:
            finite[block] &= np.isfinite(ticks[name])
    return finite


def _computed(fcu: Table) -> list[int]:
    """The columns that have to be finite at all ticks at which a law flies.

    Its command, outputs and state have to be, but for the reference model, which it may not have. Of this,
    and of what it computes on the way, it tells what is finite as it takes over.
    """
    first = np.isfinite(fcu.rows[0]) if len(fcu.rows) else np.zeros(len(fcu.names), dtype=bool)
    return [
        i
        for i, name in enumerate(fcu.names)
        if name.startswith(_OF_THE_LAW) and (first[i] or _is_always_a_number(name))
    ]


def _is_always_a_number(name: str) -> bool:
    """True for a column of what a law commands, tells or remembers. Of a reference it may tell nothing."""
    return name.startswith(("command.", "outputs.", "state.")) and not name.startswith(
        _OF_A_REFERENCE
    )


METRICS: dict[str, Callable[[EngagedTicks], float]] = {
    "reference_error_rms_m": lambda f: _rms(f.reference_error),
    "reference_error_rms_settled_m": lambda f: _rms(_settled(f).reference_error),
    "reference_error_max_m": lambda f: _greatest(f.reference_error),
    "reference_error_final_m": lambda f: _final(f, f.reference_error),
    "setpoint_error_rms_m": lambda f: _rms(_asked(f).setpoint_error),
    "setpoint_error_rms_settled_m": lambda f: _rms(_asked(_settled(f)).setpoint_error),
    "setpoint_error_max_m": lambda f: _greatest(_asked(f).setpoint_error),
    "setpoint_error_final_m": lambda f: _final(_asked(f), _asked(f).setpoint_error),
    "thrust_saturated_fraction": _fraction("outputs.saturation.thrust", in_air=True),
    "tilt_saturated_fraction": _fraction("outputs.saturation.tilt", in_air=True),
    "torque_saturated_fraction": _fraction("outputs.saturation.torque", in_air=True),
    "yaw_saturated_fraction": _fraction("outputs.saturation.yaw", in_air=True),
    "rotor_saturated_fraction": _fraction(
        "outputs.saturation.torque", "outputs.saturation.yaw", in_air=True
    ),
    "governed_fraction": _fraction("guard.governed"),
    "contradicted_fraction": _contradicted,
    "margin_min_n": lambda f: _least_told(aloft(f), "guard.margin.force"),
    "margin_tilt_min_deg": lambda f: math.degrees(_least_told(aloft(f), "guard.margin.tilt")),
    "margin_condition_min_n": lambda f: _least_told(aloft(f), "guard.margin.condition"),
    "thrust_max_n": lambda f: _greatest_told(f, "outputs.T_c"),
    "tilt_max_deg": lambda f: math.degrees(_tilt_max(f)),
    "energy_j": _energy,
    "nonfinite_samples": _nonfinite,
}


OF_ITEMS = ("took_s", "touchdown_m_s", "touchdown_m", "passed_m")  # of items alone: see item_checks

# which need the plant and the mission alone, whatever a controller tells of itself
OF_THE_TRUTH = frozenset(name for name in METRICS if name.startswith("setpoint_error_")) | {
    "energy_j", "nonfinite_samples",
}  # fmt: skip

# of the ticks in the air
ALOFT = frozenset(
    n for n in METRICS if "_saturated_" in n or n.startswith(("margin_", "contradicted_"))
)

# what is wanted of these is a floor: a bare number in [expect] is the least that will do
FLOOR = "this metric is a minimum: a number is the least that it may be"
FLOORS = frozenset(name for name in METRICS if "_min_" in name)

RENAMED = {  # the names that result.json of version 1 and missions of its time have
    **{
        f"position_{of}_m": f"reference_error_{of}_m"
        for of in ("rms", "rms_settled", "max", "final")
    },
    **{f"command_{of}_m": f"setpoint_error_{of}_m" for of in ("rms", "rms_settled")},
}


def metrics(
    plant: Table, fcu: Table, settle_from_s: float | None = None
) -> dict[str, float | None]:
    """Every metric of a flight (rows as for EngagedTicks.of); None for one without a value."""
    return EngagedTicks.of(plant, fcu, settle_from_s).metrics()


def metric(
    name: str,
    plant: Table,
    fcu: Table,
    t_from: float | None = None,
    t_to: float | None = None,
    settle_from_s: float | None = None,
) -> float | None:
    """One metric of a flight from t_from to t_to (s); None for one without a value."""
    return EngagedTicks.of(plant, fcu, settle_from_s).metric(name, t_from, t_to)
