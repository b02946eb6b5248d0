"""`gcs setpoint`."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import click

from fcu.interface.options import Number
from fcu.interface.ports import ports, running_instances
from gcs_tools.cli import arguments
from gcs_tools.cli.live_vehicle import up_by, wait_ready
from gcs_tools.cli.output import Failure, print_json

if TYPE_CHECKING:
    from gcs_tools.flight.ground_script import Vehicle

NO_AUTOPILOT = 8  # HEARTBEAT.autopilot of who is no vehicle


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("x", type=float)
@click.argument("y", type=float)
@click.argument("z", type=float)
@click.option(
    "--yaw-deg", type=float, help="Yaw from East, counter-clockwise, deg; default: unchanged."
)
@arguments.UP_TIMEOUT
@click.option("--within", "within_s", type=Number(min=0.0), default=60.0, show_default=True, metavar="S", help="Seconds of simulation time within which the vehicle is to arrive; then exit with 3.")  # fmt: skip
@arguments.as_json("Print the final position as JSON.")
@arguments.instance("the first that runs")
def setpoint(
    x: float, y: float, z: float, yaw_deg: float | None, timeout_s: float, within_s: float,
    as_json: bool, instance: int | None,
) -> None:  # fmt: skip
    """Arm a running vehicle, take off, and fly to East X, North Y, Up Z (m).

    The vehicle holds there, and also when you interrupt the command. Exit codes: 0 arrived, 3 not
    arrived: no vehicle ready within --timeout, rejected, below the ground, no reply, landed, or not
    there within --within.
    """
    from fcu.interface.link import PortBusy
    from fcu.kernel.algebra import Vec3
    from gcs_tools.flight.ground_script import Vehicle, VehicleError, distance, fly_to

    if not all(math.isfinite(v) and abs(v) <= 1e5 for v in (x, y, z, yaw_deg or 0.0)):
        raise click.UsageError("X, Y, Z and --yaw-deg must be finite numbers, at most 1e5")
    number, due = up_by(instance, timeout_s)
    try:
        vehicle = Vehicle(number)
    except PortBusy as error:
        raise Failure(f"another script or gcs setpoint flies instance {number} (it holds UDP port {error.port}): wait for it, or end it") from error  # fmt: skip
    target = Vec3(x, y, z)
    began = time.monotonic()
    try:
        _meet(vehicle, number, due)
        if instance is None and (others := not_met(number)):
            click.echo(f"not met, but there: {'; '.join(others)}", err=True)
        here = fly_to(vehicle, target, yaw_deg, lambda text: click.echo(text, err=True), within_s)
    except VehicleError as error:
        raise Failure(error) from error
    finally:
        vehicle.close()
    away = distance(here.r_E, target)
    if as_json:
        print_json(
            {"position_m": list(here.r_E), "error_m": away, "wall_s": time.monotonic() - began}
        )
    else:
        click.echo(f"there: ({here.r_E.x:.2f}, {here.r_E.y:.2f}, {here.r_E.z:.2f}) m, {away:.2f} m off")  # fmt: skip


def _meet(vehicle: Vehicle, instance: int, due: float) -> None:
    """Wait for the vehicle until `due`, and name it. Raises VehicleError, Failure if it is not this instance."""
    from gcs_tools.flight.ground_script import VehicleError

    asked, met = ports(instance).system_id, set[int]()

    def hear(message: Any) -> None:
        if getattr(message, "autopilot", NO_AUTOPILOT) != NO_AUTOPILOT:  # a vehicle's heartbeat
            met.add(message.source.system)

    def check() -> None:
        if others := sorted(met - {asked}):
            named = ", ".join(f"system {other}" for other in others)
            raise Failure(
                f"met {named} on the link of instance {instance}, which is system {asked}"
            )

    vehicle.on_message = hear
    try:
        wait_ready(vehicle, due)
    except VehicleError:
        check()
        raise
    vehicle.on_message = lambda _message: None
    check()
    click.echo(f"met system {asked} (instance {instance})", err=True)


def not_met(instance: int) -> list[str]:
    """Each other vehicle that runs on this machine, and the option that means it."""
    others = (n for n in running_instances() if n != instance)
    return [f"system {ports(n).system_id} (--instance {n})" for n in others]
