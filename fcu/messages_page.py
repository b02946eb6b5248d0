"""The table in docs/mavlink.md of what the vehicle tells of itself, from the table of messages.

python -m fcu.messages_page docs/mavlink.md
"""

from __future__ import annotations

from pathlib import Path

import click

from fcu.services.messages import ANSWERS, STREAMS

BEGIN, END = "<!-- messages: written by make schemas -->\n", "<!-- end of messages -->\n"


def table() -> str:
    """A row a message, in the order of their names."""
    rows = [
        f"| {stream.name} | {_rate(stream.station_hz)} | {_rate(stream.script_hz)} | {stream.meaning} |\n"
        for stream in STREAMS.values()
    ]
    rows += [f"| {answer.name} | – | – | {answer.meaning} |\n" for answer in ANSWERS.values()]
    return "| message | ground station, Hz | script, Hz | content |\n|---|---|---|---|\n" + "".join(
        sorted(rows)
    )


def _rate(hz: float) -> str:
    return f"{hz:g}"


def written(page: str) -> str:
    """A page with the table in its place."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    return before + begin + "\n" + table() + "\n" + end + after


@click.command()
@click.argument("page", type=click.Path(dir_okay=False, exists=True, path_type=Path))
def main(page: Path) -> None:
    """Write the table into PAGE."""
    page.write_text(written(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
