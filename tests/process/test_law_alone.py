"""A law flown alone, for studies: as a whole vehicle flies it, while its autopilot only passes setpoints on."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools.flight import law_alone
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.run import prepared

NOISY = "plant.noise={position_m=0.01, velocity_m_s=0.02, attitude_deg=0.2, rate_rad_s=0.01}"


@pytest.mark.parametrize(
    ("mission", "settings"),
    [
        ("noisy_state", ["flight.duration_s=3", "plant.delay_s=0.02"]),
        ("take_off", ["flight.duration_s=9", NOISY, "plant.delay_s=0.01"]),
        ("figure_eight", ["flight.duration_s=3"]),
        ("paper_printed_fast", ["flight.duration_s=3"]),
        (
            "weak_rotor",
            ["flight.duration_s=3", "plant.rotor_loss=[{rotor=1, at_s=1.0, effectiveness=0.6}]"],
        ),
    ],
)
def test_every_row_is_the_vehicles(mission, settings):
    _, scene = prepared(mission, settings)
    plant, fcu = law_alone.fly(scene)
    flown = MemoryFlight(scene, None, (lambda rows: None, lambda rows: None)).fly()
    assert len(plant) == len(flown.plant) > 1000
    assert plant.tobytes() == np.ascontiguousarray(flown.plant).tobytes()
    assert fcu.tobytes() == np.ascontiguousarray(flown.fcu).tobytes()
