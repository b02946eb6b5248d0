"""docs/python.md: the functions of the package, from their signatures and docstrings.

python -m gcs_tools.library.page docs/python.md
"""

from __future__ import annotations

import inspect
import json
import re
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

import gcs_tools

HEAD = """# From Python

```python
from gcs_tools import fly, read

result = fly("paper_nominal", settings=["law.f_m=1.4"], in_process=True)
assert result.passed
recording = read(result.folder)
height = recording.plant["state.r_E.z"]  # float64 (n,), m
```

Each function is the work of a command. Importing the package takes a millisecond: what a function needs is
imported when it is asked for. A result shows itself as tables, and a flight with its figure, at the
end of a notebook's cell. Types are checked by mypy and pyright. Written by `make schemas`.
"""
TAIL = """
## In pytest

The package brings a plugin for pytest. Missions are tests where they are named, on the command line or
in pytest's configuration:

```toml
[tool.pytest.ini_options]
mmrac_missions = ["flights/*.toml"]
```

    pytest flights/square.toml

Each mission is flown in process. A missed expectation is the failure, with what was measured. A mission with a script of
its own is flown over the wire, if `--mmrac-allow-commands` is given. Log, light recording, `result.json` and, of a mission that
misses, a figure are in pytest's cache, `.pytest_cache/d/m-mrac/`, until the next run.

The fixture `vehicle` starts a vehicle on the ground, on an instance that is free, and ends it with
the test. A test talks to it through any client:

```python
from pymavlink import mavutil


def test_it_arms(vehicle):
    link = mavutil.mavlink_connection(vehicle.url)
    link.wait_heartbeat()
    link.arducopter_arm()
    link.motors_armed_wait()
```

| of `vehicle` | what |
|---|---|
| `url`, `mavsdk_url` | the script link, as pymavlink and MAVSDK take it |
| `instance`, `port`, `system_id` | of the vehicle |
| `folder` | logs of both processes |
| `alive()` | whether it still runs |

`@pytest.mark.vehicle(mission="urban_step", speed=8)` chooses the mission whose start, wind and airframe it has, and simulated
seconds per second. Without it the vehicle stands on the ground in still air, at the speed of the wall clock.
"""


def page() -> str:
    """The text of the page."""
    return (
        HEAD
        + "".join(_section(name, getattr(gcs_tools, name)) for name in gcs_tools.FUNCTIONS)
        + TAIL
    )


def _section(name: str, function: Callable[..., Any]) -> str:
    signature = inspect.signature(function)
    each = [f"    {_parameter(one)}," for one in signature.parameters.values()]
    if any(p.kind is p.KEYWORD_ONLY for p in signature.parameters.values()):
        first = next(
            i for i, p in enumerate(signature.parameters.values()) if p.kind is p.KEYWORD_ONLY
        )
        each.insert(first, "    *,")
    code = "\n".join([f"{name}(", *each, f") -> {signature.return_annotation}"])
    text = textwrap.dedent("    " + inspect.getdoc(function).replace("\n", "\n    "))  # type: ignore[union-attr]
    text = re.sub(r"^(\w[\w, ]*) : ", lambda found: f"- `{found[1]}`: ", text, flags=re.MULTILINE)
    return f"\n## {name}\n\n```python\n{code}\n```\n\n{text}\n"


def _parameter(one: inspect.Parameter) -> str:
    default = json.dumps(one.default) if isinstance(one.default, str) else repr(one.default)
    return f"{one.name}: {one.annotation}" + ("" if one.default is one.empty else f" = {default}")


@click.command(help=__doc__)
@click.argument("path", type=click.Path(path_type=Path))
def main(path: Path) -> None:
    """Write the page."""
    path.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
