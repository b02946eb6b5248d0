"""A law in a user's FILE.py: what it consists of, and its import as a package of its own.

The package's name holds the hash of its sources: FILE, and every module beside it that it imports,
found without running any of it. So a change of either is a new law, two laws with helpers of one name
do not meet, and a FILE may be called as it likes.
"""

from __future__ import annotations

import ast
import builtins
import hashlib
import importlib
import importlib.util
import re
import sys
import traceback
from collections.abc import Iterator, Set
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from fcu.interface import foreign_code
from fcu.interface.files import input_file
from fcu.kernel import compile
from fcu.laws import seam

MOST_BYTES = input_file.MIB  # of a FILE
_ROOT = Path(__file__).resolve().parents[2]
_OURS = tuple(_ROOT / package for package in ("fcu", "gcs_tools", "sitl_plant"))


class LawError(input_file.PlainError):
    """A law that cannot be flown: file, line or name, and what was expected."""

    KEPT = "\n"


def found(path: Path) -> tuple[Path, str, str]:
    """The whole path of a FILE, the hash of its sources, and the name by which it is imported.

    Raises LawError.
    """
    try:
        file = path.resolve()
        if file.exists() and not file.is_file():
            raise LawError(f"{path}: expected a file")
    except (RuntimeError, ValueError) as error:  # links in a circle, a null character
        raise LawError(f"{path}: {error}") from error
    stem = re.sub(r"\W", "_", file.stem)  # a file may be called as it likes
    sources = _sources(file, stem, path)
    digest = hashlib.sha256()
    for name, source in sorted(sources.items()):
        digest.update(f"{name} {len(source)}\n".encode() + source)
    hashed = digest.hexdigest()[:16]
    package, beside = f"own_law_{hashed}", sources.keys() - {stem}
    if package not in sys.modules:
        seam.make(package)
        for name, text in sources.items():
            source_of = _beside(file.parent, name) or file
            seam.add(f"{package}.{name}", source_of, _Source(source_of, text, package, beside))
        compile.keep_apart(package, hashed)
    return file, hashed, f"{package}.{stem}"


class _Source(Loader):
    """Runs a module's text as it was hashed. What it imports from beside FILE is of the package."""

    def __init__(self, file: Path, text: bytes, package: str, beside: Set[str]) -> None:
        self._file, self._text, self._package, self._beside = file, text, package, beside

    def create_module(self, spec: ModuleSpec) -> None:
        """As usual."""

    def exec_module(self, module: ModuleType) -> None:
        code = builtins.compile(self._text, str(self._file), "exec", dont_inherit=True)
        module.__dict__["__builtins__"] = vars(builtins) | {"__import__": self._import}
        exec(code, module.__dict__)

    def _import(
        self, name: str, globals: Any = None, locals: Any = None, what: Any = (), level: int = 0
    ) -> Any:
        """The function that an import statement of the module calls."""
        if level or name not in self._beside:
            return __import__(name, globals, locals, what, level)
        found = __import__(f"{self._package}.{name}", globals, locals, what)
        # `import a.b` binds a
        return found if what else sys.modules[f"{self._package}.{name.partition('.')[0]}"]


def imported(name: str, file: Path, shown: Path) -> ModuleType:
    """The module; what goes wrong while it is imported, with the line of the user's at fault."""
    foreign_code.before_import(file)
    try:
        return importlib.import_module(name)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever it is, it ends the law, and not the program
        ours = [
            frame
            for frame in traceback.extract_tb(error.__traceback__)
            if Path(frame.filename).parent.is_relative_to(file.parent)
        ]
        at = f"{ours[-1].filename}:{ours[-1].lineno}" if ours else f"{shown}"
        raise LawError(f"{at}: {type(error).__name__}: {error}") from error


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
                if _is_ours(at):  # a FILE in a checkout has them beside it
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


def _is_ours(at: Path) -> bool:
    """True for a file of the packages that fly the law."""
    return any(at.resolve().is_relative_to(package) for package in _OURS)


def _is_installed(name: str, beside: Path) -> bool:
    """Whether a module of this name is found elsewhere than `beside`, too."""
    if name in sys.builtin_module_names or name in sys.stdlib_module_names:
        return True
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return False
    return spec is not None and Path(spec.origin or beside).resolve() != beside
