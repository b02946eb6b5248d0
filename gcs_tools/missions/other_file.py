"""What was meant where a law or an airframe is given in the place of a mission."""

from __future__ import annotations

from pathlib import Path

from fcu.interface.airframe import SHIPPED as AIRFRAMES
from fcu.interface.files import toml_file
from fcu.interface.files.toml_file import FileError
from fcu.laws.loader import SHIPPED as LAWS

OF_AN_AIRFRAME = {"vehicle", "rotors"}  # tables that no mission has
EXAMPLE = "gust_step"


def meant(name: str) -> str:
    """A sentence on the option that takes a law or an airframe; empty if `name` is none of them.

    name : what stands where a mission belongs: a name, or a file, which need not be there.
    """
    if name.endswith(".py") or name in LAWS:
        option, what = "--law", "a law"
    elif name in AIRFRAMES or _is_airframe(name):
        option, what = "--airframe", "an airframe"
    else:
        return ""
    return (
        f"{name}: expected a mission, got {what} (did you mean {option} {name}, with a mission, as in"
        f" gcs fly {EXAMPLE} {option} {name}?)"
    )


def _is_airframe(name: str) -> bool:
    """Whether it is a TOML file with the tables of an airframe, and none of a flight."""
    if not name.endswith(".toml"):
        return False
    try:
        tables = toml_file.read(Path(name)).tables
    except FileError:
        return False
    return tables.keys() >= OF_AN_AIRFRAME and "flight" not in tables
