"""A flight under attack: the wind answers at every tick, a setpoint may be refused.

The ticks are those of `law_alone`. A setpoint is offered to the guard as a vehicle would do it
(`fcu.vehicle.feasibility_check`): with the policy `refuse` one that misses the condition is not flown,
and the vehicle goes on as before.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from fcu.guard import admission, margin
from fcu.guard.parameters import REFUSE
from fcu.guard.present import Beginning
from fcu.guard.types import GuardParams
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import size, to_buffer, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rows import column_of, slice_of
from fcu.laws.loader import LawError
from fcu.laws.mmrac.types import Params
from fcu.mavlink.plant_link import LONGEST
from fcu.process import burst
from fcu.process.tick import Tick, beginning
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import Scenario
from gcs_tools.flight.vehicle_loop import ENDED, RAISED, TICKS, together
from gcs_tools.studies.attack.wind import OWN, Gust, blown, wanted
from sitl_plant.burst import NOISE_AT, WIDTH
from sitl_plant.physics.types import PlantParams, PlantRecord
from sitl_plant.simulator import Simulator

Rows = np.ndarray[Any, np.dtype[np.float64]]

_AIR = slice_of(PlantParams, "wind.steady").start
_DEMAND = slice_of(Tick, "internals.demand.T_0").start
_POSITION = slice_of(VehicleState, "r_E").start
_TOLD = column_of(Beginning, "present.told")
_SINCE = column_of(burst.Course, "since_us")
_SETPOINT = size(Setpoint)

_unpack_guard = unpacker(GuardParams)
_unpack_law = unpacker(Params)


class Script(NamedTuple):
    """What is asked of the vehicle, and what it looks ahead with."""

    sent_at: Any  # int64[m], ticks, ascending, the first 0
    sent: Any  # float64[m, size(Setpoint)]
    admitted: Any  # float64[m], written: 1 if the setpoint was flown
    refuses: float  # 1 if the guard may refuse one
    told: float  # 1 if its look ahead is told what is demanded now
    guard: Rows  # GuardParams
    law: Rows  # Params
    look_law: Rows  # the same, of which a look ahead overwrites h
    way: Rows  # float64[1, 1 + size(Setpoint)], scratch
    settings: Rows  # Settings
    beginning: Rows  # float64[BEGINNING], scratch


class AttackFlown(NamedTuple):
    """A flight: rows of plant and law, one a tick, and what became of the setpoints."""

    plant: Rows  # float64[n, size(PlantRecord)]
    fcu: Rows  # float64[n, size(Tick)]
    admitted: Rows  # float64[m], 1 if the setpoint was flown


@kernel
def fits(script, i, flight):
    """Whether setpoint i meets the condition from where vehicle and reference model are."""
    h = script.law[0]
    script.look_law[0] = h
    script.way[0, 0] = math.inf
    for j in range(_SETPOINT):
        script.way[0, 1 + j] = script.sent[i, j]
    beginning(script.settings, flight.remembered, flight.measured, script.beginning)
    if script.told < 0.5:
        script.beginning[_TOLD] = 0.0
    return admission.ahead(script.guard, script.look_law, script.way, script.beginning) >= 0.0


@kernel
def attacked(flight, law, plant, datagram, plant_rows, fcu_rows, script, gust):
    """Fly all rows; returns how many ticks were flown, why no more (TICKS: all), and what that leaves.

    flight, law, plant, datagram, plant_rows, fcu_rows : as for `vehicle_loop.together`.
    """
    h = script.law[0]
    known = margin.known(_unpack_guard(script.guard), _unpack_law(script.law))
    air = Vec3(plant.params[_AIR], plant.params[_AIR + 1], plant.params[_AIR + 2])
    T_0, to_go = Vec3(0.0, 0.0, 1.0), Vec3(0.0, 0.0, 0.0)
    i, setpoints = 0, len(script.sent_at)
    for k in range(len(fcu_rows)):
        while i < setpoints and script.sent_at[i] <= k:
            flown = script.refuses == 0.0 or i == 0 or fits(script, i, flight)
            script.admitted[i] = 1.0 if flown else 0.0
            if flown:
                for j in range(_SETPOINT):
                    flight.setpoint[j] = script.sent[i, j]
                flight.course[_SINCE] = k * plant.period_us
                to_go = Vec3(
                    script.sent[i, 0] - flight.measured[_POSITION],
                    script.sent[i, 1] - flight.measured[_POSITION + 1],
                    script.sent[i, 2] - flight.measured[_POSITION + 2],
                )
            i += 1
        if gust.kind != OWN:
            air = blown(gust, air, wanted(gust, known, k * h, to_go, T_0), h)
            plant.params[_AIR], plant.params[_AIR + 1], plant.params[_AIR + 2] = air.x, air.y, air.z
        _, why, left = together(
            flight, law, plant, datagram, plant_rows[k : k + 1], fcu_rows[k : k + 1], -1
        )
        if why != TICKS:
            return k, why, left
        row = fcu_rows[k]
        T_0 = Vec3(row[_DEMAND], row[_DEMAND + 1], row[_DEMAND + 2])
    return len(fcu_rows), TICKS, 0


def fly(
    scene: Scenario, gust: Gust, noise: Rows, refuses: bool = True, told: bool = True
) -> AttackFlown:
    """Fly a scene in a wind.  noise : float64[scene.ticks, 12], of each report.  Raises LawError.

    refuses : whether a guard with that policy does.  told : whether its look ahead is told what is
    demanded now.
    """
    alone, law = law_alone.flight(scene)
    simulator = Simulator(scene.world, law_alone.SYSTEM, wind=scene.wind, layers=scene.layers)
    plant = simulator.plant._replace(noise=noise)
    plant.progress[NOISE_AT] = 0.0
    plant_rows = np.zeros((scene.ticks, WIDTH))
    fcu_rows = np.zeros((scene.ticks, size(Tick)))
    script = Script(
        sent_at=scene.sent_at,
        sent=scene.setpoints,
        admitted=np.zeros(len(scene.sent_at)),
        refuses=float(refuses and scene.guard.policy == REFUSE),
        told=float(told),
        guard=to_buffer(scene.guard),
        law=to_buffer(scene.law),
        look_law=to_buffer(scene.law),
        way=np.zeros((1, 1 + _SETPOINT)),
        settings=to_buffer(scene.settings),
        beginning=np.zeros(admission.BEGINNING),
    )
    ticks, why, left = attacked(
        alone, law.address, plant, np.zeros(LONGEST, dtype=np.uint8), plant_rows, fcu_rows, script,
        gust,
    )  # fmt: skip
    if why == RAISED:
        raise LawError(burst.what_was_raised(law, alone, fcu_rows[ticks]))
    if why not in (TICKS, ENDED):
        raise LawError(f"tick {ticks}: {why}, {left}")
    return AttackFlown(plant_rows[:ticks, : size(PlantRecord)], fcu_rows[:ticks], script.admitted)
