"""JUnit XML: how CI services read what passed."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple


class Case(NamedTuple):
    """One test case. `failure` or `error`, in words, tells that it did not pass."""

    classname: str
    name: str
    seconds: float
    failure: str = ""
    error: str = ""
    text: str = ""  # below the failure or error
    out: str = ""  # what is told of it besides


def document(suite: str, cases: Iterable[Case], seconds: float | None = None) -> str:
    """The text of a whole file. `seconds`: of all cases together. None: their sum.

    Cases of equal names are numbered in the order in which they are given: "m", "m-1".
    """
    root = ET.Element("testsuite", name=suite)
    count = {"tests": 0, "failures": 0, "errors": 0}
    total_s = 0.0
    named: Counter[str] = Counter()
    for case in cases:
        name = f"{case.name}-{n}" if (n := named[case.name]) else case.name
        named[case.name] += 1
        time = f"{case.seconds:.3f}"
        element = ET.SubElement(root, "testcase", classname=case.classname, name=name, time=time)
        count["tests"] += 1
        total_s += case.seconds
        if case.out:
            ET.SubElement(element, "system-out").text = case.out
        for kind, message in (("error", case.error), ("failure", case.failure)):
            if message:
                count[f"{kind}s"] += 1
                ET.SubElement(element, kind, message=message).text = case.text
                break
    for name, number in count.items():
        root.set(name, str(number))
    root.set("time", f"{total_s if seconds is None else seconds:.3f}")
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, "unicode") + "\n"
