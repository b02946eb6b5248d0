"""The one decorator through which everything compiled is compiled, and the cache of its code.

`@kernel` is `numba.njit` with the project's flags: without the GIL, IEEE arithmetic (never
`fastmath`: the same text must give the same bits in plain Python, in a process and in a
campaign), and cached on disk by `cache`.

numba's own cache does not notice that a *called* function in another file changed, and trusts
whatever its files hold. The cache therefore lives in a folder named by the hash of every source
that takes part, and checks a file before it uses it. A law of a user's own has a folder beside
it, named by the hash of its sources too.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.codegen import ll

from fcu.kernel import cache
from fcu.kernel.cache import Cache, Folder

F = TypeVar("F", bound=Callable[..., Any])

_KERNEL = Path(__file__).resolve().parent
_ROOT = _KERNEL.parents[1]
_PACKAGES = ("fcu", "sitl_plant", "gcs_tools")


def _sources() -> Iterator[tuple[str, bytes]]:
    """Path and text of every file of compiled code, or of the layout of a value that it works on."""
    for package in _PACKAGES:
        for folder, below, files in os.walk(_ROOT / package):
            below.sort()
            for path in (os.path.join(folder, name) for name in sorted(files)):
                if path.endswith(".py"):
                    with open(path, "rb") as file:
                        text = file.read()
                    values = b"fcu.kernel" in text and (b"@kernel" in text or b"NamedTuple" in text)
                    here = folder == str(_KERNEL) and path != cache.__file__  # which has a version
                    if values or here:
                        yield Path(path).relative_to(_ROOT).as_posix(), text


def _digest(start: str, folders: tuple[str, ...] = ()) -> str:
    digest = hashlib.sha256(start.encode())
    for name, text in _sources():
        if not folders or name.startswith(folders):
            digest.update(name.encode() + text)
    return digest.hexdigest()[:16]


def digest(*folders: str) -> str:
    """A hash of the sources below `folders` ("fcu/laws") that take part; of all if none is named."""
    return _digest("", folders)


def _machine() -> str:
    """The compiler, and the processor that it compiles for."""
    config = numba.config
    name = config.CPU_NAME or ll.get_host_cpu_name()
    features = config.CPU_FEATURES or ll.get_host_cpu_features().flatten()
    return f"{numba.__version__} {sys.version} {platform.machine()} {name} {features}"


FINGERPRINT = _digest(_machine())
_HOME = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "m-mrac"
_folders = dict.fromkeys(_PACKAGES, Folder(_HOME / FINGERPRINT))  # by package


def keep_apart(package: str, digest: str) -> None:
    """Cache the kernels of a package of a user's in a folder of their own, named by a digest."""
    _folders[package] = Folder(_HOME / f"{FINGERPRINT}-{digest}")


def is_cached(name: str, package: str = "fcu", told: bool = True) -> bool:
    """Whether whole compiled code for the kernel called `name` is on disk already.

    `name` may begin with as much of the module's as tells it from others ("tick.advance"). If not,
    whoever asks is expected to say that it compiles (`told`); else the compiler itself does.
    """
    return _folders[package].holds(name, told)


def _is_strange(kind: Any) -> bool:
    """Whether a type holds a NamedTuple that is declared outside our packages."""
    if not isinstance(kind, numba.types.BaseTuple):
        return False
    named = isinstance(kind, numba.types.BaseNamedTuple)
    strange = named and kind.instance_class.__module__.partition(".")[0] not in _PACKAGES
    return strange or any(map(_is_strange, kind.types))


class _OurCache(Cache):
    """The cache of a kernel of ours: of values that a user has declared it keeps nothing.

    The user's kernel that calls ours is cached whole, in its own folder.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """As of any kernel, where all types are ours."""
        return None if any(map(_is_strange, sig)) else super().load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """As of any kernel, where all types are ours."""
        if not any(map(_is_strange, sig)):
            super().save_overload(sig, data)


def kernel(function: F, makes_arrays: bool = False) -> F:
    """Compile `function` on first call, with the project's flags.

    Cached on disk are the functions of modules of ours and of packages that are kept apart.
    `makes_arrays`: it allocates, or returns an array; one of a package that is kept apart may.
    """
    package = function.__module__.partition(".")[0]
    # inlined, a kernel costs no copies of its NamedTuples: a flight runs 1.6 times as fast
    flags = {"nogil": True, "error_model": "numpy", "forceinline": True}
    # counting who holds an array costs a third of a tick
    flags["_nrt"] = makes_arrays or package not in _PACKAGES
    compiled: Any = numba.njit(**flags)(function)
    from_file = not function.__code__.co_filename.startswith("<")
    if package in _folders and from_file and function.__closure__ is None:
        kind = _OurCache if package in _PACKAGES else Cache
        compiled._cache = kind(function, _folders[package])
    made: F = compiled
    return made
