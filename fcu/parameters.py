"""The vehicle's parameters: read, set, refused with a reason, saved.

A value is a float32, kept as the shortest decimal that is that float32 (0.3, not
0.30000001192...): what is saved and read again is the same to the bit. A parameter at its value
of the start leaves LawParams as it was handed over, to the bit.
"""

from __future__ import annotations

import math
import os
import re
import stat
import tempfile
import tomllib
from pathlib import Path

import numpy as np

from fcu.guard.stability import grounded, stable, unstable
from fcu.laws.mmrac.parameters import ParameterError, check
from fcu.laws.mmrac.types import LawParams
from fcu.parameters_law import DECIDES, LAW, PREDICTION, with_values
from fcu.parameters_table import BELOW, NOT_ABOVE, VEHICLE, Parameter

__all__ = ["Parameter", "Parameters", "ParamsFileError", "Refused"]

DOES_NOT_EXIST, OUT_OF_RANGE = "DOES_NOT_EXIST", "VALUE_OUT_OF_RANGE"
READ_ONLY, PERMISSION_DENIED = "READ_ONLY", "PERMISSION_DENIED"
RULE = (
    " (the loop has to be stable in hover, estimates right or 3 dB off:"
    ' fcu/laws/mmrac/README.md, "Which gains go together")'
)


class Refused(ValueError):
    """A parameter that was not set: `kind`, one of the four above, and the reason in words."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


class Unstable(Refused):
    """A value that was not set, since the loop would not be stable with it."""


class ParamsFileError(ValueError):
    """A file of parameters that cannot be flown: file, line, name and what was expected."""


def shortest(value: float) -> float:
    """The shortest decimal that rounds to the same float32; beyond float32, infinity."""
    with np.errstate(over="ignore"):
        return float(str(np.float32(value)))


def _number(value: float) -> str:
    return f"{value:.9g}"


def expected(p: Parameter) -> str:
    """What a parameter may be, in words."""
    if p.values is not None:
        return "one of " + ", ".join(_number(v) for v in p.values)
    return f"{_number(p.low)} to {_number(p.high)} {p.unit}".rstrip()


class Parameters:
    """Every parameter of one vehicle, and the law's parameters in force."""

    def __init__(self, law: LawParams, system_id: int, file: Path | None = None) -> None:
        """`file`: read now, if it is there; its folder must be. Raises ParamsFileError."""
        table = {p.name: p for p in (*VEHICLE, *(entry.parameter for entry in LAW.values()))}
        self.names: tuple[str, ...] = tuple(sorted(table))
        self._table = table
        self._indices = {name: i for i, name in enumerate(self.names)}
        self._start_law = law
        self._fixed = {"MAV_SYS_ID": float(system_id)}
        self._changed: dict[str, float] = {}  # what differs from the law and the defaults
        self.law = law  # in force
        # what starts unstable, or unable to hover, may fly on, for a study
        self._stable, self._able = not unstable(law), not grounded(law)
        self._values = self._all_values(self._changed)
        self.changed: tuple[str, ...] = ()  # by the last value that was set
        if file is not None:
            self._read(file)
        self._at_start = dict(self._changed)

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Place of a parameter in `names`. Raises KeyError."""
        return self._indices[name]

    def __getitem__(self, name: str) -> float:
        """The value in force. Raises KeyError."""
        return self._values[name]

    def info(self, name: str) -> Parameter:
        """What a parameter is. Raises KeyError."""
        return self._table[name]

    def set(self, name: str, value: float, armed: bool) -> bool:
        """Set a parameter; False if it had this value. Raises Refused, with nothing changed.

        `changed` then names all that changed: the prediction takes its bounds along.
        """
        p = self._table.get(name)
        if p is None:
            raise Refused(DOES_NOT_EXIST, f"{name}: no such parameter")
        value = shortest(value)
        if value == self._values[name]:
            return False
        if p.read_only:
            raise Refused(READ_ONLY, f"{name} is read only: {p.sentence}")
        self._in_range(p, value)
        if p.disarmed_only and armed:
            raise Refused(PERMISSION_DENIED, f"{name} can be set while disarmed only")
        before = self._values
        self._adopt({**self._changed, name: value}, f"{name} {_number(value)} refused: ")
        self.changed = tuple(n for n in self.names if self._values[n] != before[n])
        return True

    def reset(self) -> None:
        """Every parameter as it was at the start, after the file was read."""
        self._adopt(self._at_start, "")

    # --- what is in force

    def _base(self, name: str, changed: dict[str, float]) -> float:
        """The value that a parameter has while nobody sets it."""
        if name in LAW:
            prediction = {k: v for k, v in changed.items() if k == PREDICTION and k != name}
            return shortest(LAW[name].get(with_values(self._start_law, prediction)))
        return self._fixed.get(name, self._table[name].default)

    def _all_values(self, changed: dict[str, float]) -> dict[str, float]:
        return {name: changed.get(name, self._base(name, changed)) for name in self.names}

    @staticmethod
    def _in_range(p: Parameter, value: float) -> None:
        allowed = value in p.values if p.values is not None else p.low <= value <= p.high
        if not allowed:  # nor is what is not a number
            raise Refused(OUT_OF_RANGE, f"{p.name} {_number(value)} refused: {expected(p)}")

    def _adopt(self, wanted: dict[str, float], refused: str) -> None:
        """Put values in force that are in range each. Raises Refused if not so together."""
        changed = {k: v for k, v in wanted.items() if v != self._base(k, wanted)}
        values = self._all_values(changed)
        for low, high in (*BELOW, *NOT_ABOVE):
            strict = (low, high) in BELOW
            if values[low] < values[high] or (values[low] == values[high] and not strict):
                continue
            must = "must be below" if strict else "must not be above"
            at = f"{low} {_number(values[low])} {must} {high} {_number(values[high])}"
            raise Refused(OUT_OF_RANGE, refused + at)
        if _of_law(changed) != _of_law(self._changed):
            law = with_values(self._start_law, _of_law(changed))
            try:
                check(law)
            except ParameterError as error:
                raise Refused(OUT_OF_RANGE, f"{refused}{error}") from error
            why = grounded(law)
            if why and self._able:
                raise Refused(OUT_OF_RANGE, refused + why)
            channel = unstable(law)
            if channel and self._stable:
                raise Unstable(OUT_OF_RANGE, refused + self._why(channel, changed, values))
            self.law, self._stable, self._able = law, not channel, not why
        self._changed, self._values = changed, values

    def _why(self, channel: str, changed: dict[str, float], values: dict[str, float]) -> str:
        """Why a combination that is not stable is refused: the channel, with what, what would do."""
        new = [n for n in DECIDES[channel] if values[n] != self._values[n]]
        beside = [n for n in DECIDES[channel] if n not in new][:2]
        why = f"{channel} unstable with " + ", ".join(f"{n} {_number(values[n])}" for n in beside)
        if len(new) != 1:
            return why
        name = new[0]
        good, bad = self._values[name], values[name]
        for _ in range(5):  # halve the way, in ratio
            middle = float(f"{(good * bad) ** 0.5:.3g}")
            law = with_values(self._start_law, {**_of_law(changed), name: middle})
            fine = stable(law, channel) and not unstable(law)
            good, bad = (middle, bad) if fine else (good, middle)
        return f"{why}; {_number(good)} would do"

    # --- the file

    def text(self) -> str:
        """The file's text: TOML, a parameter a line, without those that are read only."""
        rows = []
        for p in (self._table[name] for name in self.names):
            if not p.read_only:
                of = f"{p.unit}: " if p.unit else ""
                rows.append(f"{p.name} = {self._values[p.name]!r}  # {of}{p.sentence}\n")
        return "".join(rows)

    def write(self, path: Path, text: str | None = None) -> None:
        """Write `text` (the text as of now) whole or not at all. Raises OSError.

        What a link points to is replaced, not the link; the file's mode is kept.
        """
        text = self.text() if text is None else text
        path = path.resolve()
        folder = path.parent
        mode = path.stat().st_mode & 0o777 if path.exists() else 0o644
        handle, name = tempfile.mkstemp(dir=folder, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                os.fchmod(handle, mode)
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            os.replace(name, path)
        except BaseException:
            os.unlink(name)
            raise
        if os.name == "posix":  # the name too must reach the disk
            at = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(at)
            finally:
                os.close(at)

    def _read(self, path: Path) -> None:
        try:
            if not path.parent.is_dir():
                raise ParamsFileError(f"{path}: there is no folder {path.parent}")
            if not stat.S_ISREG(path.stat().st_mode):
                raise ParamsFileError(f"{path}: not a file")
            text = path.read_text(encoding="utf-8")
            given = tomllib.loads(text)
        except FileNotFoundError:
            return
        except OSError as error:
            raise ParamsFileError(f"{path}: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise ParamsFileError(f"{path}: not UTF-8") from error
        except ParamsFileError:
            raise
        except (ValueError, RecursionError) as error:  # TOML's, of Python's limits too
            raise ParamsFileError(f"{path}: {error}") from error
        values: dict[str, float] = {}
        for name, value in given.items():
            where = f"{path}:{_line(text, name)}: {name}"
            p = self._table.get(name)
            if p is None:
                raise ParamsFileError(f"{where}: no such parameter")
            if p.read_only:
                raise ParamsFileError(f"{where}: read only: {p.sentence}")
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ParamsFileError(f"{where}: expected a number, {expected(p)}, got {value!r}")
            try:
                values[name] = shortest(value)
            except OverflowError:
                values[name] = math.inf
            try:
                self._in_range(p, values[name])
            except Refused as error:
                got = _number(values[name])
                raise ParamsFileError(f"{where}: expected {expected(p)}, got {got}") from error
        try:
            self._adopt(values, "")
        except Refused:
            name, why = self._one_too_many(values)
            where = f"{path}:{_line(text, name)}: {name} {_number(values[name])}"
            rule = RULE if isinstance(why, Unstable) else ""
            raise ParamsFileError(f"{where} refused: {why}{rule}") from why

    def _one_too_many(self, values: dict[str, float]) -> tuple[str, Refused]:
        """Of values that are refused together the one, in their order, after which they are; why."""
        name, so_far = "", dict[str, float]()
        why = Refused(OUT_OF_RANGE, "")
        for each, value in values.items():
            so_far[each] = value
            try:
                self._adopt(so_far, "")
                name = ""
            except Refused as refused:
                name, why = name or each, refused
        return name, why


def _of_law(values: dict[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if name in LAW}


def _line(text: str, name: str) -> int:
    """Number of the line that sets `name` (or 1, for a name written in an unusual way)."""
    found = re.search(rf"^[ \t]*[\"'\[]*{re.escape(name)}\b", text, re.MULTILINE)
    return 1 if found is None else text.count("\n", 0, found.start()) + 1
