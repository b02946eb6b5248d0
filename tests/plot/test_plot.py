"""The figure is drawn of any flight, and thinning a line keeps its peaks."""

from pathlib import Path

import numpy as np
import pytest

from fcu.kernel.buffers import columns, size
from fcu.kernel.rows import column
from fcu.process.settings import Settings
from fcu.process.tick import Tick
from gcs_tools.pictures.plot.overview import flight_figure
from gcs_tools.pictures.plot.style import POINTS, thin
from gcs_tools.recording.table import Table
from sitl_plant.physics.types import PlantRecord


def test_thinning_keeps_the_peaks() -> None:
    t = np.arange(100_001) / 500.0
    y = np.sin(t)
    y[[12_345, 54_321, 100_000]] = 7.0, -9.0, 5.0
    at, thinned = thin(t, y)
    assert len(at) <= 2 * POINTS
    assert (np.diff(at) >= 0.0).all()
    for peak in (12_345, 54_321, 100_000):
        assert y[peak] in thinned and t[peak] in at


@pytest.mark.slow
@pytest.mark.parametrize(("n", "bad"), [(0, False), (1, False), (5000, True)])
def test_any_flight_is_drawn(tmp_path: Path, n: int, bad: bool) -> None:
    random = np.random.default_rng(1)
    plant, fcu = random.random((n, size(PlantRecord))), random.random((n, size(Tick)))
    if bad:
        plant[n // 2 :], fcu[n // 2 :] = np.nan, np.inf
    plant[:, 0] = fcu[:, 0] = np.arange(n) / 500.0
    column(Tick, fcu, "engaged")[:] = 2.0
    params = dict(zip(columns(Settings), random.random(size(Settings)), strict=True))
    path = tmp_path / "flight.png"
    truth, told = Table.of(PlantRecord, plant), Table.of(Tick, fcu)
    flight_figure(truth, told, params, "A flight of noise.", path)
    assert path.read_bytes().startswith(b"\x89PNG")
