"""`gcs reset`."""

from __future__ import annotations

import time

import click

from fcu.interface.ports import ports
from gcs_tools.cli import arguments
from gcs_tools.cli.live_vehicle import MEET_S, up_by, wait_ready
from gcs_tools.cli.output import Failure


@click.command(
    epilog="Exit codes: 0 the vehicle is at its start and time runs, 2 invalid command line,\n"
    "3 no vehicle ready or no reply within --timeout, or rejected: it is armed."
)
@click.option("--force", is_flag=True, help="Reset an armed vehicle too, also in flight.")
@arguments.UP_TIMEOUT
@arguments.instance("the first that runs")
def reset(force: bool, timeout_s: float, instance: int | None) -> None:
    """Put a vehicle that is up back to its start, simulator and flight controller.

    After a crash, or on the ground. Simulation time begins again at 0, and everything is as after
    `gcs up`, except that parameters set over MAVLink stay. A vehicle that started in the air is
    armed again and holds there. Ports, telemetry and diagnostics go on.
    """
    from fcu.interface.link import UdpLink
    from gcs_tools.flight.ground_script import Vehicle, VehicleError, put_back

    number, due = up_by(instance, timeout_s)
    # from a port of its own: a script may have the vehicle's
    vehicle = Vehicle(number, UdpLink(0, ports(number).fcu_station))
    try:
        wait_ready(vehicle, due)
        put_back(vehicle, force, max(due - time.monotonic(), MEET_S))
    except VehicleError as error:
        raise Failure(error) from error
    finally:
        vehicle.close()
    click.echo(f"reset: instance {number} is at its start")
