"""Compiled code on disk: one file a kernel and its types, checked whole before it is used.

A file that is damaged, or that another user could have written, is never unpickled nor handed to
LLVM: its kernel is compiled anew, and standard error is told. So it is where nothing can be
written. What can go wrong with the cache costs time, never a flight.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from llvmlite import binding as ll
from numba import types

try:  # names that numba may change: without them nothing is kept
    from numba.core.compiler import CompileResult
    from numba.core.runtime import _nrt_python
    from numba.core.serialize import dumps
except ImportError as missing:
    _missing: Exception | None = missing
else:
    _missing = None

_SUFFIX, _INNER = ".kernel", ".inner"  # called from Python, by other kernels
_START = b"m-mrac kernel 2\n"
_DIGEST = hashlib.sha256().digest_size
_LENGTH = 8  # of the length of what comes first, bytes
_NO_CODE = ll.parse_assembly("").as_bitcode()
_FOLDER = re.compile(r"[0-9a-f]{16}(-\w+)?")  # as compile.py names them

# Folders of versions that are not used: kept are so many, for so long, and all used just now.
KEPT, KEPT_S, JUST_NOW_S = 32, 30 * 86400.0, 3600.0

COMPILING = "compiling, once for this version (up to a minute)"
_told: set[str] = set()
watchers: list[Callable[[], None]] = []  # called whenever a kernel was compiled


def _tell(text: str) -> None:
    """One line on standard error, once a process; never fails."""
    if text in _told:
        return
    _told.add(text)
    with contextlib.suppress(OSError, ValueError, AttributeError):  # closed, or none
        sys.stderr.write(f"m-mrac: {text}\n")
        sys.stderr.flush()


class Folder:
    """A folder of compiled code, made when the first is written. Nothing here raises OSError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._writable = True  # until it proves not to be
        self._used = False
        self._checked: bool | None = None

    def holds(self, name: str, told: bool = True) -> bool:
        """Whether there are files of a kernel of this name, all whole; tells of those that are not.

        told : if there are none, the user is told that they are compiled, and not once more by us.
        """
        found = []
        with contextlib.suppress(OSError):
            for file in sorted(os.listdir(self.path)):
                kernel, _, rest = file.rpartition("-")
                if rest.endswith(_SUFFIX) and f".{kernel}".endswith(f".{name}"):
                    found.append(file)
        held = bool(found) and None not in [self.read(file) for file in found]
        if not held and told:
            _told.add(COMPILING)
        return held

    def count(self) -> int:
        """Count the kernels that have a file."""
        with contextlib.suppress(OSError):
            return sum(file.endswith((_SUFFIX, _INNER)) for file in os.listdir(self.path))
        return 0

    def read(self, name: str) -> bytes | None:
        """What was written as `name`, or None if it is not there, whole and ours."""
        if not self._is_ours():
            return None
        path = self.path / name
        try:
            data = _read(path)
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            _tell(f"{path}: {error.strerror or error}; compiling it anew")
            return None
        head = len(_START) + _DIGEST
        expected = self._digest(name, memoryview(data)[head:])
        if data[: len(_START)] != _START or data[len(_START) : head] != expected:
            self.damaged(name)
            return None
        if not self._used:
            self._used = True
            with contextlib.suppress(OSError):  # of somebody who may only read
                os.utime(self.path)
        return data[head:]

    def damaged(self, name: str) -> None:
        """Tell of a file that cannot be used."""
        _tell(f"{self.path / name}: damaged; compiling it anew")
        _told.add(COMPILING)

    def write(self, name: str, data: bytes) -> None:
        """Keep `data` under `name`: all of it, or nothing. Once that has failed it is not tried again."""
        if not self._writable or not self._is_ours():
            return
        digest = self._digest(name, data)
        try:
            if not self.path.is_dir():
                for path in (self.path.parent, self.path):
                    path.mkdir(mode=0o700, parents=True, exist_ok=True)
                _clean(self.path.parent)
            file, made = tempfile.mkstemp(prefix=".new-", dir=self.path)
            try:
                with open(file, "wb") as f:
                    f.write(_START + digest + data)
                os.replace(made, self.path / name)
            except OSError:
                os.unlink(made)
                raise
        except OSError as error:
            self._writable = False
            _tell(
                f"{self.path}: {error.strerror or error}: compiled code is not kept for the next start"
            )

    def _digest(self, name: str, data: bytes | memoryview) -> bytes:
        """The digest of a file: of its folder, too, whose name is the version that it was compiled by."""
        digest = hashlib.sha256(f"{self.path.name}/{name}\n".encode())
        digest.update(data)
        return digest.digest()

    def _is_ours(self) -> bool:
        """Whether nobody else can have written here. What is not there yet is ours."""
        if self._checked is None:
            try:
                here, above = os.stat(self.path), os.stat(self.path.parent)
            except OSError:
                return True
            # whoever may write above may put another folder in its place
            self._checked = _is_own(here) and _is_own(above)
            if not self._checked:
                _tell(
                    f"{self.path}: belongs to another user, or others may write there: not used, so"
                    " every start compiles (set XDG_CACHE_HOME to a folder of your own)"
                )
        return self._checked


def _is_own(status: os.stat_result) -> bool:
    if not hasattr(os, "geteuid"):
        return True
    return status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _read(path: Path) -> bytes:
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    with open(path, "rb", opener=lambda name, _: os.open(name, flags)) as file:
        if not _is_own(os.fstat(file.fileno())):
            raise PermissionError(0, "belongs to another user, or others may write it")
        return file.read()


def _clean(home: Path) -> None:
    """Delete the folders of versions that have not been used for long, or of the many since.

    A process that is using one finds nothing more there, and compiles what it does not have yet.
    """
    now, found = time.time(), []
    with contextlib.suppress(OSError), os.scandir(home) as entries:
        for entry in entries:
            if _FOLDER.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False):
                found.append((now - entry.stat(follow_symlinks=False).st_mtime, entry.path))
    for n, (age_s, path) in enumerate(sorted(found)):
        if age_s > KEPT_S or (n >= KEPT and age_s > JUST_NOW_S):
            shutil.rmtree(path, ignore_errors=True)


def tell_missing(error: Exception, instead: str) -> None:
    """Tell that this version of numba lacks a name, and what that costs."""
    _tell(f"numba {numba.__version__}: {error}: {instead}")


class Cache:
    """What numba asks for the compiled code of one function, and gives it to."""

    def __init__(self, function: Callable[..., Any], folder: Folder, inner: bool = False) -> None:
        """`inner`: it is called by other kernels alone, never from Python."""
        self._function = function
        self._suffix = _INNER if inner else _SUFFIX
        self._folder = folder
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """The folder, for numba's statistics."""
        return str(self._folder.path)

    def enable(self) -> None:
        """Read and write, as at first."""
        self._enabled = True

    def disable(self) -> None:
        """Neither read nor write."""
        self._enabled = False

    def flush(self) -> None:
        """Nothing is kept here."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What is kept of the function for these types, or None: then numba compiles it."""
        if not self._enabled or _missing is not None:
            return None
        try:
            name = self._name(sig, target_context.codegen())
            data = self._folder.read(name)
            if data is not None:
                return _loaded(data, target_context)
        except AttributeError as error:
            _do_without(error)
        except Exception:  # whole, but not what this Python can unpickle
            self._folder.damaged(name)
        _tell(COMPILING)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what has been compiled."""
        if _missing is not None:
            _do_without(_missing)
        else:
            try:
                self._keep(sig, data)
            except AttributeError as error:
                _do_without(error)
        for watcher in watchers:
            watcher()

    def _keep(self, sig: Any, data: Any) -> None:
        if data.library.has_dynamic_globals or data.lifted:
            name = f"{self._function.__module__}.{self._function.__qualname__}"
            _tell(
                f"{name}: holds a pointer, a large array or Python objects: compiled at every start"
            )
        elif self._enabled:
            self._folder.write(self._name(sig, data.codegen), _kept(data))

    def _name(self, sig: Any, codegen: Any) -> str:
        code = hashlib.sha256(self._function.__code__.co_code).hexdigest()
        told = [*map(_spelled, sig), *map(str, codegen.magic_tuple()), code]
        digest = hashlib.sha256("\n".join(told).encode()).hexdigest()[:16]
        kernel = f"{self._function.__module__}.{self._function.__qualname__}"
        safe = re.sub(r"[^\w.]", "_", kernel)[-200:]
        return f"{safe}-{digest}{self._suffix}"


def _do_without(error: Exception) -> None:
    """Neither read nor write from now on: numba has changed a name."""
    global _missing
    _missing = error
    tell_missing(error, "compiled code is not kept, so every start compiles")


def _spelled(kind: Any) -> str:
    """A type by name; of NamedTuples with the module, for two classes may share a name."""
    if not isinstance(kind, types.BaseTuple):
        return str(kind)
    named = getattr(kind, "instance_class", tuple)
    return f"{named.__module__}.{named.__qualname__}({', '.join(map(_spelled, kind.types))})"


def _kept(result: Any) -> bytes:
    """A compile result as bytes: what it takes to call it, then the bitcode to inline it."""
    (name, kind, (code, bitcode)), *rest, environments = result._reduce()
    # those that hold nothing would have all that numba can compile imported with them
    rest.append(tuple(each for each in environments if each.consts))
    final, shared = result.library._final_module, result.library._get_module_for_linking()
    both = [[*module.functions, *module.global_variables] for module in (final, shared)]
    needed = [v.name for v in both[0] if v.is_declaration and not v.name.startswith("llvm.")]
    defined = [v.name for v in both[1] if not v.is_declaration]
    head = dumps((needed, defined, ((name, kind, (code, _NO_CODE)), *rest)))
    return b"".join((len(head).to_bytes(_LENGTH, "little"), head, bitcode))


def _loaded(data: bytes, target_context: Any) -> Any:
    """The compile result of `_kept`, ready to be called.

    numba's own cache first imports all that can be compiled (0.7 s), and parses the bitcode:
    that is put off until something is compiled.
    """
    end = _LENGTH + int.from_bytes(data[:_LENGTH], "little")
    needed, defined, reduced = pickle.loads(memoryview(data)[_LENGTH:end])
    for helper, address in _nrt_python.c_helpers.items():
        ll.add_symbol(helper if helper.startswith("_") else f"NRT_{helper}", address)
    engine = target_context.codegen()._engine
    if not all(engine.is_symbol_defined(name) or ll.address_of_symbol(name) for name in needed):
        target_context.refresh()  # whatever it is that LLVM would end the process for
    engine._defined_symbols.update(defined)
    result = CompileResult._rebuild(target_context, *reduced)
    _link_later(result.library, data[end:])
    return result


def _link_later(library: Any, bitcode: bytes) -> None:
    """Parse the module of a library that was loaded once another library links it."""

    def parsed() -> Any:
        library._shared_module = ll.parse_bitcode(bitcode)
        del library._get_module_for_linking  # its class's returns that from now on
        return library._shared_module

    library._shared_module, library._get_module_for_linking = None, parsed
