"""`gcs plan`: plans of ground stations, shown and uploaded."""

from __future__ import annotations

import math
from pathlib import Path

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure, print_json
from gcs_tools.exit_codes import INFRASTRUCTURE, OK, USAGE

FILE = click.argument("file", type=click.Path(path_type=Path), metavar="FILE")


@click.group()
def plan() -> None:
    """Plans of ground stations: .plan of QGroundControl, and .waypoints (docs/plans.md).

    gcs fly FILE flies one.
    """


@plan.command()
@FILE
@click.option("--figure", type=click.Path(path_type=Path), callback=arguments.new_file, metavar="FILE", help="Also draw the plan, its fence and rally points, as PNG, SVG or PDF.")  # fmt: skip
@arguments.as_json("Print the items as JSON.")
def show(file: Path, figure: Path | None, as_json: bool) -> int:
    """Show the items of FILE and whether the vehicle would take them.

    Exit codes: 0 the vehicle takes the plan, 1 it refuses an item, 2 the file cannot be read.
    """
    from gcs_tools.flight.plan_look import look
    from gcs_tools.missions import plan_file

    try:
        read = plan_file.read(file)
        found = look(read)
    except plan_file.PlanError as error:
        raise Failure(error, USAGE) from error
    if as_json:
        print_json(
            {
                "items": [each._asdict() for each in found.items],
                "fence": len(read.fence), "rally": len(read.rally), "refused": found.refused,
            }
        )  # fmt: skip
    else:
        for each in found.items:
            place = ""
            if each.east_m is not None and each.north_m is not None:
                place = f"{each.east_m:9.1f} E {each.north_m:9.1f} N"
            height = (
                ""
                if each.height_m is None or math.isnan(each.height_m)
                else f"{each.height_m:7.1f} m"
            )
            click.echo(f"{each.item:4d}  {each.command:24s} {place:24s} {height}".rstrip())
        click.echo(
            f"{len(read.mission)} items, fence of {len(read.fence)}, {len(read.rally)} rally points"
        )
        click.echo(f"Refused: {found.refused}" if found.refused else "The vehicle takes this plan.")
    if figure is not None:
        from gcs_tools.flight.plan_look import outlines, path
        from gcs_tools.pictures.plot.plan import Drawn, Outline, draw

        drawn = Drawn(
            title=file.name,
            way=[(r.x, r.y) for r in path(found)],
            items=[
                (each.item, each.east_m, each.north_m)
                for each in found.items
                if each.east_m is not None and each.north_m is not None
            ],
            areas=[Outline(*each) for each in outlines(found)],
            rally=[(r.x, r.y) for r in found.rally],
        )
        try:
            draw(drawn, figure)
        except (OSError, ValueError) as error:  # ValueError: of a kind of picture that there is not
            raise Failure(error, USAGE) from error
    return 1 if found.refused else OK


@plan.command()
@FILE
@arguments.FREE_INSTANCE
@click.option("--start", is_flag=True, help="Then arm, and fly the plan.")
def upload(file: Path, instance: int | None, start: bool) -> int:
    """Upload FILE, with its fence and rally points, to a vehicle that is up (gcs up).

    The whole file is looked at before any part is sent. Exit codes: 0 taken, 1 refused, 2 the file cannot be read,
    3 the vehicle does not answer.
    """
    from fcu.interface.link import PortBusy
    from gcs_tools.flight.ground_script import Refused, Vehicle, VehicleError
    from gcs_tools.flight.plan_look import look, send
    from gcs_tools.missions import plan_file

    try:
        read = plan_file.read(file)
        refused = look(read).refused
    except plan_file.PlanError as error:
        raise Failure(error, USAGE) from error
    if refused:
        raise Failure(ValueError(f"{file}: {refused}"), 1)
    try:
        vehicle = Vehicle(instance or 0)
    except PortBusy as error:
        raise Failure(error, INFRASTRUCTURE) from error
    try:
        vehicle.wait_ready()
        send(vehicle, read)
        if start:
            vehicle.start_mission()
    except Refused as error:
        raise Failure(error, 1) from error
    except VehicleError as error:
        raise Failure(error, INFRASTRUCTURE) from error
    finally:
        vehicle.close()
    click.echo(f"{file}: uploaded" + (" and started" if start else ""))
    return OK
