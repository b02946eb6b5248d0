"""The one decorator of kernels, and the cache of their compiled code.

`@kernel` is `numba.njit` with the project's flags: without the GIL, IEEE arithmetic (never
`fastmath`: the same text must give the same bits in plain Python, in a process and in a
campaign), and cached on disk by `cache`.

numba's own cache does not notice that a *called* function in another file changed, and trusts
whatever its files hold. The cache therefore lives in a folder named by the hash of every source
that takes part, and checks a file before it uses it. A law of a user's own has a folder beside
it, named by the hash of its sources too. So have the studies, which the wheel leaves out: a wheel and
the checkout that it was built from share a folder.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Callable, Iterator
from functools import cache as cache_of
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numba
from llvmlite import binding as ll

try:
    from numba.core.cpu import CPUTargetOptions as _Options
except ImportError:
    _Options = None

from fcu.kernel import cache
from fcu.kernel.buffers import builder, size
from fcu.kernel.cache import Cache, Folder

F = TypeVar("F", bound=Callable[..., Any])

_KERNEL = Path(__file__).resolve().parent
_ROOT = _KERNEL.parents[1]
_PACKAGES = ("fcu", "sitl_plant", "gcs_tools")
_STUDIES = "gcs_tools/studies/"  # of a checkout alone


def _sources() -> Iterator[tuple[str, bytes]]:
    """Path and text of every file of compiled code, or of the layout of a value that it works on.

    A file of kernels or of values imports fcu.kernel. A file that does not, but that a law is
    compiled with, begins with "Once a law".
    """
    for package in _PACKAGES:
        for folder, below, files in os.walk(_ROOT / package):
            below.sort()
            for name in sorted(files):
                if name.endswith(".py"):
                    path = os.path.join(folder, name)
                    with open(path, "rb") as file:
                        text = file.read()
                    values = b"fcu.kernel" in text and (b"@kernel" in text or b"NamedTuple" in text)
                    here = folder == str(_KERNEL) and name != "cache.py"  # which has a version
                    if values or here or text.startswith(b'"""Once a law'):
                        yield Path(path).relative_to(_ROOT).as_posix(), text


def _digest(start: str, folders: tuple[str, ...] = ()) -> str:
    digest = hashlib.sha256(start.encode())
    for name, text in _sources():
        if name.startswith(folders) if folders else not name.startswith(_STUDIES):
            digest.update(name.encode() + text)
    return digest.hexdigest()[:16]


def digest(*folders: str) -> str:
    """A hash of the sources below `folders` ("fcu/laws") that take part.

    If none is named, of all that the wheel holds.
    """
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


def kept(package: str = "fcu") -> int:
    """Count the kernels on disk, of our packages and of this one."""
    return sum(folder.count() for folder in {_folders["fcu"], _folders[package]})


def _of_studies(module: str) -> bool:
    """True for a module of the studies."""
    return f"{module.replace('.', '/')}/".startswith(_STUDIES)


@cache_of
def _folder_of_studies() -> Folder:
    return Folder(_HOME / f"{FINGERPRINT}-{digest(_STUDIES)}")


def _folder(module: str) -> Folder | None:
    """Folder in which the kernels of a module are cached. None if they are not."""
    if _of_studies(module):
        return _folder_of_studies()
    return _folders.get(module.partition(".")[0])


def _is_strange(kind: Any) -> bool:
    """Whether a type holds a NamedTuple that is declared outside our packages, or in a study."""
    if not isinstance(kind, numba.types.BaseTuple):
        return False
    if isinstance(kind, numba.types.BaseNamedTuple):
        module = kind.instance_class.__module__
        if module.partition(".")[0] not in _PACKAGES or _of_studies(module):
            return True
    return any(map(_is_strange, kind.types))


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


def _known(**flag: bool) -> dict[str, bool]:
    """Return an undocumented flag of numba, or nothing if this version does not have it."""
    (name,) = flag
    if hasattr(_Options, name):
        return flag
    lacks = "flags of the compiler" if _Options is None else name
    cache.tell_missing(AttributeError(f"no {lacks}"), "compiling or flying takes longer")
    return {}


def _known_cache(made: Any) -> bool:
    """Tell if numba asks the cache that a dispatcher is given."""
    known = hasattr(made, "_cache")
    if not known:
        cache.tell_missing(AttributeError("no cache of a dispatcher"), "every start compiles")
    return known


def kernel(function: F, makes_arrays: bool = False, inlined: bool = True) -> F:
    """Compile `function` on first call, with the project's flags.

    Cached on disk are the functions of modules of ours and of packages that are kept apart.
    `makes_arrays`: it allocates, or returns an array; one of a package that is kept apart may.
    `inlined`: into the kernels that call it; not, where that would be long to compile and save nothing.
    """
    package = function.__module__.partition(".")[0]
    # inlined, a kernel costs no copies of its NamedTuples: a flight runs 1.6 times as fast
    flags = {"nogil": True, "error_model": "numpy", **_known(forceinline=inlined)}
    # counting references to arrays costs a third of a tick
    flags |= _known(_nrt=makes_arrays or package not in _PACKAGES)
    from_file = not function.__code__.co_filename.startswith("<")
    folder = _folder(function.__module__) if from_file and function.__closure__ is None else None
    is_ours = package in _PACKAGES and not _of_studies(function.__module__)
    kind = _OurCache if is_ours else Cache

    def compiled(inner: bool) -> Any:
        made: Any = numba.njit(**flags, **_known(no_cpython_wrapper=inner))(function)
        if folder is not None and _known_cache(made):
            made._cache = kind(function, folder, inner)
        return made

    made: Any = compiled(False)
    # The code that takes arguments from Python is as long to compile as the kernel itself. Other
    # kernels call a second dispatcher of the same function, which is compiled without.
    inner = cache_of(partial(compiled, True))
    made.get_call_template = lambda args, kws: inner().get_call_template(args, kws)
    made.get_overload = lambda sig: inner().get_overload(sig)
    result: F = made
    return result


def compile_for(kernel: Any, *arguments: Any) -> None:
    """Compile a kernel for arguments of these types, or load it, without calling it."""
    kernel.compile(tuple(map(numba.typeof, arguments)))


def type_of(value: type) -> Any:
    """The type that numba gives to values of a NamedTuple class."""
    return numba.typeof(builder(value)((0.0,) * size(value)))


def compile_inner(kernel: Any, *types: Any) -> None:
    """Compile a kernel as other kernels call it, or load it."""
    kernel.get_call_template(types, {})
