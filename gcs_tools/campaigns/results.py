"""A comparison on file: results.json, and results.parquet with a row for each flight.

Rows are sorted, and nothing in them depends on when, or how quickly, they were flown: the same
comparison writes the same bytes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from io import BytesIO
from typing import Any

from gcs_tools.campaigns.comparing import Row, Summary
from gcs_tools.campaigns.entrant import Entrant
from gcs_tools.campaigns.gains_file import Gains
from gcs_tools.campaigns.margins import Margin
from gcs_tools.campaigns.procedure import Procedure
from gcs_tools.campaigns.score import NAMES
from gcs_tools.campaigns.statistics import CONFIDENCE, Interval
from gcs_tools.missions.mission import Mission

SCHEMA_VERSION = 1
JSON, PARQUET = "results.json", "results.parquet"


@dataclass(frozen=True)
class Comparison:
    """What was compared, and what came out."""

    entrants: Sequence[Entrant]
    tuned: Mapping[tuple[str, str], Gains]  # by law and airframe
    missions: Sequence[Mission]
    seeds: Sequence[int]
    settings: Sequence[str]
    procedure: Procedure
    rows: Sequence[Row]
    summary: Summary
    margins: Sequence[Margin]


def about(of: Comparison) -> dict[str, Any]:
    """What was flown: versions, procedure, laws, missions, seeds."""
    return {
        "schema_version": SCHEMA_VERSION,
        "versions": {name: version(name) for name in ("m-mrac", "numpy", "numba", "scipy")},
        "procedure_sha256": of.procedure.sha256,
        "objective": of.procedure.objective.model_dump(),
        "confidence": CONFIDENCE,
        "laws": [
            {
                "law": entrant.label,
                "source": entrant.name,
                "airframe": entrant.airframe,
                "airframe_sha256": entrant.vehicle.sha256,
                "digest": entrant.law.digest,
                "gains": dict(entrant.gains),
                "provenance": dict(found.provenance)
                if (found := of.tuned.get((entrant.name, entrant.airframe)))
                else None,
            }
            for entrant in of.entrants
        ],
        "missions": [
            {"mission": mission.name, "title": mission.title, "given": mission.given}
            for mission in of.missions
        ],
        "seeds": list(of.seeds),
        "settings": list(of.settings),
    }


def content(of: Comparison) -> dict[str, Any]:
    """All of it as plain values: what is not a number is None."""
    found: dict[str, Any] = _plain(
        {
            **about(of),
            **{name: [asdict(each) for each in getattr(of.summary, name)] for name in vars(of.summary)},
            "margins": [each._asdict() for each in of.margins],
            "flights": [flat(row) for row in sorted(of.rows)],
        }
    )  # fmt: skip
    return found


def flat(row: Row) -> dict[str, Any]:
    """A flight as one row of a table."""
    score = row.score
    return {
        **{name: getattr(row, name) for name in ("airframe", "mission", "law", "seed")},
        "lost": bool(score.lost),
        "why_lost": score.lost,
        **{name: getattr(score, name) for name in NAMES},
    }


def as_json(of: Comparison) -> str:
    """The text of results.json: each flight a line."""
    found = content(of)
    flights = found.pop("flights")
    text = json.dumps(found, indent=1, allow_nan=False, ensure_ascii=False)
    lines = ",\n  ".join(json.dumps(row, allow_nan=False) for row in flights)
    return f'{text[:-2]},\n "flights": [\n  {lines}\n ]\n}}\n'


def as_parquet(of: Comparison) -> bytes:
    """The bytes of results.parquet; what was flown is in its metadata. Needs pyarrow."""
    import pyarrow
    from pyarrow import parquet

    rows = [flat(row) for row in sorted(of.rows)]
    kinds = {
        **dict.fromkeys(("airframe", "mission", "law", "why_lost"), pyarrow.string()),
        "seed": pyarrow.int64(),
        "lost": pyarrow.bool_(),
    }
    names = list(rows[0])
    told = json.dumps(_plain(about(of)), allow_nan=False)
    schema = pyarrow.schema(
        [(name, kinds.get(name, pyarrow.float64())) for name in names],
        metadata={"m-mrac": told},
    )
    columns = {name: [row[name] for row in rows] for name in names}
    table, file = pyarrow.table(columns, schema=schema), BytesIO()
    parquet.write_table(table, file, compression="zstd")
    return file.getvalue()


def _plain(value: Any) -> Any:
    if isinstance(value, Interval):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
