"""`gcs replay`."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fcu.interface import options
from fcu.interface.options import WholeNumber
from fcu.interface.ports import INSTANCES
from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure
from gcs_tools.exit_codes import USAGE

if TYPE_CHECKING:
    from gcs_tools.live.replay import Replay


@click.command()
@click.argument("recording", type=click.Path(path_type=Path), callback=arguments.recording)
@arguments.speed("1")
@click.option("--from", "t_from", type=float, default=0.0, callback=options.time_s, metavar="S", help="Simulation time of the first tick, s.")  # fmt: skip
@click.option("--to", "t_to", type=float, default=options.LATEST_S, callback=options.time_s, metavar="S", help="Simulation time of the last tick, s.")  # fmt: skip
@click.option("--loop", is_flag=True, help="Repeat until Ctrl-C.")
@click.option("--wait", is_flag=True, help="Wait for a subscriber before the first tick.")
@click.option("--instance", type=WholeNumber(0, INSTANCES - 1), help=f"Instance number to publish as, 0 to {INSTANCES - 1}; default: the first that nobody publishes.")  # fmt: skip
@arguments.ZENOH
def replay(
    recording: Path, speed: float | None, t_from: float, t_to: float, loop: bool, wait: bool,
    instance: int | None, zenoh: Path | None,
) -> None:  # fmt: skip
    """Publish a RECORDING on Zenoh again, for the same tools: monitor, view, topics, record.

    Exit codes: 0 at its end or after Ctrl-C, 2 RECORDING or CONFIG cannot be read, 3 no connection
    to Zenoh.
    """
    from fcu.interface.ports import ports
    from fcu.interface.topics import run_name
    from gcs_tools.cli.terminal import status
    from gcs_tools.live import bus
    from gcs_tools.live.replay import replay as send
    from gcs_tools.recording.reader import RecordingError

    taken = bus.published() if zenoh is None else []
    if instance in taken:
        raise Failure(f"instance {instance} is published already: choose another, or none")
    free = [n for n in range(INSTANCES) if n not in taken]
    number = instance if instance is not None else next(iter(free), 0)
    name = f"replay-{recording.absolute().parent.name}-{recording.stem}"

    def ready(made: Replay) -> None:
        first, last = made.span_s
        click.echo(f"replaying {first:.3f} to {last:.3f} s as instance {number} (gcs monitor)", err=True)  # fmt: skip

    try:
        for n in itertools.count(1):  # each time it is another run
            run = run_name(f"{name}-{n}" if loop else name)
            with status("") as tell:
                send(
                    recording, number, str(ports(number).system_id), run, zenoh, speed, t_from,
                    t_to, wait, ready, lambda t: tell(f"{t:10.3f} s"),
                )  # fmt: skip
            if not loop:
                break
    except RecordingError as error:
        raise Failure(error, USAGE) from error
    except bus.BusError as error:
        raise Failure(error, error.exit_code) from error
    except KeyboardInterrupt:
        pass
