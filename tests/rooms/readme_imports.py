"""The line of a room's README that says what the room may import, from the room's contract.

python -m tests.rooms.readme_imports     # writes the line again (`make schemas` does)
"""

from __future__ import annotations

import re
import sys
import textwrap
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
LINTER = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
LINE = re.compile(r"^May import .*?\n(?=\n|\Z)", re.MULTILINE | re.DOTALL)


def line(contract: dict[str, Any]) -> str:
    """What a contract allows: packages and rooms first, then how much of the standard library."""
    library = [m for m in contract["may_import"] if m in sys.stdlib_module_names]
    rest = [m for m in contract["may_import"] if m not in library and m != "stdlib"]
    told = "the standard library"
    if "stdlib" not in contract["may_import"]:
        told = f"of the standard library {', '.join(f'`{m}`' for m in library)}"
    text = f"May import (pyproject.toml): {', '.join(f'`{m}`' for m in rest)}; {told}."
    return textwrap.fill(text, 100, break_long_words=False, break_on_hyphens=False) + "\n"


def readmes() -> dict[Path, str]:
    """By README with such a line: the line as it should be."""
    found = {}
    for contract in LINTER["contracts"]:
        for room in contract["room"]:
            path = ROOT / room.replace(".", "/") / "README.md"
            if path.exists() and LINE.search(path.read_text()):
                found[path] = line(contract)
    return found


if __name__ == "__main__":
    for path, told in readmes().items():
        path.write_text(LINE.sub(lambda _, told=told: told, path.read_text(), count=1))
