"""`sitl-plant`: the simulator of the vehicle and its environment, as a process."""

from __future__ import annotations

try:
    import signal
    import sys
    from functools import partial
    from pathlib import Path

    import click

    from fcu.interface import options
    from fcu.interface.ports import ANY_PORTS, INSTANCES, first_free_instance, ports, table
    from fcu.interface.starter import occupy_standard_streams
except KeyboardInterrupt:
    raise SystemExit(130) from None  # interrupted before there is anything to end


@click.command(
    epilog=f"\b\n{table()}\n\nExit codes: 0 stopped or flight ended, 2 usage error, 3 controller link or port failed."
)
@click.version_option(package_name="m-mrac")
@click.option("--instance", type=options.WholeNumber(0, INSTANCES - 1), help=f"Instance number, 0 to {INSTANCES - 1}; default: the first that is free.")  # fmt: skip
@click.option("--world", "world_file", type=click.Path(path_type=Path), help="JSON file that describes vehicle and world (default: the airframe on the ground in still air).")  # fmt: skip
@options.AIRFRAME
@click.option("--wind", "wind_file", type=click.Path(path_type=Path), help="CSV file of the velocity of the air over time (columns t_s, x_m_s, y_m_s, z_m_s), added to that of the world.")  # fmt: skip
@click.option("--layers", "layers_file", type=click.Path(path_type=Path), help="JSON file of layers of the wind, as gcs fly writes it.")  # fmt: skip
@click.option(
    "--faults",
    "faults_file",
    type=click.Path(path_type=Path),
    help="JSON file of faults to order, as gcs fly writes it.",
)
@click.option("--rate", "rate_hz", callback=options.rate_hz, default=500.0, show_default=True, help="Control rate in Hz; ignored with --world.")  # fmt: skip
@click.option("--speed", default="1", show_default=True, callback=options.speed, help="Simulated seconds per wall-clock second, or max.")  # fmt: skip
@click.option("--stay/--end", default=False, show_default=True, help="After a crash: hold time until a reset, or end.")  # fmt: skip
@click.option("--record-fd", type=int, hidden=True)
@click.option("--control-fd", type=int, hidden=True)
@click.option("--events-fd", type=int, hidden=True)
@click.option("--lifeline-fd", type=int, hidden=True)
@click.option("--drop/--wait", default=False, hidden=True)
def main(
    instance: int | None,
    world_file: Path | None,
    wind_file: Path | None,
    layers_file: Path | None,
    faults_file: Path | None,
    airframe: str | None,
    rate_hz: float,
    speed: float | None,
    stay: bool,
    record_fd: int | None,
    control_fd: int | None,
    events_fd: int | None,
    lifeline_fd: int | None,
    drop: bool,
) -> None:
    """Simulate a vehicle: send its state to a flight controller by UDP, apply the reply.

    This process owns simulation time and waits for the controller at every tick, so the
    flight is the same at any speed. Start the controller (`fcu`) before or after it.
    """
    occupy_standard_streams()
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a signal ends it at once until the flight

    from fcu.interface import event_log
    from fcu.interface.airframe import AirframeError, find, read
    from fcu.interface.faults import FaultsError
    from fcu.interface.faults import load as load_faults
    from fcu.interface.handover import HandoverError, load
    from fcu.interface.link import PortBusy
    from fcu.interface.publisher_feed import PublisherFeed
    from fcu.interface.recorder_pipe import BATCH, FULL_SPEED_BATCH, RecorderPipe
    from fcu.interface.samples_file import SamplesError, read_wind
    from fcu.interface.starter import announce, watched
    from fcu.kernel.compile import is_cached
    from sitl_plant.loop import INFRASTRUCTURE, WIDTH, Server, say
    from sitl_plant.pacing import Pacer
    from sitl_plant.physics.wind.layers import LayersError
    from sitl_plant.physics.wind.layers import load as load_layers
    from sitl_plant.physics.wind.packed_field import FieldError, opened
    from sitl_plant.physics.world import World
    from sitl_plant.physics.world import world as still_air

    write = partial(event_log.write, fd=events_fd)
    try:
        if world_file is not None and airframe is not None:
            raise click.UsageError(
                "--world and --airframe: a world has its vehicle; leave out one of them"
            )
        if world_file is not None:
            world = load(world_file, World)
        else:
            world = still_air(rate_hz, airframe=None if airframe is None else read(find(airframe)))
        wind = None if wind_file is None else read_wind(wind_file)
        layers = None if layers_file is None else load_layers(layers_file)
        if layers is not None and layers.field is not None:
            opened(Path(layers.field.path))
        ordered = () if faults_file is None else load_faults(faults_file)
    except (
        AirframeError, FaultsError, FieldError, HandoverError, LayersError, SamplesError,
    ) as error:  # fmt: skip
        raise click.UsageError(str(error)) from error
    try:
        number = first_free_instance("plant") if instance is None else instance
        pacer = Pacer(1.0 / world.rate_hz, speed)
        batch = BATCH if pacer.paced else FULL_SPEED_BATCH
        tape = RecorderPipe(WIDTH, record_fd, wait=not drop, batch=batch)
        with watched(control_fd, lifeline_fd):
            if not is_cached("burst.begin"):
                why = "compiling the simulator, once per version (about half a minute)"
                say(0, "info", why, write)
            feed = PublisherFeed(number, "plant")
            server = Server(
                ports(number), world, tape, feed, pacer, control_fd, lifeline_fd,
                stays=stay, announce=announce, write=write, wind=wind, ordered=ordered,
                layers=layers,
            )  # fmt: skip
            server.warm_up()
    except PortBusy as error:
        say(0, "error", str(error.strerror), write)
        sys.exit(INFRASTRUCTURE)
    except OSError as error:
        say(0, "error", str(error), write)
        sys.exit(INFRASTRUCTURE)

    def stop(_signal: int, _frame: object) -> None:
        server.stopping = True

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    at = ports(number)
    say(0, "info", f"instance {number}: expecting the flight controller on 127.0.0.1:{at.fcu_plant}", write)  # fmt: skip
    announce({"ready": "plant", "instance": number, **at._asdict()})
    code = server.run()
    figures = {
        **vars(server.figures),
        "slips": pacer.slips,
        "lateness": pacer.lateness(),
        "dropped": tape.dropped,
    }
    announce({"ended": "plant", "exit_code": code, **figures})
    sys.exit(code)


def load() -> None:
    """Import and load here what a plant runs: for processes forked later.

    A server is made, on a port of its own, and stopped before it has begun.
    """
    from fcu.interface.publisher_feed import PublisherFeed
    from fcu.interface.recorder_pipe import RecorderPipe
    from sitl_plant.loop import WIDTH, Server
    from sitl_plant.pacing import Pacer
    from sitl_plant.physics.world import world

    feed, pacer = PublisherFeed(0, "plant"), Pacer(0.002, None)
    server = Server(ANY_PORTS, world(500.0), RecorderPipe(WIDTH), feed, pacer)
    server.warm_up()
    server.stopping = True
    server.run()


if __name__ == "__main__":
    main()
