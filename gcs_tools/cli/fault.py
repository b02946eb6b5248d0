"""`gcs fault`."""

from __future__ import annotations

import math
import time

import click

from fcu.interface.faults import LINK, SPECS, Kind
from fcu.interface.files.spelling import suggestion
from fcu.interface.options import Number, WholeNumber
from fcu.interface.ports import ports
from gcs_tools.cli import arguments
from gcs_tools.cli.live_vehicle import MEET_S, up_by, wait_ready
from gcs_tools.cli.output import Failure

CLEAR = "clear"
GIVEN = [name for name, spec in SPECS.items() if spec.kind not in {*LINK, Kind.GROUND_LOST}]


def _known(_context: click.Context, _option: click.Parameter, name: str | None) -> str | None:
    """A callback: a fault that there is. Raises BadParameter."""
    if name is None or name in (*GIVEN, CLEAR):
        return name
    meant = suggestion(name, [*GIVEN, CLEAR])
    raise click.BadParameter(f"{name!r}: no such fault{meant}. The list: gcs fault")


@click.command(
    epilog="Exit codes: 0 the simulator has done it, 2 invalid command line,\n"
    "3 no vehicle ready or no reply within --timeout, or rejected: the reason is told."
)
@click.argument("name", required=False, metavar="[NAME]", callback=_known)
@click.option(
    "--rotor", type=WholeNumber(1, 8), help="Of motor_... and clear; default: all rotors."
)
@click.option("--much", type=float, help="How much, in the unit that the list names.")
@click.option(
    "--for", "for_s", type=Number(0.0), default=0.0,
    help="Simulation time in seconds; 0, the default: until gcs fault clear.",
)  # fmt: skip
@click.option("--enable", is_flag=True, help="Set SYS_FAILURE_EN to 1 first.")
@arguments.UP_TIMEOUT
@arguments.instance("the first that runs")
def fault(
    name: str | None, rotor: int | None, much: float | None, for_s: float, enable: bool, timeout_s: float,
    instance: int | None,
) -> None:  # fmt: skip
    """Break something of a vehicle that is up, or list what can be broken.

    Without NAME: the list. `clear` ends every fault, or with --rotor those of
    one rotor. A mission has the same faults as a timeline, in [[plant.faults]].
    """
    from fcu.interface.link import UdpLink
    from gcs_tools.flight.fault_order import choices, clear, give
    from gcs_tools.flight.ground_script import Vehicle, VehicleError

    _check(name, rotor, much, for_s)
    if name is None:
        for each in choices():
            much_told = f"; --much {each.much:g} ({each.range})" if each.what else ""
            click.echo(f"{each.name:15}{each.says}{much_told}")
        click.echo(f"{CLEAR:15}every fault ends, or with --rotor those of one rotor")
        return
    number, due = up_by(instance, timeout_s)
    vehicle = Vehicle(number, UdpLink(0, ports(number).fcu_station))  # a port of its own
    try:
        wait_ready(vehicle, max(due, time.monotonic() + MEET_S))
        if name == CLEAR:
            clear(vehicle, rotor or 0)
        else:
            give(vehicle, name, rotor or 0, much or 0.0, for_s, enable)
    except VehicleError as error:
        raise Failure(error) from error
    finally:
        vehicle.close()
    whose = f" of rotor {rotor}" if rotor else ""
    click.echo(f"{name}{whose}: done by the simulator of instance {number}")


def _check(name: str | None, rotor: int | None, much: float | None, for_s: float) -> None:
    """Refuse options that would be done as something else. Raises UsageError."""
    if much is not None and (much == 0.0 or not math.isfinite(much)):
        raise click.UsageError(
            f"--much {much:g}: expected a number that is finite and not 0 (a command's 0 stands for the "
            "default). motor_off stops a rotor, and a size near 0 may be given"
        )
    if much is not None and name is not None and name != CLEAR:
        from gcs_tools.flight.fault_order import choices

        chosen = next(each for each in choices() if each.name == name)
        if not chosen.what:
            raise click.UsageError(f"--much {much:g}: {name} has no size")
        if not chosen.least <= much <= chosen.most:
            raise click.UsageError(f"--much {much:g}: expected {chosen.range}")
    if not math.isfinite(for_s):
        raise click.UsageError(
            f"--for {for_s:g}: expected seconds; left out: until gcs fault clear"
        )
    if name == CLEAR and (much is not None or for_s):
        raise click.UsageError("clear takes neither --much nor --for: it ends faults at once")
    if rotor is not None and name is not None and not name.startswith((CLEAR, "motor_")):
        raise click.UsageError(f"--rotor {rotor}: {name} is of no rotor")
