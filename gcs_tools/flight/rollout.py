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
from fcu.laws.mmrac.reference_model import carried
from fcu.mavlink.frames import command_through_the_wire, through_the_wire
from fcu.tick import (
    FLYING,
    TAKE_OVER,
    Remembered,
    Tick,
    engaged_tick,
    unpack_remembered,
    unpack_settings,
)
from gcs_tools.flight.scenario import Scenario
from sitl_plant.physics import battery, dynamics, tick
from sitl_plant.physics.types import PlantRecord

Rows = np.ndarray[Any, np.dtype[np.float64]]

_unpack_setpoint = unpacker(Setpoint)
_pack_tick = packer(Tick)
REMEMBERED = size(Remembered)
_recorded_state = unpacker(PlantRecord, "state")


@kernel
def rollout(
    plant_buffer, settings_buffer, start_buffer, sent_at, setpoints, noise, delay, steps, period_us,
    n, plant_rows, fcu_rows, zeros,
):  # fmt: skip
    """Fly at most n control ticks; returns how many plant rows were written.

    sent_at : int64[m], ticks at which setpoints are sent, the first at 0.
    setpoints : float64[m, 19], as decoded from the wire.
    noise : float64[n, 12], or float64[0, 12] for none.  delay : ticks the report is late.
    plant_rows : float64[n, size(PlantRecord)].  fcu_rows : float64[n, size(Tick)].
    A flight that ends early has one fcu row fewer than plant rows.
    """
    plant = tick.unpack_params(plant_buffer)
    settings = unpack_settings(settings_buffer)
    start = tick.unpack_state(start_buffer)
    state, remembered = start, unpack_remembered(zeros)
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
            measured = through_the_wire(shown)

        while sent + 1 < len(sent_at) and sent_at[sent + 1] <= k:
            sent += 1
        age = ((k - sent_at[sent]) * period_us) * 1e-6
        setpoint = carried(_unpack_setpoint(setpoints[sent]), age)
        engaged = TAKE_OVER if k == 0 else FLYING
        flown = engaged_tick(t, engaged, remembered, settings, setpoint, measured)
        remembered = Remembered(law=flown.state, guard=flown.guard_state)
        _pack_tick(fcu_rows[k], flown)

        received = command_through_the_wire(flown.command)
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
        to_buffer(scene.world.params), to_buffer(scene.settings), to_buffer(scene.world.start),
        scene.sent_at, scene.setpoints, scene.noise(n), int(scene.world.delay_ticks),
        scene.world.steps, scene.period_us, n, plant_rows, fcu_rows, np.zeros(REMEMBERED),
    )  # fmt: skip
    ended = plant_rows[rows - 1, column_of(PlantRecord, "ended")] != dynamics.FLYING
    return plant_rows[:rows], fcu_rows[: rows - 1 if ended else rows]


def warm_up(scene: Scenario) -> None:
    """Compile, by flying one tick."""
    fly(replace(scene, ticks=1))
