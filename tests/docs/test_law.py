"""The page about a law of your own lists what a law may read of its vehicle, and nothing else."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

from fcu.interface.airframe import Airframe, believed
from fcu.laws import scales
from fcu.laws.allocation import RotorParams
from fcu.laws.face import Limits
from fcu.laws.scales import Vec3

PAGE = (Path(__file__).parents[2] / "docs" / "law-of-your-own.md").read_text()
SECTION = PAGE.partition("## What a law knows of its vehicle")[2].partition("\n## ")[0]
TABLES = re.findall(r"^\|.*\n\|---.*\n((?:\|.*\n)+)", SECTION, re.MULTILINE)


def _first(table: str) -> list[str]:
    """The names in the first column."""
    cells = [line.split("|")[1] for line in table.splitlines()]
    return [name for cell in cells for name in re.findall(r"`([\w.]+)`", cell)]


def test_each_field_that_a_kernel_reads_is_listed():
    of_kernels, _, _ = TABLES
    limits = [f"limits.{name}" for name in Limits._fields]
    assert _first(of_kernels) == [*limits, *(f"rotors.{name}" for name in RotorParams._fields)]


def test_each_field_of_believed_is_listed():
    _, _, of_believed = TABLES
    assert _first(of_believed) == [*Airframe._fields, "n"]


def test_each_public_function_of_scales_is_listed_and_takes_the_tables_alone():
    _, of_tables, _ = TABLES
    names = _first(of_tables.replace("`Vec3`", ""))
    public = [
        name
        for name, each in inspect.getmembers(scales, inspect.isfunction)
        if each.__module__ == scales.__name__ and not name.startswith("_")
    ]
    assert sorted(names) == sorted(public)
    _, tables = believed()
    vectors = {name for name in names if isinstance(getattr(scales, name)(tables), Vec3)}
    assert vectors == {"inertia", "torque", "authority", "rate_bandwidth", "attitude_bandwidth"}
