"""`gcs reset`."""

from __future__ import annotations

import click

from fcu.interface.ports import busy, first_running_instance, ports
from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure

WAIT_S = 10.0


@click.command(
    epilog="\b\nExit codes: 0 the vehicle is at its start and time runs, 2 invalid command line,\n"
    "3 no vehicle, no reply within --timeout, or rejected: it is armed."
)
@click.option("--force", is_flag=True, help="Reset an armed vehicle too, also in flight.")
@click.option("--timeout", "timeout_s", type=click.FloatRange(min=0.0), default=WAIT_S, show_default=True, metavar="S", help="Seconds to wait for the vehicle; then exit with 3.")  # fmt: skip
@arguments.instance("the first that runs")
def reset(force: bool, timeout_s: float, instance: int | None) -> None:
    """Put a vehicle that is up back to its start, simulator and flight controller.

    After a crash, or on the ground. Simulation time begins again at 0, and everything is as after
    `gcs up`, except that parameters set over MAVLink stay. A vehicle that started in the air is
    armed again and holds there. Ports, telemetry and diagnostics go on.
    """
    from fcu.interface.link import UdpLink
    from gcs_tools.flight.ground_script import Vehicle, VehicleError, put_back

    number = first_running_instance() if instance is None else instance
    if number is None or not busy(number, "fcu_script"):
        which = "" if number is None else f" as instance {number}"
        raise Failure(f"no vehicle is up on this machine{which} (start one: gcs up)")
    # from a port of its own: a script may have the vehicle's
    vehicle = Vehicle(number, UdpLink(0, ports(number).fcu_station))
    try:
        put_back(vehicle, force, timeout_s)
    except VehicleError as error:
        raise Failure(error) from error
    finally:
        vehicle.close()
    click.echo(f"reset: instance {number} is at its start")
