"""docs/parameters.md: every parameter with its unit, range, default and sentence.

python -m fcu.parameters_page docs/parameters.md
"""

from __future__ import annotations

from pathlib import Path

import click

from fcu.configuration import read_law
from fcu.parameters import Parameters, expected

HEAD = """# Parameters

All REAL32. `MR_` are the law's, and are in force from the next tick; the others have PX4's names.
What is refused, and why: [mavlink.md](mavlink.md). Written by `make schemas`.

| name | default | may be | |
|---|---|---|---|
"""


def page() -> str:
    """The text of the page, for the default airframe and control rate."""
    params = Parameters(read_law(None, 500.0), 1)
    rows = []
    for name in params.names:
        p = params.info(name)
        limits = "read only" if p.read_only else expected(p)
        when = " (while disarmed)" if p.disarmed_only else ""
        rows.append(f"| {name} | {params[name]:.6g} | {limits}{when} | {p.sentence} |\n")
    return HEAD + "".join(rows)


@click.command()
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path))
def main(out: Path) -> None:
    """Write the page to OUT."""
    out.write_text(page())


if __name__ == "__main__":
    main()
