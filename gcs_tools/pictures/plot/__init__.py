"""Figures of a flight: `gcs plot` draws the standard ones, `overview.flight_figure` that of `gcs fly`.

matplotlib is imported when something is drawn, not before: it takes longer than all else.
"""
