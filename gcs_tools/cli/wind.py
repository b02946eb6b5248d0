"""`gcs wind`: fields of wind for missions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from fcu.interface.files.input_file import plain
from gcs_tools.cli import arguments
from gcs_tools.cli.output import Failure
from gcs_tools.exit_codes import USAGE

if TYPE_CHECKING:
    from sitl_plant.physics.wind.field import Field

FIELD = click.argument(
    "file", metavar="FIELD", type=click.Path(path_type=Path, exists=True)
)  # as a tool wrote it, or packed
ALONG = click.option(
    "--along", type=click.Path(path_type=Path, exists=True), callback=arguments.recording, metavar="RUN",
    help="A flight (a run folder or flight.mcap): what it meets in the field, whatever it flew in.",
)  # fmt: skip
ORIGIN = click.option(
    "--origin", type=float, nargs=3, metavar="X Y Z",
    help="Where in the field the flight's origin lies, m; default: as the flight's mission says.",
)  # fmt: skip
START_S = "wind.field.start_s"
SCALE = "wind.field.scale"
PLACE = "wind.field.origin_m"
AFTER = "wind.field.after"
FILE = "wind.field.file"


MOST_PLACES = 20_000  # of a flight that are looked at


class Way(NamedTuple):
    """A flight's places in a field."""

    t: Any  # s, (n,), of the field
    r: Any  # m, (n, 3), of the field
    scale: float  # of the field's velocities
    repeats: bool  # times begin anew after the field's end


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
            click.echo(f"{key if i == 0 else '':14}{plain(str(line))}")


def _opened(file: Path) -> tuple[Field, dict[str, Any]]:
    """A field, and what is known of it. Raises Failure."""
    from gcs_tools.wind_fields.files import read
    from gcs_tools.wind_fields.grid import packable
    from sitl_plant.physics.wind.packed_field import FieldError, is_packed, opened

    try:
        if is_packed(file):
            packed = opened(file)
            return packed.field, packed.about
        grid = read(file)
        return packable(grid), {"kind": grid.kind, "notes": grid.notes, **grid.about}
    except FieldError as error:
        raise Failure(error, USAGE) from error


def _way(run: Path, origin: tuple[float, float, float] | None, file: Path) -> Way:
    """The places of a flight in the field of a file. Raises Failure, BadParameter."""
    import numpy as np

    _check_origin(origin)

    from gcs_tools.recording.reader import VALUES, RecordingError, read

    try:
        found = read(run)
    except RecordingError as error:
        raise Failure(error, USAGE) from error
    told = {
        key: value["value"] if isinstance(value, dict) else value
        for key, value in json.loads(found.metadata.get(VALUES, "{}")).items()
    }
    flew_in = Path(str(told.get(FILE) or "")).stem
    place = origin or (told.get(PLACE) if flew_in == file.resolve().stem else None)
    if place is None:
        where = f"another field ({flew_in})" if flew_in else "no field"
        raise click.BadParameter(
            f"{run}: its mission flew in {where}: say where its origin lies in this one (--origin X Y Z)",
            param_hint="'--along'",
        )
    if len(found.plant) < 2:
        raise Failure(f"{run}: it has no flight in it", USAGE)
    if not found.complete:
        click.echo(f"Warning: {run} was cut short: looked at as far as it goes", err=True)
    some = slice(None, None, max(1, len(found.plant) // MOST_PLACES))
    r = np.asarray(found.plant["state.r_E"])[some] + np.asarray(place, dtype=np.float64)
    t = np.asarray(found.plant["t"])[some]
    t = t + float(told.get(START_S, 0.0))
    return Way(t, r, float(told.get(SCALE, 1.0)), told.get(AFTER) == "repeat")


def _check_origin(origin: tuple[float, float, float] | None) -> None:
    """Raise BadParameter for a place that is none."""
    if origin is not None and not all(abs(x) <= 1e9 for x in origin):  # nor nan
        raise click.BadParameter("expected three numbers of metres", param_hint="'--origin'")


def _placed(
    along: Path | None, origin: tuple[float, float, float] | None, field: Field, file: Path
) -> Way | None:
    """The flight in the field, of which a part at least is in it. Raises Failure, UsageError."""
    from gcs_tools.wind_fields.sample import is_known

    if along is None:
        if origin is not None:
            raise click.UsageError("--origin says where a flight lies: name it (--along RUN)")
        return None
    way = _way(along, origin, file)
    if not is_known(field, way.r).any():
        raise Failure(
            f"{along}: no part of the flight is in the field: where does it begin? (--origin X Y Z)",
            USAGE,
        )
    return way


@wind.command()
@FIELD
@ALONG
@ORIGIN
@click.option("--json", "as_json", is_flag=True, help="Write JSON.")
def check(
    file: Path, along: Path | None, origin: tuple[float, float, float] | None, as_json: bool
) -> None:
    """Tell what a FIELD is: a file of PALM, QES-Winds, OpenFOAM (VTK), RotorS or CSV, or a packed field.

    With --along also which beliefs (guard_wind_m_s, guard_wind_rate_m_s2) a flight through it needs, with what the
    grid of the field leaves out.

    Exit codes: 0 it can be flown, 2 it, or the flight, cannot be read.
    """
    from gcs_tools.wind_fields.along import along as met
    from gcs_tools.wind_fields.check import summary

    field, about = _opened(file)
    rows = summary(field, about)
    way = _placed(along, origin, field, file)
    if way is not None:
        found = met(field, way.t, way.r, way.scale, way.repeats)
        rows["along"] = found.numbers() if as_json else found.lines()
    _told(rows, as_json)


@wind.command()
@FIELD
@ALONG
@ORIGIN
@click.option(
    "--height",
    type=float,
    metavar="M",
    help="Of the plan, m of the field; default: that at which the flight goes farthest, or half a cell above the highest roof.",
)
@click.option(
    "--at",
    "at_s",
    type=float,
    default=0.0,
    metavar="S",
    show_default=True,
    help="Time of the field, s.",
)
@click.option(
    "--figure",
    type=click.Path(path_type=Path),
    callback=arguments.drawable,
    metavar="FILE",
    help="Where to draw: .png, .svg or .pdf; default: wind-FIELD.png.",
)
def show(
    file: Path, along: Path | None, origin: tuple[float, float, float] | None,
    height: float | None, at_s: float, figure: Path | None,
) -> None:  # fmt: skip
    """Draw a plan and a section of a FIELD: speed, direction, buildings and a flight.

    Exit codes: 0 drawn, 2 it, or the flight, cannot be read, or the figure cannot be written.
    """
    import numpy as np

    from gcs_tools.pictures.plot import wind_field
    from gcs_tools.wind_fields.cut import cuts

    field, _ = _opened(file)
    if not 0.0 <= at_s <= max(float(field.t[-1]), 0.0):
        raise click.BadParameter(
            f"{at_s:g} s: the field lasts from 0 to {field.t[-1]:g} s", param_hint="'--at'"
        )
    way = _placed(along, origin, field, file)
    path = np.zeros((0, 3)) if way is None else way.r
    low, high = float(field.bounds[4]), float(field.bounds[5])
    if height is not None and not low <= height <= high:
        raise click.BadParameter(
            f"{height:g} m is outside the field: {low:g} to {high:g} m", param_hint="'--height'"
        )
    at = figure or Path(f"wind-{file.resolve().stem}.png")
    made = cuts(field, height, at_s, path, 1.0 if way is None else way.scale)
    try:
        wind_field.save(f"The wind of {file.resolve().name}", made, at)
    except OSError as error:
        raise Failure(f"{at}: {error.strerror}", USAGE) from error
    click.echo(f"{at}  {made[0].title.lower()}; {made[1].title.lower()}")


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
        if out.exists():
            raise click.UsageError(f"{out}: it exists already: name a new folder") from error
        # NumPy tells of a write that was cut short without a number
        why = error.strerror or f"cannot be written whole ({error}): is the disk full?"
        raise Failure(f"{out}: {why}", USAGE) from error
    _told(summary(field, {"kind": grid.kind, "notes": grid.notes, **grid.about}), as_json)
