"""`gcs monitor`."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fcu.interface.options import Number
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
GONE_S = 2.0  # wall: a vehicle that is back within it has not left
LOOK_S = 0.02  # wall: between two looks for what has come


@click.command()
@click.option("--once", is_flag=True, help="Print one picture and exit; needs no terminal.")
@click.option("--svg", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="Write one picture as SVG and exit.")  # fmt: skip
@arguments.as_json("Print the numbers of one picture as JSON and exit.")
@click.option("--for", "for_s", type=Number(min=0.0, min_open=True), metavar="S", help="Seconds of simulation time to watch, or to listen before a single picture; default: until Ctrl-C, or --after.")  # fmt: skip
@click.option("--after", "seconds", type=Number(min=0.1), default=2.0, show_default=True, metavar="S", help="Seconds to listen before a single picture.")  # fmt: skip
@arguments.TIMEOUT
@arguments.LIVE_INSTANCE
@arguments.ZENOH
def monitor(
    once: bool, svg: Path | None, as_json: bool, for_s: float | None, seconds: float,
    timeout_s: float | None, instance: int | None, zenoh: Path | None,
) -> int:  # fmt: skip
    """Watch a vehicle in this terminal: tracking, limits, estimates against truth, wind, losses.

    Waits for a vehicle if there is none: for --timeout, or for the seconds of --for; a single picture
    for 10 s without either. When the vehicle ends, waits for the next one, until Ctrl-C; with --for it
    ends then, and also when simulation time stands, as after a crash, for --timeout (default 10 s, at
    least 2 s). Exit codes: 0; 2 FILE cannot be written, 3 no vehicle, simulation time stands or no
    connection to Zenoh, 130 interrupted before a single picture.
    """
    from rich.console import Console

    from gcs_tools.pictures.follower import Follower
    from gcs_tools.pictures.monitor.readings import Readings
    from gcs_tools.pictures.monitor.screen import screen

    if svg is not None and not svg.absolute().parent.is_dir():
        raise Failure(f"--svg {svg}: there is no folder {svg.absolute().parent}", USAGE)
    console = Console(highlight=False)
    single = once or as_json or svg is not None or not console.is_terminal
    still_s, stands = timeout_s, ""
    if timeout_s is None:
        timeout_s = for_s if for_s is not None else WAIT_S if single else None
    try:
        while True:
            with watched(instance, zenoh, timeout_s) as vehicle:
                follower = Follower(vehicle)
                readings = Readings(follower)
                span = None if for_s is None else _Span(readings, for_s, still_s)
                if single and span is not None:
                    while not span.is_over():
                        _listen(follower.take, LOOK_S)
                        readings.speed()
                elif single:
                    _listen(follower.take, seconds - min(SPEED_S, 0.5 * seconds))
                    readings.speed()
                    _listen(follower.take, min(SPEED_S, 0.5 * seconds))
                else:
                    _live(console, readings, span)
                stands = "" if span is None else span.stands
                if single or span is not None:
                    break
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
    if stands:
        raise Failure(stands)
    return OK


def _draw(readings: Readings, svg: Path) -> None:
    import io

    from rich.console import Console

    from fcu.interface.files import whole_file
    from gcs_tools.pictures.monitor.screen import screen

    canvas = Console(record=True, width=WIDTH, height=HEIGHT, file=io.StringIO(), highlight=False)
    canvas.print(screen(readings, WIDTH, HEIGHT), height=HEIGHT)
    try:
        whole_file.write(svg, canvas.export_svg(title="gcs monitor").encode())
    except OSError as error:
        raise Failure(f"{svg}: {error.strerror}", USAGE) from error


def _listen(take: Callable[[], bool], seconds: float) -> None:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if not take():
            time.sleep(LOOK_S)


class _Span:
    """The seconds of simulation time for which a vehicle is watched."""

    def __init__(self, readings: Readings, seconds: float, still_s: float | None) -> None:
        """`still_s`: how long (wall) simulation time may stand, as for Standstill."""
        from gcs_tools.live.standstill import Standstill

        self._readings, self._seconds = readings, seconds
        self._still = Standstill(still_s)
        self.stands = ""  # that simulation time stands, and why; empty: it does not
        self._first = math.nan  # s
        self._gone_at: float | None = None  # wall

    def is_over(self) -> bool:
        """Whether they have passed, time stands, or the vehicle has ended, or is out of sight."""
        from gcs_tools.live.standstill import end_told, why

        vehicle, t, now = self._readings.follower.vehicle, self._readings.t, time.monotonic()
        self._first = t if math.isnan(self._first) else self._first
        self._gone_at = (self._gone_at or now) if vehicle.gone else None
        ended = vehicle.has_ended and not vehicle.missing()
        lost = self._gone_at is not None and now - self._gone_at > GONE_S
        over = ended or lost or t - self._first >= self._seconds
        if not over:
            end = end_told(self._readings.follower.events)
            self.stands = why(end) if self._still.see(t, end) else ""
        return over or bool(self.stands)


def _live(console: Console, readings: Readings, span: _Span | None) -> None:
    """Until the vehicle is gone and another is there, or the span is over."""
    from rich.live import Live

    from gcs_tools.pictures.monitor.screen import screen

    follower = readings.follower
    with Live(console=console, screen=True, auto_refresh=False) as live:
        while True:
            _listen(follower.take, 1.0 / FRAMES_HZ)
            size = console.size
            live.update(screen(readings, size.width, size.height), refresh=True)
            if span.is_over() if span is not None else follower.vehicle.succeeded:
                return
