"""`gcs topics`."""

from __future__ import annotations

from pathlib import Path

import click

from fcu.interface.options import Number
from gcs_tools.cli import arguments
from gcs_tools.cli.live_vehicle import watched
from gcs_tools.cli.output import print_json
from gcs_tools.exit_codes import INFRASTRUCTURE, OK


@click.command()
@click.option("--for", "seconds", type=Number(min=0.0, min_open=True), default=2.0, show_default=True, metavar="S", help="Seconds to listen, and to wait for a vehicle.")  # fmt: skip
@arguments.TIMEOUT
@arguments.as_json("Print the table as JSON.")
@arguments.LIVE_INSTANCE
@arguments.ZENOH
def topics(
    seconds: float, timeout_s: float | None, as_json: bool, instance: int | None,
    zenoh: Path | None,
) -> int:  # fmt: skip
    """List the topics that a vehicle publishes: key, message, measured rate, losses, sizes.

    Exit codes: 0 samples arrived, 3 none arrived or no vehicle within --timeout (default: the
    seconds of --for), 130 interrupted.
    """
    from gcs_tools.live.topics import listen, print_table

    with watched(instance, zenoh, seconds if timeout_s is None else timeout_s) as vehicle:
        found = listen(vehicle, seconds)
    if as_json:
        print_json(found)
    else:
        print_table(found)
    return OK if any(topic["ticks"] for topic in found["topics"].values()) else INFRASTRUCTURE
