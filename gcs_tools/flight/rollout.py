"""A whole flight in one compiled call: the only place that sees the law and the physics together.

The same kernels run in the two processes, and what the wire rounds is rounded here, so a
flight by `rollout` and one over UDP are equal to the bit.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fcu.interface.messages import Setpoint
from fcu.kernel.buffers import packer, size, to_buffer, unpacker
from fcu.kernel.compile import kernel
from fcu.kernel.rows import column_of
from fcu.laws.mmrac import cascade, reference_model
from fcu.laws.mmrac.types import Tick
from fcu.mavlink.frames import command_through_the_wire, through_the_wire
from gcs_tools.flight.scenario import Scenario
from sitl_plant.physics import battery, dynamics, tick
from sitl_plant.physics.types import PlantRecord

Rows = np.ndarray[Any, np.dtype[np.float64]]

_unpack_setpoint = unpacker(Setpoint)
_pack_tick = packer(Tick)
_recorded_state = unpacker(PlantRecord, "state")


@kernel
def rollout(
    plant_buffer, law_buffer, start_buffer, sent_at, setpoints, noise, delay, steps, period_us,
    n, plant_rows, fcu_rows,
):  # fmt: skip
    """Fly at most n control ticks; returns how many plant rows were written.

    sent_at : int64[m], ticks at which setpoints are sent, the first at 0.
    setpoints : float64[m, 19], as decoded from the wire.
    noise : float64[n, 12], or float64[0, 12] for none.  delay : ticks the report is late.
    plant_rows : float64[n, size(PlantRecord)].  fcu_rows : float64[n, size(Tick)].
    A flight that ends early has one fcu row fewer than plant rows.
    """
    plant = tick.unpack_params(plant_buffer)
    law = cascade.unpack_params(law_buffer)
    start = tick.unpack_state(start_buffer)
    state, law_state = start, cascade.take_over(law, through_the_wire(tick.as_reported(start)))
    drawn = battery.BatteryState(0.0, 0.0)
    sent = 0
    for k in range(n):
        t = (k * period_us) * 1e-6
        truth = dynamics.record(plant, state, drawn, t, start.r_E)
        tick.pack_record(plant_rows[k], truth)
        if truth.ended != dynamics.FLYING:
            return k + 1

        late = max(k - delay, 0)
        shown = _recorded_state(plant_rows[late]) if delay > 0 else state
        if len(noise) > 0:
            measured = through_the_wire(tick.report(shown, noise[k]))
        else:
            measured = through_the_wire(tick.as_reported(shown))

        while sent + 1 < len(sent_at) and sent_at[sent + 1] <= k:
            sent += 1
        age = ((k - sent_at[sent]) * period_us) * 1e-6
        setpoint = reference_model.carried(_unpack_setpoint(setpoints[sent]), age)
        if k == 0:
            engaged = cascade.TAKE_OVER
            law_state, command, internals = cascade.first_step(law, setpoint, measured)
        else:
            engaged = cascade.FLYING
            law_state, command, internals = cascade.step(law_state, law, setpoint, measured)
        _pack_tick(fcu_rows[k], Tick(t, measured, setpoint, law_state, internals, command, engaged))

        received = command_through_the_wire(command)
        for j in range(steps):
            state = dynamics.integrate(plant, state, received, t + j * plant.h)
        drawn = battery.drained(drawn, truth.battery, steps * plant.h)
    return n


def fly(scene: Scenario) -> tuple[Rows, Rows]:
    """Plant rows and fcu rows of a whole flight."""
    n = scene.ticks
    plant_rows = np.zeros((n, size(PlantRecord)))
    fcu_rows = np.zeros((n, size(Tick)))
    rows = rollout(
        to_buffer(scene.world.params), to_buffer(scene.law), to_buffer(scene.world.start),
        scene.sent_at, scene.setpoints, scene.noise(n), int(scene.world.delay_ticks),
        scene.world.steps, scene.period_us, n, plant_rows, fcu_rows,
    )  # fmt: skip
    ended = plant_rows[rows - 1, column_of(PlantRecord, "ended")] != dynamics.FLYING
    return plant_rows[:rows], fcu_rows[: rows - 1 if ended else rows]


def warm_up(scene: Scenario) -> None:
    """Compile, by flying one tick."""
    fly(replace(scene, ticks=1))
