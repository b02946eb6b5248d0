"""The cache of compiled code: whatever happens to its files costs time, never a flight."""

from __future__ import annotations

import json
import os
import pickle
import random
import resource
import shutil
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import pytest

from fcu.kernel import cache, compile

LEVERS = """
from fcu.kernel import cache
from fcu.kernel.compile import is_cached, keep_apart, kernel

keep_apart("levers", "0123")

@kernel
def longer(a, b):
    return a if a > b else b
"""


def first(x: float, y: float) -> float:
    return x - 2.0 * y


def second(x: float, y: float) -> float:
    return x / y


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> cache.Folder:
    monkeypatch.setattr(cache, "_told", set())
    return cache.Folder(tmp_path / "cache" / "0123456789abcdef")


def _started(function: Callable[..., Any], folder: cache.Folder) -> Any:
    """The function as a process that has just started has it."""
    compiled: Any = numba.njit(function)
    compiled._cache = cache.Cache(function, cache.Folder(folder.path))
    return compiled


def _is_loaded(function: Callable[..., Any], folder: cache.Folder) -> bool:
    """Whether it gives what it should; whether without being compiled."""
    compiled = _started(function, folder)
    assert compiled(3.0, 4.0) == function(3.0, 4.0)
    hits = sum(compiled.stats.cache_hits.values())
    return bool(hits == 1)


def _files(folder: cache.Folder) -> list[Path]:
    return sorted(folder.path.iterdir())


def _told(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What standard error was told; from now on it is told everything again."""
    monkeypatch.setattr(cache, "_told", set())
    return capsys.readouterr().err.splitlines()


def test_a_second_start_compiles_nothing(
    folder: cache.Folder, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not folder.holds("first")  # who asks, tells
    assert not _is_loaded(first, folder)
    assert _told(capsys, monkeypatch) == []
    assert _is_loaded(first, folder)
    assert folder.holds("first")
    assert folder.holds(f"{__name__}.first")
    assert not folder.holds("irst")
    assert _told(capsys, monkeypatch) == []
    assert not _is_loaded(second, folder)  # nobody asked
    assert [line.split(",")[0] for line in _told(capsys, monkeypatch)] == ["m-mrac: compiling"]
    assert len(_files(folder)) == 2


def test_types_of_a_kernel_have_a_file_each(folder: cache.Folder) -> None:
    compiled = _started(first, folder)
    assert (compiled(3.0, 1.0), compiled(3, 1)) == (1.0, 1.0)
    assert len(_files(folder)) == 2
    assert _is_loaded(first, folder)


def _flip(data: bytes, at: int) -> bytes:
    return data[: at // 8] + bytes([data[at // 8] ^ 1 << at % 8]) + data[at // 8 + 1 :]


DAMAGES: dict[str, Callable[[bytes], list[bytes]]] = {
    "cut": lambda data: [data[:n] for n in (1, 15, 16, 47, 48, 55, 56, 1000, len(data) - 1)],
    "emptied": lambda data: [b""],
    "longer": lambda data: [data + b"\0"],
    "of zeros": lambda data: [bytes(len(data))],
    "flipped": lambda data: [_flip(data, random.Random(n).randrange(8 * len(data))) for n in range(25)],
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.computes
def test_a_damaged_file_is_told_of_and_made_anew(
    damage: str, folder: cache.Folder, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    for function in (first, second):
        _started(function, folder)(3.0, 4.0)
        path = next(p for p in _files(folder) if f".{function.__name__}-" in p.name)
        _told(capsys, monkeypatch)
        for data in DAMAGES[damage](path.read_bytes()):
            path.write_bytes(data)
            assert not folder.holds(function.__name__)
            assert not _is_loaded(function, folder)
            (line,) = _told(capsys, monkeypatch)
            assert f"{path}: damaged" in line
            assert _is_loaded(function, folder)
            assert _told(capsys, monkeypatch) == []


def test_a_file_in_the_place_of_another_is_damaged(folder: cache.Folder) -> None:
    for function in (first, second):
        _started(function, folder)(3.0, 4.0)
    one, other = _files(folder)
    shutil.copy(one, other)
    assert _is_loaded(first, folder)
    assert not _is_loaded(second, folder)


def test_what_is_damaged_is_not_unpickled(
    folder: cache.Folder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _started(first, folder)(3.0, 4.0)
    (path,) = _files(folder)
    trace = tmp_path / "unpickled"

    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (trace,))

    trap = pickle.dumps(Trap())
    data = len(trap).to_bytes(8, "little") + trap
    whole = path.read_bytes()
    path.write_bytes(whole[:48] + data)
    assert not _is_loaded(first, folder)
    assert not trace.exists()

    # nor what is whole, in a folder or a file that others may have written
    for mode in (0o770, 0o707):
        folder.path.chmod(0o700)
        cache.Folder(folder.path).write(path.name, data)
        folder.path.chmod(mode)
        assert not _is_loaded(first, folder)
        assert not folder.holds("first")
    folder.path.chmod(0o700)
    cache.Folder(folder.path).write(path.name, data)
    path.chmod(0o606)
    assert not _is_loaded(first, folder)
    cache.Folder(folder.path).write(path.name, data)
    owner = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    assert not _is_loaded(first, folder)
    assert not trace.exists()
    monkeypatch.undo()
    assert not _is_loaded(first, folder)  # it is a trap
    assert trace.exists()
    assert _is_loaded(first, folder)


def test_nobody_else_may_write_what_is_kept(folder: cache.Folder) -> None:
    before = os.umask(0)
    try:
        _started(first, folder)(3.0, 4.0)
    finally:
        os.umask(before)
    assert {stat.S_IMODE(p.stat().st_mode) for p in _files(folder)} == {0o600}
    assert stat.S_IMODE(folder.path.stat().st_mode) == 0o700
    assert _is_loaded(first, folder)


def test_kernels_compile_in_memory_where_nothing_can_be_written(
    folder: cache.Folder, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.path.parent.mkdir()
    folder.path.write_text("a file, in the place of the folder")
    compiled = _started(first, folder)
    assert compiled(3.0, 4.0) == -5.0
    assert compiled(3, 4) == -5.0
    assert not folder.holds("first")
    lines = _told(capsys, monkeypatch)
    assert [str(folder.path) in line for line in lines] == [False, True]  # it compiles, and why


def test_a_full_disk_leaves_nothing_half_written(
    folder: cache.Folder, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    _started(first, folder)(3.0, 4.0)
    _told(capsys, monkeypatch)
    before = _files(folder)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        assert not _is_loaded(second, folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert _files(folder) == before
    assert len(_told(capsys, monkeypatch)) == 2
    assert not _is_loaded(second, folder)
    assert _is_loaded(second, folder)


def test_a_folder_that_is_deleted_meanwhile_is_made_again(folder: cache.Folder) -> None:
    used = cache.Folder(folder.path)
    for function in (first, second):
        compiled: Any = numba.njit(function)
        compiled._cache = cache.Cache(function, used)
        assert compiled(3.0, 4.0) == function(3.0, 4.0)
        assert len(_files(folder)) == 1
        shutil.rmtree(folder.path)


def _aged(folder: Path, age_s: float) -> Path:
    folder.mkdir(parents=True)
    (folder / "a").touch()
    os.utime(folder, (time.time() - age_s,) * 2)
    return folder


def test_versions_that_are_not_used_are_deleted(folder: cache.Folder) -> None:
    home = folder.path.parent
    recent = [_aged(home / f"{n:016x}", n) for n in range(cache.KEPT + 3)]
    idle = [_aged(home / f"{n:016x}-{n:016x}", 2 * cache.JUST_NOW_S) for n in range(3)]
    old = _aged(home / f"{99:016x}", cache.KEPT_S + 60.0)
    others = [_aged(home / name, cache.KEPT_S + 60.0) for name in ("notes", "0123", "lost+found")]
    link = home / f"{100:016x}"
    link.symlink_to(others[0])
    _started(first, folder)(3.0, 4.0)
    assert {p.name for p in home.iterdir()} == {
        p.name for p in (folder.path, *recent, *others, link)
    }
    assert not any(p.exists() for p in (*idle, old))
    assert (others[0] / "a").exists()


def test_a_version_that_is_used_is_kept(folder: cache.Folder) -> None:
    _started(first, folder)(3.0, 4.0)
    os.utime(folder.path, (0.0, 0.0))
    assert _is_loaded(first, folder)
    assert time.time() - folder.path.stat().st_mtime < cache.KEPT_S


def _run(home: Path, script: str) -> subprocess.Popen[str]:
    env = {**os.environ, "XDG_CACHE_HOME": str(home / "cache"), "PYTHONPATH": str(home)}
    return subprocess.Popen(
        [sys.executable, "-c", script],
        env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.mark.slow
def test_two_cold_starts_at_once(tmp_path: Path) -> None:
    (tmp_path / "levers.py").write_text(LEVERS)
    script = "from levers import *; print(longer(2.0, 1.0), is_cached('longer', 'levers'))"
    both = [_run(tmp_path, script) for _ in range(2)]
    for process in both:
        said, told = process.communicate()
        assert (said, process.returncode) == ("2.0 True\n", 0)
        assert len(told.splitlines()) == 1
    names = [p.name for p in (tmp_path / "cache").rglob("*") if p.is_file()]
    assert len(names) == 1
    assert names[0].startswith("levers.longer-")


@pytest.mark.slow
def test_a_warm_start_imports_little_of_numba(tmp_path: Path) -> None:
    """Nothing of what numba can compile, which takes longer than all else of a start."""
    (tmp_path / "levers.py").write_text(LEVERS)
    script = (
        "import sys, numpy; from levers import *; a = numpy.ones(3);"
        "print(longer(a[0], 2.0), 'numba.np.arrayobj' in sys.modules)"
    )
    for imported in ("True", "False"):
        said, _ = _run(tmp_path, script).communicate()
        assert said == f"2.0 {imported}\n"


@pytest.mark.slow
def test_a_flight_from_damaged_code_is_the_same(tmp_path: Path) -> None:
    kept = Path(compile._folders["fcu"].path)
    copied = tmp_path / "cache" / "m-mrac" / kept.name
    kernels = ("sines.phases", "rotations.from_euler", "frames.yaw_enu_ned")

    def flown(out: str, cache_home: str | None) -> tuple[str, int]:
        """The hash of the trajectory, and of how many damaged files was told."""
        env = {**os.environ, **({"XDG_CACHE_HOME": cache_home} if cache_home else {})}
        done = subprocess.run(
            [sys.executable, "-m", "gcs_tools", "fly", "paper_nominal", "--in-process", "--json",
             "--set", "flight.duration_s=1", "--figure", "never", "--out", str(tmp_path / out)],
            env=env, capture_output=True, text=True,
        )  # fmt: skip
        (result,) = json.loads(done.stdout)
        return result["trajectory_sha256"], done.stderr.count(": damaged")

    whole, told = flown("whole", None)
    assert told == 0
    shutil.copytree(kept, copied)
    for path in (p for name in kernels for p in copied.glob(f"*.{name}-*")):
        path.write_bytes(_flip(path.read_bytes(), 100_000))
    assert flown("damaged", str(tmp_path / "cache")) == (whole, len(kernels))
    assert flown("mended", str(tmp_path / "cache")) == (whole, 0)


def test_code_of_another_version_is_compiled_anew_whatever_its_folder_is_called(
    folder: cache.Folder,
) -> None:
    _started(first, folder)(3.0, 4.0)
    assert _is_loaded(first, folder)
    renamed = folder.path.with_name("fedcba9876543210")
    folder.path.rename(renamed)
    assert not _is_loaded(first, cache.Folder(renamed))


@pytest.mark.parametrize("mode", [0o770, 0o707])
def test_a_folder_that_others_may_exchange_is_not_used(folder: cache.Folder, mode: int) -> None:
    _started(first, folder)(3.0, 4.0)
    folder.path.parent.chmod(mode)
    assert not _is_loaded(first, folder)
    folder.path.parent.chmod(0o700)
    assert _is_loaded(first, folder)
