"""The command `gcs monitor`."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gcs_tools.commands_bus import OK, WHICH, ZENOH, watched

if TYPE_CHECKING:
    from rich.console import Console

    from gcs_tools.monitor.readings import Readings

HEIGHT = 42  # lines of a single picture, at least
LISTEN_S = 2.0  # wall: before a single picture
FRAMES_HZ = 5.0
LOOK_S = 0.02  # wall: between two looks for what has come


@click.command()
@click.option("--once", is_flag=True, help="One picture after two seconds, and end; also off a terminal.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="The numbers of one picture as JSON, and end.")  # fmt: skip
@WHICH
@ZENOH
def monitor(once: bool, as_json: bool, instance: int | None, zenoh: Path | None) -> None:
    """Watch a vehicle in this terminal: tracking, limits, estimates against truth, wind, losses.

    Stays when the vehicle goes, and goes on with the next one. Ctrl-C ends it. Exits 0; 3
    without Zenoh.
    """
    from rich.console import Console

    from gcs_tools import bus
    from gcs_tools.follow import Follower
    from gcs_tools.monitor.readings import KEPT, Readings
    from gcs_tools.monitor.screen import screen

    console = Console(highlight=False)
    single = once or as_json or not console.is_terminal
    try:
        while True:
            with watched(instance, zenoh, "publish") as watch:
                follower = Follower(watch, kept=KEPT)
                readings = Readings(follower)
                if single:
                    _listen(follower.take, LISTEN_S)
                    break
                _live(console, readings)
    except KeyboardInterrupt:
        bus.leave(OK)
    if as_json:
        click.echo(json.dumps(readings.snapshot(), indent=2))
    else:
        height = max(console.size.height, HEIGHT)
        console.print(screen(readings, console.size.width, height), height=height)
    bus.leave(OK)


def _listen(take: Callable[[], bool], seconds: float) -> None:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if not take():
            time.sleep(LOOK_S)


def _live(console: Console, readings: Readings) -> None:
    """Until the vehicle is gone and another is there."""
    from rich.live import Live

    from gcs_tools.monitor.screen import screen

    follower = readings.follower
    with Live(console=console, screen=True, auto_refresh=False) as live:
        while True:
            _listen(follower.take, 1.0 / FRAMES_HZ)
            size = console.size
            live.update(screen(readings, size.width, size.height), refresh=True)
            if follower.watch.succeeded:
                return
