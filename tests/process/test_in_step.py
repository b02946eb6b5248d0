"""Rows that one side dropped in real time leave with those of the other."""

from __future__ import annotations

import numpy as np

from gcs_tools.flight.scripted_flight import in_step


def rows(*times):
    return np.array([[t, 10 * t] for t in times], dtype=float)


def test_only_ticks_of_both_are_kept():
    plant, fcu = in_step(rows(0, 1, 2, 5, 6, 7), rows(0, 2, 3, 4, 5, 7))
    assert plant[:, 0].tolist() == fcu[:, 0].tolist() == [0, 2, 5, 7]


def test_the_row_that_says_how_it_ended_stays():
    plant, fcu = in_step(rows(0, 2, 3), rows(0, 1, 2))
    assert plant[:, 0].tolist() == [0, 2, 3]
    assert fcu[:, 0].tolist() == [0, 2]


def test_no_ticks_are_in_step_with_no_ticks():
    plant, fcu = in_step(rows(0)[:0], rows(0)[:0])
    assert len(plant) == len(fcu) == 0
