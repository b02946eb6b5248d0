"""The charts of a flight: which quantities, held against which truth or limit."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gcs_tools.pictures.history import XYZ, FlightHistory, Limits, Series
from gcs_tools.pictures.plot.style import INK, THREE, X, Y

LEAST_ERROR_M = 1e-3  # the error axis is logarithmic: less is drawn as this


class Line(NamedTuple):
    """One line of a chart, and what stands behind it, wide and pale: what it is held against."""

    label: str
    colour: str
    of: Callable[[FlightHistory], Series]
    behind: Callable[[FlightHistory], Series] | None = None
    behind_is: str = "truth"


class Chart(NamedTuple):
    """One chart over time."""

    title: str
    unit: str
    lines: tuple[Line, ...]
    least: float  # of the quantity is shown, so that noise does not fill a chart
    about_zero: bool = True  # live, `least` is shown around zero; False: lines are fitted closely
    digits: int = 2  # behind the point, in the caption
    limits: Callable[[Limits], tuple[float, ...]] = lambda limits: ()
    logarithmic: bool = False
    fine: float | None = None  # below this (of the unit) linear, above it logarithmic


def _law(name: str, scale: float = 1.0) -> Callable[[FlightHistory], Series]:
    """A column of the law; not a number while it does not fly."""

    def of(flight: FlightHistory) -> Series:
        t, values = flight.series(name)
        return t, np.where(flight.along(t, "engaged") > 0.5, scale * values, np.nan)

    return of


def _seen(name: str) -> Callable[[FlightHistory], Series]:
    """A column of anybody else."""
    return lambda flight: flight.series(name)


def _drag_over_mass(axis: str) -> Callable[[FlightHistory], Series]:
    """The truth of s_v_hat."""
    return lambda flight: flight.drag_over_mass(axis)


def _position_error(flight: FlightHistory) -> Series:
    """Of the true position against the reference model, as in gcs_tools.judging.metrics."""
    t = flight.series("outputs.reference.r_m.x")[0]
    squares = [
        (flight.along(t, f"state.r_E.{axis}") - flight.along(t, f"outputs.reference.r_m.{axis}"))
        ** 2
        for axis in XYZ
    ]
    flies = flight.along(t, "engaged") > 0.5
    return t, np.where(flies, np.sqrt(squares[0] + squares[1] + squares[2]), np.nan)


def _axes(
    of: Callable[[str], Callable[[FlightHistory], Series]],
    truth: Callable[[str], Callable[[FlightHistory], Series]] | None = None,
    labels: tuple[str, str, str] = ("east", "north", "up"),
) -> tuple[Line, ...]:
    """Three lines, of the components of a vector."""
    return tuple(
        Line(label, colour, of(axis), None if truth is None else truth(axis))
        for axis, label, colour in zip(XYZ, labels, THREE, strict=True)
    )


_DEGREES = 180.0 / np.pi


def _tilt(limits: Limits) -> tuple[float, ...]:
    return -_DEGREES * limits.phi_star, _DEGREES * limits.phi_star


FLIGHT = (
    Chart("Distance from the reference", "m", (Line("", INK, _position_error),),
          least=1.0, digits=3, logarithmic=True),
    Chart("Velocity prediction error", "m/s", _axes(lambda a: _law(f"internals.prediction.v_til.{a}")),
          least=0.01, digits=4, fine=0.002),
    Chart("Drag over mass", "m/s²", _axes(lambda a: _law(f"state.estimates.s_v_hat.{a}"), _drag_over_mass),
          least=1.0),
    Chart("Mass", "kg", (Line("estimate", X, _law("state.estimates.m_hat"), _seen("m")),), least=1.0,
          about_zero=False),
    Chart("Thrust", "N", (Line("commanded", X, _law("outputs.T_c"),
                               _law("outputs.T_achieved"), "achieved"),),
          least=1.0, digits=1, limits=lambda limits: (limits.T_min, limits.T_max)),
    Chart("Commanded tilt", "°", (Line("roll", X, _law("outputs.angles_c.x", _DEGREES)),
                                  Line("pitch", Y, _law("outputs.angles_c.y", _DEGREES))),
          least=1.0, digits=1, limits=_tilt),
    Chart("Wind", "m/s", _axes(lambda a: _seen(f"wind.v_air_E.{a}"), lambda a: _seen(f"v_air_E.{a}")),
          least=1.0, digits=1),
)  # fmt: skip
RATES = (
    Chart("Rate prediction error", "rad/s",
          _axes(lambda a: _law(f"internals.prediction.w_til.{a}"), labels=("roll", "pitch", "yaw")),
          least=0.01, digits=4, fine=0.01),
    Chart("Inertia", "kg m²",
          _axes(lambda a: _law(f"state.estimates.J_hat.{a}"), lambda a: _seen(f"J.{a}"), ("x", "y", "z")),
          least=0.1, about_zero=False, digits=3),
)  # fmt: skip
