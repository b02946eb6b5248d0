"""What a parameter is: one row, from which everything that knows a parameter is derived.

A law (and the vehicle) lists its rows. From them come the values that Params are built with and
their checks, MAVLink's parameters, the `[law]` table of mission files with its JSON Schema, and
docs/parameters.md. A value is what a person writes: a number, three, the two ends of an
interval, or a word; in Params, and over MAVLink, it is numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from operator import attrgetter, or_
from typing import Any, NamedTuple, TypeVar

import numpy as np

from fcu.interface.airframe import PINNED, AirframeError
from fcu.interface.files.input_file import shown
from fcu.kernel.buffers import from_buffer, size

Value = float | str | tuple[float, ...]
Numbers = tuple[float, ...]
T = TypeVar("T")


class ParameterError(ValueError):
    """A parameter that cannot be flown: its name and what was expected."""


def choice(words: Iterable[str]) -> str:
    """Words of which one is to be written: `a, b or c`."""
    *others, last = words
    return f"{', '.join(others)} or {last}" if others else last


def not_one_of(words: Iterable[str], got: Any) -> str:
    """What a message says of a value that is none of the words: as a person writes both."""
    return f"expected {choice(words)}, got {got if is_word(got) else shown(got)}"


def is_word(value: Any) -> bool:
    """Whether a value reads as a word without quotes, and can be taken for nothing else."""
    return isinstance(value, str) and value.isidentifier() and value not in ("true", "false")


class Conversion(NamedTuple):
    """How one number goes with Params, where it is not simply one of their fields."""

    get: Callable[[Any], float]  # of Params
    put: Callable[[Any, float], Any]  # Params with another number
    # and with what follows from it, by the tables of an airframe file
    lead: Callable[[Any, float, Mapping[str, Any]], Any] | None = None


class Part(NamedTuple):
    """Some of a parameter's numbers, which are one number over MAVLink."""

    name: str  # at most 16 characters
    fields: tuple[str, ...]
    sentence: str


class Parameter(NamedTuple):
    """A row of the table."""

    key: str  # in a mission's [law], a dot for a table in it; empty: not of missions
    mavlink: str | tuple[Part, ...]  # at most 16 characters; empty: not of MAVLink
    default: Value | None  # None: of the airframe
    low: float = -math.inf  # of each number
    high: float = math.inf
    unit: str = ""
    sentence: str = ""
    field: str | tuple[str, ...] | None = None  # path(s) in Params; None: the key; (): none
    convert: Conversion | None = None
    axes: bool = False  # three numbers, or one for all three
    words: Mapping[str, float] | None = None  # that are written for numbers
    values: Numbers | None = None  # if only these are allowed
    airframe: str = ""  # where the default stands in the airframe file: "limits.thrust_min_n"
    of_several: Callable[[Any], float] = max  # of the numbers that stand there, for a row of one
    rule: Callable[[Mapping[str, Any]], Value] | None = None  # or how it follows from those tables
    below: str = ""  # key (or MAVLink name) of a parameter that must be greater
    degrees: bool = False  # what is in radians is in degrees over MAVLink
    group: str = ""  # in the docs
    read_only: bool = False
    disarmed_only: bool = False
    at_start: bool = False  # chosen when the vehicle starts, and not set afterwards
    leads: bool = False  # the defaults of others depend on it
    integer: bool = False  # over MAVLink an INT32, as PX4 has it; else a REAL32
    gain: bool = False  # what a procedure that tunes a law is free to choose
    law: str = ""  # whose [law.NAME] in an airframe file may pin it

    @property
    def name(self) -> str:
        """What messages call it."""
        return self.key or self.parts[0].name

    @property
    def interval(self) -> bool:
        """Whether it is two numbers, least and most."""
        return isinstance(self.field, tuple) and len(self.field) == 2

    @property
    def fields(self) -> tuple[str, ...]:
        """Paths in Params, one a number."""
        if isinstance(self.field, tuple):
            return self.field
        path = self.key if self.field is None else self.field
        three = self.axes or isinstance(self.default, tuple)
        return tuple(f"{path}.{axis}" for axis in "xyz") if three else (path,)

    @property
    def parts(self) -> tuple[Part, ...]:
        """MAVLink's parameters of this one."""
        if isinstance(self.mavlink, tuple):
            return self.mavlink
        return (Part(self.mavlink, self.fields, self.sentence),) if self.mavlink else ()

    def get(self, params: Any) -> Numbers:
        """Its numbers in Params."""
        if self.convert is not None:
            return (float(self.convert.get(params)),)
        return tuple(float(attrgetter(path)(params)) for path in self.fields)

    def put(self, params: Any, numbers: Numbers, airframe: Mapping[str, Any] | None = None) -> Any:
        """Params with other numbers.

        `airframe`: the tables of an airframe file, by which defaults that depend on a row that
        `leads` follow it.
        """
        if self.convert is not None and self.convert.lead is not None and airframe is not None:
            return self.convert.lead(params, numbers[0], airframe)
        if self.convert is not None:
            return self.convert.put(params, numbers[0])
        for path, number in zip(self.fields, numbers, strict=True):
            params = with_field(params, path, number)
        return params

    def expected(self) -> str:
        """What each of its numbers may be, in words."""
        if self.words is not None:
            return choice(self.words)
        if self.high == math.inf:
            return f"of at least {self.low:g} {self.unit}".rstrip()
        return f"from {self.low:g} to {self.high:g} {self.unit}".rstrip()

    def described(self) -> str:
        """The sentence, with its unit and where its default is from."""
        unit = f", {self.unit}" if self.unit else ""
        if self.rule is not None:
            return f"{self.sentence}{unit}; follows from the airframe"
        given = self.airframe if self.default is None else self.default
        of = "of the airframe file: " if self.default is None else "default "
        return f"{self.sentence}{unit}; {of}{_written(given)}"

    def numbers(self, value: Any) -> Numbers:
        """What a value is in Params. Raises ParameterError for a value that it may not have."""
        if self.words is not None:
            if not isinstance(value, str) or value not in self.words:
                raise ParameterError(f"{self.name}: {not_one_of(self.words, value)}")
            return (self.words[value],)
        n = max(len(self.fields), 1)
        row = list(value) if isinstance(value, list | tuple) else [value] * (n if self.axes else 1)
        if len(row) != n or not all(_finite(v) for v in row):
            which = "two numbers, least and most" if self.interval else "three finite numbers"
            which = "a finite number" if n == 1 else which + (", or one" if self.axes else "")
            raise ParameterError(f"{self.name}: expected {which}, got {shown(value)}")
        numbers = tuple(float(v) for v in row)
        self.check(numbers)
        return numbers

    def check(self, numbers: Numbers, slack: float = 0.0) -> None:
        """Raise ParameterError if one is out of range, and not within a fraction `slack` of its ends."""
        ends = self.low, self.high
        near = (any(math.isclose(v, end, rel_tol=slack) for end in ends) for v in numbers)
        inside = (self.low <= v <= self.high for v in numbers)
        if not all(map(or_, inside, near)):
            raise ParameterError(f"{self.name}: expected a value {self.expected()}")
        if self.interval and numbers[0] > numbers[1]:
            raise ParameterError(f"{self.name}: expected the least first, then the most")


def _written(value: Any) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_written(v) for v in value) + "]"
    return value if isinstance(value, str) else f"{value:g}"


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def group(name: str, *rows: Parameter) -> tuple[Parameter, ...]:
    """Rows that belong together in the docs."""
    return tuple(row._replace(group=name) for row in rows)


def with_field(value: T, path: str, number: Any) -> T:
    """A NamedTuple with another number at a dotted path."""
    of: Any = value
    head, _, rest = path.partition(".")
    inner = with_field(getattr(value, head), rest, number) if rest else number
    changed: T = of._replace(**{head: inner})
    return changed


def flat(chosen: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted key and value of nested tables."""
    for name, value in chosen.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{above}{name}.")
        else:
            yield above + name, value


def default(row: Parameter, airframe: Mapping[str, Any]) -> Value:
    """The default of a row; `airframe`: the tables of an airframe file.

    What the file pins for the law that is flown comes first (`PINNED`). Of several numbers
    in the file `of_several`, for a row of one. Raises AirframeError.
    """
    pinned = airframe.get(PINNED)
    if pinned is None:
        pinned = dict(flat(airframe.get("law", {}).get(row.law, {})))
    if row.key and row.key in pinned:
        value = pinned[row.key]
        return tuple(value) if isinstance(value, list) else value
    if row.default is not None:
        return row.default
    if row.rule is not None:
        return row.rule(airframe)
    found: Any = airframe
    for name in row.airframe.split("."):
        if name not in found:
            table, _, key = row.airframe.rpartition(".")
            raise AirframeError(f"[{table}] {key} is missing")
        found = found[name]
    several = isinstance(found, list) and len(row.fields) == 1
    return row.of_several(found) if several else tuple(found) if isinstance(found, list) else found


def values(
    rows: Iterable[Parameter],
    airframe: Mapping[str, Any],
    chosen: Mapping[str, Any],
    instead: Mapping[str, Value] | None = None,
) -> dict[str, Numbers]:
    """Key -> numbers of each row: as chosen, else `instead` of its default, else its default.

    Raises ParameterError, AirframeError.
    """
    table = {row.key: row for row in rows if row.key}
    given = dict(flat(chosen))
    for name in given:
        if name not in table:
            raise ParameterError(f"{name}: no such law parameter")
    underneath = instead or {}
    found = {}
    for key, row in table.items():
        value = given[key] if key in given else underneath.get(key)
        found[key] = row.numbers(default(row, airframe) if value is None else value)
    return found


def blank(cls: type[T], **known: Any) -> T:
    """Params of which all but the known fields are NaN."""
    empty: Any = from_buffer(cls, np.full(size(cls), math.nan))
    value: T = empty._replace(**known)
    return value


def filled(params: T, rows: Iterable[Parameter], given: Mapping[str, Numbers]) -> T:
    """Params with the values of their rows."""
    for row in rows:
        if row.key and row.fields:
            plain = row._replace(convert=None) if row.leads else row
            params = plain.put(params, given[row.key])
    return params


def check(params: Any, rows: Iterable[Parameter]) -> None:
    """Raise ParameterError for Params whose values could not have been chosen.

    A number that went through a conversion and back may be off by its rounding.
    """
    seen = {row.name: (row, row.get(params)) for row in rows if row.key and row.fields}
    for row, numbers in seen.values():
        row.check(numbers, 1e-9)
        if row.below and not numbers < seen[row.below][1]:
            raise ParameterError(f"{row.name}: expected a value below {row.below}")
