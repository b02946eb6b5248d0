"""What the vehicle tells ground stations, and how often.

Rates are in simulation time, and no faster than that in wall time either: a flight at a
hundred times real time does not flood its listeners. Heartbeats are paced by the wall clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from fcu.ground.port import GroundPort
from fcu.interface.messages import VehicleState
from fcu.kernel.algebra import Quat, Rotors, Vec3
from fcu.kernel.buffers import columns, from_buffer, size
from fcu.kernel.rotations import from_euler
from fcu.law.types import Tick
from fcu.supervisor import Supervisor

HEARTBEAT_S = 1.0  # wall

_TICK = columns(Tick)
_MEASURED = slice(1, 1 + size(VehicleState))
_ANGLES_C = _TICK.index("internals.angles_c.x")
_W_C = _TICK.index("internals.w_c.x")
_T_C = _TICK.index("internals.T_c")

Row = np.ndarray


class Stream(NamedTuple):
    """One message at one rate."""

    rate_hz: float
    pack: Callable[[GroundPort, Row], bytes]


class Telemetry:
    """Streams to every ground port."""

    def __init__(
        self, ports: Sequence[GroundPort], supervisor: Supervisor, spin: Rotors, T_max: float
    ) -> None:
        self._ports = ports
        self._supervisor = supervisor
        self._spin = spin
        self._T_max = T_max
        self._heartbeat_due = 0.0
        self._last_status: tuple[bool, int, int, int] | None = None
        streams = (
            Stream(50.0, self._attitude),
            Stream(30.0, self._local_position),
            Stream(10.0, self._attitude_target),
            Stream(10.0, self._rotors),
            Stream(1.0, self._extended_state),
            Stream(1.0, self._system_time),
        )
        self._streams = [s.pack for s in streams]
        self._period = [1.0 / s.rate_hz for s in streams]
        self._due_sim = [0.0] * len(streams)
        self._due_wall = [0.0] * len(streams)
        self._next_sim = 0.0

    def heartbeat(self, now: float) -> None:
        """Send one if a second has passed, or the status has changed. `now`: monotonic, s."""
        vehicle = self._supervisor
        status = (vehicle.armed, vehicle.main_mode, vehicle.sub_mode, vehicle.status)
        if now < self._heartbeat_due and status == self._last_status:
            return
        self._heartbeat_due, self._last_status = now + HEARTBEAT_S, status
        for port in self._ports:
            port.broadcast(port.codec.pack_heartbeat(*status))

    def tick(self, t: float, row: Row) -> None:
        """Send what is due at simulation time t (s). `row`: the Tick just flown."""
        if t < self._next_sim:
            return
        now = time.monotonic()
        for i, pack in enumerate(self._streams):
            if t >= self._due_sim[i] and now >= self._due_wall[i]:
                self._due_sim[i] = t + self._period[i]
                self._due_wall[i] = now + self._period[i]
                for port in self._ports:
                    port.broadcast(pack(port, row))
        self._next_sim = min(self._due_sim) if min(self._due_sim) > t else t + 0.01

    def text(self, severity: int, text: str) -> None:
        """STATUSTEXT to everyone."""
        for port in self._ports:
            port.broadcast(port.codec.pack_text(severity, text))

    @staticmethod
    def _measured(row: Row) -> VehicleState:
        return from_buffer(VehicleState, row[_MEASURED])

    def _attitude(self, port: GroundPort, row: Row) -> bytes:
        m = self._measured(row)
        return port.codec.pack_attitude(row[0], m.q_EB, m.w_B)

    def _local_position(self, port: GroundPort, row: Row) -> bytes:
        m = self._measured(row)
        return port.codec.pack_local_position(row[0], m.r_E, m.v_E)

    def _attitude_target(self, port: GroundPort, row: Row) -> bytes:
        q: Quat = from_euler(*row[_ANGLES_C : _ANGLES_C + 3].tolist())
        w_c = Vec3(*row[_W_C : _W_C + 3].tolist())
        return port.codec.pack_attitude_target(row[0], q, w_c, row[_T_C] / self._T_max)

    def _rotors(self, port: GroundPort, row: Row) -> bytes:
        return port.codec.pack_rotors(row[0], self._measured(row).Omega, self._spin)

    def _extended_state(self, port: GroundPort, row: Row) -> bytes:
        return port.codec.pack_extended_state(self._supervisor.landed_state)

    def _system_time(self, port: GroundPort, row: Row) -> bytes:
        return port.codec.pack_system_time(time.time(), row[0])
