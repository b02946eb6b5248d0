"""Masks: texts that differ between two recordings of the same tree, replaced by names, with reasons."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple


class Mask(NamedTuple):
    """A pattern and its replacement. `reason`: why the text says nothing about the flight."""

    pattern: str
    replacement: str
    reason: str


NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
MASKS = (
    Mask(r"(\b(?:wall_time_s|startup_s|real_time_factor|flown_in_s|took_wall_s) = )" + NUMBER,
         r"\1<wall>", "wall time of a result"),
    Mask(r"(?<=passed in )\d+ s", "<wall> s", "wall time of several missions"),
    Mask(r"[\d.,]+ times real time", "<wall> times real time", "wall time of a verdict"),
    Mask(r'(\btime(?:stamp)?=)"[^"]*"', r'\1"<wall>"', "wall time of a JUnit report"),
    Mask(r"\b20\d\d-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\.\d+)?(?:Z|[+-]\d\d:?\d\d)?", "<date>", "when it was flown"),
    Mask(r"\b20\d{6}[-T]\d{6}\w*", "<date>", "when it was flown: folders of runs"),
    Mask(r"((?:law = \"[\w.-]+ |law_sha256 = \"))[0-9a-f]{16}", r"\1<sources>", "digest of a law's sources"),
    Mask(r"0x[0-9a-f]{8,}", "<address>", "where something lies in memory"),
    Mask(r"\bpid \d+", "pid <pid>", "number of a process"),
)  # fmt: skip
LEFT_OUT = (
    Mask(r".*\bcompiling\b.*\n", "", "said by a cold start, and not by a warm one"),
)  # whole lines
_ALL = [(re.compile(mask.pattern), mask.replacement) for mask in (*LEFT_OUT, *MASKS)]


def masked(text: str, names: dict[Path, str]) -> str:
    """A text in which paths have names, and what no two runs share is replaced."""
    for path, name in sorted(names.items(), key=lambda each: -len(str(each[0]))):
        text = text.replace(str(path), name)
    for pattern, replacement in _ALL:
        text = pattern.sub(replacement, text)
    return text
