"""Tables and figures as HTML, for results that are shown in a notebook."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path


def table(title: str, heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A titled table."""
    head = "".join(f"<th>{escape(each)}</th>" for each in heads)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(str(each))}</td>' for each in row)}</tr>" for row in rows
    )
    return f"<p><b>{escape(title)}</b></p><table><tr>{head}</tr>{body}</table>"


def picture(path: Path) -> str:
    """A PNG file within the page. Empty if there is none."""
    try:
        data = base64.b64encode(path.read_bytes()).decode("ascii")
    except OSError:
        return ""
    return f'<img style="max-width: 100%" src="data:image/png;base64,{data}">'
