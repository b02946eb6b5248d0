"""A law flown alone: for studies of laws, in which no ground station says anything.

The ticks are those of a whole vehicle (`closed_loop`), without its autopilot: always armed, every
setpoint flown as it is, nothing refused, limited or landed, no position doubted. As long as a
vehicle's autopilot only passes setpoints on, its flight is the same to the bit; but it flies on to
the end of its time where a vehicle has arrived. Of many flights `several` flies eight at a time.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from fcu.interface.faults import NAMES, OF_AUTOPILOT, Kind
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.pointers import Pointer
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.face import TAKE_OVER
from fcu.laws.loader import LawError
from fcu.mavlink.plant_link import PlantCodec, fault_in_words
from fcu.process import burst
from fcu.process.burst import Course, Flight
from fcu.vehicle.conditions import Due, Watch
from fcu.vehicle.position_filter import Filtered
from gcs_tools.flight.closed_loop import closed
from gcs_tools.flight.scenario import Scenario
from gcs_tools.flight.vehicle_loop import ENDED, NOISE, RAISED, TICKS
from gcs_tools.judging.metrics import SETTLE_S
from sitl_plant.burst import WIDTH
from sitl_plant.physics.parameters import start_state
from sitl_plant.physics.types import PlantRecord
from sitl_plant.simulator import Simulator

Rows = np.ndarray[Any, np.dtype[np.float64]]

# parameters by which a vehicle passes on setpoints that it would limit: a law alone limits none
PASSED_ON = {"MR_SP_BELOW"}
SYSTEM = 1  # MAVLink's
_TIME, _ARMED, _ENGAGED, _SINCE = (
    column_of(Course, name) for name in ("time_us", "armed", "engaged", "since_us")
)
_DUE = slice_of(Watch, "due")
_TRUTH = size(PlantRecord)


def flight(scene: Scenario) -> tuple[Flight, Pointer]:
    """The law, armed and about to take over at time 0, with the first setpoint. Raises LawError."""
    ticks = scene.flown.ticks
    with scene.flown.compiling():
        pointer = ticks.compiled()
    watch = np.zeros(size(Watch))
    never = Due(look_us=np.inf, until_us=np.inf, heard_us=np.inf, lost_us=0.0)
    watch[_DUE] = to_buffer(never)  # nothing is looked for
    alone = burst.flight(
        PlantCodec(SYSTEM, rotors=scene.law.rotors.n), to_buffer(scene.settings), scene.law.h, size(ticks.Remembered),
        np.zeros(size(Filtered)), watch,
    )  # fmt: skip
    alone.course[_ARMED], alone.course[_ENGAGED] = 1.0, TAKE_OVER
    alone.course[_TIME] = -scene.period_us  # the tick that comes next is that at 0
    alone.setpoint[:] = scene.setpoints[0]
    return alone, pointer


def hovering(scene: Scenario) -> Scenario:
    """A scene of items as far as a law alone can fly it: from hover where they begin, sent as is foreseen.

    It ends SETTLE_S after the last setpoint. Take-off and landing, which a vehicle leads itself, are left out.
    """
    start = start_state(scene.world.params, {"position_m": tuple(scene.begin.r_E)})
    return replace(
        scene,
        legs=(),
        ticks=int(scene.sent_at[-1]) + round(SETTLE_S * scene.rate_hz),
        world=scene.world._replace(start=start),
    )


def refuse_faults(scene: Scenario) -> None:
    """Raise LawError for a fault, or a parameter, that nothing but an autopilot answers for."""
    if of_autopilot := sorted(scene.parameters.keys() - PASSED_ON):
        raise LawError(
            f"[vehicle.params] {of_autopilot[0]} is of an autopilot: expected a whole vehicle,"
            " not a law alone"
        )
    for each in scene.faults:
        if each.kind in OF_AUTOPILOT:
            name = NAMES[Kind(int(each.kind))]
            raise LawError(
                f"[[plant.faults]] {name} is answered by an autopilot: expected a whole vehicle,"
                " not a law alone"
            )


def fly(scene: Scenario) -> tuple[Rows, Rows]:
    """Plant rows (n, size(PlantRecord)) and rows of the law's Tick of a whole flight.

    One that ends early has one of these fewer. Raises LawError.
    """
    if scene.legs:
        raise LawError("a mission of items is flown by a whole vehicle, not by a law alone")
    refuse_faults(scene)
    ticks = scene.flown.ticks
    alone, law = flight(scene)
    simulator = Simulator(
        scene.world, SYSTEM, wind=scene.wind, ordered=scene.faults, layers=scene.layers
    )
    plant_rows = np.zeros((scene.ticks, WIDTH))
    fcu_rows = np.zeros((scene.ticks, size(ticks.Tick)))
    begins = [*np.minimum(scene.sent_at, scene.ticks).tolist(), scene.ticks]
    for setpoint, (k, until) in zip(scene.setpoints, pairwise(begins), strict=True):
        alone.setpoint[:], alone.course[_SINCE] = setpoint, k * scene.period_us
        while k < until:
            simulator.draw_noise()
            flown, why, left = closed(
                alone, law.address, simulator.plant, plant_rows[k:until], fcu_rows[k:until]
            )
            k += flown
            if why == ENDED:
                return plant_rows[: k + 1, :_TRUTH], fcu_rows[:k]
            if why == RAISED:
                raise LawError(burst.what_was_raised(law, alone, fcu_rows[k]))
            if why not in (TICKS, NOISE):
                raise LawError(f"tick {k}: {fault_in_words(left)}")
    return plant_rows[:, :_TRUTH], fcu_rows


def warm_up(scene: Scenario) -> None:
    """Compile, by flying one tick. Raises LawError."""
    fly(replace(scene, ticks=1, sent_at=scene.sent_at[:1], sent=scene.sent[:1]))
