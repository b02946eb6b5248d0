"""The tables of numbers inside a page of Markdown, between two marks each."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

COMMAND = "python -m gcs_tools.studies.figures --numbers --write"
END = "<!-- end of the numbers -->"

Table = Sequence[Sequence[str]]


class PageError(ValueError):
    """A page without the marks that a table belongs between: says which."""


def mark(group: str) -> str:
    """What stands above a group's table."""
    return f"<!-- numbers of {group}, by {COMMAND} -->"


def markdown(rows: Table) -> str:
    """A table; `rows[0]` is its head."""
    head, *body = rows
    lines = [
        head,
        [":-:" if i == 0 else "---" if i == 1 else "--:" for i in range(len(head))],
        *body,
    ]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def tables(text: str) -> dict[str, str]:
    """The tables that a page has between marks, by group."""
    pattern = re.compile(rf"<!-- numbers of (\w+), .*? -->\n(.*?)\n{re.escape(END)}", re.DOTALL)
    return {found[1]: found[2].strip() for found in pattern.finditer(text)}


def check(text: str, groups: Iterable[str]) -> None:
    """Raises PageError for a group whose table has no place in the page."""
    for group in groups:
        if not _place(group).search(text):
            raise PageError(f"no table between {mark(group)!r} and {END!r}: add both lines")


def written(text: str, found: Mapping[str, Table]) -> str:
    """The page with its tables replaced. Raises PageError for a group that it has no marks for."""
    check(text, found)
    for group, rows in found.items():
        block = f"{mark(group)}\n\n{markdown(rows)}\n\n{END}"
        text = _place(group).sub(block.replace("\\", r"\\"), text)
    return text


def _place(group: str) -> re.Pattern[str]:
    return re.compile(rf"{re.escape(mark(group))}\n.*?{re.escape(END)}", re.DOTALL)
