"""`gcs`: fly missions, bring a vehicle up, send it somewhere."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fcu.interface import options
from fcu.interface.ports import INSTANCES, busy, first_running_instance, ports, table
from gcs_tools.cli import bus_commands as commands_bus
from gcs_tools.cli import envelope as commands_envelope
from gcs_tools.cli import monitor as commands_monitor
from gcs_tools.cli import plot as commands_plot
from gcs_tools.cli import view as commands_view

if TYPE_CHECKING:
    from gcs_tools.live.publishing import Zenoh

OK, USAGE, INFRASTRUCTURE, INTERRUPTED = 0, 2, 3, 130

INSTANCE = click.option(
    "--instance", type=click.IntRange(0, INSTANCES - 1), help="Default: the first free (named)."
)


def _creatable(
    _context: click.Context, _option: click.Parameter, value: Path | None
) -> Path | None:
    if value is not None and (value.is_dir() or not value.absolute().parent.is_dir()):
        raise click.BadParameter(f"{value}: not a file in a folder that is there")
    return value


class _Program(click.Group):
    """Ends with 130 when it is interrupted, wherever it is."""

    def main(self, *args: Any, **options: Any) -> Any:
        """Run the command line, and exit."""
        try:
            code = super().main(*args, **{**options, "standalone_mode": False})
        except click.ClickException as error:
            error.show()
            code = error.exit_code
        except (click.Abort, KeyboardInterrupt):
            code = INTERRUPTED
        except OSError as error:  # of standard output: a full disk
            click.echo(f"Error: {error.strerror or error}", err=True)
            os._exit(INFRASTRUCTURE)  # what is still buffered would fail again
        sys.exit(code if isinstance(code, int) else OK)


@click.group(cls=_Program, epilog=f"\b\n{table()}")
@click.version_option(package_name="m-mrac")
def main() -> None:
    """Ground tools of the M-MRAC flight stack."""
    signal.signal(signal.SIGTERM, _interrupt)


def _interrupt(_signal: int, _frame: object) -> None:
    """Being told to end is being interrupted: what was started is stopped, what was flown kept."""
    raise KeyboardInterrupt


def _published(publish: bool, zenoh: Path | None) -> Zenoh | None:
    """How what is flown is put on Zenoh. Raises click's UsageError for a file that is not there."""
    from gcs_tools.live.publishing import Zenoh

    if zenoh is not None and not zenoh.is_file():
        raise click.UsageError(f"--zenoh {zenoh}: no such file")
    return Zenoh(zenoh and zenoh.absolute()) if publish or zenoh else None


def _print_json(content: Any) -> None:
    try:
        print(json.dumps(content, allow_nan=False, indent=2), flush=True)
    except BrokenPipeError:
        from gcs_tools.cli.terminal import silence

        silence(sys.stdout)


@main.command(
    epilog="\b\nExit codes: 0 every expectation met, 1 one missed, 2 a bad command line or mission\n"
    "file, 3 a process died or stalled or a port was busy, 130 interrupted (also by SIGTERM); of\n"
    "several missions the worst. A mission is a file, or the name of one that is shipped."
)
@click.argument("missions", nargs=-1, required=True, metavar="MISSION...")
@click.option("--speed", default="max", show_default=True, callback=options.speed, metavar="N|max", help="Simulated seconds a second, or max.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), help="Of the noise; default: the mission's.")
@click.option(
    "--rate", "rate_hz", type=float, metavar="HZ", help="Control rate, Hz; default: the mission's."
)
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="The run's folder; default: a new one in runs/.")  # fmt: skip
@click.option(
    "--junit",
    type=click.Path(path_type=Path),
    callback=_creatable,
    metavar="FILE",
    help="Write a JUnit report here too.",
)
@click.option("--set", "settings", multiple=True, metavar="TABLE.KEY=VALUE", help="Change a value of the mission; may be repeated.")  # fmt: skip
@click.option("--in-process", is_flag=True, help="Fly the same law and plant without sockets.")
@click.option("--json", "as_json", is_flag=True, help="Print the results as JSON.")
@click.option("--publish/--no-publish", default=None, help="Put every tick on Zenoh; default: unless --speed is max.")  # fmt: skip
@commands_bus.ZENOH
@INSTANCE
def fly(
    missions: tuple[str, ...],
    speed: float | None,
    seed: int | None,
    rate_hz: float | None,
    out: Path | None,
    junit: Path | None,
    settings: tuple[str, ...],
    in_process: bool,
    as_json: bool,
    publish: bool | None,
    zenoh: Path | None,
    instance: int | None,
) -> None:
    """Fly each MISSION and judge it.

    Starts a flight controller and a plant, sends the mission over MAVLink as a ground script
    would, holds what was flown against the mission's [expect], and stops both.
    """
    from gcs_tools.cli import terminal as present
    from gcs_tools.flight.run import UsageError, fly_missions

    try:
        results = fly_missions(
            missions,
            speed=speed,
            seed=seed,
            rate_hz=rate_hz,
            out=out,
            settings=settings,
            in_process=in_process,
            instance=instance,
            show=present.Quiet() if as_json else present.Terminal(),
            zenoh=_published(speed is not None if publish is None else publish, zenoh),
        )
    except UsageError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(USAGE)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    code = max(r.exit_code for r in results)
    if junit is not None:
        from gcs_tools.judging import result

        try:
            result.junit(results, junit)
        except result.ResultError as error:
            click.echo(f"Error: {error}", err=True)
            code = max(code, INFRASTRUCTURE)
    if as_json:
        _print_json([dataclasses.asdict(r) for r in results])
    sys.exit(code)


@main.command()
@click.argument("mission", required=False)
@click.option("--speed", default="1", show_default=True, callback=options.speed, metavar="N|max", help="Simulated seconds a second, or max.")  # fmt: skip
@click.option("--autopilot", type=click.Choice(["px4", "generic"]), help="As what the vehicle presents itself; default px4.")  # fmt: skip
@click.option("--origin", metavar="LAT,LON,ALT", help="Where local (0, 0, 0) is on Earth; default: PX4's home.")  # fmt: skip
@click.option("--link-clock", type=click.Choice(["both", "sim"]), help="By which clock a script's stream is lost; default both.")  # fmt: skip
@click.option("--params", type=click.Path(dir_okay=False), metavar="FILE", help="Saved parameters: read if it exists, written when a ground station asks.")  # fmt: skip
@click.option("--publish/--no-publish", default=True, show_default=True, help="Put every tick on Zenoh.")  # fmt: skip
@commands_bus.ZENOH
@INSTANCE
def up(
    mission: str | None, speed: float | None, autopilot: str | None, origin: str | None,
    link_clock: str | None, params: str | None, publish: bool, zenoh: Path | None,
    instance: int | None,
) -> None:  # fmt: skip
    """Run the pair until Ctrl-C, for a ground station or a script.

    With MISSION its law, world and starting point are flown; without, an S1000 stands on
    the ground in still air.
    """
    given = {
        "--autopilot": autopilot, "--origin": origin, "--link-clock": link_clock, "--params": params
    }  # fmt: skip
    options = [word for name, value in given.items() if value for word in (name, value)]
    from gcs_tools.flight.instance import claimed
    from gcs_tools.flight.processes import InfrastructureError, Misused
    from gcs_tools.flight.run import UsageError, flies, new_folder, prepared
    from gcs_tools.flight.up import up as run

    try:
        flown, scene = (None, None) if mission is None else prepared(mission)
        folder = new_folder(None, "up")
    except UsageError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(USAGE)
    click.echo("starting (the first time compiles for half a minute) ...", err=True)
    try:
        with claimed(instance) as number:
            at = ports(number)
            ready = (
                f"ready: instance {number}, MAVLink system {at.system_id}\n"
                f"  script          listen on {at.script} (or send to {at.fcu_script})\n"
                f"  ground station  listen on {at.station} (or send to {at.fcu_station})\n"
                f"  logs            {folder}"
            )
            pace = "max" if speed is None else str(speed)
            run(
                scene, folder, number, ready, pace, options, _published(publish, zenoh),
                flies(flown, scene),
            )  # fmt: skip
    except (InfrastructureError, OSError) as error:
        click.echo(f"Error: {getattr(error, 'strerror', None) or error}", err=True)
        sys.exit(USAGE if isinstance(error, Misused) else INFRASTRUCTURE)
    except KeyboardInterrupt:
        click.echo("stopped", err=True)
        sys.exit(OK)


@main.command(context_settings={"ignore_unknown_options": True})
@click.argument("x", type=float)
@click.argument("y", type=float)
@click.argument("z", type=float)
@click.option("--yaw-deg", type=float, help="From East, counter-clockwise; default: as it is.")
@click.option("--json", "as_json", is_flag=True, help="Print where it arrived as JSON.")
@click.option("--instance", type=click.IntRange(0, INSTANCES - 1), help="Default: the first that runs.")  # fmt: skip
def setpoint(
    x: float, y: float, z: float, yaw_deg: float | None, as_json: bool, instance: int | None
) -> None:
    """Arm, take off and fly to East X, North Y, Up Z (m) of a vehicle that is up.

    There it holds, and so it does when you interrupt this. Exits 0 when it is there, 3 when it
    is not: refused, silent, landed, or a minute gone.
    """
    import math

    from fcu.interface.link import PortBusy
    from fcu.kernel.algebra import Vec3
    from gcs_tools.flight.ground_script import Vehicle, VehicleError
    from gcs_tools.flight.setpoint import distance, fly_to

    if not all(math.isfinite(v) and abs(v) <= 1e5 for v in (x, y, z, yaw_deg or 0.0)):
        raise click.UsageError("X, Y, Z and --yaw-deg must be finite numbers, at most 1e5")
    number = first_running_instance() if instance is None else instance
    if number is None or not busy(number, "fcu_script"):
        which = "" if number is None else f" as instance {number}"
        click.echo(f"Error: no vehicle is up on this machine{which} (start one: gcs up)", err=True)
        sys.exit(INFRASTRUCTURE)
    try:
        vehicle = Vehicle(number)
    except PortBusy as error:
        click.echo(f"Error: another script or gcs setpoint flies instance {number} (it holds UDP port {error.port}): wait for it, or end it", err=True)  # fmt: skip
        sys.exit(INFRASTRUCTURE)
    target = Vec3(x, y, z)
    began = time.monotonic()
    try:
        here = fly_to(vehicle, target, yaw_deg, lambda text: click.echo(text, err=True))
    except VehicleError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(INFRASTRUCTURE)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    finally:
        vehicle.close()
    away = distance(here.r_E, target)
    if as_json:
        said = {"position_m": list(here.r_E), "error_m": away, "wall_s": time.monotonic() - began}
        _print_json(said)
    else:
        click.echo(f"there: ({here.r_E.x:.2f}, {here.r_E.y:.2f}, {here.r_E.z:.2f}) m, {away:.2f} m off")  # fmt: skip


@main.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), callback=_creatable, metavar="FILE", help="Write it there; default: in the place of RECORDING.")  # fmt: skip
def recover(recording: Path, out: Path | None) -> None:
    """Make a RECORDING whole whose writer was killed: give it its index and its end.

    Exits 0 when it is whole, 2 when it cannot be read, is damaged, or cannot be written.
    """
    from gcs_tools.recording.reader import RecordingError
    from gcs_tools.recording.repair import recover as made_whole

    if out is not None and out.exists():
        raise click.UsageError(f"--out {out}: it exists already")
    try:
        done = made_whole(recording, out)
    except RecordingError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(USAGE)
    what = "was whole already" if done.complete else "whole again"
    what += f", written to {out}" if out else ""
    click.echo(f"{recording}: {done.messages} messages, {done.first_s:.3f} to {done.last_s:.3f} s, {what}")  # fmt: skip
    if done.damage:
        click.echo(f"  without what lies behind a damage: {done.damage}")


for command in (
    commands_bus.publish, commands_bus.record, commands_bus.replay, commands_bus.topics,
    commands_envelope.envelope,
    commands_monitor.monitor,
    commands_plot.plot,
    commands_view.view,
):  # fmt: skip
    main.add_command(command)


if __name__ == "__main__":
    main()
