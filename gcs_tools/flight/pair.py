"""Flight controller, plant and publisher of one vehicle: started and stopped together."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from fcu.guard.gains import FLY
from fcu.interface import faults, handover
from fcu.interface.airframe import AirframeFile
from fcu.interface.samples_file import write_wind
from fcu.laws.loader import Law
from gcs_tools.flight.forking import can_fork, load
from gcs_tools.flight.processes import Child, Unanswered, stop_all
from gcs_tools.flight.publisher_process import PublisherProcess, Zenoh
from gcs_tools.flight.scenario import Scenario
from sitl_plant.physics.wind import layers


def plant_arguments(folder: Path, scene: Scenario) -> list[str]:
    """Arguments for a plant of the scene's own wind and faults, if it has any. Raises OSError."""
    found: list[str] = []
    if scene.wind is not None:
        write_wind(folder / "wind.csv", scene.wind)
        found += ["--wind", str(folder / "wind.csv")]
    if scene.layers is not None:
        layers.save(folder / "layers.json", scene.layers)
        found += ["--layers", str(folder / "layers.json")]
    if scene.faults:
        faults.save(folder / "faults.json", scene.faults)
        found += ["--faults", str(folder / "faults.json")]
    return found


class Pair:
    """The processes of one vehicle, which end with whoever has started them."""

    def __init__(
        self, stack: ExitStack, folder: Path, instance: int, law: Law,
        airframe: AirframeFile, zenoh: Zenoh | None,
        flies: dict[str, Any], look: Callable[[], None] = lambda: None,
        starting: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        """`stack`: stops them. `law`: that is flown. `airframe`: with which. `zenoh`: how they are published, None: not;
        `flies`: what is then said of them. `look`: called by every check; may raise.
        `starting`: called several times a second until both are ready.
        """
        self.children: list[Child] = []  # flight controller, plant
        self.publisher: PublisherProcess | None = None
        self._folder, self._instance, self._law = folder, instance, law
        self._airframe = airframe
        self._look, self._starting = look, starting
        self._forks = can_fork() and load(law)
        self._life, held = os.pipe()  # who reads it ends when it is closed, with us at the latest
        for end in (self._life, held):
            stack.callback(os.close, end)
        stack.callback(self.stop)
        if zenoh is not None:
            self.publisher = PublisherProcess(
                zenoh, folder, instance, law.source, flies, self.lifeline()
            )

    def lifeline(self) -> int:
        """A file descriptor for one more process that ends with us."""
        return os.dup(self._life)

    def start(
        self, scene: Scenario | None, fcu: Sequence[str], plant: Sequence[str],
        fcu_fds: Sequence[int] = (), plant_fds: Sequence[int] = (),
    ) -> str:  # fmt: skip
        """Start both with these arguments; why nothing is published, or "".

        `scene`: whose settings and world to fly; None: the airframe's, standing on the ground. Raises InfrastructureError when one of them ends, OSError.
        """
        own = ["--instance", str(self._instance)]
        settings, world = self._folder / "settings.json", self._folder / "world.json"
        life = self.lifeline()
        fcu = [*own, "--law", self._law.source, "--law-sha256", self._law.digest, *fcu]
        fcu += ["--airframe", self._airframe.source, "--airframe-sha256", self._airframe.sha256]
        fcu += ["--lifeline-fd", str(life)]
        plant = [*own, *plant]
        if scene is not None:
            handover.save(settings, scene.settings)
            handover.save(world, scene.world)
            fcu += ["--handover", str(settings)]
            fcu += ["--unstable-gains", FLY] if scene.flies_unstable else []
            for name, value in scene.parameters.items():
                fcu += ["--param", f"{name}={value!r}"]
            plant += ["--world", str(world), *plant_arguments(self._folder, scene)]
        else:
            plant += ["--airframe", self._airframe.source]
        for name, module, arguments, log, fds in (
            ("flight controller", "fcu", fcu, "fcu.log", (*fcu_fds, life)),
            ("plant", "sitl_plant", plant, "plant.log", plant_fds),
        ):
            self.children.append(
                Child(name, module, arguments, self._folder / log, fds, self._forks, tells=True)
            )
        for child in self.children:
            child.wait_ready(self._check_start)
        return self.publisher.wait_ready() if self.publisher is not None else ""

    def _check_start(self) -> None:
        """Raise InfrastructureError if one of the two has ended, or hangs before it is ready."""
        self.check()
        self._starting()
        for child in self.children:
            child.is_ready()

    def check(self) -> None:
        """Raise InfrastructureError if one of the two has ended, or is suspended."""
        self._look()
        try:
            for child in self.children:
                child.check()
                child.check_suspended()
        except Unanswered as error:
            if not self.children[0].is_computing():
                raise
            raise Unanswered(f"{error}; it is still computing: the law may not return") from error

    def stop(self) -> dict[str, dict[str, Any]]:
        """Stop them; returns what each said last, by name."""
        said = stop_all(self.children)
        if self.publisher is not None:
            said["publisher"] = self.publisher.stop()
        return said
