"""Recording of a checkout: a folder for each case, a text file for each output."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.equality.cases import Case
from tests.equality.masks import masked

HERE = Path(__file__).parent
LONGEST_S = 600.0  # wall: a command that takes longer has hung
WIDTH = "400"  # columns of a terminal: lines are not broken at a path, whose length differs
TEXTS = ".traffic", ".json", ".xml", ".log", ".csv", ".params"


class NotRecorded(Exception):
    """A case that could not be recorded: which, and why."""


def checkout_of(python: Path) -> Path:
    """The folder whose product an interpreter runs."""
    found = subprocess.run(
        [python, "-c", "import fcu; print(fcu.__file__)"], cwd="/", capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    return Path(found.stdout.strip()).parent.parent


def alone(words: list[str], folder: Path, held: tuple[int, ...] = ()) -> subprocess.CompletedProcess[str]:  # fmt: skip
    """Run a command in a network of its own, where every port is free but those `held`."""
    ports = ",".join(map(str, held))
    home = {name: os.environ[name] for name in ("HOME", "PATH", "XDG_CACHE_HOME") if name in os.environ}  # fmt: skip
    return subprocess.run(
        ["unshare", "-Urn", sys.executable, str(HERE / "alone.py"), ports, *words],
        cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=LONGEST_S,
        env={**home, "COLUMNS": WIDTH, "LANG": "C.UTF-8", "PYTHONHASHSEED": "0"},
    )  # fmt: skip


def record_case(case: Case, python: Path, checkout: Path, out: Path) -> None:
    """Run its command lines, and write what came out to `out`."""
    with tempfile.TemporaryDirectory(prefix="equality-") as made:
        folder = Path(made) / "here"
        folder.mkdir()
        for name, text in case.files.items():
            (folder / name).write_text(text)
        names = {folder: "<folder>", checkout: "<checkout>", python.parent.parent: "<venv>"}
        said: dict[str, str] = {}
        for number, words in enumerate(case.commands):
            filled = [word.format(checkout=checkout, python=python) for word in words]
            done = alone([str(python), "-m", *filled], folder, case.held)
            which = f"{number}-" if len(case.commands) > 1 else ""
            said[f"{which}exit"] = f"{' '.join(words)}\nexit code {done.returncode}\n"
            said[f"{which}stdout"], said[f"{which}stderr"] = _flat(done.stdout), done.stderr
        if case.ground:
            words = ("tests.equality.ground_traffic", case.ground, str(python), str(checkout))
            done = alone([sys.executable, "-m", *words], folder)
            if done.returncode:
                raise NotRecorded(f"{case.name}: {done.stderr.strip().splitlines()[-1]}")
        said |= dict(_written(folder, set(case.files)))
    out.mkdir(parents=True)
    for name, text in said.items():
        (out / name.replace("/", "+")).write_text(masked(text, names))


def _written(folder: Path, before: set[str]) -> Iterator[tuple[str, str]]:
    """Every file that was written, by name, as text. Of pictures and the like that they are there."""
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())  # fmt: skip
    yield "files", "".join(f"{name}\n" for name in names)
    for name in names:
        path = folder / name
        if name in before:
            continue
        if path.suffix == ".parquet":
            yield name, parquet_text(path)
        elif path.suffix == ".mcap":
            yield name, mcap_text(path)
        elif path.suffix in TEXTS:
            text = path.read_text()
            yield name, _flat(text) if path.suffix == ".json" else text
            told = json.loads(text) if path.name == "result.json" else {}
            if isinstance(told, dict) and "trajectory_sha256" in told:
                yield name.replace("result.json", "trajectory"), f"{told['trajectory_sha256']}\n"


def parquet_text(path: Path) -> str:
    """The rows of a table, a value a line: row, column, value to the bit."""
    from pyarrow import parquet

    table = parquet.read_table(path)
    lines = [f"columns {', '.join(f'{f.name}: {f.type}' for f in table.schema)}"]
    for number, row in enumerate(table.to_pylist()):
        lines += [f"{number} {name} = {value!r}" for name, value in row.items()]
    return "\n".join(lines) + "\n"


WALL_TOPICS = "timing"  # of topics that hold wall times, messages are counted only


def mcap_text(path: Path) -> str:
    """Of each topic of a recording its schema and messages: how many, and their digest."""
    from mcap.reader import make_reader

    topics: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        reader = make_reader(file)
        for schema, channel, message in reader.iter_messages():
            of = topics.setdefault(channel.topic, [schema.name, 0, hashlib.sha256()])
            of[1] += 1
            of[2].update(message.data)
        lines = [
            f"{topic} {name} {count} {'' if WALL_TOPICS in topic else digest.hexdigest()}"
            for topic, (name, count, digest) in sorted(topics.items())
        ]
        for each in reader.iter_metadata():
            lines += [f"{each.name}: {_flat(json.dumps(each.metadata))}"]
    return "\n".join(lines) + "\n"


def _flat(text: str) -> str:
    """JSON as a line for each value, with the way to it. Other text as it is."""
    try:
        told = json.loads(text)
    except ValueError:
        return text
    return "".join(f"{line}\n" for line in _lines(told, ""))


def _lines(value: Any, way: str) -> Iterator[str]:
    if isinstance(value, dict) and value:
        for key, each in value.items():
            yield from _lines(each, f"{way}.{key}" if way else str(key))
    elif isinstance(value, list) and value and not all(isinstance(v, int | float) for v in value):
        for number, each in enumerate(value):
            yield from _lines(each, f"{way}[{number}]")
    else:
        yield f"{way} = {json.dumps(value, ensure_ascii=False)}"


def clear(out: Path) -> None:
    """Forget what was recorded of a case before."""
    shutil.rmtree(out, ignore_errors=True)
