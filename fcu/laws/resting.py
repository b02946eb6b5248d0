"""What is recorded of a law that does not fly, unless it tells by itself: `idle`.

It remembers and computes nothing (zeros), and tells what is measured.
"""

from __future__ import annotations

import math

from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import size, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rotations import euler, matrix
from fcu.laws.face import Outputs, Reference, Saturation
from fcu.laws.mmrac.types import Internals, State

_state, _internals = unpacker(State), unpacker(Internals)
_NO_STATE, _NO_INTERNALS = (0.0,) * size(State), (0.0,) * size(Internals)


@kernel
def idle(measured):
    """(state, outputs, internals) of a law at rest."""
    zero, none = Vec3(0.0, 0.0, 0.0), Vec3(math.nan, math.nan, math.nan)
    angles = euler(matrix(measured.q_EB))
    outputs = Outputs(
        reference=Reference(r_m=none, v_m=none), e_r=none, T_c=0.0, T_achieved=0.0,
        angles=angles, angles_c=angles, w_c=zero,
        thrusts=Rotors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        saturation=Saturation(thrust=0.0, tilt=0.0, torque=0.0, yaw=0.0),
    )  # fmt: skip
    return _state(_NO_STATE), outputs, _internals(_NO_INTERNALS)
