"""What the default gains are chosen for (docs/gains.md), in the flights that its table is made of."""

from __future__ import annotations

import pytest

from fcu.interface.airframe import believed
from fcu.process.settings import settings
from gcs_tools.studies.gains import pairs


@pytest.mark.slow
def test_the_defaults_track_as_they_were_chosen_to():
    law = settings(*believed(), 500.0).law
    (found,) = pairs([(law.f_m, law.gamma)])
    assert found.refused == ""
    assert found.nominal <= 0.012
    assert max(found.lags) <= 1.1 * found.nominal  # m, from 20 to 120 ms where 50 are believed
    assert found.noisy <= 0.02
    assert found.drop <= 0.03
    assert found.eight <= 0.02
