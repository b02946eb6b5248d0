"""`gcs up`."""

from __future__ import annotations

import os
import select
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import IO, TYPE_CHECKING

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure
from gcs_tools.exit_codes import INFRASTRUCTURE, INTERRUPTED, OK, USAGE

if TYPE_CHECKING:
    from gcs_tools.flight.live_vehicle import LiveVehicle
    from gcs_tools.flight.pair import Pair
    from gcs_tools.flight.scenario import Scenario


@click.command(
    epilog="Exit codes: 0 Ctrl-C, SIGTERM or SIGHUP once the vehicle was up, 2 invalid command line, mission\n"
    "or law, 3 a process died or stalled, a port was busy or the vehicle did not arm in the air,\n"
    "130 interrupted before."
)
@click.argument("mission", required=False)
@arguments.speed("1")
@click.option("--autopilot", type=click.Choice(["px4", "generic"]), help="Autopilot type to report; default px4.")  # fmt: skip
@click.option("--origin", metavar="LAT,LON,ALT", help="Latitude, longitude (deg) and altitude (m) of local (0, 0, 0); default: PX4's home.")  # fmt: skip
@click.option("--link-clock", type=click.Choice(["both", "sim"]), help="Clock used for the setpoint timeout; default both.")  # fmt: skip
@click.option("--params", type=click.Path(dir_okay=False), metavar="FILE", help="Parameter file: read if it exists, written when a ground station saves.")  # fmt: skip
@arguments.LAW
@arguments.AIRFRAME
@click.option("--publish/--no-publish", default=True, show_default=True, help="Publish every tick on Zenoh.")  # fmt: skip
@arguments.ZENOH
@click.option("--until-eof", is_flag=True, help="Stop also when standard input ends: it does when the program that holds its other end dies.")  # fmt: skip
@arguments.FREE_INSTANCE
def up(
    mission: str | None, speed: float | None, autopilot: str | None, origin: str | None,
    link_clock: str | None, params: str | None, law: str | None, airframe: str | None, publish: bool, zenoh: Path | None,
    until_eof: bool, instance: int | None,
) -> int:  # fmt: skip
    """Start flight controller and simulator, and keep them running until Ctrl-C.

    For a ground station or a script. With MISSION they start with its law, world and start point;
    without, the vehicle stands on the ground in still air. A vehicle whose start is in the air is
    armed and holds there (mode Hold). After a crash it lies there until `gcs reset` puts it back.
    A program that starts it and may be killed gives it a pipe as standard input, and --until-eof.
    """
    given = {
        "--autopilot": autopilot, "--origin": origin, "--link-clock": link_clock, "--params": params
    }  # fmt: skip
    options = [word for name, value in given.items() if value for word in (name, value)]
    from fcu.laws import loader
    from fcu.process.configuration import ConfigurationError, read_airframe, read_settings
    from gcs_tools.flight.interrupts import interrupts_wait
    from gcs_tools.flight.live_vehicle import LiveVehicle
    from gcs_tools.flight.pair import Pair
    from gcs_tools.flight.processes import InfrastructureError, Misused, claimed
    from gcs_tools.flight.run import flies, prepared
    from gcs_tools.flight.run_folder import UsageError, new_folder
    from gcs_tools.judging.preflight_check import refused_gains

    try:
        chosen, scene = (
            (None, None) if mission is None else prepared(mission, law=law, airframe=airframe)
        )
        flown = loader.load(law or loader.DEFAULT) if scene is None else scene.flown
        carried = read_airframe(flown, airframe) if scene is None else scene.airframe
        if chosen is None or scene is None:
            read_settings(flown, None, 500.0, carried)
        elif why := refused_gains(chosen, scene):
            raise UsageError(why)
        flown.check_compiles()
    except (UsageError, loader.LawError, ConfigurationError) as error:
        raise Failure(error, USAGE) from error
    code = INTERRUPTED
    published = arguments.publication(publish, zenoh)
    try:
        with (
            interrupts_wait() as interrupts,
            claimed(instance) as number,
            ExitStack() as stack,
        ):
            look = interrupts.look
            folder = new_folder(None, "up")  # not before: of a port that is busy none is left
            click.echo("starting (the first start compiles, for up to a minute) ...", err=True)
            pair = Pair(
                stack,
                folder,
                number,
                flown,
                carried,
                published,
                flies(chosen, scene, carried),
                look,
            )
            in_the_air = chosen is not None and not chosen.flight.start.on_ground
            vehicle = LiveVehicle(pair, stack, number, in_the_air)
            _stand_by(vehicle, pair, scene, folder, number, "max" if speed is None else str(speed),
                      options, zenoh is not None, until_eof)  # fmt: skip
            code = OK
    except UsageError as error:
        raise Failure(error, USAGE) from error
    except (InfrastructureError, OSError) as error:
        failed = USAGE if isinstance(error, Misused) else INFRASTRUCTURE
        raise Failure(getattr(error, "strerror", None) or error, failed) from error
    except KeyboardInterrupt:
        pass
    click.echo("stopped", err=True)
    return code


def _stand_by(
    vehicle: LiveVehicle, pair: Pair, scene: Scenario | None, folder: Path, number: int, speed: str,
    options: list[str], configured: bool, until_eof: bool,
) -> None:  # fmt: skip
    """Run both until interrupted; say what to connect to once both are ready.

    Raises KeyboardInterrupt when that is before, InfrastructureError when one of them ends.
    """
    from fcu.interface.link import HOST
    from fcu.interface.ports import ports
    from fcu.interface.topics import port

    at = ports(number)
    why = vehicle.start(scene, options, speed)
    try:
        click.echo(
            f"ready: instance {number}, MAVLink system {at.system_id}\n"
            f"  script          listen on {at.script} (or send to {at.fcu_script}, or TCP {at.fcu_tcp})\n"
            f"  ground station  listen on {at.station} (or send to {at.fcu_station})\n"
            f"  logs            {folder}"
        )
        if pair.publisher is not None:
            where = "as configured" if configured else f"tcp/{HOST}:{port(number)}"
            click.echo(f"  diagnostics     {why or f'Zenoh, {where} (gcs monitor)'}")
        while not (until_eof and _has_ended(sys.stdin)):
            for event in vehicle.events():
                click.echo(event, err=True)
            if pair.publisher is not None and pair.publisher.has_died():
                click.echo(f"  diagnostics     ended (again with: gcs publish --instance {number})")
            time.sleep(0.1)
    except KeyboardInterrupt:
        return


def _has_ended(stream: IO[str]) -> bool:
    """Return true if a stream has come to its end. Whatever is there to be read is dropped."""
    poll = select.poll()
    poll.register(stream, select.POLLIN)
    return bool(poll.poll(0)) and not os.read(stream.fileno(), select.PIPE_BUF)
