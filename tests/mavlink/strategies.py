"""What crosses the plant link, of any number that is one."""

from __future__ import annotations

import math

from hypothesis import strategies as st

from fcu.interface.messages import RotorCommand, VehicleState
from fcu.kernel.algebra import Quat, Rotors, Vec3

anything = st.floats(allow_nan=False)  # infinities, subnormals and all
vectors = st.builds(Vec3, anything, anything, anything)
component = st.floats(-1.0, 1.0)
quaternions = (
    st.tuples(component, component, component, component)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(lambda q: Quat(*(c / math.hypot(*q) for c in q)))
)
speeds = st.builds(Rotors, *[st.floats(min_value=0.0, allow_nan=False)] * 8)
states = st.builds(VehicleState, vectors, vectors, quaternions, vectors, speeds)
commands = st.builds(RotorCommand, st.builds(Rotors, *[anything] * 8))
