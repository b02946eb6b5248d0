"""The JSON Schema of mission files, from which editors complete and check them.

`python -m gcs_tools.missions.schema` writes it beside the missions.
"""

from __future__ import annotations

import json
from typing import Any

from gcs_tools.missions.mission import folder
from gcs_tools.missions.tables import Document

NAME = "mission.schema.json"


def _without_null(node: Any) -> Any:
    """The same without null: TOML has none, a key is left out instead."""
    if isinstance(node, list):
        return [_without_null(item) for item in node]
    if not isinstance(node, dict):
        return node
    found = {k: _without_null(v) for k, v in node.items() if v is not None}
    choices = [c for c in found.get("anyOf", ()) if c != {"type": "null"}]
    if len(choices) == 1:
        del found["anyOf"]
        return {**choices[0], **found}
    return {**found, "anyOf": choices} if choices else found


def text() -> str:
    """The schema, as it stands in the file."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **_without_null(Document.model_json_schema(by_alias=True)),
    }
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    (folder() / NAME).write_text(text(), encoding="utf-8")
