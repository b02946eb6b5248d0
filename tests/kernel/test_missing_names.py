"""A version of numba that lacks a name that we use: it costs time, and never a flight."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

# hides a name of numba's from our modules, then calls a kernel that calls another
HIDDEN = """
import builtins, importlib, sys

module, _, name = sys.argv[1].partition(":")
owner, _, attribute = name.partition(".")
real = builtins.__import__

def hiding(asked, globals=None, locals=None, fromlist=(), level=0):
    ours = (globals or {}).get("__name__", "").startswith("fcu.")
    if ours and asked == module and owner in (fromlist or ()):
        raise ImportError(f"cannot import name {owner!r}")
    return real(asked, globals, locals, fromlist, level)

if attribute:
    classes = getattr(importlib.import_module(module), owner).__mro__
    delattr(next(kind for kind in classes if attribute in vars(kind)), attribute)
elif module:
    builtins.__import__ = hiding

from fcu.kernel.algebra import Quat
from fcu.kernel.lanes import Lanes
from fcu.kernel.rotations import normalised

print(*(x.hex() for x in normalised(Quat(0.1, 0.2, 0.3, 0.4))))
try:
    Lanes(4)
except NotImplementedError:
    print("no lanes")
"""
CACHE = [
    "numba.core.compiler:CompileResult", "numba.core.compiler:CompileResult._reduce",
    "numba.core.compiler:CompileResult._rebuild", "numba.core.runtime:_nrt_python",
    "numba.core.serialize:dumps",
]  # fmt: skip
# but for no_cpython_wrapper, without which numba compiles nothing of its own
FLAGS = [
    "numba.core.cpu:CPUTargetOptions", "numba.core.cpu:CPUTargetOptions.forceinline",
    "numba.core.cpu:CPUTargetOptions._nrt",
]  # fmt: skip
LANES = [
    "numba.core:cgutils", "numba.core.imputils:lower_builtin", "numba.core.imputils:lower_cast",
    "numba.core.typeconv:Conversion", "numba.core.types:BaseNamedTuple",
    "numba.core.typing.templates:AbstractTemplate", "numba.core.typing.templates:infer_global",
]  # fmt: skip


def _run(folder: Path, hidden: str) -> tuple[list[str], list[str]]:
    """Lines on standard output, and on standard error without that which tells of compiling."""
    done = subprocess.run(
        [sys.executable, "-c", HIDDEN, hidden],
        env={**os.environ, "XDG_CACHE_HOME": str(folder)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines(), [x for x in done.stderr.splitlines() if "numba" in x]


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A cache that holds all, and what is printed without anything hidden."""
    folder = tmp_path_factory.mktemp("cache")
    said, told = _run(folder, "")
    assert told == []
    return folder, said


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [*CACHE, *FLAGS])
def test_without_a_name_the_same_is_computed_and_told_once(filled, tmp_path, hidden):
    folder, said = filled
    unneeded = {"_reduce": folder, "_rebuild": tmp_path}.get(hidden.rpartition(".")[2])
    for cache in (folder, tmp_path):  # all is there, and nothing
        again, told = _run(cache, hidden)
        assert again == said
        assert len(told) == (cache != unneeded)
    kept = list(tmp_path.rglob("*.kernel"))
    assert bool(kept) == (hidden in FLAGS or hidden.endswith("_rebuild"))


@pytest.mark.slow
@pytest.mark.parametrize("hidden", LANES)
def test_without_a_name_that_lanes_need_there_are_no_lanes(filled, hidden):
    folder, said = filled
    again, told = _run(folder, hidden)
    assert again == [*said, "no lanes"]
    assert len(told) == 1
