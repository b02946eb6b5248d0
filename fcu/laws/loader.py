"""A law found by its name, or in a user's FILE.py, with what is compiled around it.

How a law gets into the tick: README.md. `own_file.py` imports a user's FILE, and `seam.py` compiles
around whichever law.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

from numba.core.errors import NumbaError

from fcu.interface.files.input_file import plain
from fcu.interface.files.spelling import suggestion
from fcu.kernel import buffers, compile
from fcu.laws import own_file, parameters, seam, unguarded
from fcu.laws.allocation import RotorParams
from fcu.laws.face import Limits, SharedTick
from fcu.laws.own_file import LawError as LawError

DEFAULT = "mmrac"
# Name -> file of the laws that are here.
SHIPPED = {
    file.parent.name: file for file in sorted(Path(__file__).resolve().parent.glob("*/law.py"))
}

_VALUES = {
    "Params": "a NamedTuple of what the law is told",
    "State": "a NamedTuple of what it remembers from tick to tick",
    "Internals": "a NamedTuple of what it computes on the way, to be recorded",
}
_KERNELS = {
    "take_over": ("params", "setpoint", "measured"),
    "step": ("state", "params", "setpoint", "measured"),
    "idle": ("measured",),
}
_OPTIONAL = ("idle",)
LONGEST = 200  # characters of what numba says: types are written out in full
_GIVES = "(state, command, outputs, internals)"


@dataclass(frozen=True, eq=False)
class Law:
    """A law that has the face of one, and its sources as they were when it was loaded."""

    name: str
    digest: str  # of its sources: what is compiled of it depends on ours, and on numba, too
    package: str  # in which ours are compiled around it
    face: ModuleType
    file: Path | None = None  # of a user's own
    guard: ModuleType | None = None

    @property
    def source(self) -> str:
        """By what it is loaded, from wherever: its name, or the whole path of its FILE.py."""
        return self.name if self.file is None else str(self.file)

    @property
    def identity(self) -> str:
        """Its name and the hash of its sources: equal for what computes the same."""
        return f"{self.name} {self.digest}"

    @cached_property
    def ticks(self) -> Any:
        """fcu.process.tick around this law: `tick`, and the types Tick, Settings and Remembered."""
        return self.module("tick")

    @cached_property
    def settings(self) -> Any:
        """fcu.process.settings around this law: its table of parameters, and Settings from it."""
        return self.module("settings")

    def module(self, name: str) -> Any:
        """A module of `seam.ONCE_A_LAW` around this law."""
        return importlib.import_module(f"{self.package}.{name}")

    def is_cached(self, kernel: str = "tick_at", told: bool = True) -> bool:
        """Whether this kernel of its ticks is on disk already. `told` as of `compile.is_cached`."""
        root = self.package.partition(".")[0]
        return compile.is_cached(f"{self.package}.tick.{kernel}", root, told)

    def tells(self, name: str, kind: type) -> bool:
        """Whether the field `name` of a Tick (`state`, `guard`) is of this type."""
        return buffers.fields(self.ticks.Tick).get(name) is kind

    def check_compiles(self) -> None:
        """Compile the kernels of a user's own law, unless they are on disk already.

        Called before anything else is compiled, so that an error in the file is reported within
        seconds. Raises LawError.
        """
        if self.file is None or self.is_cached(told=False):
            return
        told = buffers.fields(SharedTick)
        kinds = self.face.State, self.face.Params, told["setpoint"], told["measured"]
        state, params, setpoint, measured = map(compile.type_of, kinds)
        with self.compiling():
            for name, given in {
                "step": (state, params, setpoint, measured),
                "take_over": (params, setpoint, measured),
                "idle": (measured,),
            }.items():
                if (kernel := getattr(self.face, name, None)) is not None:
                    compile.compile_inner(kernel, *given)
            self.ticks.compiled()  # what they return is compared there

    @contextmanager
    def compiling(self) -> Iterator[None]:
        """Around what compiles the law for the first time. Raises LawError if it does not."""
        try:
            yield
        except NumbaError as error:
            raise LawError(_told(error, self.file)) from error
        except TypeError as error:  # numba, of a NamedTuple built without one of its fields
            if self.file is None:
                raise
            raise LawError(_incomplete(error, self.file)) from error


def load(name: str | Path = DEFAULT, folder: Path | None = None) -> Law:
    """The law of a name, or of a FILE.py (if relative: to `folder`). Raises LawError."""
    if not str(name).isprintable():  # several lines of an error are kept, those of a name are not
        expected = "expected a name without control characters"
        raise LawError(f"{plain(str(name))}: no such law; {expected}")
    with _one_at_a_time:
        if str(name) in SHIPPED:
            return _shipped(str(name))
        if str(name).endswith(".py"):
            return _own((folder or Path()) / name)
    raise LawError(
        f"{name}: no such law{suggestion(name, SHIPPED)}; expected {', '.join(SHIPPED)}, or a file of your own, FILE.py"
    )


# Python 3.11 keeps the depth of a tree that is parsed for all threads: two at once raise SystemError.
_one_at_a_time = threading.RLock()


@cache
def _shipped(name: str) -> Law:
    face = importlib.import_module(f"fcu.laws.{name}.law")
    guard, package = _guard(face), seam.PLAIN
    if name != DEFAULT:  # around which they are compiled as they stand
        package = seam.bind(f"{seam.PLAIN}.{name}", face, guard or unguarded)
    return Law(name, compile.digest("fcu/laws", "fcu/guard"), package, face, guard=guard)


def _own(path: Path) -> Law:
    file, digest, name = own_file.found(path)
    if digest in _laws:
        return _laws[digest]
    face = own_file.imported(name, file, path)
    with _blamed(path):
        _check(face, path)
        guard = _guard(face)
        if guard is not None:
            _check_guard(guard, face, path)
        parameters.check_table(face)
    package = f"{name.partition('.')[0]}.{seam.PLAIN}"  # no module beside FILE is called fcu
    seam.bind(package, face, guard or unguarded)
    law = _laws[digest] = Law(file.stem, digest, package, face, file, guard)
    return law


_laws: dict[str, Law] = {}  # those of users' own that are loaded, by digest


def _guard(face: ModuleType) -> ModuleType | None:
    """The guard that a law names, if it does: the module, or its name."""
    guard: Any = getattr(face, "GUARD", None)
    if isinstance(guard, str):
        guard = importlib.import_module(guard)
    if guard is not None and not isinstance(guard, ModuleType):
        raise LawError(f"GUARD: expected a module, or its name; got {guard!r}")
    return guard


def _check_guard(guard: ModuleType, face: ModuleType, shown: Path) -> None:
    """Raise LawError for a guard that lacks a name, or a field of Params that it needs."""
    lacks = [name for name in unguarded.NAMES if not hasattr(guard, name)]
    if lacks:
        raise LawError(f"{shown}: GUARD: {guard.__name__} lacks {', '.join(lacks)}")
    needs = buffers.fields(getattr(guard, "LawParams", face.Params))
    if lacks := sorted(needs.keys() - buffers.fields(face.Params).keys()):
        raise LawError(f"{shown}: GUARD: {guard.__name__} needs Params.{', Params.'.join(lacks)}")


@contextmanager
def _blamed(path: Path) -> Iterator[None]:
    """Whatever goes wrong with a law while it is looked at is said of its file."""
    try:
        yield
    except ValueError as error:  # ours say what was expected
        said = str(error)
        raise LawError(said if said.startswith(str(path)) else f"{path}: {said}") from error
    except Exception as error:
        raise LawError(f"{path}: {type(error).__name__}: {error}") from error


# --- the face


def _check(face: ModuleType, shown: Path) -> None:
    """Raise LawError for a module that has not the face of a law."""
    for name, is_what in _VALUES.items():
        kind = getattr(face, name, None)
        if kind is None:
            raise LawError(f"{shown}: {name} is missing: expected {is_what}")
        line = _line(kind)
        if not buffers.is_value(kind):
            raise LawError(f"{shown}{line}: {name}: expected {is_what}")
        try:
            buffers.columns(kind)
        except (TypeError, NameError) as error:
            raise LawError(f"{shown}{line}: {name}: {error}") from error
    told = buffers.fields(face.Params)
    for name, kind in {"h": float, "limits": Limits, "rotors": RotorParams}.items():
        if told.get(name) is not kind:
            raise LawError(
                f"{shown}{_line(face.Params)}: Params: expected a field {name}: {kind.__name__}"
            )
    for name, takes in _KERNELS.items():
        kernel = getattr(face, name, None)
        if kernel is None and name in _OPTIONAL:
            continue
        gives = "(state, outputs, internals)" if name == "idle" else _GIVES
        expected = f"expected @kernel def {name}({', '.join(takes)}), which returns {gives}"
        if kernel is None:
            raise LawError(f"{shown}: {name} is missing: {expected}")
        function = getattr(kernel, "py_func", None)
        if function is None or len(inspect.signature(function).parameters) != len(takes):
            raise LawError(f"{shown}{_line(function or kernel)}: {name}: {expected}")


def _line(what: Any) -> str:
    """`:line` of a class or a function; nothing for anything else."""
    try:
        return f":{inspect.getsourcelines(what)[1]}"
    except (TypeError, OSError):
        return ""


def _incomplete(error: TypeError, file: Path) -> str:
    """Which NamedTuple was built without which field, and where in FILE such are built."""
    said = re.fullmatch(r"In '<class '[\w.]*?(\w+)'>':\s*(.*)", str(error), re.DOTALL)
    if said is None:
        return f"{file}: does not compile: {error}"
    calls = [node for node in ast.walk(ast.parse(file.read_bytes())) if isinstance(node, ast.Call)]
    lines = sorted(call.lineno for call in calls if getattr(call.func, "id", "") == said[1])
    at = f":{lines[0]}" if len(lines) == 1 else ""
    return f"{file}{at}: does not compile: {said[1]}: {said[2]}"


def _told(error: NumbaError, file: Path | None) -> str:
    """What numba says, without the pages around it: the user's line at fault, and the reason."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    reason = next(line for line in lines if not line.startswith("Failed in "))
    if reason.startswith("('"):  # parts of a sentence, about a value that numba has named
        reason = re.sub(r" for \$\S+: ", ": ", "".join(re.findall(r"'([^']*)'", reason)))
    reason = re.sub(r"\((float64|\w+\(float64).*", "", reason)[:LONGEST]
    at = [re.match(r'File "(.+)", line (\d+):', line) for line in lines]
    places = [(Path(found[1]).resolve(), found[2]) for found in at if found]
    own = [(path, line) for path, line in places if file and path.is_relative_to(file.parent)]
    if own:
        return f"{own[0][0]}:{own[0][1]}: does not compile: {reason}"
    gives = (
        "expected step and take_over both to return (State, RotorCommand, Outputs, Internals), and"
        " idle (State, Outputs, Internals): State and Internals of the file, the others of"
        " fcu.interface.messages and fcu.laws.face"
    )
    return f"{file}: does not compile: {reason}: {gives}"
