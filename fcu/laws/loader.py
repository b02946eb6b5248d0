"""A law found by its name, or in a user's FILE.py, and what of ours is compiled around it.

A FILE is imported as a package of its own, whose name holds the hash of its sources: FILE, and
every module beside it that it imports, found without running any of it. So a change of either is
a new law, two laws with helpers of one name do not meet, and a FILE may be called as it likes.

What is compiled around a law (one tick of it, a whole flight) is a module of ours that is written
against the law of the paper. For another law the same file is imported once more, with that law in
its place: a module on disk, which numba's cache serves at the second start. A closure over a law's
kernels, or a kernel that is given them, it would not.
"""

from __future__ import annotations

import ast
import builtins
import difflib
import hashlib
import importlib
import importlib.util
import inspect
import re
import sys
import threading
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from numba.core.errors import NumbaError

from fcu.interface import input_file
from fcu.kernel import buffers, compile
from fcu.laws.allocation import RotorParams
from fcu.laws.face import Limits

DEFAULT = "mmrac"
MOST_BYTES = input_file.MIB  # of a FILE
FACE = "fcu.laws.mmrac.law"  # of the default: what is around a law is written against it
# Name -> file of the laws that are here. But for the default each is loaded as a user's own is.
SHIPPED = {
    file.parent.name: file for file in sorted(Path(__file__).resolve().parent.glob("*/law.py"))
}
UNGUARDED = "fcu.laws.unguarded"
# Written against the law of the paper and its guard, and bound to whichever law is flown.
_LAW = ("fcu.laws.mmrac.law", "fcu.laws.mmrac.types")
_GUARD = ("fcu.guard.guard", "fcu.guard.parameters", "fcu.guard.types")
_OF_GUARD = (
    "GuardParams", "GuardState", "GuardInternals", "take_over", "before", "after", "idle",
    "PARAMETERS", "printed", "guard_params", "followed", "derived", "check",
)  # fmt: skip
_PARAMETERS = "fcu.laws.mmrac.parameters"  # in the place of which stands fcu.laws.built
_AROUND = ("fcu.settings", "fcu.tick", "fcu.laws.resting", "fcu.laws.built")

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


class LawError(ValueError):
    """A law that cannot be flown: file, line or name, and what was expected."""


@dataclass(frozen=True, eq=False)
class Law:
    """A law that has the face of one, and its sources as they were when it was loaded."""

    name: str
    digest: str  # of its sources: what is compiled of it depends on ours, and on numba, too
    package: str  # the root of its modules' names
    face: ModuleType
    file: Path | None = None  # of any but the default
    guard: ModuleType | None = None
    _instead: dict[str, str] = field(default_factory=dict)  # our module -> the same for this law

    @property
    def source(self) -> str:
        """By what it is loaded, from wherever: its name, or the whole path of its FILE.py."""
        return self.name if self.file in (None, SHIPPED.get(self.name)) else str(self.file)

    @property
    def identity(self) -> str:
        """Its name and the hash of its sources: equal for what computes the same."""
        return f"{self.name} {self.digest}"

    @cached_property
    def ticks(self) -> Any:
        """fcu.tick around this law: `tick`, and the types Tick, Settings and Remembered."""
        return self.module("fcu.tick")

    @cached_property
    def settings(self) -> Any:
        """fcu.settings around this law: its table of parameters, and Settings from it."""
        return self.module("fcu.settings")

    def tells(self, name: str, kind: type) -> bool:
        """Whether the field `name` of a Tick (`state`, `guard`) is of this type."""
        return buffers.fields(self.ticks.Tick).get(name) is kind

    def module(self, name: str) -> Any:
        """The module of ours called `name`, written for the law of the paper, around this law."""
        if self.file is None:
            return importlib.import_module(name)
        if name not in self._instead:
            self._instead[name] = _bind(name, self.package, self._instead)
        return importlib.import_module(self._instead[name])

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
    if str(name) == DEFAULT:
        return _default()
    if str(name) in SHIPPED:
        with _parsing:
            return _own(SHIPPED[str(name)], str(name))
    if not str(name).endswith(".py"):
        close = difflib.get_close_matches(str(name), SHIPPED, n=1)
        meant = f" (did you mean {close[0]}?)" if close else ""
        raise LawError(
            f"{name}: no such law{meant}; expected {', '.join(SHIPPED)}, or a file of your own, FILE.py"
        )
    with _parsing:
        return _own((folder or Path()) / name)


# Python 3.11 keeps the depth of a tree that is parsed for all threads: two at once raise SystemError.
_parsing = threading.RLock()


@cache
def _default() -> Law:
    face = importlib.import_module(FACE)
    return Law(DEFAULT, compile.digest("fcu/laws", "fcu/guard"), "fcu", face, guard=_guard(face))


def _own(path: Path, called: str = "") -> Law:
    try:
        file = path.resolve()
        if file.exists() and not file.is_file():
            raise LawError(f"{path}: expected a file")
    except (RuntimeError, ValueError) as error:  # links in a circle, a null character
        raise LawError(f"{path}: {error}") from error
    stem = re.sub(r"\W", "_", file.stem)  # a file may be called as it likes
    found = _sources(file, stem, path)
    digest = hashlib.sha256()
    for name, source in sorted(found.items()):
        digest.update(f"{name} {len(source)}\n".encode() + source)
    hashed = digest.hexdigest()[:16]
    package = f"own_law_{hashed}"
    if package not in sys.modules:
        root = ModuleType(package)
        root.__path__ = []  # a package, of which _Finder finds every part
        sys.modules[package] = root
        names = {name: f"{package}.{name}" for name in found if name != stem}
        _packages[package] = {
            f"{package}.{name}": _Source(_beside(file.parent, name) or file, text, names)
            for name, text in found.items()
        }
        compile.keep_apart(package, hashed)
    if package in _laws:
        return _laws[package]
    face = _imported(f"{package}.{stem}", file, path)
    with _blamed(path):
        _check(face, path)
        guard = _guard(face)
    if guard is not None and guard.__name__ not in _GUARD:
        lacks = [name for name in _OF_GUARD if not hasattr(guard, name)]
        if lacks:
            raise LawError(f"{path}: GUARD: {guard.__name__} lacks {', '.join(lacks)}")
    elif guard is not None:
        needs = buffers.fields(importlib.import_module(_LAW[1]).Params)
        if lacks := sorted(needs.keys() - buffers.fields(face.Params).keys()):
            raise LawError(
                f"{path}: GUARD: the guard of mmrac needs Params.{', Params.'.join(lacks)}"
            )
    instead = dict.fromkeys(_LAW, face.__name__)
    if guard is None or guard.__name__ not in _GUARD:
        instead.update(dict.fromkeys(_GUARD, UNGUARDED if guard is None else guard.__name__))
    instead.update({name: _bind(name, package, instead) for name in _AROUND})
    instead[_PARAMETERS] = instead["fcu.laws.built"]
    law = Law(called or file.stem, hashed, package, face, file, guard, instead)
    with _blamed(path):
        importlib.import_module(instead[_PARAMETERS]).check_table()
    if not hasattr(face, "idle"):
        face.idle = law.module("fcu.laws.resting").idle  # type: ignore[attr-defined]
    _laws[package] = law
    return law


_laws: dict[str, Law] = {}  # those of users' own that are loaded, by package


def _guard(face: ModuleType) -> ModuleType | None:
    """The guard that a law names, if it does: the module, or its name."""
    guard: Any = getattr(face, "GUARD", None)
    if isinstance(guard, str):
        guard = importlib.import_module(guard)
    if guard is not None and not isinstance(guard, ModuleType):
        raise LawError(f"GUARD: expected a module, or its name; got {guard!r}")
    return guard


def _bind(name: str, package: str, instead: Mapping[str, str]) -> str:
    """Have the module of ours called `name` found in a law's package too; its name there."""
    found = importlib.util.find_spec(name)
    assert found is not None and found.origin is not None
    file, own = Path(found.origin), f"{package}.around_{name.replace('.', '_')}"
    _packages[package][own] = _Source(file, file.read_bytes(), instead)
    return own


# --- what a FILE consists of


def _beside(folder: Path, name: str) -> Path | None:
    """The file of a module (dotted) in `folder`."""
    path = folder.joinpath(*name.split("."))
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


def _sources(file: Path, stem: str, shown: Path) -> dict[str, bytes]:
    """Module name -> text, of FILE and of what it imports from beside it. Raises LawError."""
    found: dict[str, bytes] = {}
    todo = {stem: file}
    while todo:
        name, path = todo.popitem()
        try:
            found[name] = input_file.content(path, MOST_BYTES)
            tree = ast.parse(found[name])
            _refuse_print(tree, shown if path == file else path)
        except OSError as error:
            raise LawError(f"{shown}: {error.strerror}") from error
        except SyntaxError as error:
            where = shown if path == file else path
            raise LawError(f"{where}:{error.lineno or 1}: {error.msg}") from error
        except (ValueError, RecursionError, MemoryError) as error:
            raise LawError(f"{shown}: expected Python ({error or type(error).__name__})") from error
        for wanted, line in _imports(tree, name, path.name == "__init__.py"):
            parts = wanted.split(".")
            for n in range(1, len(parts) + 1):
                part = ".".join(parts[:n])
                if part in found or (at := _beside(file.parent, part)) is None:
                    continue
                if n == 1 and _is_installed(part, at):
                    raise LawError(
                        f"{path}:{line}: import {part}: {at.name} beside it, or the installed"
                        f" {part}? Expected another name for the file"
                    )
                todo[part] = at
    return found


def _refuse_print(tree: ast.Module, shown: Path) -> None:
    """Raise LawError for a kernel that prints: what the cache keeps of it hangs at the next start."""
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        if "kernel" not in map(ast.unparse, function.decorator_list):
            continue
        for node in ast.walk(function):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "print":
                raise LawError(
                    f"{shown}:{node.lineno}: {function.name}: a kernel cannot print; put what you"
                    " want to see into Internals, which is recorded, plotted and published"
                )


def _imports(tree: ast.Module, name: str, is_package: bool) -> Iterator[tuple[str, int]]:
    """Every name that the module `name` may import, as seen from FILE's folder, and the line."""
    here = name.split(".") if is_package else name.split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = here[: len(here) - node.level + 1] if node.level else []
            start = ".".join([*base, *([node.module] if node.module else [])])
            if start:
                yield start, node.lineno
            for alias in node.names:
                yield (f"{start}.{alias.name}" if start else alias.name), node.lineno


def _is_installed(name: str, beside: Path) -> bool:
    """Whether a module of this name is found elsewhere than `beside`, too."""
    if name in sys.builtin_module_names or name in sys.stdlib_module_names:
        return True
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return False
    return spec is not None and Path(spec.origin or beside).resolve() != beside


# --- importing


@dataclass(frozen=True)
class _Source:
    """A file that is imported with other modules in the place of some."""

    file: Path
    text: bytes  # as it was hashed
    instead: Mapping[str, str]


_packages: dict[str, dict[str, _Source]] = {}  # package -> module -> what it is imported from


class _Finder:
    """Finds the modules of the packages that laws of users' own are."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        source = _packages.get(name.partition(".")[0], {}).get(name)
        if source is None:
            return None
        within: list[str] | None = [] if source.file.name == "__init__.py" else None
        return importlib.util.spec_from_file_location(
            name, source.file, loader=_Loader(source), submodule_search_locations=within
        )


class _Loader(Loader):
    """Runs a file with its imports replaced."""

    def __init__(self, source: _Source) -> None:
        self._source = source

    def create_module(self, spec: ModuleSpec) -> None:
        """As usual."""

    def exec_module(self, module: ModuleType) -> None:
        file = str(self._source.file)
        tree = _Instead(self._source.instead).visit(ast.parse(self._source.text))
        code = builtins.compile(ast.fix_missing_locations(tree), file, "exec", dont_inherit=True)
        exec(code, module.__dict__)


# First: a package's folder is searched by Python's own finder too, which replaces no imports, and
# takes bytecode for that of a file written again within a second.
sys.meta_path.insert(0, _Finder)


class _Instead(ast.NodeTransformer):
    """Imports of some modules as imports of others."""

    def __init__(self, instead: Mapping[str, str]) -> None:
        self._instead = instead

    def visit_Import(self, node: ast.Import) -> list[ast.stmt]:
        made: list[ast.stmt] = []
        for alias in node.names:
            root, dot, _ = alias.name.partition(".")
            to = self._instead.get(alias.name)
            if to is None:
                made.append(ast.Import([alias]))
            elif dot and not alias.asname:  # `import a.b` binds a
                made += [ast.Import([ast.alias(to, "_")]), *_import(self._instead[root], root)]
            else:
                made += _import(to, alias.asname or alias.name)
        return [ast.copy_location(each, node) for each in made]

    def visit_ImportFrom(self, node: ast.ImportFrom) -> list[ast.stmt]:
        if node.level or not node.module:
            return [node]
        made: list[ast.stmt] = []
        module = self._instead.get(node.module, node.module)
        for alias in node.names:
            to = self._instead.get(f"{node.module}.{alias.name}")
            if to is None:
                made.append(ast.ImportFrom(module, [alias], 0))
            else:
                made += _import(to, alias.asname or alias.name)
        return [ast.copy_location(each, node) for each in made]


def _import(module: str, name: str) -> list[ast.stmt]:
    return [ast.Import([ast.alias(module, name)])]


def _imported(name: str, file: Path, shown: Path) -> ModuleType:
    """The module; what goes wrong while it is imported, with the line of the user's at fault."""
    try:
        return importlib.import_module(name)
    except (Exception, SystemExit) as error:
        ours = [
            frame
            for frame in traceback.extract_tb(error.__traceback__)
            if Path(frame.filename).parent.is_relative_to(file.parent)
        ]
        at = f"{ours[-1].filename}:{ours[-1].lineno}" if ours else f"{shown}"
        raise LawError(f"{at}: {type(error).__name__}: {error}") from error


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
        f"expected step and take_over to return {_GIVES}, and idle (state, outputs, internals), of"
        " its own types"
    )
    return f"{file}: does not compile: {reason}: {gives}"
