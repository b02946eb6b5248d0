"""Command-line options that several of the programs have, and how they are read."""

from __future__ import annotations

import click

SLOWEST_HZ, FASTEST_HZ = 50.0, 2000.0


def speed(_context: click.Context, _option: click.Parameter, value: str) -> float | None:
    """Simulated seconds a second; None for "max". Raises BadParameter."""
    if value == "max":
        return None
    try:
        number = float(value)
    except ValueError:
        number = 0.0
    if not 0.0 < number < 1e6:
        raise click.BadParameter(f"expected a number above 0 and below 1e6, or max; got {value}")
    return number


def rate_hz(_context: click.Context, _option: click.Parameter, value: float) -> float:
    """A control rate. Raises BadParameter, also for what is not a number."""
    if not SLOWEST_HZ <= value <= FASTEST_HZ:
        raise click.BadParameter(f"expected {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz, got {value:g}")
    return value
