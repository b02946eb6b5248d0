"""Options that several commands have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from fcu.interface import options
from fcu.interface.ports import INSTANCES

if TYPE_CHECKING:
    from gcs_tools.flight.publisher_process import Zenoh as Publication

Decorator = Callable[[Any], Any]

SETTINGS = click.option("--set", "settings", multiple=True, metavar="TABLE.KEY=VALUE", help="Override a value of the mission; may be repeated.")  # fmt: skip
LAW = click.option("--law", metavar="NAME|FILE.py", help="Control law: a name, or your own Python file (it is executed).")  # fmt: skip
ZENOH = click.option(
    "--zenoh", type=click.Path(path_type=Path), metavar="CONFIG.json5",
    help="Zenoh configuration (docs/zenoh); default: loopback, no router.",
)  # fmt: skip


def instance(said: str, **more: Any) -> Decorator:
    """--instance; `said`: what holds without it."""
    return click.option(
        "--instance",
        type=click.IntRange(0, INSTANCES - 1),
        help=f"Instance number; default: {said}.",
        **more,
    )


FREE_INSTANCE = instance("the first that is free")
LIVE_INSTANCE = instance("the first that publishes")


def speed(default: str) -> Decorator:
    """--speed: None for max."""
    return click.option("--speed", default=default, show_default=True, callback=options.speed, metavar="N|max", help="Simulated seconds per second, or max.")  # fmt: skip


def as_json(said: str) -> Decorator:
    """--json."""
    return click.option("--json", "as_json", is_flag=True, help=said)


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
