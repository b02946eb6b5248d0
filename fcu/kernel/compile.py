"""The one decorator through which everything compiled is compiled.

`@kernel` is `numba.njit` with the project's flags: cached on disk, without the GIL,
IEEE arithmetic (never `fastmath`: the same text must give the same bits in plain
Python, in a process and in a campaign).

numba's own cache does not notice that a *called* function in another file changed.
The cache therefore lives in a folder named by the hash of every source that takes part.
A law of a user's own has a folder beside it, named by the hash of its sources too.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, UserProvidedCacheLocator

F = TypeVar("F", bound=Callable[..., Any])

_KERNEL = Path(__file__).resolve().parent
_ROOT = _KERNEL.parents[1]
_PACKAGES = ("fcu", "sitl_plant", "gcs_tools")


def _sources() -> list[Path]:
    """Every file that holds compiled code, or the layout of a value that it works on."""

    def takes_part(path: Path) -> bool:
        text = path.read_bytes()
        values = b"fcu.kernel" in text and (b"@kernel" in text or b"NamedTuple" in text)
        return values or path.parent == _KERNEL

    files = (p for name in _PACKAGES for p in sorted((_ROOT / name).rglob("*.py")))
    return [p for p in files if takes_part(p)]


def _digest(start: str, folders: tuple[str, ...] = ()) -> str:
    digest = hashlib.sha256(start.encode())
    for path in _sources():
        name = path.relative_to(_ROOT).as_posix()
        if not folders or name.startswith(folders):
            digest.update(name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def digest(*folders: str) -> str:
    """A hash of the sources below `folders` ("fcu/laws") that take part; of all if none is named."""
    return _digest("", folders)


def _cache_folder() -> Path | None:
    """The folder for this version of the sources, or None where none can be written."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = Path(home) / "m-mrac" / FINGERPRINT
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        warnings.warn(f"compiled kernels are not cached: {error}", RuntimeWarning, stacklevel=2)
        return None
    return folder


FINGERPRINT = _digest(f"{numba.__version__} {sys.version} {platform.machine()}")
CACHE_FOLDER = _cache_folder()

_apart: dict[str, Path | None] = {}  # folders of packages that are not ours


def keep_apart(package: str, digest: str) -> None:
    """Cache the kernels of a package of a user's in a folder of their own, named by a digest."""
    beside = CACHE_FOLDER
    _apart[package] = None if beside is None else beside.with_name(f"{beside.name}-{digest}")


def is_cached(name: str, package: str = "fcu") -> bool:
    """Whether compiled code for the kernel function called `name` is on disk already."""
    folder = _apart.get(package, CACHE_FOLDER)
    return folder is not None and any(folder.rglob(f"*.{name}-*.nbi"))


class _Locator(UserProvidedCacheLocator):  # type: ignore[misc]  # numba has no types
    """Places by the path in the project: checkouts of one version share what is compiled."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """A folder of the cache, for the kernels of one file."""
        return Path(py_file).resolve().parent.relative_to(_ROOT).as_posix().replace("/", ".")


class _OurImpl(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes: ClassVar = [_Locator]


class _OurCache(FunctionCache):  # type: ignore[misc]
    """The cache of a kernel of ours: of values that a user has declared it keeps nothing.

    Who reads an index has to be able to import every class in it; the user's kernel that calls
    ours is cached whole, in its own folder.
    """

    _impl_class = _OurImpl

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        return None if any(map(_is_strange, sig)) else super().load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        if not any(map(_is_strange, sig)):
            super().save_overload(sig, data)


def _is_strange(kind: Any) -> bool:
    """Whether a type holds a NamedTuple that is declared outside our packages."""
    if not isinstance(kind, numba.types.BaseTuple):
        return False
    named = isinstance(kind, numba.types.BaseNamedTuple)
    strange = named and kind.instance_class.__module__.partition(".")[0] not in _PACKAGES
    return strange or any(map(_is_strange, kind.types))


def kernel(function: F) -> F:
    """Compile `function` on first call, with the project's flags."""
    package = function.__module__.partition(".")[0]
    folder = _apart.get(package, CACHE_FOLDER)
    cached = folder is not None and not function.__code__.co_filename.startswith("<")
    if cached:
        numba.config.CACHE_DIR = str(folder)  # which numba reads when it decorates
    ours = cached and package in _PACKAGES
    # inlined, a kernel costs no copies of its NamedTuples: a rollout runs 1.6 times as fast
    flags = {"nogil": True, "error_model": "numpy", "forceinline": True}
    compiled: Any = numba.njit(cache=cached and not ours, **flags)(function)
    if ours:
        compiled._cache = _OurCache(function)
    made: F = compiled
    return made
