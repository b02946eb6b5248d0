"""A vehicle that is up: its two processes, which a crash does not end, and its start.

A flight that begins in the air would be over before a person has typed a command. So the plant
holds time at the start until the vehicle is armed, as a ground script arms it over MAVLink, and it
then holds where it is from the first tick on; after a reset again.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from typing import Any

from fcu.interface import handover
from fcu.interface.link import UdpLink
from fcu.interface.ports import ports
from fcu.mavlink.framing import Source
from gcs_tools.flight.ground_script import Vehicle, VehicleError
from gcs_tools.flight.pair import Pair
from gcs_tools.flight.processes import InfrastructureError
from gcs_tools.flight.scenario import Scenario

ARMS = Source(254, 190)  # who arms it: beside a ground station, which is 255
FOREVER = 1 << 62  # ticks


class LiveVehicle:
    """One vehicle, from its start until somebody stops the pair."""

    def __init__(self, pair: Pair, stack: ExitStack, instance: int, in_the_air: bool) -> None:
        """`in_the_air`: it begins there. `stack`: closes what this opens."""
        self._pair = pair
        self._stack = stack
        self._instance = instance
        self._in_the_air = in_the_air
        self._grants = -1

    def start(self, scene: Scenario | None, fcu: Sequence[str], speed: str) -> str:
        """Start both, and the flight; why nothing is published, or "". Raises InfrastructureError."""
        fds = [self._pair.lifeline()]
        plant = ["--speed", speed, "--stay", "--lifeline-fd", str(fds[0])]
        if self._in_the_air:
            granted, self._grants = os.pipe()
            self._stack.callback(os.close, self._grants)
            fds.append(granted)
            plant += ["--control-fd", str(granted)]
        why = self._pair.start(scene, fcu, plant, plant_fds=fds)
        if self._in_the_air:
            try:
                self._let_go(0)
            except VehicleError as error:
                raise InfrastructureError(str(error)) from error
        return why

    def events(self) -> Iterator[str]:
        """What has become of the vehicle since the last call, a sentence each.

        Raises InfrastructureError when one of the processes has ended.
        """
        self._pair.check()
        for said in self._pair.children[1].heard():
            if "flight_ended" in said:
                yield (
                    f"the vehicle {said['flight_ended']} at {said['time_s']:.1f} s; "
                    f"to put it back: gcs reset --instance {self._instance}"
                )
            elif "reset" in said:
                yield self._after_reset(said)

    def _after_reset(self, said: dict[str, Any]) -> str:
        if not self._in_the_air:
            return "reset: the vehicle stands at the start"
        try:
            self._let_go(said["reset"])
        except VehicleError as error:
            return f"reset: simulation time is held, since the vehicle does not arm: {error}"
        return "reset: the vehicle holds at the start"

    def _let_go(self, flight: int) -> None:
        """Arm, and let time run. A flight that was reset meanwhile does not run by this.

        Raises VehicleError, InfrastructureError.
        """
        vehicle = Vehicle(self._instance, UdpLink(0, ports(self._instance).fcu_station), ARMS)
        try:
            vehicle.on_wait = self._pair.check
            vehicle.wait_ready()
            vehicle.arm()
        finally:
            vehicle.close()
        with suppress(BrokenPipeError):  # the plant is gone: the next check says why
            os.write(self._grants, handover.grant(FOREVER, flight))
