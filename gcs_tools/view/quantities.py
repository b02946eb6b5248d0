"""The charts of a flight: which quantities, held against which truth or limit."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gcs_tools.layout import Rows
from gcs_tools.plot import INK, THREE, X, Y
from gcs_tools.view.source import HALF_US, Flight, History, Limits

Series = tuple[Rows, Rows]  # times, s, and values
LEAST_ERROR_M = 1e-3  # the error axis is logarithmic: less is drawn as this


class Line(NamedTuple):
    """One line of a chart, and what stands behind it, wide and pale: what it is held against."""

    label: str
    colour: str
    of: Callable[[Flight], Series]
    behind: Callable[[Flight], Series] | None = None
    behind_is: str = "truth"


class Chart(NamedTuple):
    """One chart over time."""

    title: str
    unit: str
    lines: tuple[Line, ...]
    least: float  # of the quantity is shown, so that noise does not fill a chart
    digits: int = 2  # behind the point, in the caption
    limits: Callable[[Limits], tuple[float, ...]] = lambda limits: ()
    logarithmic: bool = False
    fine: float | None = None  # below this (of the unit) linear, above it logarithmic


def flying(fcu: History, values: Rows) -> Series:
    """Values of the law; not a number while it does not fly."""
    return fcu["t"], np.where(fcu["engaged"] > 0.5, values, np.nan)


def _law(name: str, scale: float = 1.0) -> Callable[[Flight], Series]:
    return lambda flight: flying(flight.fcu, scale * flight.fcu[name])


def _truth(name: str) -> Callable[[Flight], Series]:
    return lambda flight: (flight.plant["t"], flight.plant[name])


def _estimate(name: str) -> Callable[[Flight], Series]:
    return lambda flight: (flight.wind["t"], flight.wind[name])


def _drag_over_mass(axis: str) -> Callable[[Flight], Series]:
    def of(flight: Flight) -> Series:
        plant = flight.plant
        return plant["t"], plant[f"f_D_E.{axis}"] / plant["m"]

    return of


def _position_error(flight: Flight) -> Series:
    """Of the true position against the reference model, as in gcs_tools.metrics."""
    fcu, plant = flight.fcu, flight.plant
    if not len(plant) or not len(fcu):
        return fcu["t"], np.full(len(fcu), np.nan)
    at = np.searchsorted(plant["t"], fcu["t"] + HALF_US, side="right") - 1
    away = plant.vector("state.r_E")[np.maximum(at, 0)] - fcu.vector("internals.r_m")
    error = np.where(at >= 0, np.sqrt((away * away).sum(axis=1)), np.nan)
    return flying(fcu, error)


def _axes(
    of: Callable[[str], Callable[[Flight], Series]],
    truth: Callable[[str], Callable[[Flight], Series]] | None = None,
    labels: tuple[str, str, str] = ("east", "north", "up"),
) -> tuple[Line, ...]:
    """Three lines, of the components of a vector."""
    return tuple(
        Line(label, colour, of(axis), None if truth is None else truth(axis))
        for axis, label, colour in zip("xyz", labels, THREE, strict=True)
    )


_DEGREES = 180.0 / np.pi


def _tilt(limits: Limits) -> tuple[float, ...]:
    return -_DEGREES * limits.phi_star, _DEGREES * limits.phi_star


FLIGHT = (
    Chart("Distance from the reference", "m", (Line("", INK, _position_error),),
          least=1.0, digits=3, logarithmic=True),
    Chart("Velocity prediction error", "m/s", _axes(lambda a: _law(f"internals.v_til.{a}")),
          least=0.01, digits=4, fine=0.002),
    Chart("Drag over mass", "m/s²", _axes(lambda a: _law(f"state.s_v_hat.{a}"), _drag_over_mass),
          least=1.0),
    Chart("Mass", "kg", (Line("estimate", X, _law("state.m_hat"), _truth("m")),), least=1.0),
    Chart("Thrust", "N", (Line("commanded", X, _law("internals.T_c"),
                               _law("internals.T_achieved"), "achieved"),),
          least=1.0, digits=1, limits=lambda limits: (limits.T_min, limits.T_max)),
    Chart("Commanded tilt", "°", (Line("roll", X, _law("internals.angles_c.x", _DEGREES)),
                                  Line("pitch", Y, _law("internals.angles_c.y", _DEGREES))),
          least=1.0, digits=1, limits=_tilt),
    Chart("Wind", "m/s", _axes(lambda a: _estimate(f"v_air_E.{a}"), lambda a: _truth(f"v_air_E.{a}")),
          least=1.0, digits=1),
)  # fmt: skip
RATES = (
    Chart("Rate prediction error", "rad/s",
          _axes(lambda a: _law(f"internals.w_til.{a}"), labels=("roll", "pitch", "yaw")),
          least=0.01, digits=4, fine=0.01),
    Chart("Inertia", "kg m²",
          _axes(lambda a: _law(f"state.J_hat.{a}"), lambda a: _truth(f"J.{a}"), ("x", "y", "z")),
          least=0.1, digits=3),
)  # fmt: skip
