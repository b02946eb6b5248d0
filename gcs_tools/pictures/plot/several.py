"""How far off were several flights? Their errors in one figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gcs_tools.judging.metrics import EngagedTicks
from gcs_tools.pictures.plot.style import GREY, INK, STYLE, TIME, legend, line, logarithmic

SIZE = (12.0, 8.0)  # inches
QUESTION = "How far off were they?"
LEAST_M = 1e-3  # what is less is drawn there
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", INK)
NAMED = len(COLOURS)  # flights with a colour of their own; of more all are drawn alike
PANELS = {
    "Distance from the setpoint that the mission asks for, m": "setpoint_error",
    "Distance from the reference model, m": "reference_error",
}
METRICS = (
    "setpoint_error_rms_settled_m", "setpoint_error_final_m", "reference_error_rms_settled_m",
    "reference_error_max_m",
)  # fmt: skip

Numbers = dict[str, dict[str, float | None]]


def save(
    flights: Mapping[str, EngagedTicks], path: Path, kind: str, remarks: Sequence[str] = ()
) -> Numbers:
    """Draw the errors of flights, by name, to `path` as `kind`; the metrics of each.

    remarks : what is to be known of them, in the figure too. Raises OSError if it cannot be written.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        figure = Figure(figsize=SIZE, layout="constrained")
        figure.suptitle(QUESTION, x=0.012, ha="left", fontsize=13.0, fontweight="bold", color=INK)
        panels = figure.subplots(len(PANELS), 1, sharex=True)
        for axes, (title, error) in zip(panels, PANELS.items(), strict=True):
            axes.set_title(title)
            logarithmic(axes, "y")
            for i, (name, flight) in enumerate(flights.items()):
                values = getattr(flight, error)
                if not np.isfinite(values).any():
                    continue
                few = len(flights) <= NAMED
                line(
                    axes, flight.t, np.maximum(values, LEAST_M), label=name if few else None,
                    color=COLOURS[i] if few else INK, alpha=1.0 if few else 0.35,
                )  # fmt: skip
            if axes.get_lines():
                legend(axes)
        panels[-1].set_xlabel(TIME)
        if remarks:
            figure.supxlabel("\n".join(remarks), x=0.012, ha="left", fontsize=8.0, color=GREY)
        figure.savefig(path, format=kind, dpi=110)
    return {name: {m: flight.metric(m) for m in METRICS} for name, flight in flights.items()}
