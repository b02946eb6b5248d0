"""What is cached where: ours by our sources, a user's apart, so that neither spoils the other."""

from __future__ import annotations

import inspect
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fcu.interface.messages import Setpoint
from fcu.kernel import compile
from fcu.kernel.buffers import fields, is_value
from fcu.laws import loader
from fcu.vehicle.conditions import Due, Watch
from fcu.vehicle.plans import PlanLimits
from sitl_plant.physics.types import PlantRecord

ROOT = Path(__file__).parents[2]
LEVERS = """
from typing import NamedTuple
from fcu.kernel.algebra import select
from fcu.kernel.compile import kernel

class Lever(NamedTuple):
    arm: float

@kernel
def longer(a, b):
    return select(a.arm > b.arm, a, b)
"""
OURS = "from fcu.kernel.algebra import maximum; print(maximum(2.0, 1.0))"
THEIRS = """
from fcu.kernel.compile import keep_apart
keep_apart("levers", "0123")
from levers import Lever, longer
print(longer(Lever(2.0), Lever(1.0)).arm)
"""


CALLED_BOTH_WAYS = """
from fcu.kernel.algebra import Quat
from fcu.kernel.rotations import conjugate, normalised

q = Quat(0.1, 0.2, 0.3, 0.4)
print(*(x.hex() for x in normalised(q)), *(x.hex() for x in conjugate(q)))
assert normalised(q) == normalised.py_func(q)
"""


def _run(folder: Path, script: str) -> str:
    env = {**os.environ, "XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=env, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout


def _files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.slow
def test_a_value_of_a_users_leaves_our_cache_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "levers.py").write_text(LEVERS)
    assert _run(tmp_path, OURS) == "2.0\n"
    ours, *others = sorted((tmp_path / "cache" / "m-mrac").iterdir())
    before = _files(ours)
    assert before
    assert others == []
    assert _run(tmp_path, THEIRS) == "2.0\n"
    assert _files(ours) == before
    _, apart = sorted((tmp_path / "cache" / "m-mrac").iterdir())
    assert apart.name == f"{ours.name}-0123"
    assert any("longer" in name for name in _files(apart))


@pytest.mark.slow
def test_checkouts_of_one_version_share_what_is_compiled(tmp_path: Path) -> None:
    for checkout in ("one", "other"):
        shutil.copytree(ROOT / "fcu", tmp_path / checkout / "fcu")
    script = "import fcu; print(fcu.__path__[0]); " + OURS
    said, written = [], []
    for checkout in ("one", "other"):
        env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
        done = subprocess.run(
            [sys.executable, "-P", "-c", f"import sys; sys.path.insert(0, '.'); {script}"],
            cwd=tmp_path / checkout, env=env, capture_output=True, text=True, check=True,
        )  # fmt: skip
        said.append(done.stdout.split())
        written.append(_files(tmp_path / "cache"))
    assert [line[1] for line in said] == ["2.0", "2.0"]
    assert "other" in said[1][0]
    assert written[0]
    assert written[1] == written[0]


@pytest.mark.slow
def test_a_wheel_and_its_checkout_have_one_fingerprint(tmp_path: Path) -> None:
    """The wheel leaves the studies out, and an environment may be reached through a link."""
    (tmp_path / "link").symlink_to(tmp_path / "wheel")
    for package in compile._PACKAGES:
        ignored = shutil.ignore_patterns("__pycache__", "studies")
        shutil.copytree(ROOT / package, tmp_path / "wheel" / package, ignore=ignored)
    show = "import fcu.kernel.compile as c; print(c.__file__, c.FINGERPRINT, c.digest())"
    for folder in ("wheel", "link"):
        env = {**os.environ, "PYTHONPATH": str(tmp_path / folder)}
        done = subprocess.run(
            [sys.executable, "-P", "-c", show], env=env, capture_output=True, text=True, check=True
        )
        file, *told = done.stdout.split()
        assert file == str(tmp_path / folder / "fcu" / "kernel" / "compile.py")
        assert told == [compile.FINGERPRINT, compile.digest()]


def test_kernels_of_studies_have_a_folder_of_their_own() -> None:
    ours, studies = (
        compile._folder("gcs_tools.flight.vehicle_loop"),
        compile._folder("gcs_tools.studies.gains"),
    )
    assert ours is not None and studies is not None
    assert ours.path.name == compile.FINGERPRINT
    assert studies.path.name == f"{compile.FINGERPRINT}-{compile.digest('gcs_tools/studies/')}"
    assert compile._folder("gcs_tools.studies_of_mine") is ours
    assert compile._folder("somebody.elses") is None


@pytest.mark.slow
def test_a_kernel_is_compiled_for_calls_from_python_only_where_python_calls_it(
    tmp_path: Path,
) -> None:
    said = _run(tmp_path, CALLED_BOTH_WAYS)
    assert _run(tmp_path, CALLED_BOTH_WAYS) == said
    (folder,) = (tmp_path / "cache" / "m-mrac").iterdir()
    names = sorted(
        file.rpartition("-")[0].rpartition(".")[2]
        for file in _files(folder)
        if file.endswith(".kernel")
    )
    assert names == ["conjugate", "normalised"]
    assert any(file.endswith(".inner") for file in _files(folder))


def nested(kind: type) -> set[type]:
    """A NamedTuple, and all that its fields hold."""
    inside = (of for of in fields(kind).values() if is_value(of))
    return {kind}.union(*map(nested, inside))


def test_every_value_that_a_tick_works_on_is_declared_in_a_file_that_the_cache_is_named_by() -> (
    None
):
    kinds = {PlantRecord, Watch, Due, PlanLimits, Setpoint}
    for name in loader.SHIPPED:
        law = loader.load(name)
        kinds |= {law.ticks.Tick, law.ticks.Remembered, law.settings.Settings}
    hashed = {ROOT / name for name, _ in compile._sources()}
    for kind in set().union(*map(nested, kinds)):
        file = inspect.getsourcefile(sys.modules[kind.__module__])
        assert file is not None and Path(file) in hashed, kind
    assert ROOT / "fcu" / "process" / "flown.py" in hashed


def test_a_hash_of_sources_has_16_digits_and_tells_folders_apart() -> None:
    """The folder of the cache, and what a recording says of its law, are named by it."""
    hashes = [compile.FINGERPRINT, compile.digest(), compile.digest("fcu/laws")]
    assert all(re.fullmatch("[0-9a-f]{16}", each) for each in hashes)
    assert len(set(hashes)) == 3
