"""`gcs view`: a flight in a browser, live or from a recording."""

from __future__ import annotations

import sys
import webbrowser
from pathlib import Path
from typing import NoReturn

import click

OK, USAGE, INFRASTRUCTURE = 0, 2, 3
INSTALL = "pip install 'm-mrac[view]'"


@click.command()
@click.argument("recording", required=False, type=click.Path(path_type=Path))
@click.option("--port", type=click.IntRange(1, 65535), metavar="N", help="To serve the page on; default: 8080, or the next that is free.")  # fmt: skip
@click.option("--no-open", is_flag=True, help="Do not open a browser.")
def view(recording: Path | None, port: int | None, no_open: bool) -> None:
    """Show a flight in a browser: in space, and its estimates against the truth.

    With RECORDING (a flight.mcap) that flight, to be played; without, the vehicle that is up.
    The page is served to this machine alone and needs no network. Ctrl-C ends it.

    Exits 0 when ended, 2 when RECORDING cannot be read, 3 when no port is free or what the page
    needs is not installed.
    """
    try:
        from gcs_tools.view.app import App, NoPort, free_port
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith(("fcu", "gcs_tools", "sitl_plant")):
            raise
        _fail(f"the page needs {error.name}, which is not installed: {INSTALL}", INFRASTRUCTURE)
    from gcs_tools.recording import RecordingError
    from gcs_tools.view.source import recorded

    try:
        if recording is None:
            _fail("name the RECORDING of a flight", USAGE)
        flight = recorded(recording)
        at = free_port(port)
        app = App(flight, at, whole=True)
    except RecordingError as error:
        _fail(str(error), USAGE)
    except NoPort as error:
        _fail(str(error), INFRASTRUCTURE)
    try:
        if port is None and at != 8080:
            click.echo(f"port 8080 is in use, {at} is not", err=True)
        click.echo(f"{app.url} (Ctrl-C ends it)")
        if not no_open:
            webbrowser.open(app.url)
        app.run()
    except KeyboardInterrupt:
        click.echo("stopped", err=True)
    finally:
        app.stop()
    sys.exit(OK)


def _fail(why: str, code: int) -> NoReturn:
    click.echo(f"Error: {why}", err=True)
    sys.exit(code)
