"""Options that several commands have."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fcu.interface import options
from fcu.interface.options import Number, WholeNumber
from fcu.interface.ports import INSTANCES

if TYPE_CHECKING:
    from gcs_tools.flight.publisher_process import Zenoh as Publication

Decorator = Callable[[Any], Any]

RECORDED = "flight.mcap"  # in the folder of a run
SEEDS_MOST = 1000  # flights of a mission in one call

SETTINGS = click.option("--set", "settings", multiple=True, metavar="TABLE.KEY=VALUE", help="Override a value of the mission; may be repeated.")  # fmt: skip
PARAMS = click.option("--param", "params", multiple=True, metavar="NAME=VALUE", help="Set a parameter of the vehicle by its MAVLink name (docs/parameters.md); may be repeated.")  # fmt: skip
LAW = click.option("--law", metavar="NAME|FILE.py", help="Control law: a name, or your own Python file (it is executed).")  # fmt: skip
AIRFRAME = options.AIRFRAME
ALLOW_COMMANDS = click.option("--allow-commands", is_flag=True, help="Run the command that a mission names as its [flight] script.")  # fmt: skip
FORMATS = (".png", ".svg", ".pdf")


def drawable(_context: click.Context, _option: click.Parameter, path: Path | None) -> Path | None:
    """A callback: a file that a figure may be drawn in. Raises BadParameter."""
    if path is not None and path.suffix.lower() not in FORMATS:
        raise click.BadParameter(f"{path}: ends in none of {', '.join(FORMATS)}")
    if path is not None and not path.parent.is_dir():
        raise click.BadParameter(f"{path}: there is no folder {path.parent}")
    return path


FIGURE = click.option("--figure", type=click.Path(path_type=Path), callback=drawable, metavar="FILE", help="Draw a figure: .png, .svg or .pdf.")  # fmt: skip
ZENOH = click.option(
    "--zenoh", type=click.Path(path_type=Path), metavar="CONFIG.json5",
    help="Zenoh configuration (docs/zenoh); default: loopback, no router.",
)  # fmt: skip


def instance(said: str, **more: Any) -> Decorator:
    """--instance; `said`: what holds without it."""
    return click.option(
        "--instance",
        type=WholeNumber(0, INSTANCES - 1),
        help=f"Instance number, 0 to {INSTANCES - 1}; default: {said}.",
        **more,
    )


TIMEOUT = click.option(
    "--timeout", "timeout_s", type=Number(min=0.0), metavar="S",
    help="Seconds to wait for a vehicle; then exit with 3.",
)  # fmt: skip
UP_TIMEOUT = click.option(
    "--timeout", "timeout_s", type=Number(min=0.0), default=10.0, show_default=True, metavar="S",
    help="Seconds to wait until a vehicle is up and ready; then exit with 3.",
)  # fmt: skip
FREE_INSTANCE = instance("the first that is free")
LIVE_INSTANCE = instance("the first that publishes")


def speed(default: str) -> Decorator:
    """--speed: None for max."""
    return click.option("--speed", default=default, show_default=True, callback=options.speed, metavar="N|max", help="Simulated seconds per second, or max.")  # fmt: skip


def wall_speed(default: str) -> Decorator:
    """--speed of what runs by the wall clock: max, which is None, is not offered."""
    return click.option("--speed", default=default, show_default=True, callback=options.speed, metavar="N", help="Simulated seconds per second.")  # fmt: skip


def as_json(said: str) -> Decorator:
    """--json."""
    return click.option("--json", "as_json", is_flag=True, help=said)


def _seeds(
    _context: click.Context, _option: click.Parameter, value: str | None
) -> int | range | None:
    """A callback: N as an int, A..B as a range. Raises BadParameter."""
    if value is None:
        return None
    found = re.fullmatch(r"(\d+)(?:\.\.(\d+))?", value)
    if found is None:
        raise click.BadParameter(f"{value!r}: expected a whole number, or a range as 1..20")
    first, last = int(found[1]), int(found[2] or found[1])
    if not 0 <= last - first < SEEDS_MOST:
        raise click.BadParameter(
            f"{value!r}: expected A..B, with A at most B, and {SEEDS_MOST} at most"
        )
    return range(first, last + 1) if found[2] else first


SEEDS = click.option("--seed", callback=_seeds, metavar="N|A..B", help="Seed of the noise, or a range: a flight with each; default: the mission's.")  # fmt: skip


def recorded(path: Path) -> Path:
    """A recording by its file, or by the folder of its run. Raises BadParameter."""
    if not path.is_dir():
        return path
    if not (path / RECORDED).is_file():
        raise click.BadParameter(f"{path}: there is no {RECORDED} in this folder")
    return path / RECORDED


def recording(
    _context: click.Context, _option: click.Parameter, value: Path | tuple[Path, ...] | None
) -> Path | tuple[Path, ...] | None:
    """A callback: the same, of what may be left out or given several times."""
    if isinstance(value, tuple):
        return tuple(map(recorded, value))
    return value and recorded(value)


def new_file(
    _context: click.Context, option: click.Parameter, path: Path | None
) -> Path | None:  # fmt: skip
    """A callback: a file in a folder that is there. Raises BadParameter.

    A file is written beside its path and then put in its place: what is there must be a file.
    """
    if path is not None and path.exists() and not (path.is_dir() or path.is_file()):
        raise click.BadParameter(f"{path}: neither a file nor free")
    if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
        raise click.BadParameter(f"{path}: not a file in a folder that is there")
    return path


def publication(publish: bool, zenoh: Path | None) -> Publication | None:
    """How what is flown is put on Zenoh. Raises click's UsageError for a file that is not there."""
    from gcs_tools.flight.publisher_process import Zenoh as Publication

    if zenoh is not None and not zenoh.is_file():
        raise click.UsageError(f"--zenoh {zenoh}: no such file")
    return Publication(zenoh and zenoh.absolute()) if publish or zenoh else None
