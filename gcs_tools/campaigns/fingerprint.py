"""What the bits of a flight depend on: the project's sources, its versions, and the arithmetic here.

Two machines whose fingerprints are equal fly a campaign's flights to the same bits.
"""

from __future__ import annotations

import hashlib
import json
import platform
from importlib.metadata import version

from fcu.kernel import compile
from gcs_tools.campaigns.batch import VEHICLE, OrderedFlight, fly_batch

PROBE = {
    "title": "A short flight whose every bit is compared.",
    "flight": {
        "duration_s": 2.0,
        "setpoints": [[0.0, 1.0, -2.0, 3.0]],
        "yaw": {"amplitude_rad": 0.5, "frequency_rad_s": 3.0},
        "seed": 7,
    },
    "plant": {"noise": {"position_m": 0.01, "attitude_deg": 0.2}},
    "wind": {
        "amplitude_m_s": [7.2, 7.2, 5.7],
        "frequency_rad_s": [1.5, 1.6, 1.7],
        "azimuth_deg": 30.0,
    },
}


def fingerprint() -> dict[str, str]:
    """Versions, a hash of the sources, and of a short flight that is flown for it."""
    plan = json.dumps({"name": "probe", "fly": VEHICLE, "flights": 1, "laws": [{"given": PROBE}]})
    flown = repr(fly_batch(plan, [OrderedFlight(0, 0, {})]))  # every digit, of metrics too
    python = ".".join(platform.python_version_tuple()[:2])
    names = ("m-mrac", "numba", "numpy")
    return {
        **{name: version(name) for name in names},
        "python": python,
        "sources": compile.digest(),
        "bits": hashlib.sha256(flown.encode()).hexdigest()[:16],
    }


def of_the_draws() -> dict[str, str]:
    """What draws depend on, which the process that leads a campaign makes alone."""
    return {"scipy": version("scipy")}
