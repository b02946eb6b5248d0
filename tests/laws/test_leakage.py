"""Departure 18: mass and vertical drag told apart, by what lasts."""

from __future__ import annotations

import numpy as np
import pytest

from fcu.kernel.rows import column
from fcu.process.tick import Tick
from gcs_tools.flight import law_alone
from gcs_tools.flight.run import prepared
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import from_tables

WIDE = "law.bounds={m_min=1.0, m_max=20.0}"
HOVER = {
    "title": "A hover.",
    "flight": {"duration_s": 20.0, "ground_z_m": -1e4, "setpoints": [[0.0, 0.0, 0.0, 0.0]]},
    "wind": {},
    "expect": {},
}


def m_hat_of(name, duration_s, *settings):
    _, scene = prepared(name, [f"flight.duration_s={duration_s}", *settings])
    _, rows = law_alone.fly(scene)
    assert len(rows) == scene.ticks
    return column(Tick, rows, "state.estimates.m_hat"), round(scene.rate_hz)


@pytest.mark.slow
@pytest.mark.parametrize("bounds", [(), (WIDE, "law.m_hat_0=5.0")], ids=["default", "wide set"])
@pytest.mark.parametrize(
    ("name", "duration_s"), [("noisy_state", 300.0), ("figure_eight", 120.0), ("gust_step", 60.0)]
)
def test_the_mass_stays_known(name, duration_s, bounds):
    m_hat, rate_hz = m_hat_of(name, duration_s, *bounds)
    assert abs(m_hat[-1] / 8.0 - 1.0) < 0.15
    assert np.abs(m_hat[5 * rate_hz :] / 8.0 - 1.0).max() < 0.25


@pytest.mark.slow
def test_noise_drives_the_estimate_away_without_leakage():
    m_hat, _ = m_hat_of("noisy_state", 120.0, WIDE, "law.sigma_v=0.0")
    assert m_hat[-1] < 5.0


@pytest.mark.slow
def test_a_package_is_noticed_within_two_seconds():
    both = "law.guard_mass_kg=[6.0, 9.0]", "law.bounds={m_min=6.0, m_max=9.0}"
    m_hat, rate_hz = m_hat_of("package_drop", 30.0, *both)
    assert abs(m_hat[-1] / 6.0 - 1.0) < 0.05
    assert np.abs(m_hat[14 * rate_hz :] / 6.0 - 1.0).max() < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("mass_kg", [7.0, 9.0])
def test_what_lasts_goes_over_into_the_mass_at_the_rate_of_leakage(mass_kg):
    def hovered(sigma_v):
        tables = {**HOVER, "law": {"sigma_v": sigma_v}, "plant": {"mass_kg": mass_kg}}
        scene = scenario(from_tables("hover", tables))
        _, rows = law_alone.fly(scene)
        return column(Tick, rows, "state.estimates.m_hat")[-1]

    assert hovered(1.0) == pytest.approx(mass_kg, rel=2e-3)
    assert abs(hovered(0.0) - mass_kg) > 0.1
