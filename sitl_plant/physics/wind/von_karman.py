"""Von Karman turbulence, as a sum of Dryden turbulences of several lengths. MIL-F-8785C, 3.7.1.1.

Von Karman's longitudinal spectrum, (1 + (1.339 w)^2)^(-5/6) with w = omega L / V, is a mixture of Dryden's 1 / (1 + w^2):
(1 + x)^(-5/6) is a Stieltjes function. Across the wind isotropy makes of each the other half of its pair, so the
same mixture serves. Five lengths hold the standard's spectra to 1.5 % along the wind and 2.5 % across, for w from
0.01 to 1000. The rational filters of MIL-HDBK-1797 leave them beyond w = 10, where a small vehicle flies. Variances are
shared out so that their sum is 1.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Vec3
from fcu.kernel.compile import kernel
from sitl_plant.physics.wind import dryden

MODES = 5
STATES = MODES * dryden.STATES
# length over L and share of the variance: least squares of the logarithm of the spectrum
_LENGTHS = 1.2265, 0.31133, 0.056681, 0.010105, 0.00164
_SHARES = 0.77255, 0.15625, 0.04972, 0.01586, 0.00562
_INVERSE = tuple(1.0 / length for length in _LENGTHS)
_GAINS = tuple(math.sqrt(share / sum(_SHARES)) for share in _SHARES)


@kernel
def begin(x, n):
    """Draw the states from their stationary distribution.  x, n : float64[STATES], n normal."""
    for i in range(MODES):
        dryden.begin(x, n, i * dryden.STATES)


@kernel
def step(x, h, n):
    """Go on by `h` (V dt / L, by axis).  x, n : float64[STATES], n normal."""
    for i in range(MODES):
        dryden.step(x, _INVERSE[i] * h, n, i * dryden.STATES)


@kernel
def output(x):
    """Turbulence of variance 1 by axis: along the wind, across, up."""
    v = Vec3(0.0, 0.0, 0.0)
    for i in range(MODES):
        v = v + _GAINS[i] * dryden.output(x, i * dryden.STATES)
    return v
