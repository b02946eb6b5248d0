"""A vehicle, the law and the plant, flown without processes or sockets."""

from __future__ import annotations

import math

import numpy as np

from fcu.interface.airframe import believed
from fcu.interface.messages import Setpoint, VehicleState
from fcu.kernel.algebra import Vec3
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.rows import column, slice_of
from fcu.parameters import Parameters
from fcu.process import tick as control
from fcu.process.settings import settings
from fcu.process.tick import Remembered, Tick
from fcu.vehicle.modes import Mode
from fcu.vehicle.state_machine import StateMachine
from sitl_plant.physics import dynamics, tick
from sitl_plant.physics.battery import BatteryState
from sitl_plant.physics.types import PlantRecord
from sitl_plant.physics.world import world

ZERO = Vec3(0.0, 0.0, 0.0)
TICK_US, STREAM_US = 2000, 50_000


class Flown:
    """A vehicle that stands on the ground in still air, and what has become of it since."""

    def __init__(self, wind=None):
        self.params = Parameters(settings(*believed(), 500.0), 1)
        self.vehicle = StateMachine(self.params, sim_only=True)
        self.world = world(wind=wind)
        self.plant = to_buffer(self.world.params)
        self.start = to_buffer(self.world.start)
        self.state = self.start.copy()
        self.drawn = np.zeros(size(BatteryState))
        self.remembered = np.zeros(size(Remembered))
        self.vehicle.reference_model = self.remembered[slice_of(Remembered, "law.reference")]
        self.row = np.zeros(size(Tick))
        self.truth = np.zeros(size(PlantRecord))
        self.reported = np.zeros(size(VehicleState))
        self.t_us = 0
        self.engaged = control.IDLE
        self.told = []  # codes
        self.tilt_deg = 0.0  # the greatest at less than 0.2 m above where it stood
        self.down_m_s = 0.0  # the fastest there
        self.ended = dynamics.FLYING

    @property
    def r(self):
        return Vec3(*self.state[:3].tolist())

    def fly(self, seconds, done=lambda: False):
        """On, for so long or until it is done or has crashed."""
        until = self.t_us + round(seconds * 1e6)
        vehicle, no_noise = self.vehicle, np.zeros(tick.NOISE)
        while self.t_us < until and not done():
            t = self.t_us * 1e-6
            self.ended = tick.observe(
                self.plant, self.state, self.drawn, t, self.start, self.truth
            )  # fmt: skip
            if self.ended != dynamics.FLYING:
                return
            tick.sense(self.state, no_noise, self.reported)
            self.told += [told.code for told in vehicle.observe(self.reported, self.t_us, t)]
            flown = vehicle.setpoint
            if flown is None:
                self.engaged, flown = control.IDLE, Setpoint(ZERO, ZERO, ZERO, 0.0, 0.0)
            else:
                idle = self.engaged == control.IDLE
                self.engaged = control.TAKE_OVER if idle else control.FLYING
            age = (self.t_us - vehicle.since_us) * 1e-6
            control.tick(
                t, self.engaged, self.remembered, to_buffer(self.params.settings),
                to_buffer(flown), age, self.reported, self.row,
            )  # fmt: skip
            command = column(Tick, self.row, "command")
            steps = self.world.steps
            tick.advance(self.plant, self.state, self.drawn, command, t, steps)
            self.t_us += TICK_US
            self._look()

    def _look(self):
        if self.state[2] < self.start[2] + 0.2:
            _, x, y, _ = self.state[6:10]
            lean = math.degrees(math.acos(1.0 - 2.0 * (x * x + y * y)))
            self.tilt_deg = max(self.tilt_deg, lean)
            self.down_m_s = max(self.down_m_s, -self.state[5])

    def up(self, height):
        """Armed, and this much above where it stood."""
        self.fly(0.5)
        assert self.vehicle.arm(self.t_us, 0.0).granted
        assert self.vehicle.take_off(self.r.z + height, self.t_us, 0.0).granted
        self.fly(60.0, lambda: self.vehicle.mode is Mode.HOLD)
        self.tilt_deg = self.down_m_s = 0.0

    def stream(self, ask, seconds, done=lambda: False):
        """A script in offboard mode: `ask()`, a setpoint, as often as a script sends one."""
        vehicle, until = self.vehicle, self.t_us + round(seconds * 1e6)
        while self.t_us < until and not done() and self.ended == dynamics.FLYING:
            vehicle.script.take(ask(), self.t_us, self.t_us * 1e-6)
            told = vehicle.fly_script(self.t_us)
            self.told += [] if told is None else [told.code]
            if vehicle.mode is not Mode.OFFBOARD and vehicle.armed:
                vehicle.select(Mode.OFFBOARD, self.t_us, 0.0)
            self.fly(STREAM_US * 1e-6)


def at(x, y, z, v=ZERO, a=ZERO):
    return Setpoint(Vec3(x, y, z), v, a, 0.0, 0.0)
