"""Whether a vehicle whose guard refuses would fly a mission's setpoints, known before it flies.

Looked at as the vehicle looks at each when it arrives: from where the reference model (34) is
then, which under that policy is the mission's alone to say. What the vehicle will demand by then is the
air's to say, so it counts for nothing here: in the air more may be admitted.
"""

from __future__ import annotations

import numpy as np

from fcu.guard import admission
from fcu.guard.parameters import REFUSE
from fcu.interface.messages import Setpoint
from fcu.interface.status_texts import lacks, words
from fcu.kernel.buffers import from_buffer, to_buffer
from fcu.mavlink.frames import through_the_wire
from gcs_tools.flight.scenario import Scenario


def refusal(scene: Scenario) -> str:
    """Which of its setpoints would be refused, and why; empty if none."""
    if scene.flown.guard is None or scene.guard.policy != REFUSE:
        return ""
    look = admission.Look(scene.guard, scene.law)
    guard, law = to_buffer(scene.guard), to_buffer(scene.law)
    start = through_the_wire(scene.world.start)
    reference = np.array([*start.r_E, *start.v_E, 0.0, 0.0, 0.0])
    before = None
    for k, row in zip(scene.sent_at.tolist(), scene.setpoints, strict=True):
        setpoint = from_buffer(Setpoint, row)
        if before is not None:
            admission.follow(guard, law, to_buffer(before[1]), k - before[0], reference)
        if before is None or not admission.is_same_way(setpoint, before[1]):
            way = admission.way_to(setpoint)
            short = look.short(way, reference)
            if short > 0.0:
                lack = words(lacks(*admission.lack_of(look, setpoint, short, reference)))
                return f"setpoint at {k / scene.rate_hz:g} s refused: {lack}"
        if before is None:  # it takes over there
            reference[:3] += scene.law.initial.r_m_offset
        before = k, setpoint
    return ""
