"""Figures of a flight: `gcs plot` draws the standard ones, `flight_figure` the overview.

matplotlib is imported when something is drawn, not before: it takes longer than all else.
"""

from gcs_tools.pictures.plot.drawing import POINTS, thin
from gcs_tools.pictures.plot.flight import flight_figure

__all__ = ["POINTS", "flight_figure", "thin"]
