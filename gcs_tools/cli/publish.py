"""`gcs publish`."""

from __future__ import annotations

import json
import time
from functools import partial
from pathlib import Path

import click

from fcu.interface.options import WholeNumber
from fcu.interface.ports import INSTANCES
from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure
from gcs_tools.exit_codes import INFRASTRUCTURE, OK, USAGE


@click.command()
@click.option("--instance", type=WholeNumber(0, INSTANCES - 1), default=0, show_default=True, help=f"Instance number, 0 to {INSTANCES - 1}.")  # fmt: skip
@click.option("--run", metavar="NAME", help="Run name in the Zenoh keys; default: the time.")
@arguments.LAW
@arguments.AIRFRAME
@arguments.ZENOH
@click.option("--about", type=click.Path(path_type=Path), hidden=True)
@click.option("--events-fd", type=int, hidden=True)
@click.option("--lifeline-fd", type=int, hidden=True)
def publish(
    instance: int, run: str | None, law: str | None, airframe: str | None, zenoh: Path | None, about: Path | None,
    events_fd: int | None, lifeline_fd: int | None,
) -> int:  # fmt: skip
    """Publish the ticks of fcu and sitl-plant processes that you started by hand.

    `gcs up` and `gcs fly` publish by themselves. Can be started, stopped and killed at any time.
    """
    from fcu.interface import event_log
    from fcu.interface.link import PortBusy
    from fcu.interface.starter import occupy_standard_streams
    from fcu.interface.topics import run_name
    from fcu.laws import loader
    from fcu.process.configuration import ConfigurationError, read_airframe
    from gcs_tools.live import bus, publisher
    from gcs_tools.recording.reader import flies_with

    occupy_standard_streams()
    write = partial(event_log.write, fd=events_fd)
    name = run_name(run or time.strftime("%Y%m%d-%H%M%S"))
    try:
        flown = loader.load(law or loader.DEFAULT)
        if about is not None:
            flies = json.loads(about.read_text())
        else:
            flies = flies_with(read_airframe(flown, airframe))
        publisher.publish(instance, flown, name, flies, zenoh, lifeline_fd, write)
    except (loader.LawError, ConfigurationError) as error:
        raise Failure(error, USAGE) from error
    except PortBusy:
        publisher.say("error", f"instance {instance} has a publisher already", write)
        return INFRASTRUCTURE
    except bus.BusError as error:
        publisher.say("error", str(error), write)
        return error.exit_code
    return OK
