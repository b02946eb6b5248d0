"""`gcs plan`: plans of ground stations, shown and uploaded."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.live_vehicle import up_by, wait_ready
from gcs_tools.cli.output import Failure, print_json
from gcs_tools.exit_codes import OK, USAGE

if TYPE_CHECKING:
    from gcs_tools.flight.plan_look import Shown
    from gcs_tools.missions.plan_file import PlanFile

FILE = click.argument("file", type=click.Path(path_type=Path), metavar="FILE")


@click.group()
def plan() -> None:
    """Plans of ground stations: .plan of QGroundControl, and .waypoints (docs/plans.md).

    gcs fly FILE flies one.
    """


@plan.command()
@FILE
@click.option("--figure", type=click.Path(path_type=Path), callback=arguments.new_file, metavar="FILE", help="Also draw the plan, its fence and rally points, as PNG, SVG or PDF.")  # fmt: skip
@click.option("--flight", type=click.Path(path_type=Path), callback=arguments.recording, metavar="RUN", help="Draw the way that was flown in a run over it, by its recording.")  # fmt: skip
@arguments.as_json("Print the items as JSON.")
def show(file: Path, figure: Path | None, flight: Path | None, as_json: bool) -> int:
    """Show the items of FILE and whether the vehicle would take them.

    Exit codes: 0 the vehicle takes the plan, 1 it refuses an item, 2 the file or RUN cannot be read.
    """
    if flight is not None and figure is None:
        raise click.UsageError("--flight draws over a figure: name one with --figure")
    from gcs_tools.flight.plan_look import counts, look
    from gcs_tools.missions import plan_file
    from gcs_tools.recording.reader import RecordingError

    try:
        read = plan_file.read(file)
        found = look(read)
    except plan_file.PlanError as error:
        raise Failure(error, USAGE) from error
    if as_json:
        print_json(
            {
                "items": [_plain(each._asdict()) for each in found.items],
                "home": _home(read), "fence": len(read.fence), "rally": len(read.rally),
                "refused": found.refused,
            }
        )  # fmt: skip
    else:
        for each in found.items:
            click.echo(_line(each))
        click.echo(counts(read, found))
        if read.home is None:
            click.echo(
                "The file has no home: places are shown about the first one, below which it begins."
            )
        if read.returns is not None and read.returns < len(read.mission) - 1:
            behind = f"{read.returns + 1} to {len(read.mission) - 1}"
            click.echo(f"Item {read.returns} returns and lands: items {behind} are not flown.")
        click.echo(f"Refused: {found.refused}" if found.refused else "The vehicle takes this plan.")
    if figure is not None:
        from gcs_tools.flight.plan_look import flown_way, outlines, path
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
            if flight is not None:
                flown = flown_way(flight, read)
                for note in flown.notes:
                    click.echo(note, err=True)
                drawn = drawn._replace(flown=flown.way)
            draw(drawn, figure)
        except RecordingError as error:
            raise Failure(error, USAGE) from error
        except (OSError, ValueError) as error:  # ValueError: of a kind of picture that there is not
            raise Failure(error, USAGE) from error
    return 1 if found.refused else OK


@plan.command()
@FILE
@arguments.UP_TIMEOUT
@arguments.instance("the first that runs")
@click.option("--start", is_flag=True, help="Then arm, and fly the plan.")
def upload(file: Path, timeout_s: float, instance: int | None, start: bool) -> int:
    """Upload FILE, with its fence and rally points, to a vehicle that is up (gcs up).

    The whole file is looked at before any part is sent. Exit codes: 0 taken, 1 refused, 2 the file cannot be read,
    3 no vehicle is ready within --timeout, or it does not answer.
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
    number, due = up_by(instance, timeout_s)
    try:
        vehicle = Vehicle(number)
    except PortBusy as error:
        raise Failure(f"another script flies instance {number} (it holds UDP port {error.port}): wait for it, or end it") from error  # fmt: skip
    try:
        wait_ready(vehicle, due)
        send(vehicle, read)
        if start:
            vehicle.start_mission()
    except Refused as error:
        raise Failure(f"instance {number}: {error}", 1) from error
    except VehicleError as error:
        raise Failure(f"instance {number}: {error}") from error
    finally:
        vehicle.close()
    click.echo(f"{file}: uploaded to instance {number}" + (" and started" if start else ""))
    return OK


def _home(plan: PlanFile) -> dict[str, float | None] | None:
    """The home of a plan file for JSON: null if it has none."""
    home = plan.home
    if home is None:
        return None
    return {"lat_deg": home.lat_deg, "lon_deg": home.lon_deg, "alt_m": home.alt_m}


def _plain(value: Any) -> Any:
    """The value for JSON: a number that is left out (NaN) is null."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _line(item: Shown) -> str:
    """Number, name and place of an item, and its height or speed."""
    place = last = ""
    if item.east_m is not None and item.north_m is not None:
        place = f"{item.east_m:9.1f} E {item.north_m:9.1f} N"
    if item.height_m is not None and math.isfinite(item.height_m):
        last = f"{item.height_m:7.1f} m"
    if item.speed_m_s is not None:
        last = f"{item.speed_m_s:7.1f} m/s"
    return f"{item.item:4d}  {item.command:24s} {place:24s} {last}".rstrip()
