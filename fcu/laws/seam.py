"""Packages that are made while the program runs, and what is compiled once a law.

Three files of fcu/process are imported once for each law: settings.py, tick.py and steps.py. Their
first line says so. settings.py and tick.py import their law from `.flown`, steps.py imports tick.py.
Imported plainly, from `fcu.process`, that is M-MRAC. For each other law `bind` makes a package with a `flown` of its own, and with the three files as
modules of that package. So each law has types and kernels of its own, under module names that stay the
same from start to start, and numba's cache serves them at the second start. It would not serve a
closure over a law's kernels, or a kernel that is given them.
"""

from __future__ import annotations

import importlib.util
import sys
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

PLAIN = "fcu.process"  # the package that is bound to M-MRAC, by its own flown.py
ONCE_A_LAW = ("settings", "tick", "steps")

_modules: dict[str, tuple[Path, Loader | None]] = {}  # name -> file, and how it is run


def bind(package: str, law: ModuleType, guard: ModuleType) -> str:
    """Make a package in which ONCE_A_LAW is compiled around `law` and `guard`. Its name."""
    flown: Any = ModuleType(f"{package}.flown")
    flown.law, flown.guard = law, guard
    sys.modules[flown.__name__] = flown
    folder = Path(__file__).resolve().parents[1] / "process"
    make(package)
    for name in ONCE_A_LAW:
        add(f"{package}.{name}", folder / f"{name}.py")
    return package


def make(package: str) -> None:
    """Make an empty package, and those that it is in."""
    parent, _, _ = package.rpartition(".")
    if parent and parent not in sys.modules:
        make(parent)
    made = sys.modules[package] = ModuleType(package)
    made.__path__ = []  # no folder is searched: _Finder knows what is in it


def add(module: str, file: Path, loader: Loader | None = None) -> None:
    """Have a module of such a package found in a file.  loader : runs it. None: as any other."""
    _modules[module] = file, loader


class _Finder:
    """Finds the modules of the packages that are made here."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if name not in _modules:
            return None
        file, loader = _modules[name]
        within: list[str] | None = [] if file.name == "__init__.py" else None
        return importlib.util.spec_from_file_location(
            name, file, loader=loader, submodule_search_locations=within
        )


# First: Python's own finder searches the folder of a package, too, and takes bytecode for that of a
# file written again within a second.
sys.meta_path.insert(0, _Finder)
