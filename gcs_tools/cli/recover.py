"""`gcs recover`."""

from __future__ import annotations

from pathlib import Path

import click

from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure
from gcs_tools.exit_codes import USAGE


@click.command()
@click.argument("recording", type=click.Path(path_type=Path), callback=arguments.recording)
@click.option("--out", type=click.Path(path_type=Path), callback=arguments.new_file, metavar="FILE", help="Where to write the repaired file; default: replace RECORDING.")  # fmt: skip
def recover(recording: Path, out: Path | None) -> None:
    """Repair a truncated RECORDING: write the index and footer that a killed recorder left out.

    Exit codes: 0 the recording is complete, 2 it cannot be read, is damaged, or cannot be written.
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
