"""`gcs monitor`."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.live_vehicle import watched
from gcs_tools.cli.output import Failure, print_json
from gcs_tools.exit_codes import INTERRUPTED, OK, USAGE

if TYPE_CHECKING:
    from rich.console import Console

    from gcs_tools.pictures.monitor.readings import Readings

WIDTH, HEIGHT = 140, 42  # columns and lines of a single picture: lines at least
FRAMES_HZ = 5.0
SPEED_S = 2.0  # wall: over which a single picture measures the speed of the flight
WAIT_S = 10.0  # wall: for a vehicle, of a single picture
LOOK_S = 0.02  # wall: between two looks for what has come


@click.command()
@click.option("--once", is_flag=True, help="Print one picture and exit; needs no terminal.")
@click.option("--svg", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="Write one picture as SVG and exit.")  # fmt: skip
@arguments.as_json("Print the numbers of one picture as JSON and exit.")
@click.option("--after", "seconds", type=click.FloatRange(min=0.1), default=2.0, show_default=True, metavar="S", help="Seconds to listen before a single picture.")  # fmt: skip
@arguments.TIMEOUT
@arguments.LIVE_INSTANCE
@arguments.ZENOH
def monitor(
    once: bool, svg: Path | None, as_json: bool, seconds: float, timeout_s: float | None,
    instance: int | None, zenoh: Path | None,
) -> int:  # fmt: skip
    """Watch a vehicle in this terminal: tracking, limits, estimates against truth, wind, losses.

    Waits for a vehicle if there is none: for --timeout, a single picture for 10 s without it. When
    the vehicle ends, waits for the next one, until Ctrl-C. Exit codes: 0; 2 FILE cannot be written,
    3 no vehicle or no connection to Zenoh, 130 interrupted before a single picture.
    """
    from rich.console import Console

    from gcs_tools.pictures.follower import Follower
    from gcs_tools.pictures.monitor.readings import Readings
    from gcs_tools.pictures.monitor.screen import screen

    if svg is not None and not svg.absolute().parent.is_dir():
        raise Failure(f"--svg {svg}: there is no folder {svg.absolute().parent}", USAGE)
    console = Console(highlight=False)
    single = once or as_json or svg is not None or not console.is_terminal
    if timeout_s is None and single:
        timeout_s = WAIT_S
    try:
        while True:
            with watched(instance, zenoh, timeout_s) as vehicle:
                follower = Follower(vehicle)
                readings = Readings(follower)
                if single:
                    _listen(follower.take, seconds - min(SPEED_S, 0.5 * seconds))
                    readings.speed()
                    _listen(follower.take, min(SPEED_S, 0.5 * seconds))
                    break
                _live(console, readings)
    except KeyboardInterrupt:
        return INTERRUPTED if single else OK
    if as_json:
        print_json(readings.snapshot())
    elif svg is not None:
        _draw(readings, svg)
    else:
        height = max(console.size.height, HEIGHT)
        told = console.is_terminal or "COLUMNS" in os.environ
        width = console.size.width if told else WIDTH
        Console(width=width, highlight=False).print(screen(readings, width, height), height=height)
    return OK


def _draw(readings: Readings, svg: Path) -> None:
    import io

    from rich.console import Console

    from gcs_tools.pictures import picture_file
    from gcs_tools.pictures.monitor.screen import screen

    canvas = Console(record=True, width=WIDTH, height=HEIGHT, file=io.StringIO(), highlight=False)
    canvas.print(screen(readings, WIDTH, HEIGHT), height=HEIGHT)
    try:
        picture_file.write(svg, canvas.export_svg(title="gcs monitor").encode())
    except OSError as error:
        raise Failure(f"{svg}: {error.strerror}", USAGE) from error


def _listen(take: Callable[[], bool], seconds: float) -> None:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if not take():
            time.sleep(LOOK_S)


def _live(console: Console, readings: Readings) -> None:
    """Until the vehicle is gone and another is there."""
    from rich.live import Live

    from gcs_tools.pictures.monitor.screen import screen

    follower = readings.follower
    with Live(console=console, screen=True, auto_refresh=False) as live:
        while True:
            _listen(follower.take, 1.0 / FRAMES_HZ)
            size = console.size
            live.update(screen(readings, size.width, size.height), refresh=True)
            if follower.vehicle.succeeded:
                return
