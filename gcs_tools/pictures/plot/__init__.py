"""Figures of a flight: `gcs plot` draws the standard ones, `flight_figure` the overview.

matplotlib is imported when something is drawn, not before: it takes longer than all else.
"""

from gcs_tools.pictures.plot.overview import flight_figure
from gcs_tools.pictures.plot.style import POINTS, thin

__all__ = ["POINTS", "flight_figure", "thin"]
