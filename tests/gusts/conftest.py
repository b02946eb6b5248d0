"""A vehicle that hovers, at the end of the beliefs that torque finds weakest."""

from __future__ import annotations

import pytest

from gcs_tools.flight.scenario import scenario
from gcs_tools.gusts.ends import ends
from gcs_tools.missions.mission import from_tables

HOVER = {
    "title": "Hover.",
    "flight": {"duration_s": 4.5, "setpoints": [[0.0, 0.0, 0.0, 0.0]], "ground_z_m": -1e4},
    "law": {"guard": "govern"},
}


@pytest.fixture(scope="session")
def hover():
    return scenario(from_tables("hover", HOVER))


@pytest.fixture(scope="session")
def weakest(hover):
    return next(end for end in ends(hover) if end.mass_kg < 8.0 and end.rotor_lag_s > 0.07)


@pytest.fixture(scope="session")
def level():
    """Ten metres to the north, and there."""
    flight = {**HOVER["flight"], "duration_s": 14.0, "setpoints": [[0.0, 10.0, 0.0, 0.0]]}
    return scenario(from_tables("level", {**HOVER, "flight": flight}))
