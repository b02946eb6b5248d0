"""The quantities of a flight: a row of QUANTITIES is all that one needs to be shown.

A quantity with a `panel` is in that panel of `gcs monitor`, one with a `tab` is a chart in that tab
of `gcs view`, one with `axes` has axes in the overview of `gcs plot`; its columns are kept of what
arrives. One whose columns a law does not tell is left out. Columns are those of a recording, by
name, and those of DERIVED.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from fcu.interface.airframe import Airframe, believed, checked
from fcu.interface.files import input_file
from gcs_tools.pictures.plot.style import INK, THREE
from gcs_tools.recording.schema import TIMING, TRUTH
from gcs_tools.recording.table import Rows

XYZ = ("x", "y", "z")
ENU = ("east", "north", "up")
ANGLES = ("roll", "pitch", "yaw")
ROTORS = tuple(f"r{i}" for i in range(1, 9))
HALF, WHOLE = "half", "whole"  # of the width of the overview
DEGREES = 180.0 / math.pi


def parts(name: str, of: Sequence[str] = XYZ) -> tuple[str, ...]:
    """The columns of a Vec3, or of a Quat or Rotors."""
    return tuple(f"{name}.{part}" for part in of)


class ShownLimits(NamedTuple):
    """What the controller keeps to, or believes it does, and its rotors. SI units, rad."""

    T_min: float
    T_max: float
    phi_star: float  # of roll and of pitch
    Omega_max: tuple[float, ...]  # of each of the rotors there are
    x: tuple[float, ...]  # where they are, m, forward of the centre of mass
    y: tuple[float, ...]  # left of it
    gravity: float  # that s_v_hat has to find: none, but for the prediction as printed

    @classmethod
    def of(cls, params: Mapping[str, float]) -> ShownLimits:
        """Those of a law's parameters, by name; of what it does not have, not a number."""

        def told(name: str) -> float:
            return params.get(f"law.{name}", math.nan)

        return cls(
            T_min=told("limits.T_min"), T_max=told("limits.T_max"),
            phi_star=told("limits.phi_star"), Omega_max=of_rotor(params, "Omega_max"),
            x=of_rotor(params, "x"), y=of_rotor(params, "y"),
            gravity=told("g") if told("achieved") < 0.5 else 0.0,
        )  # fmt: skip

    @classmethod
    def believed(cls) -> ShownLimits:
        """Those of the airframe file, as long as a flight has not said others."""
        return cls._of_file(*believed())

    @classmethod
    def of_airframe(cls, text: str) -> ShownLimits:
        """Those of the text of an airframe file. Raises AirframeError, TomlError."""
        return cls._of_file(*checked(input_file.toml(text), "airframe"))

    @classmethod
    def _of_file(cls, rotors: Airframe, tables: Mapping[str, Any]) -> ShownLimits:
        limits, n = tables["limits"], rotors.n
        return cls(
            float(limits["thrust_min_n"]), float(limits["thrust_max_n"]),
            math.radians(float(limits["tilt_max_deg"])), rotors.Omega_max[:n],
            rotors.x[:n], rotors.y[:n], 0.0,
        )  # fmt: skip


def of_rotor(params: Mapping[str, float], name: str) -> tuple[float, ...]:
    """A parameter of each of the rotors there are, by name; of an older recording, of all the same."""
    one = params.get(f"law.rotors.{name}", math.nan)
    return tuple(params.get(f"law.rotors.{name}.{r}", one) for r in rotors_of(params))


def rotors_of(params: Mapping[str, float]) -> tuple[str, ...]:
    """The names of the rotors there are; of a law that does not tell, of all that there may be."""
    there = tuple(r for r in ROTORS if params.get(f"law.rotors.spin.{r}", 0.0) != 0.0)
    return there or ROTORS


Ends = tuple[()] | tuple[float, float]  # the least and the greatest, of what has limits


class Line(NamedTuple):
    """One line of a quantity, and the column that stands behind it, wide and pale."""

    label: str
    colour: str
    column: str
    truth: str | None


class Quantity(NamedTuple):
    """One number or a few of a kind, and where and how they are shown."""

    title: str
    unit: str
    columns: tuple[str, ...]
    labels: tuple[str, ...] = ("",)  # of the columns
    truth: tuple[str, ...] = ()  # a column for each, against which it is held
    truth_is: str = "truth"
    asked: tuple[str, ...] = ()  # a column for each: the setpoint
    digits: int = 2  # behind the point
    limits: Callable[[ShownLimits], Ends] = lambda limits: ()
    panel: str = ""  # of the monitor; "": none
    short: str = ""  # what the monitor calls it, before a label
    size: bool = False  # the monitor shows its length, not its components
    tab: str = ""  # of the page; "": none
    axes: str = ""  # of the overview: HALF or WHOLE; "": none
    colours: tuple[str, ...] = THREE
    least: float = 1.0  # of it is drawn, so that noise does not fill a chart
    about_zero: bool = True  # live, `least` is drawn around zero; False: lines are fitted closely
    logarithmic: float | None = None  # the least that its logarithmic axis shows; None: linear
    fine: float | None = None  # below this (of the unit) linear, above it logarithmic

    @property
    def lines(self) -> tuple[Line, ...]:
        """One for each column."""
        truth = self.truth or (None,) * len(self.columns)
        found = zip(self.labels, self.colours, self.columns, truth, strict=False)
        return tuple(Line(*each) for each in found)


QUANTITIES = (
    Quantity("Position", "m", parts("state.r_E"), ENU, parts("outputs.reference.r_m"), "reference",
             parts("setpoint.r_c"), least=0.0, axes=HALF),
    Quantity("Distance from the reference", "m", ("position_error",), colours=(INK,), digits=3,
             logarithmic=1e-3, panel="Tracking", short="off the reference", tab="Flight", axes=HALF),
    Quantity("Velocity prediction error", "m/s", parts("internals.prediction.v_til"), ENU, digits=4,
             least=0.01, fine=0.002, panel="Tracking", short="velocity predicted off", size=True,
             tab="Flight"),
    Quantity("Rate prediction error", "rad/s", parts("internals.prediction.w_til"), ANGLES, digits=4,
             least=0.01, fine=0.01, panel="Tracking", short="rate predicted off", size=True,
             tab="Rates"),
    Quantity("Thrust", "N", ("outputs.T_c",), ("commanded",), ("outputs.T_achieved",), "achieved",
             digits=1, limits=lambda limits: (limits.T_min, limits.T_max), panel="Limits",
             short="thrust", tab="Flight", axes=HALF),
    Quantity("Commanded tilt", "°", ("roll_c", "pitch_c"), ANGLES[:2], digits=1,
             limits=lambda limits: (-DEGREES * limits.phi_star, DEGREES * limits.phi_star),
             panel="Limits", tab="Flight", axes=HALF),
    Quantity("Control difference", "N", parts("internals.achieved.delta_u"), ENU, panel="Limits",
             short="Δu", size=True),
    Quantity("Drag over mass", "m/s²", parts("state.estimates.s_v_hat"), ENU, parts("drag_over_mass"),
             panel="Estimates", short="drag/mass ", tab="Flight", axes=WHOLE),
    Quantity("Mass", "kg", ("state.estimates.m_hat",), ("estimate",), ("m",), about_zero=False,
             panel="Estimates", short="mass, kg", tab="Flight", axes=HALF),
    Quantity("Inertia", "kg m²", parts("state.estimates.J_hat"), XYZ, parts("J"), digits=3, least=0.1,
             about_zero=False, panel="Estimates", short="inertia ", tab="Rates", axes=HALF),
    Quantity("Wind", "m/s", parts("wind.v_air_E"), ENU, parts("v_air_E"), panel="Wind",
             short="wind ", tab="Flight"),
    Quantity("Angular disturbance", "rad/s²", parts("state.estimates.s_w_hat"), ANGLES, digits=3,
             panel="Wind", short="disturbance "),
)  # fmt: skip
# in the place of the distance from a reference, for a law that has none
FROM_SETPOINT = Quantity("Distance from the setpoint", "m", ("setpoint_error",), colours=(INK,),
                         digits=3, logarithmic=1e-3, axes=HALF)  # fmt: skip
BY_TITLE = {quantity.title: quantity for quantity in QUANTITIES}
# the overview of a flight whose controller tells nothing of itself
OF_TRUTH = (
    Quantity("Position", "m", parts("state.r_E"), ENU, asked=parts("setpoint.r_c"), least=0.0,
             axes=HALF),
    FROM_SETPOINT,
    Quantity("Tilt", "°", ("roll", "pitch"), ANGLES[:2], digits=1, axes=HALF),
    Quantity("Rotor speeds", "rad/s", ("Omega_least", "Omega_mean", "Omega_most"),
             ("least", "mean", "greatest"), digits=0, about_zero=False, axes=HALF),
    Quantity("Velocity of the air", "m/s", parts("v_air_E"), ENU, axes=HALF),
    Quantity("Battery", "W", ("power",), ("power drawn",), digits=0, colours=(INK,), about_zero=False,
             axes=HALF),
)  # fmt: skip


class Derived(NamedTuple):
    """A quantity that nobody tells, from columns that are told."""

    columns: tuple[str, ...]
    of: Callable[..., Rows]  # (limits, the columns, each (n,)) -> (n,)


def _distance(_limits: ShownLimits, *both: Rows) -> Rows:
    """Between two points, of the components of the one and then of the other."""
    half = len(both) // 2
    distance: Rows = np.sqrt(sum(np.square(np.subtract(both[:half], both[half:]))))
    return distance


def _turning(of: Callable[[Rows], Rows]) -> Callable[..., Rows]:
    """A value of the speeds of the rotors that ever turn: others are absent, or their flight is over."""

    def speed(_limits: ShownLimits, *Omega: Rows) -> Rows:
        each = np.stack(Omega)
        turn = (each > 0.0).any(axis=1)
        return of(each[turn] if turn.any() else each)

    return speed


def _roll(_limits: ShownLimits, w: Rows, x: Rows, y: Rows, z: Rows) -> Rows:
    """Of a quaternion, in degrees."""
    roll: Rows = DEGREES * np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll


def _pitch(_limits: ShownLimits, w: Rows, x: Rows, y: Rows, z: Rows) -> Rows:
    """Of a quaternion, in degrees; nose down is positive, as body y points left."""
    pitch: Rows = DEGREES * np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return pitch


_Q_EB, _OMEGA = parts("state.q_EB", "wxyz"), parts("state.Omega", ROTORS)
DERIVED = {
    "setpoint_error": Derived((*parts("setpoint.r_c"), *parts("state.r_E")), _distance),
    "roll": Derived(_Q_EB, _roll),
    "pitch": Derived(_Q_EB, _pitch),
    "Omega_least": Derived(_OMEGA, _turning(lambda each: each.min(axis=0))),
    "Omega_mean": Derived(_OMEGA, _turning(lambda each: each.mean(axis=0))),
    "Omega_most": Derived(_OMEGA, _turning(lambda each: each.max(axis=0))),
    "power": Derived(
        ("battery.voltage", "battery.current"), lambda limits, volts, amperes: volts * amperes
    ),
    "position_error": Derived((*parts("outputs.reference.r_m"), *parts("state.r_E")), _distance),
    "wind_error": Derived((*parts("v_air_E", "xy"), *parts("wind.v_air_E", "xy")), _distance),
    "drag_over_mass.x": Derived(("f_D_E.x", "m"), lambda limits, f, m: f / m),
    "drag_over_mass.y": Derived(("f_D_E.y", "m"), lambda limits, f, m: f / m),
    # as printed, the estimate has to find gravity too
    "drag_over_mass.z": Derived(("f_D_E.z", "m"), lambda limits, f, m: f / m - limits.gravity),
    "roll_c": Derived(("outputs.angles_c.x",), lambda limits, angle: DEGREES * angle),
    "pitch_c": Derived(("outputs.angles_c.y",), lambda limits, angle: DEGREES * angle),
}
CONTRADICTED = ("lighter", "heavier", "drag", "thrust", "trim")
# what scene and panels show beside the quantities
BESIDE = (
    *parts("state.r_E"), *parts("state.v_E"), *parts("state.q_EB", "wxyz"),
    *parts("state.Omega", ROTORS), "on_ground", *parts("w_air_B"), "wind_error",
    "setpoint.level", "engaged", *parts("command.u", ROTORS),
    *parts("outputs.saturation", ("thrust", "tilt", "torque", "yaw")), "internals.flags.projected",
    "guard.governed", *parts("guard.margin", ("force", "tilt", "condition")),
    *parts("guard.contradicted", CONTRADICTED),
    *parts("status", ("armed", "main_mode", "sub_mode", "failsafe")),
    *parts("timing", ("cycle", "load", "late", "slips", "resent", "refused", "unrecorded",
                      "unpublished")),
)  # fmt: skip


def told(names: Iterable[str]) -> Iterator[str]:
    """The columns that somebody tells: of these, and of those that they are derived from."""
    for name in names:
        yield from DERIVED[name].columns if name in DERIVED else (name,)


_OF_QUANTITIES = (
    name for q in (*QUANTITIES, *OF_TRUTH) for name in (*q.columns, *q.truth, *q.asked)
)
SHOWN = frozenset(told((*BESIDE, *_OF_QUANTITIES)))


def kept(topics: Mapping[str, Iterable[str]]) -> dict[str, list[str]]:
    """Of the columns of each topic those that are shown: whole rows would be 100 MB a minute.

    What several tell under one name is taken of the truth, of the controller's times, or of the
    first of the others.
    """
    left, found = set(SHOWN), dict[str, list[str]]()
    for topic in sorted(topics, key=lambda topic: topic not in (TRUTH, TIMING)):
        found[topic] = [name for name in topics[topic] if name in left]
        left.difference_update(found[topic])
    return found
