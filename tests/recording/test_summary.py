"""What a recording off the bus came to."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_tools.live.recorder import RecordingSummary
from gcs_tools.live.samples import Sample
from gcs_tools.recording.schema import TRUTH


def ticks(*times_s):
    n = len(times_s)
    times_ns = np.rint(1e9 * np.array(times_s)).astype(np.uint64)
    return Sample(np.arange(n, dtype=np.uint64), times_ns, [b""] * n)


def test_the_time_of_a_flight_before_a_reset_counts():
    summary = RecordingSummary()
    for sample in (ticks(50.0, 50.5), ticks(51.0, 52.0), ticks(0.0, 1.0), ticks(1.0, 3.0)):
        summary.see(TRUTH, sample)
    assert summary.least_s == pytest.approx(2.0 + 3.0)
    summary.see(TRUTH, ticks(0.0, 0.25))
    assert summary.least_s == pytest.approx(2.0 + 3.0 + 0.25)
