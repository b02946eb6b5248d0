"""The tables of messages in docs/mavlink.md, from the rows that the code goes by.

python -m fcu.messages_page docs/mavlink.md
"""

from __future__ import annotations

from pathlib import Path

import click

from fcu.services.exchange import OF_PLANT, REPLIES, TAKEN
from fcu.services.messages import ANSWERS, STREAMS

BEGIN, END = "<!-- {}: written by make schemas -->\n", "<!-- end of {} -->\n"


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


def taken() -> str:
    """A row a message that the vehicle takes, by service."""
    rows = (
        f"| {row.name} | {row.service} | {', '.join(row.answers) or '–'} | {row.meaning} |\n"
        for row in TAKEN
    )
    return "| message | taken by | answered by | content |\n|---|---|---|---|\n" + "".join(rows)


def answered() -> str:
    """A row a message that the vehicle sends because of another, or when something happens."""
    rows = (f"| {row.name} | {row.meaning} |\n" for row in REPLIES)
    return "| message | content |\n|---|---|\n" + "".join(rows)


def of_plant() -> str:
    """A row a message between the vehicle and its simulator."""
    rows = (
        f"| {row.name} | {'simulator' if row.to_vehicle else 'vehicle'} | {row.meaning} |\n"
        for row in OF_PLANT
    )
    return "| message | sender | content |\n|---|---|---|\n" + "".join(rows)


TABLES = {
    "messages": table, "messages taken": taken, "answers": answered,
    "messages of the simulator": of_plant,
}  # fmt: skip


def written(page: str) -> str:
    """A page with each table in its place."""
    for name, made in TABLES.items():
        before, begin, rest = page.partition(BEGIN.format(name))
        _, end, after = rest.partition(END.format(name))
        assert begin and end, f"the page has no place for: {name}"
        page = before + begin + "\n" + made() + "\n" + end + after
    return page


@click.command()
@click.argument("page", type=click.Path(dir_okay=False, exists=True, path_type=Path))
def main(page: Path) -> None:
    """Write the tables into PAGE."""
    page.write_text(written(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
