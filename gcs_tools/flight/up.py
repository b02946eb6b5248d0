"""`gcs up`: the pair of processes in real time, for a ground station or a script to connect to."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from fcu.interface import handover
from fcu.interface.link import HOST
from fcu.interface.topics import port
from gcs_tools.flight.processes import Child, FlightEnded, stop_all
from gcs_tools.flight.scenario import Scenario
from gcs_tools.live.publishing import Publishing, Zenoh

TELL_S = 2.0  # wall: a flight controller tells after one that its plant is silent


def up(
    scene: Scenario | None, folder: Path, instance: int, ready: str,
    speed: str = "1", options: Sequence[str] = (), zenoh: Zenoh | None = None,
    flies: dict[str, Any] | None = None,
) -> None:  # fmt: skip
    """Run both until interrupted; print `ready` once both are.

    `zenoh`: how they are published, None: not; `flies`: what is then said of them.

    `scene`: whose law and world to fly; None: s1000.toml's, standing on the ground.
    `speed`: simulated seconds a second, or max.  `options`: for the flight controller.
    Raises KeyboardInterrupt when told to stop, InfrastructureError when one of them ends.
    """
    N = str(instance)
    handed: list[str] = []
    world: list[str] = []
    if scene is not None:
        handover.save(folder / "settings.json", scene.settings)
        handover.save(folder / "world.json", scene.world)
        handed = ["--handover", str(folder / "settings.json")]
        world = ["--world", str(folder / "world.json")]
    with ExitStack() as stack:
        children: list[Child] = []
        publishing: Publishing | None = None
        life_out, life_in = os.pipe()
        stack.callback(os.close, life_in)
        os.set_inheritable(life_in, False)
        if zenoh is not None:
            publishing = Publishing(zenoh, folder, instance, flies or {}, os.dup(life_out))
            stack.callback(publishing.stop)
        stack.callback(lambda: stop_all(children))
        second_out = os.dup(life_out)
        fcu = Child(
            "flight controller", "fcu",
            ["--instance", N, *handed, *options, "--lifeline-fd", str(life_out)],
            folder / "fcu.log", (life_out,),
        )  # fmt: skip
        children.append(fcu)
        plant = Child(
            "plant", "sitl_plant",
            ["--instance", N, *world, "--speed", speed, "--lifeline-fd", str(second_out)],
            folder / "plant.log", (second_out,),
        )  # fmt: skip
        children.append(plant)

        def check() -> None:
            for child in children:
                child.check()

        for child in children:
            child.wait_ready(check)
        print(ready, flush=True)
        if publishing is not None:
            why = publishing.wait_ready()
            where = "as configured" if zenoh and zenoh.config else f"tcp/{HOST}:{port(instance)}"
            print(f"  diagnostics     {why or f'Zenoh, {where} (gcs monitor)'}", flush=True)
        try:
            while True:
                check()
                if publishing is not None and publishing.has_died():
                    print(
                        f"  diagnostics     ended (again with: gcs publish --instance {instance})",
                        flush=True,
                    )
                time.sleep(0.1)
        except FlightEnded:
            _let_it_tell(fcu)
            raise


def _let_it_tell(fcu: Child) -> None:
    """Wait until the flight controller has told its ground stations that there is no plant."""
    until = time.monotonic() + TELL_S
    while time.monotonic() < until and fcu.process.poll() is None:
        if "silent" in fcu.last_words():
            return
        time.sleep(0.05)
