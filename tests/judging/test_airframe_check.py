"""Numbers of an airframe before it flies, held against plain sums."""

from __future__ import annotations

import pytest

from fcu.interface.airframe import SHIPPED, read
from gcs_tools.judging.airframe_check import RATE_HZ, _hover_time
from sitl_plant.physics.parameters import plant_params
from sitl_plant.physics.truth import truth


@pytest.mark.parametrize("name", ["s1000", "quad"])
def test_hover_at_its_mean_power_for_its_time_takes_what_the_battery_holds(name) -> None:
    """A cell gives 3 to 4.2 V, from empty to full."""
    file = read(SHIPPED[name])
    battery = plant_params(truth(file), RATE_HZ).battery
    seconds, power = _hover_time(file)
    assert 60.0 < seconds < 3600.0
    energy = seconds * power  # J
    assert 3.0 < energy / (battery.capacity * battery.cells) < 4.2
