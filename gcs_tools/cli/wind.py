"""`gcs wind`: fields of wind for missions."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import click

from gcs_tools.cli.output import Failure
from gcs_tools.exit_codes import USAGE


@click.group()
def wind() -> None:
    """Look at fields of wind, and pack them for missions."""


def _told(out: dict[str, Any], as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(out))
        return
    for key, value in out.items():
        lines = value if isinstance(value, list) else [value]
        for i, line in enumerate(lines):
            click.echo(f"{key if i == 0 else '':14}{line}")


@wind.command()
@click.argument("file", metavar="FIELD", type=click.Path(path_type=Path, exists=True))
@click.option("--json", "as_json", is_flag=True, help="Write JSON.")
def check(file: Path, as_json: bool) -> None:
    """Tell what a FIELD is: a file of PALM, QES-Winds, RotorS or CSV, or a packed field.

    Exit codes: 0 it can be flown, 2 it cannot be read.
    """
    from gcs_tools.wind_fields.check import summary
    from gcs_tools.wind_fields.files import read
    from gcs_tools.wind_fields.grid import packable
    from sitl_plant.physics.wind.packed_field import FieldError, is_packed, opened

    try:
        if is_packed(file):
            packed = opened(file)
            field, about = packed.field, packed.about
        else:
            grid = read(file)
            field = packable(grid)
            about = {"kind": grid.kind, "notes": grid.notes, **grid.about}
    except FieldError as error:
        raise Failure(error, USAGE) from error
    _told(summary(field, about), as_json)


@wind.command()
@click.argument(
    "file", metavar="FIELD", type=click.Path(path_type=Path, exists=True, dir_okay=False)
)
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Write JSON.")
def pack(file: Path, out: Path, as_json: bool) -> None:
    """Pack a FIELD into the folder OUT, which `[wind] field` of a mission names.

    Exit codes: 0 packed, 2 it cannot be read, or OUT is there already or cannot be written.
    """
    from gcs_tools.wind_fields.check import summary
    from gcs_tools.wind_fields.files import read
    from gcs_tools.wind_fields.grid import pack as packed
    from sitl_plant.physics.wind.packed_field import FieldError

    if out.exists():
        raise click.UsageError(f"{out}: it exists already: name a new folder")
    try:
        grid = read(file)
        field = packed(grid, out)
    except FieldError as error:
        raise Failure(error, USAGE) from error
    except OSError as error:
        shutil.rmtree(out, ignore_errors=True)  # a part of a field is none
        raise Failure(f"{out}: {error.strerror}", USAGE) from error
    _told(summary(field, {"kind": grid.kind, "notes": grid.notes, **grid.about}), as_json)
