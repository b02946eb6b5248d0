"""The wind that a flight meets in a field, the eddies that the grid leaves out, and beliefs that cover both."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gcs_tools.wind_fields.sample import is_known, velocity
from sitl_plant.physics.wind.field import Field

Array = np.ndarray[Any, Any]

SMALLEST_M = 1.0  # eddies that are smaller even out over a vehicle
CELLS = 2  # the smallest eddy that a grid has, in cells


class FlightInField(NamedTuple):
    """A flight as a field has it, with what is not in the field beside it."""

    lasts_s: float
    fastest_m_s: float  # of the vehicle, over ground
    wind_m_s: float  # greatest speed of the air
    rate_m_s2: float  # greatest change of the air that the vehicle meets
    eddy_m: float  # smaller eddies are not in the field, along its coarsest axis
    unresolved_m_s: float  # their speed
    unresolved_m_s2: float  # their change as the vehicle meets it
    outside: float  # share of the flight that is outside the field, or in its buildings
    after_s: float  # time of the flight after the last time of the field, which holds on
    jump_m_s: float  # of the wind where the field begins anew, in no rate

    @property
    def guard_wind_m_s(self) -> float:
        """The belief of the wind that covers the flight."""
        return self.wind_m_s + self.unresolved_m_s

    @property
    def guard_wind_rate_m_s2(self) -> float:
        """The belief of the wind's rate that covers the flight."""
        return self.rate_m_s2 + self.unresolved_m_s2

    def lines(self) -> list[str]:
        """For people."""
        part = "a part" if self.outside < 0.01 else f"{self.outside:.0%}"
        known = "the part of the flight in the field" if self.outside else "this flight"
        return [
            *([f"{part} of it is outside the field or in a building, where nothing is known"] if self.outside else []),
            *([f"{self.after_s:.3g} s of it are after the field's last time, which holds there"] if self.after_s else []),
            *([f"the wind jumps by {self.jump_m_s:.3g} m/s where the field begins anew: no rate covers it"] if self.jump_m_s else []),
            f"the wind reaches {self.wind_m_s:.3g} m/s and changes by up to {self.rate_m_s2:.3g} m/s^2",
            f"in {self.lasts_s:.3g} s at up to {self.fastest_m_s:.3g} m/s over ground",
            f"eddies below {self.eddy_m:.3g} m are not in the field: by Kolmogorov they add",
            f"{self.unresolved_m_s:.3g} m/s, and {self.unresolved_m_s2:.3g} m/s^2 down to {SMALLEST_M:g} m",
            f"guard_wind_m_s {self.guard_wind_m_s:.3g} and guard_wind_rate_m_s2 {self.guard_wind_rate_m_s2:.3g} cover {known}",
        ]  # fmt: skip

    def numbers(self) -> dict[str, float]:
        """For programs."""
        return {
            **self._asdict(),
            "guard_wind_m_s": self.guard_wind_m_s,
            "guard_wind_rate_m_s2": self.guard_wind_rate_m_s2,
        }


def _steps(axis: Array, at: Array) -> Array:
    """Steps of an axis (m) about places on it (m)."""
    steps = np.diff(axis)
    found: Array = steps[np.clip(np.searchsorted(axis, at) - 1, 0, len(steps) - 1)]
    return found


def along(
    field: Field, t: Array, r: Array, scale: float = 1.0, repeats: bool = False
) -> FlightInField:
    """The wind that a flight meets.

    t : s, (n,), rising, of the field.  r : m, (n, 3), of the field.  scale : of its velocities.
    repeats : the times of the field begin anew after their end.

    The grid has no eddy below two cells. Between points r apart, eddies make a difference of speed that grows
    with the cube root of r (Kolmogorov, Dokl. Akad. Nauk SSSR 30, 1941). Along each axis it is carried on from the
    difference over two cells about the flight, and the greatest counts. The shear of the mean wind
    is in that difference, too.
    """

    def met(at: Array) -> Array:
        return scale * velocity(field, at, t, repeats)

    known = is_known(field, r)
    v_air = met(r)
    v = np.diff(r, axis=0) / np.diff(t)[:, None]
    change = np.linalg.norm(np.diff(v_air, axis=0), axis=1)
    ends, lasts = float(field.t[-1]), float(field.t[-1] - field.t[0])
    again = np.zeros(len(change), dtype=bool)
    if repeats and lasts > 0.0:
        again = np.diff(np.where(t > ends, np.floor((t - field.t[0]) / lasts), 0.0)) > 0.0
    rate = np.where(again, 0.0, change / np.diff(t))
    past = np.linalg.norm(v_air[1:] - v, axis=1).max()  # air that passes the vehicle
    coarsest, speed, gradient = 0.0, 0.0, 0.0
    for i, axis in enumerate((field.u.x, field.v.y, field.w.z)):
        if len(axis) == 1:
            continue
        eddy = CELLS * _steps(np.asarray(axis), r[:, i])
        coarsest = max(coarsest, float(eddy.max()))
        left_out = eddy > SMALLEST_M
        for sign in (-1.0, 1.0):
            aside = r + sign * eddy[:, None] * np.eye(3)[i]
            differs = left_out * np.linalg.norm(met(aside) - v_air, axis=1)
            speed = max(speed, float(differs.max()))
            smallest = differs / eddy * (eddy / SMALLEST_M) ** (2.0 / 3.0)
            gradient = max(gradient, float(smallest.max()))
    return FlightInField(
        lasts_s=float(t[-1] - t[0]),
        fastest_m_s=float(np.linalg.norm(v, axis=1).max()),
        wind_m_s=float(np.linalg.norm(v_air, axis=1).max()),
        rate_m_s2=float(rate.max()),
        eddy_m=coarsest,
        unresolved_m_s=speed,
        outside=float(np.mean(~known)),
        after_s=0.0 if repeats or lasts == 0.0 else max(float(t[-1]) - ends, 0.0),
        jump_m_s=float(change[again].max(initial=0.0)),
        unresolved_m_s2=gradient * past,
    )
