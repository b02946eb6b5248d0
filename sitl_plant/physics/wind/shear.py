"""Growth of a steady wind with height: logarithmic, or by a power. MIL-F-8785C, 3.7.3.3, and IEC 61400-1."""

from __future__ import annotations

import math

from fcu.kernel.compile import kernel

NONE, LOG, POWER = 0.0, 1.0, 2.0


@kernel
def factor(kind, height, reference, roughness, exponent):
    """Wind at a height (m above ground) over that at the reference height (m).

    LOG: ln(height / roughness) / ln(reference / roughness), and 0 below the roughness (m).
    POWER: (height / reference) ** exponent, and 0 below the ground.
    """
    if kind == LOG:
        return math.log(max(height, roughness) / roughness) / math.log(reference / roughness)
    if kind == POWER:
        return math.pow(max(height, 0.0) / reference, exponent)
    return 1.0
