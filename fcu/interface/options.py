"""Command-line options that several of the programs have, and how they are read."""

from __future__ import annotations

from typing import Any

import click

SLOWEST_HZ, FASTEST_HZ = 50.0, 2000.0
LATEST_S = 1e7  # of simulation time: four months
AIRFRAME = click.option("--airframe", metavar="NAME|FILE.toml", help="Vehicle: the name of a shipped airframe, or a file of yours; default: the mission's, or s1000.")  # fmt: skip
ORIGIN = (47.397742, 8.545594, 489.4)  # latitude, longitude (deg), m above the sea: PX4's home


class WholeNumber(click.IntRange):
    """A whole number, refused with the numbers that are expected."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> int:  # fmt: skip
        """Read a number. Raises BadParameter."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            raise _refused(value, "a whole number", self, param, ctx) from error


class Number(click.FloatRange):
    """A number, refused with the numbers that are expected."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:  # fmt: skip
        """Read a number. Raises BadParameter."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            raise _refused(value, "a number", self, param, ctx) from error


def _refused(
    value: Any, kind: str, of: click.IntRange | click.FloatRange,
    option: click.Parameter | None, context: click.Context | None,
) -> click.BadParameter:  # fmt: skip
    """The error of a number that is none, or out of range."""
    least, most = (f"{each:g}" if isinstance(each, float) else each for each in (of.min, of.max))
    if most is None:
        kind += f" {'>' if of.min_open else '>='} {least}"
    else:
        kind += f" from {least} to {most}"
    return click.BadParameter(f"{value!r}: expected {kind}", context, option)


def speed(_context: click.Context, option: click.Parameter, value: str) -> float | None:
    """Simulated seconds a second; None for "max". Raises BadParameter."""
    if value == "max":
        return None
    try:
        number = float(value)
    except ValueError:
        number = 0.0
    if not 1e-3 <= number < 1e6:
        or_max = "" if option.metavar == "N" else ", or max"
        raise click.BadParameter(f"expected 0.001 to 1e6{or_max}; got {value}")
    return number


def time_s(_context: click.Context, _option: click.Parameter, value: float) -> float:
    """A simulation time. Raises BadParameter, also for what is not a number."""
    if not 0.0 <= value <= LATEST_S:
        raise click.BadParameter(f"expected 0 to {LATEST_S:g} s, got {value:g}")
    return value


def rate_hz(_context: click.Context, _option: click.Parameter, value: float) -> float:
    """A control rate. Raises BadParameter, also for what is not a number."""
    if not SLOWEST_HZ <= value <= FASTEST_HZ:
        raise click.BadParameter(f"expected {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz, got {value:g}")
    return value
