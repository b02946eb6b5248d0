"""Numbers of a figure, and how they are said."""

from __future__ import annotations

import math

import numpy as np

from gcs_tools.recording.table import Rows

Numbers = dict[str, float | None]  # each key carries its unit; None: without a value


def finite(value: float) -> float | None:
    """None for what is not a number to report."""
    return float(value) if math.isfinite(value) else None


def rms(error: Rows) -> float | None:
    """Root of the mean square; None without samples, or with one that is not finite."""
    if not len(error) or not np.isfinite(error).all():
        return None
    with np.errstate(over="ignore"):
        return finite(math.sqrt(float(np.mean(error * error))))


def greatest(values: Rows) -> float | None:
    """The greatest of the finite values; None without any."""
    seen = values[np.isfinite(values)]
    return float(seen.max()) if len(seen) else None


def least(values: Rows) -> float | None:
    """The least of the finite values; None without any."""
    seen = values[np.isfinite(values)]
    return float(seen.min()) if len(seen) else None


def short(value: float, digits: int = 3) -> str:
    """A number in a few digits, written out up to a million."""
    return f"{value:.0f}" if 999.5 <= abs(value) < 1e6 else f"{value:.{digits}g}"


def said(value: float | None, unit: str) -> str:
    """A value as text, with its unit."""
    return f"no value ({unit})" if value is None else f"{short(value)} {unit}"


def length(metres: float | None) -> str:
    """A length in the unit a person would choose."""
    if metres is None:
        return "no value"
    if metres < 0.01:
        return f"{short(1e3 * metres, 2)} mm"
    if metres < 0.995:
        return f"{short(1e2 * metres, 2)} cm"
    return f"{short(metres)} m"


def percent(fraction: float | None) -> str:
    """Format a fraction as a percentage. Small values that are not zero are never printed as 0."""
    if fraction is None:
        return "no value"
    hundredths = 100.0 * fraction
    return "below 0.1 %" if 0.0 < hundredths < 0.1 else f"{hundredths:.3g} %"
