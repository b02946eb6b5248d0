"""A campaign's folder: what was flown so far, part by part, and one file of it at the end.

campaign.json     what is flown, and with which versions; written first
campaign.toml     the campaign's file, as it was read
parts/            flights as they came, a file for each second or so; until the end
flights.parquet   all flights, sorted by number and law: the same bytes whatever their history
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import re
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.files import input_file, whole_file
from fcu.interface.files.input_file import TomlError, shown, written
from gcs_tools.campaigns.batch import Row
from gcs_tools.campaigns.campaign_file import (
    NO_IDENTITY,
    Campaign,
    CampaignError,
    Changes,
    Document,
    parsed,
)
from gcs_tools.campaigns.rare import Mixture
from gcs_tools.campaigns.score import COLUMNS
from gcs_tools.exit_codes import INFRASTRUCTURE, OK, USAGE
from gcs_tools.judging.metrics import METRICS

SCHEMA_VERSION = 1
JSON, TOML, PARTS, PARQUET, LOCK, PROPOSALS = (
    "campaign.json", "campaign.toml", "parts", "flights.parquet", ".lock", "proposals.json",
)  # fmt: skip
_PART = re.compile(r"[0-9]{8,18}-(?P<digest>[0-9a-f]{16})\.parquet")
PART_S = 1.0  # wall: what a crash may lose
MOST_PARTS = 200  # more are joined to one
DEFAULT_SEED = Document.model_fields["seed"].default
TEXT_MOST = 64 * input_file.MIB  # of a file of the folder that is no table
LINE_MOST = 60  # characters of a file's line that a message shows
UNKNOWN, FAILURE, SUCCESS = -1, 0, 1
OWN = ("number", "law", "seed", "success", "ended", "missed", "error", "exit_code", "sim_time_s", "ticks",
       "trajectory_sha256")  # fmt: skip
_KNOWN = ("number", "law", "success", "exit_code")  # of every flight
_CODES = (OK, USAGE, INFRASTRUCTURE)  # that a flight ends with
DRAWN = "draw."  # before the names of drawn quantities


class Refused(CampaignError):
    """A folder that holds something else."""


class Store:
    """The flights of one campaign, kept."""

    def __init__(self, folder: Path, campaign: Campaign, fingerprint: Mapping[str, str]) -> None:
        """Open a folder, new or of the same campaign. Raises Refused, OSError."""
        self.folder = folder
        self._campaign = campaign
        self._pending: list[Row] = []
        self._written_at = time.monotonic()
        self.outcome = np.full((len(campaign.variants), campaign.n), UNKNOWN, dtype=np.int8)
        self.metric = np.full(self.outcome.shape, math.nan)  # that flights are ranked by
        self.worst_exit, self.first_error = 0, ""
        self.errors: dict[str, str] = {}  # the first of each law that has one
        folder.mkdir(parents=True, exist_ok=True)
        about = self._about(fingerprint)
        found = folder / JSON
        if found.exists():
            self._compare(about)
        elif any(each.name != LOCK for each in folder.iterdir()):
            raise not_empty(folder)
        else:
            whole_file.write(folder / TOML, campaign.text.encode())
            whole_file.write(found, (json.dumps(about, indent=1) + "\n").encode())
        self._schema = schema(campaign)
        self._n_parts = 1 + max(
            (int(path.name.partition("-")[0]) for path in self._parts()), default=-1
        )
        for table in self._tables():
            self._note(table)
        (folder / PARTS).mkdir(exist_ok=True)

    @property
    def flown(self) -> int:
        """Flights of all laws that are kept."""
        return int((self.outcome != UNKNOWN).sum())

    @property
    def whole(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Whether each number is flown, by every law."""
        flown: np.ndarray[Any, np.dtype[np.bool_]] = (self.outcome != UNKNOWN).all(axis=0)
        return flown

    def add(self, rows: Iterable[Row]) -> None:
        """Keep some rows; they are on disk within PART_S, or when `flush` is called. Raises OSError."""
        for row in rows:
            self._pending.append(row)
            self._note_row(row)
        if time.monotonic() - self._written_at >= PART_S:
            self.flush()

    def flush(self) -> None:
        """Write what is not on disk yet. Raises OSError."""
        self._written_at = time.monotonic()
        if not self._pending:
            return
        self._write_part(self._table(self._pending))
        self._pending = []
        if len(parts := self._parts()) > MOST_PARTS:
            self._join(parts)

    def keep_proposals(self) -> None:
        """What the stages are drawn from, for whoever flies one of their flights again. Raises OSError."""
        mixtures = {str(k): each.plain() for k, each in self._campaign.draws.proposals.items()}
        whole_file.write(self.folder / PROPOSALS, json.dumps(mixtures).encode(), follow=False)

    def finish(self, n: int) -> Path:
        """The file of the first `n` flights of each law, in place of the parts. Raises OSError."""
        import pyarrow
        from pyarrow import compute

        self.flush()
        path = self.folder / PARQUET
        tables = list(self._tables())
        joined = pyarrow.concat_tables(tables) if tables else self._table([])
        joined = joined.filter(compute.less(joined["number"], n))
        number = joined["number"].to_numpy()
        labels = {label: i for i, label in enumerate(self._campaign.labels)}
        law = np.array([labels[each] for each in joined["law"].to_pylist()], dtype=np.int64)
        _, first = np.unique(number * len(labels) + law, return_index=True)
        self._write(path, joined.take(first).combine_chunks())
        shutil.rmtree(self.folder / PARTS)
        return path

    def _join(self, parts: Sequence[Path]) -> None:
        """Many small parts as one. A crash in between leaves both, which `finish` knows."""
        import pyarrow

        joined = pyarrow.concat_tables([_read(part, self._schema) for part in parts])
        self._write_part(joined)
        for part in parts:
            part.unlink()

    def _parts(self) -> list[Path]:
        return parts(self.folder)

    def _tables(self) -> Iterator[Any]:
        ended = self.folder / PARQUET
        for path in [*([ended] if ended.exists() else []), *self._parts()]:
            yield _read(path, self._schema)

    def _write_part(self, table: Any) -> None:
        data = _encoded(table)
        name = f"{self._n_parts:08d}-{_digest(data)}.parquet"
        whole_file.write(self.folder / PARTS / name, data)
        self._n_parts += 1

    def _write(self, path: Path, table: Any) -> None:
        whole_file.write(path, _encoded(table), follow=False)

    def _table(self, rows: Sequence[Row]) -> Any:
        import pyarrow

        draws, labels = self._campaign.draws, self._campaign.labels
        quantities: dict[int, Mapping[str, Any]] = {}
        records = []
        for row in rows:
            drawn = quantities.setdefault(row.number, draws.quantities(row.number))
            values = {f"{DRAWN}{name}": drawn.get(name) for name in draws.names}
            own = {name: getattr(row, name) for name in OWN}
            if draws.stage:
                own.update(stage=draws.stage_of(row.number), weight=draws.weight(row.number))
            records.append({**own, "law": labels[row.law], **values, **row.metrics})
        columns = {
            name: [_fit(record.get(name), text=str(kind) == "string") for record in records]
            for name, kind in zip(self._schema.names, self._schema.types, strict=True)
        }
        return pyarrow.table(columns, schema=self._schema)

    def _note_row(self, row: Row) -> None:
        self.outcome[row.law, row.number] = SUCCESS if row.success else FAILURE
        value = row.metrics.get(self._campaign.ranked_by)
        self.metric[row.law, row.number] = math.nan if value is None else value
        if row.exit_code > self.worst_exit or (row.exit_code and not self.first_error):
            self.worst_exit = max(self.worst_exit, row.exit_code)
            self.first_error = f"flight {row.number}: {row.error}"
        if row.exit_code:
            self.errors.setdefault(
                self._campaign.labels[row.law], f"flight {row.number}: {row.error}"
            )

    def _note(self, table: Any) -> None:
        labels = {label: i for i, label in enumerate(self._campaign.labels)}
        names = ("number", "law", "success", "exit_code", "error")
        columns = [table[name].to_pylist() for name in (*names, self._campaign.ranked_by)]
        for number, label, success, code, error, value in zip(*columns, strict=True):
            if label not in labels:
                raise Refused(
                    f"{self.folder}: flight {number} is of a law {label} that the campaign does not have"
                )
            if number < self._campaign.n:
                self._note_row(
                    Row(number, labels[label], 0, success, "", error, code, 0.0, 0, "",
                        {self._campaign.ranked_by: value})
                )  # fmt: skip

    def _about(self, fingerprint: Mapping[str, str]) -> dict[str, Any]:
        campaign = self._campaign
        return {
            "schema_version": SCHEMA_VERSION,
            "name": campaign.name,
            "title": campaign.document.title,
            "source": str(Path(campaign.source).absolute()),
            "flights": campaign.document.flights,
            "changes": campaign.changes.plain(),
            "identity": campaign.identity,
            "fingerprint": dict(fingerprint),
        }

    def _compare(self, about: Mapping[str, Any]) -> None:
        try:
            there = json.loads(_text(self.folder / JSON))
            same, began = there["identity"] == about["identity"], dict(there["fingerprint"])
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise Refused(f"{self.folder / JSON}: not a campaign's ({error})") from error
        if not same:
            raise Refused(
                f"{self.folder}: another campaign was flown here: {self._other(there, about)};"
                " name a new folder with --out"
            )
        if other := differences(began, about["fingerprint"]):
            raise Refused(f"{self.folder}: began with {other}: its flights would not be the same")

    def _other(self, there: Mapping[str, Any], about: Mapping[str, Any]) -> str:
        """The first difference between a campaign that was flown here and this one, in words."""
        try:
            was = _text(self.folder / TOML)
        except (OSError, UnicodeDecodeError):
            was = ""
        now = self._campaign.text
        try:
            texts = [input_file.toml(was), input_file.toml(now)]
        except TomlError:  # the file there was changed by hand
            texts = []
            for i, (old, new) in enumerate(zip_longest(was.split("\n"), now.split("\n"), fillvalue="")):  # fmt: skip
                if was and old != new:
                    return f"line {i + 1} of its file is {_cut(old)}, here {_cut(new)}"
        changes = [dict(each.get("changes", {})) for each in (there, about)]
        for tables, changed in zip(texts, changes, strict=False):
            told = {k: changed[k] for k in ("flights", "seed") if changed.get(k) is not None}
            tables |= {**told, "--set": changed.get("set", {})}
            for key in NO_IDENTITY:
                tables.pop(key, None)
        if texts and (other := _first_difference(*(dict(_leaves(each)) for each in texts))):
            return other
        return "a mission, a law or an airframe has changed since"


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The values of a TOML file by their dotted keys. A table in quotes and dots is one without."""
    if isinstance(value, Mapping) and value:
        for key, each in value.items():
            yield from _leaves(each, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and not all(isinstance(each, int | float) for each in value):
        for i, each in enumerate(value):
            yield from _leaves(each, f"{path}[{i}]")
    elif value != {}:
        yield path, value


def _first_difference(was: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """The first key whose values differ, with both, in words. Empty: no key differs."""
    for key in {**was, **now}:
        old, new = (shown(each[key]) if key in each else "" for each in (was, now))
        if old == new:
            continue
        if key == "flights" and old and new:
            return f"it has {old} flights, here {new} are asked for"
        if key == "seed":
            return f"its seed is {old or DEFAULT_SEED}, here {new or DEFAULT_SEED}"
        named = key.replace("--set.", "--set ")
        if not old:
            return f"it has no {named}, here it is {new}"
        return f"its {named} is {old}, here " + (new or "there is none")
    return ""


def not_empty(folder: Path) -> Refused:
    """The error of a folder that holds something else."""
    return Refused(f"--out {folder}: the folder is not empty (name a new or an empty one)")


def _text(path: Path) -> str:
    """A file of a campaign's folder. Raises OSError, UnicodeDecodeError."""
    return input_file.text(path, TEXT_MOST)


def _cut(line: str) -> str:
    """A line of a file, to be read in a sentence."""
    return repr(line if len(line) <= LINE_MOST else f"{line[: LINE_MOST - 3]}...")


def parts(folder: Path) -> list[Path]:
    """The parts of a campaign's folder, in the order in which they were written. Raises Refused."""
    if (folder / PARTS).is_symlink():
        raise Refused(f"{folder / PARTS}: expected a folder, not a link: remove it")
    found = sorted((folder / PARTS).glob("*.parquet"))
    for path in found:
        if not _PART.fullmatch(path.name):
            raise Refused(f"{path}: not a part of a campaign: remove it")
    return found


def _encoded(table: Any) -> bytes:
    """The bytes of a Parquet file. A page that was changed afterwards is not read."""
    from io import BytesIO

    from pyarrow import parquet

    file = BytesIO()
    parquet.write_table(
        table, file, compression="zstd", row_group_size=1 << 16, store_schema=True,
        write_page_checksum=True,
    )  # fmt: skip
    return file.getvalue()


def _digest(data: bytes) -> str:
    """The part of a file's name that tells whether its bytes are those that were written."""
    return hashlib.sha256(data).hexdigest()[:16]


def differences(theirs: Mapping[str, str], ours: Mapping[str, str]) -> str:
    """Where two fingerprints differ, in words; empty: nowhere."""
    return ", ".join(
        f"{name} {theirs.get(name, 'unknown')} (here {ours.get(name, 'unknown')})"
        for name in ours
        if theirs.get(name) != ours[name]
    )


def reopened(
    folder: Path, unchanged: bool = False, allow_commands: bool = False,
    metrics: tuple[str, ...] = (),
) -> Campaign:  # fmt: skip
    """The campaign of a folder, to go on with it. Raises CampaignError.

    metrics : shown in place of those that it began with.
    unchanged : also for one of which something has changed since.
    allow_commands : as for `campaign_file.read`.
    """
    try:
        about = json.loads(_text(folder / JSON))
        source, name = Path(about["source"]), _plain_name(about["name"])
        # older folders keep the number of flights alone
        changes = Changes(**about.get("changes", {"flights": about["flights"]}))
        changes = replace(changes, set=dict(changes.set), metrics=metrics or tuple(changes.metrics))
    except OSError as error:
        raise CampaignError(f"{error.filename}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise CampaignError(f"{folder / JSON}: not a campaign's ({error})") from error
    try:
        text = _text(folder / TOML)
    except (OSError, UnicodeDecodeError) as error:
        raise CampaignError(f"{folder / TOML}: {error}") from error
    campaign = parsed(
        text, str(folder / TOML), source.parent, name, changes, allow_commands
    )  # fmt: skip
    if unchanged and about.get("identity") != campaign.identity:
        raise CampaignError(
            f"{folder}: its campaign.toml, a mission, a law or an airframe has changed since it was flown"
        )
    if (folder / PROPOSALS).exists():
        d = len(campaign.draws.drawn)
        try:
            told = json.loads(_text(folder / PROPOSALS))
            mixtures = {int(k): Mixture.of(each, d) for k, each in told.items()}
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            raise CampaignError(f"{folder / PROPOSALS}: not a campaign's ({error})") from error
        campaign.draws.proposals.update(mixtures)
    return campaign


def _plain_name(name: object) -> str:
    """The name of a campaign. Raises ValueError for one that leads to another folder."""
    if not isinstance(name, str) or Path(name).name != name or name in ("", ".", ".."):
        raise ValueError(f"name: expected the name of a file without a folder, got {name!r}")
    return name


@contextmanager
def locked(folder: Path, what: str = "campaign") -> Iterator[None]:
    """While one process flies a campaign in a folder, no other does. Raises Refused, OSError.

    what : the name of what is flown there, for the message.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # a link in a stranger's folder would have another file emptied
    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
    try:
        descriptor = os.open(folder / LOCK, flags, 0o644)
    except OSError as error:
        if (folder / LOCK).is_symlink():
            raise Refused(f"{folder / LOCK}: expected a file, not a link: remove it") from error
        raise
    with os.fdopen(descriptor, "w") as file:
        try:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ImportError:
            pass  # not on this system
        except OSError as error:
            if error.errno not in (errno.EACCES, errno.EAGAIN):
                raise
            raise Refused(f"{folder}: another process flies a {what} in this folder") from error
        yield


def schema(campaign: Campaign) -> Any:
    """Columns of flights.parquet: what a flight is, what was drawn, every metric."""
    import pyarrow

    kinds = {
        "number": pyarrow.int64(), "seed": pyarrow.int64(), "ticks": pyarrow.int64(),
        "exit_code": pyarrow.int8(), "success": pyarrow.bool_(), "sim_time_s": pyarrow.float64(),
    }  # fmt: skip
    own = [(name, kinds.get(name, pyarrow.string())) for name in OWN]
    if campaign.draws.stage:
        own += [("stage", pyarrow.int64()), ("weight", pyarrow.float64())]
    drawn = [(f"{DRAWN}{name}", _kind(campaign, name)) for name in campaign.draws.names]
    scored = () if campaign.document.seeds is None else COLUMNS
    metrics = [(name, pyarrow.float64()) for name in (*METRICS, *scored)]
    about = {"campaign": campaign.name, "title": campaign.document.title,
             "ranked_by": campaign.ranked_by, "identity": campaign.identity}  # fmt: skip
    return pyarrow.schema([*own, *drawn, *metrics], metadata={"m-mrac": json.dumps(about)})


def _kind(campaign: Campaign, name: str) -> Any:
    """Numbers, or a text of whatever else is drawn."""
    import pyarrow

    draws = campaign.draws
    known = [point[name] for point in draws.points if name in point]
    for each, distribution in draws.drawn:
        if each.name == name:
            known += list(distribution.choice or ())
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in known)
    return pyarrow.float64() if numbers else pyarrow.string()


def _fit(value: Any, text: bool) -> Any:
    if text and value is not None and not isinstance(value, str):
        return written(value)
    return value


def _read(path: Path, wanted: Any) -> Any:
    """A part of the campaign that a schema is of. Raises Refused for anything else, OSError."""
    from io import BytesIO

    import pyarrow
    from pyarrow import compute, parquet

    try:
        with input_file.opened(path) as file:
            data = file.read()
        if (named := _PART.fullmatch(path.name)) and named["digest"] != _digest(data):
            raise ValueError("they are damaged")
        table = parquet.read_table(
            BytesIO(data), page_checksum_verification=True, use_threads=False, pre_buffer=False
        )
        if _identity(table.schema) != _identity(wanted):
            raise ValueError("they are of another campaign")
        table = table.select(wanted.names).cast(wanted).replace_schema_metadata(wanted.metadata)
        if any(table[name].null_count for name in _KNOWN):
            raise ValueError("a flight lacks its number, law, success or exit_code")
        codes = set(compute.unique(table["exit_code"]).to_pylist())
        if len(table) and (compute.min(table["number"]).as_py() < 0 or codes - set(_CODES)):
            raise ValueError("a number or an exit_code that no flight has")
    except (pyarrow.ArrowException, OSError, KeyError, ValueError, RecursionError) as error:
        if isinstance(error, OSError) and error.errno in (errno.EINVAL, errno.EISDIR):
            raise Refused(f"{path}: {error.strerror}") from error  # a folder, a pipe
        if isinstance(error, OSError) and error.errno is not None:
            raise  # of the disk; pyarrow's own, of damaged bytes, has none
        why = "they are damaged" if isinstance(error, pyarrow.ArrowException | OSError) else error
        raise Refused(
            f"{path}: not flights of this campaign ({why}): remove it, and they are flown again"
        ) from error
    return table


def _identity(schema: Any) -> str:
    """The identity of the campaign that a file is of. Raises ValueError, KeyError."""
    told = json.loads((schema.metadata or {})[b"m-mrac"])
    return str(told["identity"])


def row(campaign: Campaign, folder: Path, number: int, law: str) -> Mapping[str, Any]:
    """What is kept of a flight; empty: nothing. Raises Refused, OSError."""
    from pyarrow import compute

    wanted = schema(campaign)
    for path in (folder / PARQUET, *parts(folder)):
        if path.exists():
            table = _read(path, wanted)
            is_it = compute.and_(
                compute.equal(table["number"], number), compute.equal(table["law"], law)
            )
            if len(found := table.filter(is_it)):
                return dict(found.to_pylist()[0])
    return {}
