"""`fcu`: the flight controller as a process of its own."""

from __future__ import annotations

try:
    import math
    import signal
    import sys
    from functools import partial
    from pathlib import Path
    from typing import TYPE_CHECKING

    import click

    from fcu.interface import options
    from fcu.interface.ports import ANY_PORTS, INSTANCES, first_free_instance, ports, table
    from fcu.interface.starter import occupy_standard_streams
except KeyboardInterrupt:
    raise SystemExit(130) from None  # interrupted before there is anything to end

if TYPE_CHECKING:
    from fcu.laws.loader import Law
    from fcu.process.autopilot import LinkClock

FCU_PORTS = ("fcu_plant", "fcu_script", "fcu_station", "fcu_tcp")


def _origin(_context: click.Context, _option: click.Parameter, value: str) -> tuple[float, ...]:
    try:
        lat, lon, alt = (float(part) for part in value.split(","))
    except ValueError:
        lat = lon = alt = math.nan
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0 and abs(alt) <= 1e4):
        raise click.BadParameter(
            f"expected LAT,LON,ALT: -90 to 90 and -180 to 180 degrees, m above the sea; got {value}"
        )
    return lat, lon, alt


@click.command(
    epilog=f"\b\n{table()}\n\nExit codes: 0 stopped, 2 usage error, 3 plant link or port failed, or the simulator flies\n"
    "another number of rotors."
)
@click.version_option(package_name="m-mrac")
@click.option(
    "--instance",
    type=options.WholeNumber(0, INSTANCES - 1),
    help=f"Instance number, 0 to {INSTANCES - 1}; default: the first that is free.",
)
@click.option(
    "--rate",
    "rate_hz",
    callback=options.rate_hz,
    default=500.0,
    show_default=True,
    help="Control rate, Hz.",
)
@click.option("--law", "law_name", metavar="NAME|FILE.py", default="mmrac", show_default=True, help="Control law: a name, or your own Python file (it is executed).")  # fmt: skip
@click.option("--unstable-gains", type=click.Choice(["refuse", "fly"]), default="refuse", show_default=True, help="Start with gains that the rule of stability refuses, for a study.")  # fmt: skip
@options.AIRFRAME
@click.option("--handover", type=click.Path(path_type=Path), help="Settings as JSON; replaces the airframe's defaults and --rate.")  # fmt: skip
@click.option("--autopilot", type=click.Choice(["px4", "generic"]), default="px4", show_default=True, help="Autopilot type to report. Both use PX4's mode numbers.")  # fmt: skip
@click.option("--origin", callback=_origin, default=",".join(map(str, options.ORIGIN)), show_default=True, metavar="LAT,LON,ALT", help="Latitude, longitude (deg) and altitude (m) of local (0, 0, 0).")  # fmt: skip
@click.option("--link-clock", type=click.Choice(["both", "sim", "held"]), default="both", show_default=True, help="A script's stream is lost when it is too old by simulation time and by the wall, or by simulation time alone. With held, telemetry is due by simulation time too, and messages are read at ticks alone.")  # fmt: skip
@click.option("--params", "params_file", type=click.Path(dir_okay=False, path_type=Path), help="Parameter file: read if it exists, written when a ground station saves.")  # fmt: skip
@click.option("--param", "chosen", multiple=True, metavar="NAME=VALUE", help="Set a parameter of the vehicle by its MAVLink name, from the start on; may be repeated.")  # fmt: skip
@click.option("--law-sha256", help="Refuse a law of other sources.", hidden=True)
@click.option("--airframe-sha256", help="Refuse an airframe file of another text.", hidden=True)
@click.option("--record-fd", type=int, hidden=True)
@click.option("--events-fd", type=int, hidden=True)
@click.option("--lifeline-fd", type=int, hidden=True)
@click.option("--drop/--wait", default=False, hidden=True)
def main(
    instance: int | None,
    rate_hz: float,
    law_name: str,
    unstable_gains: str,
    airframe: str | None,
    handover: Path | None,
    autopilot: str,
    origin: tuple[float, float, float],
    link_clock: LinkClock,
    params_file: Path | None,
    chosen: tuple[str, ...],
    law_sha256: str | None,
    airframe_sha256: str | None,
    record_fd: int | None,
    events_fd: int | None,
    lifeline_fd: int | None,
    drop: bool,
) -> None:
    """Run a control law: reply to each state that the simulator sends by UDP with a command.

    The simulator (`sitl-plant`) sets the pace; start it before or after. Ground stations and
    scripts connect on PX4's ports.
    """
    occupy_standard_streams()
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until it flies a signal ends it at once

    from fcu import parameters
    from fcu.guard.gains import FLY
    from fcu.interface import event_log
    from fcu.interface.link import PortBusy
    from fcu.interface.parameter import ParameterError
    from fcu.interface.publisher_feed import PublisherFeed
    from fcu.interface.recorder_pipe import BATCH, FULL_SPEED_BATCH, RecorderPipe
    from fcu.interface.starter import announce, watched
    from fcu.laws import loader
    from fcu.mavlink.definitions import Autopilot
    from fcu.mavlink.geodesy import Origin
    from fcu.parameters import Parameters, ParamsFileError
    from fcu.process.configuration import ConfigurationError, read_airframe, read_settings
    from fcu.process.law_compiler import law_compiler
    from fcu.process.loop import INFRASTRUCTURE, Loop, say
    from fcu.process.reporting import Reporter, row_width
    from fcu.services.view import Identity

    write = partial(event_log.write, fd=events_fd)
    try:
        number = first_free_instance(*FCU_PORTS) if instance is None else instance
        law = loader.load(law_name)
        if law_sha256 not in (None, law.digest):
            raise loader.LawError(f"{law_name}: has changed since it was loaded for this flight")
        vehicle = read_airframe(law, airframe)
        if airframe_sha256 not in (None, vehicle.sha256):
            raise ConfigurationError(f"{airframe}: has changed since it was read for this flight")
        settings = read_settings(law, handover, rate_hz, vehicle, unstable_gains == FLY)
        given = parameters.chosen(parameters.parsed(chosen), law, vehicle.tables)
        params = Parameters(settings, ports(number).system_id, params_file, law, vehicle, given)
        shown_as = Autopilot[autopilot.upper()]
        identity = Identity(ports(number).system_id, shown_as, Origin(*origin), vehicle.drag)
        batch = BATCH if drop else FULL_SPEED_BATCH
        tape = RecorderPipe(row_width(law), record_fd, wait=not drop, batch=batch)
        reporter = Reporter(law, tape, PublisherFeed(number, "fcu", law.identity), identity.drag)
        with watched(lifeline_fd):
            is_cold = not law.is_cached()
            if is_cold:
                say(-1, "info", "compiling the law, once for this version (up to a minute)", write)
                law.check_compiles()
            with law_compiler(law if is_cold else None) as other:
                loop = Loop(
                    ports(number), identity, params, reporter, lifeline_fd, link_clock, params_file,
                    resets=record_fd is None,  # a recording is of one flight
                    write=write,
                )  # fmt: skip
                loop.warm_up(other.wait)
    except PortBusy as error:
        say(-1, "error", str(error.strerror), write)
        sys.exit(INFRASTRUCTURE)
    except OSError as error:
        say(-1, "error", str(error), write)
        sys.exit(INFRASTRUCTURE)
    except (ConfigurationError, loader.LawError, ParameterError, ParamsFileError) as error:
        raise click.UsageError(str(error)) from error

    def stop(_signal: int, _frame: object) -> None:
        loop.stopping = True

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    at = ports(number)
    say(-1, "info", f"instance {number}: waiting for the plant on 127.0.0.1:{at.fcu_plant}", write)
    announce({"ready": "fcu", "instance": number, **at._asdict()})
    code = loop.run()
    ended = {"ended": "fcu", "exit_code": code, "law_raised": loop.law_raised}
    announce({**ended, **vars(loop.figures)})
    sys.exit(code)


def load(law: Law) -> None:
    """Import and load here what a flight controller of this law runs: for processes forked later.

    A loop is made, on ports of its own, and stopped before it has begun.
    """
    from fcu.interface.publisher_feed import PublisherFeed
    from fcu.interface.recorder_pipe import RecorderPipe
    from fcu.mavlink.definitions import Autopilot
    from fcu.mavlink.geodesy import Origin
    from fcu.parameters import Parameters
    from fcu.process.configuration import read_airframe, read_settings
    from fcu.process.loop import Loop
    from fcu.process.reporting import Reporter, row_width
    from fcu.services.view import Identity

    vehicle = read_airframe(law)
    identity = Identity(1, Autopilot.PX4, Origin(0.0, 0.0, 0.0), vehicle.drag)
    settings = read_settings(law, None, 500.0, vehicle)
    alone = {"MR_LAW_ACT": 0.0}  # whoever asks for the baseline loads it
    params = Parameters(settings, 1, None, law, vehicle, alone)
    tape, feed = RecorderPipe(row_width(law)), PublisherFeed(0, "fcu", law.identity)
    loop = Loop(ANY_PORTS, identity, params, Reporter(law, tape, feed, identity.drag), None)
    loop.warm_up()
    loop.stopping = True
    loop.run()


if __name__ == "__main__":
    main()
