"""A flight of a mission by a controller of somebody else's, in place of `fcu`.

It is a command that speaks the plant link (docs/flight-controller-of-your-own.md). Of the flight the
truth is known, and what the mission asked for; the controller tells nothing of itself.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface import handover
from fcu.interface.link import UdpLink, bound_ports
from fcu.interface.messages import Setpoint
from fcu.interface.ports import owner, ports
from fcu.kernel.buffers import size, to_buffer
from fcu.kernel.compile import is_cached
from fcu.kernel.rows import column, column_of
from fcu.laws.face import FLYING
from fcu.mavlink import setpoints
from fcu.mavlink.framing import Source
from fcu.mavlink.geodesy import Origin
from fcu.mavlink.ground_link import GroundCodec
from gcs_tools.flight.flown_rows import FlownRows
from gcs_tools.flight.forking import can_fork
from gcs_tools.flight.ground_script import ME, VehicleError
from gcs_tools.flight.pair import plant_arguments
from gcs_tools.flight.processes import (
    Child,
    Collector,
    InfrastructureError,
    Rows,
    Take,
    stop_all,
)
from gcs_tools.flight.scenario import Scenario
from gcs_tools.flight.user_command import Leashed, command_words, filled, names_one_of
from gcs_tools.flight.wire_flight import DRAIN_S, WireFlight
from gcs_tools.missions.plan_file import PlanFile
from gcs_tools.missions.timeline import PlanProgress
from gcs_tools.recording.schema import AskedTick
from sitl_plant.burst import WIDTH
from sitl_plant.physics import dynamics
from sitl_plant.physics.types import PlantRecord

OPENS_S = 30.0  # wall: until it has opened the port of the plant link, by default
LOOK_S = 0.01  # wall: between two looks whether it has
FORESEEN_S = 0.5  # a setpoint that moves goes on for so long, if no other comes
PAGE = "docs/flight-controller-of-your-own.md"
_ENDED = column_of(PlantRecord, "ended")


# --- the command


def values(instance: int, rate_hz: float, airframe: Path) -> dict[str, str]:
    """What may stand in braces in a command, and what takes its place."""
    at = ports(instance)
    return {
        "instance": str(instance),
        "system_id": str(at.system_id),
        "plant_port": str(at.plant),
        "controller_port": str(at.fcu_plant),
        "setpoint_port": str(at.fcu_script),
        "script_port": str(at.script),
        "rate_hz": f"{rate_hz:g}",
        "airframe": str(airframe),
    }


OF_AN_INSTANCE = ("instance", "system_id", "plant_port", "controller_port")
_NAMES = tuple(values(0, 1.0, Path()))


def command(text: str) -> tuple[str, ...]:
    """The words of a command line. Raises CommandError."""
    return command_words(text, _NAMES)


def names_instance(words: Sequence[str]) -> bool:
    """Whether a command is told which instance it flies: without that, it can only be the first."""
    return names_one_of(words, OF_AN_INSTANCE)


# --- what the mission asks of it


class SetpointSender:
    """Sends setpoints as a ground script does, and waits for nobody: a controller need not listen."""

    def __init__(self, instance: int, rate_hz: float) -> None:
        """`rate_hz`: control ticks a second. Raises PortBusy."""
        at = ports(instance)
        self._link = UdpLink(at.script, at.fcu_script, owner("script"))
        self._codec = GroundCodec(*ME)
        self._target = Source(at.system_id, 1)
        self._rate_hz = rate_hz
        self._sent: list[tuple[int, list[float]]] = []  # tick, Setpoint as it is decoded
        self.on_wait: Callable[[], None] = lambda: None

    def set_setpoint(self, setpoint: Setpoint, time_s: float = 0.0) -> None:
        """Send one, while time stands: it is there before the state of that time."""
        decoded = to_buffer(setpoints.setpoint_through_the_wire(setpoint)).tolist()
        self._sent.append((round(time_s * self._rate_hz), decoded))
        self._link.send(self._codec.framed(setpoints.setpoint(self._target, time_s, setpoint)))

    def asked(self, plant: Rows) -> Rows:
        """AskedTick of each tick of the plant that was answered, float64 (n, size(AskedTick)).

        plant : rows that begin with a PlantRecord.
        """
        t = plant[plant[:, _ENDED] == dynamics.FLYING, 0]
        found = np.zeros((len(t), size(AskedTick)))
        if not len(t):
            return found
        sent = list(self._sent)
        at = np.array([tick for tick, _ in sent])
        which = np.searchsorted(at, np.rint(t * self._rate_hz), side="right") - 1
        found[:, 0] = t
        column(AskedTick, found, "engaged")[:] = FLYING
        made = column(AskedTick, found, "setpoint")
        made[:] = np.array([setpoint for _, setpoint in sent])[which]
        since = np.minimum(t - at[which] / self._rate_hz, FORESEEN_S)[:, None]
        r, v, a = (column(Setpoint, made, name) for name in ("r_c", "v_c", "a_c"))
        psi, psi_dot = (column(Setpoint, made, name) for name in ("psi_c", "psi_dot_c"))
        r += v * since + 0.5 * a * since * since
        v += a * since
        psi += psi_dot * since[:, 0]
        return found

    def wait_ready(self) -> None:
        """It is, once it has opened its port."""

    def offboard(self) -> None:
        """It has no modes."""

    def arm(self) -> None:
        """Its rotors turn as it commands."""

    def take_off(self, height_m: float) -> None:
        """No mission that it flies has such an item; the next two neither."""
        raise VehicleError(f"a controller of your own is not told to take off ({height_m:g} m)")

    def land(self) -> None:
        """As take_off."""
        raise VehicleError("a controller of your own is not told to land")

    def return_home(self) -> None:
        """As take_off."""
        raise VehicleError("a controller of your own is not told to return")

    def fly_plan(self, plan: PlanFile, origin: Origin) -> None:
        """As take_off."""
        raise VehicleError("a controller of your own is not told a plan")

    def plan_progress(self) -> PlanProgress:
        """As take_off."""
        raise VehicleError("a controller of your own is not told a plan")

    def close(self) -> None:
        """Give the port back."""
        self._link.close()


class _Both:
    """Keeps rows of the plant, and of each what was asked for at its tick."""

    def __init__(self, plant: FlownRows, asked: FlownRows, of: Callable[[Rows], Rows]) -> None:
        self._plant, self._asked, self._of = plant, asked, of

    def append(self, rows: Rows) -> None:
        """Some more of the plant's."""
        self._asked.append(self._of(rows))
        self._plant.append(rows)


# --- its process


class Controller(Leashed):
    """The process of a controller, on a leash."""

    def check(self) -> None:
        """Raise InfrastructureError if it has ended."""
        said = self.outcome()
        if said is None:
            return
        if not said:
            raise InfrastructureError("the controller was ended: its leash was killed")
        if why := said["why"]:
            raise InfrastructureError(f"the controller was ended: {why}")
        code = said["exit_code"]
        how = f"was ended by signal {-code}" if code < 0 else f"ended with exit code {code}"
        raise InfrastructureError(f"the controller {how}: {self.last_words()}")


class ForeignPair:
    """A controller of somebody else's and the plant, which end with whoever has started them."""

    def __init__(self, stack: ExitStack, look: Callable[[], None]) -> None:
        """`stack`: stops them. `look`: called by every check; may raise."""
        self.children: list[Child] = []  # controller, plant
        self._look = look
        self._life, held = os.pipe()
        for end in (self._life, held):
            stack.callback(os.close, end)
        stack.callback(self.stop)

    def start(
        self, folder: Path, words: Sequence[str], plant: Sequence[str], plant_fds: Sequence[int]
    ) -> None:  # fmt: skip
        """Start both. Raises InfrastructureError when one of them ends, OSError."""
        forks = can_fork() and is_cached("begin")
        simulator = Child(
            "plant", "sitl_plant", plant, folder / "plant.log", plant_fds, forks, tells=True
        )
        self.children.append(simulator)
        self.controller = Controller(
            "controller", words, Path(), folder / "controller.log", os.dup(self._life)
        )
        self.controller.listen()
        self.children.insert(0, self.controller)
        simulator.wait_ready(self.check)

    def check(self) -> None:
        """Raise InfrastructureError if one of the two has ended, or the plant is suspended."""
        self._look()
        self.controller.check()
        for child in self.children[1:]:
            try:
                child.check()
            except InfrastructureError as error:
                if (said := child.last_error()) is None:
                    raise
                how = self.controller.how_it_is() or PAGE
                raise type(error)(f"{said.text} ({how})") from error
            child.check_suspended()

    def stop(self) -> dict[str, dict[str, Any]]:
        """Stop them; returns what each said last, by name."""
        return stop_all(self.children)


class ForeignFlight(WireFlight):
    """The plant and the controller of one flight, and what they have flown so far."""

    def __init__(
        self, scene: Scenario, opens_s: float, folder: Path, instance: int, speed: float | None, on_rows: tuple[Take, Take], progress: Callable[[float], None],
    ) -> None:  # fmt: skip
        """`scene`: its `controller` is the command.

        `opens_s`: wall time until it has opened its port. Others as for WireFlight.
        """
        super().__init__(scene, folder, instance, speed, on_rows, progress)
        self._words = filled(scene.controller, values(instance, scene.rate_hz, scene.airframe.path))
        self._opens_s = opens_s

    def _record(self, plant: Rows) -> None:
        self._on_rows[0](plant)
        self._on_rows[1](self._sender.asked(plant))

    def _start(self, stack: ExitStack, look: Callable[[], None]) -> int:
        plant_out, plant_in = os.pipe()
        grants_out, grants_in = os.pipe()
        stack.callback(os.close, grants_in)
        self._sender = SetpointSender(self._instance, self._scene.rate_hz)
        stack.callback(self._sender.close)
        keep = _Both(self._plant_rows, self._fcu_rows, self._sender.asked)
        self._collector = Collector({plant_out: (WIDTH, keep, self._record)})
        self._plant_fd = plant_out
        stack.callback(self._collector.finish, DRAIN_S)
        self._pair = pair = ForeignPair(stack, look)
        world = self._folder / "world.json"
        handover.save(world, self._scene.world)
        pair.start(
            self._folder, self._words,
            ["--instance", str(self._instance), "--world", str(world),
             *plant_arguments(self._folder, self._scene),
             "--speed", "max" if self._speed is None else str(self._speed),
             "--wait" if self._speed is None else "--drop",
             "--record-fd", str(plant_in), "--control-fd", str(grants_out)],
            (plant_in, grants_out),
        )  # fmt: skip
        self._collector.start()
        return grants_in

    def _meet(self, stack: ExitStack) -> SetpointSender:
        self._wait_for_port()
        self._arm(self._sender)
        return self._sender

    def _wait_for_port(self) -> None:
        """Until the controller has opened the port of the plant link, where the system tells."""
        port, until = ports(self._instance).fcu_plant, time.monotonic() + self._opens_s
        while (bound := bound_ports()) is not None and port not in bound:
            self._pair.check()
            if time.monotonic() > until:
                raise InfrastructureError(
                    f"the controller did not open UDP port {port} within {self._opens_s:g} s"
                    f" (--controller-timeout; {PAGE})"
                )
            time.sleep(LOOK_S)

    def _wait_for_rows(self, tick: int) -> None:
        """They are here: what was asked for comes with the plant's."""
