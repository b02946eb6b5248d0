"""The wheel in an environment that has the dependencies of this one and nothing of the checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Bare:
    """A virtual environment, and a home folder that holds nothing but compiled code."""

    environment: Path
    home: Path
    wheel: Path

    @property
    def packages(self) -> Path:
        (found,) = self.environment.glob("lib/python*/site-packages")
        return found

    def variables(self) -> dict[str, str]:
        """Everything that a process in this environment gets: no PYTHONPATH, no settings of a user's."""
        return {
            "HOME": str(self.home), "LANG": "C.UTF-8", "PIP_NO_INDEX": "1",
            "PIP_DISABLE_PIP_VERSION_CHECK": "1",
            "PATH": f"{self.environment / 'bin'}:/usr/bin:/bin",
        }  # fmt: skip

    def run(self, folder: Path, *command: object) -> subprocess.CompletedProcess[str]:
        words = [str(word) for word in command]
        words[0] = str(self.environment / "bin" / words[0])
        return subprocess.run(
            words, cwd=folder, env=self.variables(), capture_output=True, text=True, timeout=PATIENCE_S,
            check=False,
        )  # fmt: skip


def environment(folder: Path) -> Path:
    """Make a virtual environment with what this one has installed beside our packages, pip among it."""
    make = [sys.executable, "-m", "venv", "--without-pip", folder]
    subprocess.run(make, check=True, capture_output=True, timeout=PATIENCE_S)
    (packages,) = folder.glob("lib/python*/site-packages")
    # a line of a .pth file is a folder, whose own .pth files (the checkout's is one) are not read
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder


def compiled() -> Path:
    """The folder of compiled code on this machine: what a CI service restores between jobs."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = Path(home) / "m-mrac"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a copy of the files that the checkout would commit."""
    folder = tmp_path_factory.mktemp("wheel")
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"], cwd=ROOT,
        check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file() and not name.startswith(("tests/", "docs/")):
            (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / "source" / name)
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-index",
         "--no-build-isolation", "--wheel-dir", folder, folder / "source"],
        check=True, timeout=PATIENCE_S,
    )  # fmt: skip
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="session")
def bare(tmp_path_factory: pytest.TempPathFactory, wheel: Path) -> Bare:
    folder = tmp_path_factory.mktemp("bare")
    (folder / "home" / ".cache").mkdir(parents=True)
    (folder / "home" / ".cache" / "m-mrac").symlink_to(compiled())
    made = Bare(environment(folder / "environment"), folder / "home", wheel)
    done = made.run(folder, "python", "-m", "pip", "install", "--quiet", wheel)
    assert done.returncode == 0, done.stderr
    return made
