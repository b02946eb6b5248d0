"""The simulator between its sockets: the flight, its time, its noise, and how it ends.

Knows no link and no recorder: a flight in one process joins it to a flight controller in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fcu.interface import event_log
from fcu.interface.event_log import Event, Said
from fcu.interface.faults import NEVER_US, Fault, Size
from fcu.interface.messages import Battery, VehicleState
from fcu.interface.status_texts import Code, Told
from fcu.kernel.buffers import from_buffer
from fcu.kernel.rows import slice_of
from fcu.mavlink import failures
from fcu.mavlink.plant_link import LONGEST, Ending, PlantCodec, Result
from sitl_plant import burst
from sitl_plant.burst import WIDTH
from sitl_plant.physics import dynamics, faults
from sitl_plant.physics.wind.layers import Layers
from sitl_plant.physics.world import World

# a fault that no flight meets: for what is to be compiled
NEVER = Fault(0.0, 0.0, NEVER_US, NEVER_US, Size(0.0, 0.0, 0.0, 0.0))
ENDINGS = {
    dynamics.DIVERGED: "diverged (left the arena)", dynamics.CRASHED: "hit the ground",
    dynamics.HIT_BUILDING: "hit a building", dynamics.LEFT_FIELD: "left the field of wind",
}  # fmt: skip
OF_A_CRASH = dynamics.CRASHED, dynamics.HIT_BUILDING
_MOVING = np.r_[tuple(slice_of(VehicleState, name) for name in ("v_E", "w_B", "Omega"))]


class Simulator:
    """One flight of one vehicle, from its first state."""

    def __init__(
        self,
        world: World,
        system_id: int,
        write: Callable[[Event], None] = event_log.write,
        wind: burst.Buffer | None = None,
        ordered: Sequence[Fault] = (),
        layers: Layers | None = None,
    ) -> None:
        """`system_id`: MAVLink's. `write`: takes an event. `wind`, `ordered`, `layers`: as for `burst.plant`.

        Raises FieldError.
        """
        self._write = write
        self._world = world
        self.codec = PlantCodec(system_id, world.params.airframe.spin)
        self.plant = burst.plant(world, system_id, self.codec.desk, wind, ordered, layers)
        self._failed = 0, Result.FAILED  # the last order that was taken, and what has become of it
        self._random = np.random.default_rng(int(world.seed))
        self.flight_ended = ""  # how, if the vehicle crashed or diverged
        self.ending = Ending.NOT_ENDED  # the same, for the flight controller

    def warm_up(self) -> None:
        """Compile the functions that a tick calls."""
        tried = burst.plant(self._world, self.codec.system, ordered=[NEVER])
        burst.draw_noise(tried, np.random.default_rng(0), self._world.noise_scale)
        datagram = np.zeros(LONGEST, dtype=np.uint8)
        burst.begin(tried, np.zeros(WIDTH), datagram)
        burst.finish(tried, datagram, 0)
        self.plant.battery[:] = tried.battery  # for the first keep-alive

    @property
    def tick(self) -> int:
        """The number of the tick that comes next."""
        return int(self.plant.progress[burst.SEQUENCE])

    @property
    def time_us(self) -> int:
        """Simulation time of the tick that comes next."""
        return self.tick * self.plant.period_us

    @property
    def time_s(self) -> float:
        """The same in seconds."""
        return self.time_us * 1e-6

    def draw_noise(self) -> None:
        """Draw noise for the next ticks, if there is none left."""
        if self.plant.progress[burst.NOISE_AT] == len(self.plant.noise):
            burst.draw_noise(self.plant, self._random, self._world.noise_scale)
            self._draw_faults()

    def _draw_faults(self) -> None:
        """Draw the noise of faults for the ticks of the block in which the next tick is."""
        if faults.is_noisy(self.plant.struck):
            faults.draw(self.plant.struck, int(self._world.seed), self.tick // burst.NOISE_BLOCK)

    def answer_failure(self, datagram: bytes) -> bytes | None:
        """Obey a datagram that orders a failure, and acknowledge it. None: it is another datagram.

        It holds from the tick whose command has not come yet. An order that comes twice is done once.
        """
        asked = self.codec.failure(datagram)
        if asked is None:
            return None
        order, number = asked
        if number != self._failed[0]:
            result = Result.DENIED if order is None else self.fail(order)
            self._failed = number, result
        return self.codec.pack_failure_answer(self._failed[1], number)

    def fail(self, order: failures.Order) -> Result:
        """Break something from the next command on, or mend it. ACCEPTED: it is done."""
        kinds, struck = failures.kinds(order), self.plant.struck
        if not kinds:
            return Result.UNSUPPORTED
        if not failures.is_in_range(order, int(self._world.params.airframe.n)):
            return Result.DENIED
        if order.type == failures.Type.OK:
            rotors = int(self._world.params.airframe.n)
            if not faults.end(struck, kinds, order.instance, rotors, float(self.time_us)):
                return Result.TEMPORARILY_REJECTED
        else:
            if not struck.used[0]:  # nobody has looked until now
                struck.applied[:], struck.kept[:] = self.plant.command, self.plant.reported
            if not faults.add(struck, failures.fault(order, self.time_us)):
                return Result.TEMPORARILY_REJECTED
            self._draw_faults()
        self.say("warning", Told(Code.FAILURE_DONE, (order.unit, order.type, order.instance)))
        return Result.ACCEPTED

    def hold(self) -> bytes:
        """What is sent while time stands: the last report."""
        plant = self.plant
        if self.tick == 0 and not self.ending:
            plant.reported[:] = plant.state
        return self.codec.pack_hold(
            self.time_us, plant.reported, from_buffer(Battery, plant.battery), self.ending
        )

    def end(self, status: int) -> Told:
        """The flight has ended, and the vehicle lies where it was; what is to be said of it."""
        self.flight_ended = ENDINGS[status]
        self.ending = Ending.CRASHED if status in OF_A_CRASH else Ending.DIVERGED
        plant = self.plant
        if np.isfinite(plant.state).all():
            plant.reported[:] = plant.state
        plant.reported[_MOVING] = 0.0
        return Told(Code.FLIGHT_ENDED, (self.flight_ended,))

    def say(self, level: str, said: Said) -> Event:
        """An event of now."""
        return say(self.time_us, level, said, self._write)


def say(
    time_us: int, level: str, said: Said, write: Callable[[Event], None] = event_log.write
) -> Event:
    """An event of the simulator."""
    made = event_log.event(time_us / 1e6, level, "plant", said)
    write(made)
    return made
