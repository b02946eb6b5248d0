"""Two recordings side by side: what is equal, and where the others differ first."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from difflib import unified_diff
from fnmatch import fnmatch
from itertools import zip_longest
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import common as mavlink
from rich.console import Console
from rich.table import Table

SHOWN, LONG = 6, 2000  # lines of a difference; lines of a file beyond which the first pair is shown


def files(recording: Path, only: Sequence[str] = ()) -> dict[str, Path]:
    """Outputs by case and name. `only`: patterns of the cases that count. Empty: all."""
    found = (path for path in sorted(recording.rglob("*")) if path.is_file())
    named = {path.relative_to(recording).as_posix(): path for path in found}
    return {name: path for name, path in named.items() if is_meant(name.rpartition("/")[0], only)}


def is_meant(case: str, only: Sequence[str]) -> bool:
    """True if a case is named like one of the patterns, or there is none."""
    return not only or any(fnmatch(case, each) for each in only)


def difference(a: str, b: str) -> list[str]:
    """The first lines that differ, - of `a` and + of `b`. Empty if they are equal."""
    if a == b:
        return []
    left, right = a.splitlines(), b.splitlines()
    if max(len(left), len(right)) <= LONG:
        shown = [line for line in unified_diff(left, right, n=0, lineterm="") if line[:2] not in ("--", "++", "@@")]  # fmt: skip
        more = len(shown) - SHOWN
        return shown[:SHOWN] + ([f"... {more} lines more"] if more > 0 else [])
    pairs = enumerate(zip_longest(left, right, fillvalue="(nothing)"), 1)
    number, (mine, other) = next(each for each in pairs if each[1][0] != each[1][1])
    return [f"line {number}", f"-{mine}", f"+{other}"]


def traffic_difference(a: str, b: str) -> list[str]:
    """Of each kind of message that differs: how many there are, and the first pair's fields."""
    if a == b:
        return []
    left, right = _by_kind(a), _by_kind(b)
    found = []
    for kind in sorted(left.keys() | right.keys()):
        mine, other = left.get(kind, []), right.get(kind, [])
        if mine == other:
            continue
        pairs = zip_longest(mine, other, fillvalue=("never", {}))
        (at, was), (then, now) = next((m, o) for m, o in pairs if m != o)
        names = [name for name in {**was, **now} if was.get(name) != now.get(name)]
        fields = ", ".join(f"{name} {was.get(name, '-')} -> {now.get(name, '-')}" for name in names)
        off = sum(m != o for m, o in zip_longest(mine, other))
        found.append(
            f"{kind}: {off} of {len(mine)}/{len(other)}; first at {at} s/{then} s: {fields}"
        )
    return found or ["the same messages in another order, or as other bytes"]


def _by_kind(traffic: str) -> dict[str, list[tuple[str, dict[str, Any]]]]:
    """(time, fields) of each message, by its name. Sequence numbers and checksums are left out."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    kinds: dict[str, list[tuple[str, dict[str, Any]]]] = defaultdict(list)
    for line in traffic.splitlines():
        at, _, told = line.partition(" ")
        try:
            messages = parser.parse_buffer(bytes.fromhex(told)) or []
        except ValueError:
            kinds["text"].append((at, {"text": told}))
            continue
        for message in messages:
            fields = {name: repr(value) for name, value in message.to_dict().items()}
            kinds[fields.pop("mavpackettype").strip("'")].append((at, fields))
    return kinds


def compared(a: Path, b: Path, every: bool = False, only: Sequence[str] = ()) -> bool:
    """Print a table of what is equal, and the differences, the same ones once. Whether all is equal."""
    console = Console(width=160, soft_wrap=True)
    left, right = files(a, only), files(b, only)
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    differing: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for name in sorted(left.keys() | right.keys()):
        part, output = name.partition("/")[0], re.sub(r"^\d+-", "", name.rpartition("/")[2])
        row = f"{part}: {output}"
        if name not in left or name not in right:
            found = (f"only in {'A' if name in left else 'B'}",)
        else:
            pair = left[name].read_text(), right[name].read_text()
            is_traffic = name.endswith(".traffic") and not name.endswith("sent.traffic")
            found = tuple(traffic_difference(*pair) if is_traffic else difference(*pair))
        counts[row]["differ" if found else "equal"] += 1
        if found:
            differing[found].append(name)
    table = Table("output", "equal", "differ", box=None)
    for row, count in counts.items():
        table.add_row(row, str(count["equal"]), str(count["differ"] or ""))
    console.print(table)
    for found, names in sorted(differing.items(), key=lambda each: -len(each[1])):
        listed = names if every else names[:3]
        more = f" and {len(names) - len(listed)} more" if len(names) > len(listed) else ""
        console.print(f"\n{', '.join(listed)}{more}", markup=False, highlight=False)
        for line in found:
            console.print(f"    {line}", markup=False, highlight=False)
    whole = sum(sum(count.values()) for count in counts.values())
    off = sum(count["differ"] for count in counts.values())
    console.print(f"\n{whole - off} of {whole} outputs are equal, {off} differ")
    return not off
