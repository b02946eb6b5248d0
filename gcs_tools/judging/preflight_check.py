"""Whether a vehicle whose guard refuses would fly a mission's setpoints, known before it flies.

Looked at as the vehicle looks at each when it arrives: from where the reference model (34) is
then, which under that policy is the mission's alone to say. What the vehicle will demand by then is the
air's to say, so it counts for nothing here: in the air more may be admitted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from fcu.guard import admission
from fcu.guard.parameters import REFUSE
from fcu.interface.messages import Setpoint
from fcu.interface.status_texts import lacks, words
from fcu.kernel.buffers import from_buffer, to_buffer
from fcu.mavlink.frames import through_the_wire
from gcs_tools.flight.scenario import Scenario


class Looked(NamedTuple):
    """What the vehicle sees of a setpoint when it arrives."""

    at_s: float  # when it is sent
    setpoint: Setpoint
    tightest: admission.Tightest
    reference: admission.Buffer  # float64[9], r_m, v_m and a_m of then


def as_sent(setpoint: Setpoint) -> Setpoint:
    """Itself."""
    return setpoint


def looks(
    scene: Scenario, settings: Any, changed: Callable[[Setpoint], Setpoint] = as_sent
) -> Iterator[Looked]:
    """At each setpoint of a mission that leads another way than the one before; each flown, refused or not.

    settings : of law and guard, in place of its own.  changed : what is made of each setpoint first.
    """
    law, guard = settings
    look = admission.Look(guard, law)
    guard_buffer, law_buffer = to_buffer(guard), to_buffer(law)
    start = through_the_wire(scene.begin)
    reference = np.array([*start.r_E, *start.v_E, 0.0, 0.0, 0.0])
    before = None
    for k, row in zip(scene.sent_at.tolist(), scene.setpoints, strict=True):
        setpoint = changed(from_buffer(Setpoint, row))
        if before is not None:
            past = to_buffer(before[1])
            admission.follow(guard_buffer, law_buffer, past, k - before[0], reference)
        if before is None or not admission.is_same_way(setpoint, before[1]):
            found = look.tightest(admission.way_to(setpoint), reference)
            yield Looked(k / scene.rate_hz, setpoint, found, reference)
        if before is None:  # it takes over there
            reference[:3] += law.initial.r_m_offset
        before = k, setpoint


def refusal(scene: Scenario) -> str:
    """Which of its setpoints would be refused, and why; empty if none."""
    if scene.flown.guard is None or scene.guard.policy != REFUSE:
        return ""
    for at_s, setpoint, tightest, reference in looks(scene, scene.settings):
        if tightest.margin < 0.0:
            look = admission.Look(scene.guard, scene.law)
            lack = admission.lack_of(look, setpoint, -tightest.margin, reference)
            return f"setpoint at {at_s:g} s refused: {words(lacks(*lack))}"
    return ""
