"""The commands that speak Zenoh: `gcs publish`, `record`, `replay` and `topics`."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fcu.interface import options
from fcu.interface.ports import INSTANCES

if TYPE_CHECKING:
    from zenoh import Session

    from gcs_tools.live.watch import Watch

OK, USAGE, INFRASTRUCTURE, INTERRUPTED = 0, 2, 3, 130
ALONE_S = 3.0  # wall: after that who waits with a file of their own is told what for
UNSEEN = "connected, but no vehicle answers, or not to us"

LOOK_S = 0.2  # wall: between two looks for a publisher
ZENOH = click.option(
    "--zenoh", type=click.Path(path_type=Path), metavar="CONFIG.json5",
    help="Zenoh's own configuration (docs/zenoh); default: loopback, without a router.",
)  # fmt: skip
WHICH = click.option(
    "--instance", type=click.IntRange(0, INSTANCES - 1), help="Default: the first that publishes."
)


def fail(text: str, code: int = INFRASTRUCTURE) -> None:
    """Say what is wrong, and end."""
    from gcs_tools.live.bus import leave

    click.echo(f"Error: {text}", err=True)
    leave(code)


@contextlib.contextmanager
def watched(instance: int | None, zenoh: Path | None, what: str) -> Iterator[Watch]:
    """A Watch of the vehicle that is meant, found; ends the program when there can be none.

    `what`: what is waited for it to do, for who waits.
    """
    from fcu.interface.ports import ports
    from gcs_tools.live import bus
    from gcs_tools.live.watch import Watch

    try:
        number = instance
        if zenoh is None:
            there = bus.published()
            if number not in there if number is not None else not there:
                who = "a vehicle" if number is None else f"instance {number}"
                click.echo(f"waiting for {who} to {what} (start one: gcs up) ...", err=True)
            while number is None and not there:
                time.sleep(LOOK_S)
                there = bus.published()
            number = there[0] if number is None else number
        with bus.session(bus.for_tool(number or 0, zenoh)) as session:
            watch = Watch(session, "*" if number is None else str(ports(number).system_id))
            try:
                watch.find(_told_when_alone(session, zenoh, number))
                yield watch
            finally:
                watch.close()
    except bus.BusError as error:
        fail(str(error), error.exit_code)


def _told_when_alone(
    session: Session, zenoh: Path | None, number: int | None
) -> Callable[[], None]:
    """What says once, to who waits though there is somebody, how far it leads."""
    from gcs_tools.live import bus

    there = zenoh is not None or number in bus.published()
    due = time.monotonic() + ALONE_S if there else math.inf
    where = f"as {zenoh} says" if zenoh is not None else f"instance {number}"
    who = "" if number is None or zenoh is None else f" (as instance {number})"

    def check() -> None:
        nonlocal due
        if time.monotonic() > due:
            due = math.inf
            why = UNSEEN if bus.connected(session) else bus.UNCONNECTED
            click.echo(f"waiting, {where}: {why}{who} ...", err=True)

    return check


@click.command()
@click.option("--instance", type=click.IntRange(0, INSTANCES - 1), default=0, show_default=True)
@click.option("--run", metavar="NAME", help="Under which its keys are; default: the time.")
@ZENOH
@click.option("--about", type=click.Path(path_type=Path), hidden=True)
@click.option("--lifeline-fd", type=int, hidden=True)
def publish(
    instance: int, run: str | None, zenoh: Path | None, about: Path | None, lifeline_fd: int | None
) -> None:
    """Publish what fcu and sitl-plant fly, for a pair that was started by hand.

    `gcs up` and `gcs fly` do this themselves. May be started, stopped and killed at any time.
    """
    from fcu.interface.link import PortBusy
    from fcu.interface.starter import occupy_standard_streams
    from fcu.interface.topics import run_name
    from gcs_tools.live import bus
    from gcs_tools.live.publisher import publish as run_publisher
    from gcs_tools.live.publisher import say

    occupy_standard_streams()
    name = run_name(run or time.strftime("%Y%m%d-%H%M%S"))
    try:
        flies = json.loads(about.read_text()) if about else {}
        run_publisher(instance, name, flies, zenoh, lifeline_fd)
    except PortBusy:
        say("error", f"instance {instance} has a publisher already")
        bus.leave(INFRASTRUCTURE)
    except bus.BusError as error:
        say("error", str(error))
        bus.leave(error.exit_code)
    bus.leave(OK)


@click.command()
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--for", "seconds", type=click.FloatRange(min=0.0, min_open=True), metavar="S", help="End after so many seconds of simulation time; default: with the vehicle, or Ctrl-C.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print what was recorded as JSON.")
@WHICH
@ZENOH
def record(
    out: Path, seconds: float | None, as_json: bool, instance: int | None, zenoh: Path | None
) -> None:
    """Record everything that a running vehicle publishes into OUT, an MCAP file.

    Waits for a vehicle if there is none. Exits 0 when the vehicle is gone, the time is up or
    Ctrl-C was pressed; 2 when OUT cannot be written or CONFIG read; 3 without Zenoh.
    """
    from gcs_tools.cli.terminal import recording_progress
    from gcs_tools.live import bus
    from gcs_tools.live.recorded import Recorded, record_until
    from gcs_tools.recording.reader import RecordingError

    if out.exists():
        fail(f"{out}: it exists already", USAGE)
    if not out.absolute().parent.is_dir():
        fail(f"{out}: there is no folder {out.absolute().parent}", USAGE)
    done = Recorded()
    try:
        with watched(instance, zenoh, "publish") as watch, recording_progress() as progress:
            record_until(watch, out, seconds, done, progress)
    except RecordingError as error:
        said = done.summary(out)
        click.echo(f"Error: {error}" + (f"\n{said}" if done.ticks else ""), err=True)
        bus.leave(USAGE)
    except KeyboardInterrupt:
        done.why = done.why or "interrupted"
    if as_json:
        click.echo(json.dumps(done.as_dict(out), indent=2))
    else:
        click.echo(done.summary(out))
    bus.leave(OK)


@click.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--speed", default="1", show_default=True, callback=options.speed, metavar="N|max", help="Simulated seconds a second, or max.")  # fmt: skip
@click.option("--from", "t_from", type=float, default=0.0, callback=options.time_s, metavar="S", help="Simulation time to begin at, s.")  # fmt: skip
@click.option("--to", "t_to", type=float, default=options.LATEST_S, callback=options.time_s, metavar="S", help="Simulation time to end at, s.")  # fmt: skip
@click.option("--loop", is_flag=True, help="Again and again, until Ctrl-C.")
@click.option("--wait", is_flag=True, help="Begin when somebody listens.")
@click.option("--instance", type=click.IntRange(0, INSTANCES - 1), help="As which; default: the first that nobody publishes.")  # fmt: skip
@ZENOH
def replay(
    recording: Path, speed: float | None, t_from: float, t_to: float, loop: bool, wait: bool,
    instance: int | None, zenoh: Path | None,
) -> None:  # fmt: skip
    """Put a RECORDING back onto Zenoh, for the same tools: monitor, view, topics, record.

    Exits 0 at its end or after Ctrl-C, 2 when it or CONFIG cannot be read, 3 without Zenoh.
    """
    from fcu.interface.ports import ports
    from fcu.interface.topics import run_name
    from gcs_tools.cli.terminal import replay_progress
    from gcs_tools.live import bus
    from gcs_tools.live.replay import Replay
    from gcs_tools.live.replay import replay as send
    from gcs_tools.recording.reader import RecordingError

    taken = bus.published() if zenoh is None else []
    if instance in taken:
        fail(f"instance {instance} is published already: choose another, or none")
    free = [n for n in range(INSTANCES) if n not in taken]
    number = instance if instance is not None else next(iter(free), 0)
    name = f"replay-{recording.absolute().parent.name}-{recording.stem}"

    def ready(made: Replay) -> None:
        first, last = made.span_s
        click.echo(f"replaying {first:.3f} to {last:.3f} s as instance {number} (gcs monitor)", err=True)  # fmt: skip

    try:
        for n in itertools.count(1):  # each time it is another run
            run = run_name(f"{name}-{n}" if loop else name)
            with replay_progress() as progress:
                send(
                    recording, number, str(ports(number).system_id), run, zenoh, speed, t_from,
                    t_to, wait, ready, progress,
                )  # fmt: skip
            if not loop:
                break
    except RecordingError as error:
        fail(str(error), USAGE)
    except bus.BusError as error:
        fail(str(error), error.exit_code)
    except KeyboardInterrupt:
        pass
    bus.leave(OK)


@click.command()
@click.option("--for", "seconds", type=click.FloatRange(min=0.0, min_open=True), default=2.0, show_default=True, metavar="S", help="How long to listen, s.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON.")
@WHICH
@ZENOH
def topics(seconds: float, as_json: bool, instance: int | None, zenoh: Path | None) -> None:
    """What a vehicle has on the bus: key, message, rate seen, losses, sizes.

    Exits 0 when it has heard something, 3 when not, 130 after Ctrl-C.
    """
    from gcs_tools.live import bus
    from gcs_tools.live.listed import heard, shown

    try:
        with watched(instance, zenoh, "publish") as watch:
            found = heard(watch, seconds)
    except KeyboardInterrupt:
        bus.leave(INTERRUPTED)
    if as_json:
        click.echo(json.dumps(found, indent=2))
    else:
        shown(found)
    bus.leave(OK if any(topic["ticks"] for topic in found["topics"].values()) else INFRASTRUCTURE)
