"""`gcs record`."""

from __future__ import annotations

from pathlib import Path

import click

from fcu.interface.options import Number
from gcs_tools.cli import arguments
from gcs_tools.cli.live_vehicle import watched
from gcs_tools.cli.output import Failure, print_json
from gcs_tools.exit_codes import INFRASTRUCTURE, OK, USAGE


@click.command()
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--for", "seconds", type=Number(min=0.0, min_open=True), metavar="S", help="Seconds of simulation time to record; default: until the vehicle ends, or Ctrl-C.")  # fmt: skip
@arguments.TIMEOUT
@arguments.as_json("Print a summary as JSON.")
@arguments.LIVE_INSTANCE
@arguments.ZENOH
def record(
    out: Path, seconds: float | None, timeout_s: float | None, as_json: bool, instance: int | None,
    zenoh: Path | None,
) -> int:  # fmt: skip
    """Record everything that a running vehicle publishes into OUT, an MCAP file.

    Waits for a vehicle if there is none: for --timeout, or for the seconds of --for; without either
    until there is one. With --for it ends also when simulation time stands, as after a crash, for
    --timeout (default 10 s, at least 2 s). Exit codes: 0 the vehicle ended, the time is up or Ctrl-C
    was pressed; 2 OUT cannot be written or CONFIG cannot be read; 3 no vehicle, simulation time
    stands (what came is kept), or no connection to Zenoh.
    """
    from gcs_tools.cli.terminal import status
    from gcs_tools.live.recorder import RecordingSummary, record_until
    from gcs_tools.recording.reader import RecordingError

    if out.exists():
        raise Failure(f"{out}: it exists already", USAGE)
    if not out.absolute().parent.is_dir():
        raise Failure(f"{out}: there is no folder {out.absolute().parent}", USAGE)
    wait_s = seconds if timeout_s is None else timeout_s
    done = RecordingSummary()
    try:
        with (
            watched(instance, zenoh, wait_s) as vehicle,
            status("waiting for the first tick") as progress,
        ):
            record_until(vehicle, out, seconds, done, progress, timeout_s)
    except RecordingError as error:
        raise Failure(f"{error}" + (f"\n{done.summary(out)}" if done.ticks else ""), USAGE) from error  # fmt: skip
    except KeyboardInterrupt:
        done.why = done.why or "interrupted"
    if as_json:
        print_json(done.as_dict(out))
    else:
        click.echo(done.summary(out))
    return INFRASTRUCTURE if done.stands else OK
