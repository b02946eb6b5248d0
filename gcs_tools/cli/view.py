"""`gcs view`."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

import click

from fcu.interface.options import WholeNumber
from gcs_tools.cli import arguments
from gcs_tools.cli.live_vehicle import watched
from gcs_tools.cli.output import Failure
from gcs_tools.exit_codes import USAGE

if TYPE_CHECKING:
    from gcs_tools.pictures.view.app import App

INSTALL = "pip install viser websockets"
FIRST_PORT = 8080


@click.command()
@click.argument(
    "recording", required=False, type=click.Path(path_type=Path), callback=arguments.recording
)
@click.option("--port", type=WholeNumber(1, 65535), metavar="N", help=f"TCP port of the page; default: {FIRST_PORT}, or the next free one.")  # fmt: skip
@click.option("--no-open", is_flag=True, help="Do not open a browser.")
@arguments.TIMEOUT
@arguments.LIVE_INSTANCE
@arguments.ZENOH
def view(
    recording: Path | None, port: int | None, no_open: bool, timeout_s: float | None,
    instance: int | None, zenoh: Path | None,
) -> None:  # fmt: skip
    """Show a flight in a browser: a 3-D scene, and estimates against the truth.

    With RECORDING (a flight.mcap) it plays that flight; without, it follows the running vehicle,
    and when that ends the next one. The page is served on this machine only and needs no network. It
    opens by the link that is printed, which holds a secret: other pages and users cannot read it.

    Ctrl-C ends it. Exits 0; 2 when RECORDING or CONFIG cannot be read; 3 when no port is free, no
    vehicle came within --timeout, without Zenoh, or when what the page needs is not installed.
    """
    if recording is not None and (instance is not None or zenoh is not None):
        raise click.UsageError("--instance and --zenoh are for a live vehicle, not for a RECORDING")
    try:
        from gcs_tools.pictures.view.app import NoPort, on_free_port
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith(("fcu", "gcs_tools", "sitl_plant")):
            raise
        raise Failure(f"the page needs {error.name}, which is not installed: {INSTALL}") from error
    from gcs_tools.recording.reader import RecordingError

    def show(at: int) -> None:
        if port is None and at != FIRST_PORT:
            click.echo(f"port {FIRST_PORT} is in use, {at} is not", err=True)
        if recording is not None:
            _recorded(recording, at, no_open)
        else:
            _live(at, no_open, instance, zenoh, timeout_s)

    try:
        on_free_port(port, FIRST_PORT, show)
    except RecordingError as error:
        raise Failure(error, USAGE) from error
    except NoPort as error:
        raise Failure(error) from error
    except KeyboardInterrupt:
        click.echo("stopped", err=True)


def _recorded(recording: Path, port: int, no_open: bool) -> None:
    """Until interrupted."""
    from gcs_tools.pictures.history import recorded
    from gcs_tools.pictures.view.app import App

    with App(recorded(recording), port, whole=True) as app:
        _say(app, no_open)
        app.run()


def _live(
    port: int, no_open: bool, instance: int | None, zenoh: Path | None, timeout_s: float | None
) -> None:
    """Until interrupted: one vehicle after the other, on one port, so that pages stay open."""
    from gcs_tools.pictures.follower import Follower
    from gcs_tools.pictures.view.admission import new_secret
    from gcs_tools.pictures.view.app import App

    said, secret = False, new_secret()
    while True:
        with watched(instance, zenoh, timeout_s) as vehicle:
            follower = Follower(vehicle)
            with App(follower.flight, port, whole=False, secret=secret) as app:
                if not said:
                    _say(app, no_open)
                said = True
                while not vehicle.succeeded:
                    follower.take()
                    app.gone = vehicle.gone
                    app.frame()


def _say(app: App, no_open: bool) -> None:
    click.echo(f"{app.url} (Ctrl-C ends it)")
    if not no_open:
        webbrowser.open(app.url)
