"""`gcs recover`."""

from __future__ import annotations

from pathlib import Path

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure
from gcs_tools.exit_codes import USAGE


@click.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), callback=arguments.new_file, metavar="FILE", help="Write it there; default: in the place of RECORDING.")  # fmt: skip
def recover(recording: Path, out: Path | None) -> None:
    """Make a RECORDING whole whose writer was killed: give it its index and its end.

    Exits 0 when it is whole, 2 when it cannot be read, is damaged, or cannot be written.
    """
    from gcs_tools.recording.reader import RecordingError
    from gcs_tools.recording.repair import recover as repair

    if out is not None and out.exists():
        raise click.UsageError(f"--out {out}: it exists already")
    try:
        done = repair(recording, out)
    except RecordingError as error:
        raise Failure(error, USAGE) from error
    what = "was whole already" if done.complete else "whole again"
    what += f", written to {out}" if out else ""
    click.echo(f"{recording}: {done.messages} messages, {done.first_s:.3f} to {done.last_s:.3f} s, {what}")  # fmt: skip
    if done.damage:
        click.echo(f"  without what lies behind a damage: {done.damage}")
