"""A law of a user's own that ends the process it runs in: exit code 3, and a line that names its file."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from tests.patience import until
from tests.process.conftest import alive

pytestmark = pytest.mark.slow  # starts processes

HERE = Path(__file__).parent
CASCADE = (HERE / "plain_cascade.py").read_text()
STEP = "    limits, v, angles = params.limits, measured.v_E, euler(matrix(measured.q_EB))\n"
MISSION = """title = "A hover."
[flight]
duration_s = {duration}
setpoints = [[0.0, 0.0, 0.0, 0.0]]
"""


@pytest.fixture
def hover(tmp_path):
    """`hover(seconds)`: a mission's file."""

    def made(duration: float) -> Path:
        path = tmp_path / "hover.toml"
        path.write_text(MISSION.format(duration=duration))
        return path

    return made


def law(folder: Path, first: str = "", in_step: str = "") -> Path:
    """A law that flies, but for lines at its import or in its step."""
    assert STEP in CASCADE
    path = folder / "mine.py"
    path.write_text(first + CASCADE.replace(STEP, in_step + STEP))
    return path


@pytest.mark.parametrize(
    ("first", "how"),
    [
        ("import os\nos._exit(0)\n", "ended its process"),
        ("import ctypes\nctypes.string_at(0)\n", f"signal {signal.SIGSEGV.value}"),
    ],
)
def test_a_law_that_ends_the_process_at_its_import_is_named(start, tmp_path, hover, first, how):
    file = law(tmp_path, first)
    program = start("gcs_tools", "fly", hover(1.0), "--law", file, "--in-process", "--json")
    assert program.wait() == 3
    last = program.err.read_text().splitlines()[-1]
    assert last.startswith(f"Error: {file}: ")
    assert how in last


def test_a_law_that_writes_beyond_its_memory_is_named(start, tmp_path, hover):
    first = (
        "from llvmlite import ir\nfrom numba import types\nfrom numba.extending import intrinsic\n\n\n"
        "@intrinsic\ndef poke(context, value):\n"
        "    def made(context, builder, signature, arguments):\n"
        "        at = builder.inttoptr(arguments[0], ir.IntType(64).as_pointer())\n"
        "        builder.store(ir.Constant(ir.IntType(64), 1), at)\n"
        "        return context.get_dummy_value()\n"
        "    return types.void(types.int64), made\n\n\n"
    )
    file = law(tmp_path, first, "    if measured.r_E.x < 1e9:\n        poke(8)\n")
    program = start("gcs_tools", "fly", hover(1.0), "--law", file, "--in-process")
    assert program.wait() == 3
    last = program.err.read_text().splitlines()[-1]
    assert last.startswith(f"Error: {file}: ")
    assert f"signal {signal.SIGSEGV.value}" in last


def test_a_law_that_flies_keeps_its_exit_code_and_its_output(start, tmp_path, hover):
    file = law(tmp_path)
    program = start(
        "gcs_tools", "fly", hover(0.2), "--law", file, "--in-process", "--json", "--out",
        tmp_path / "run",
    )  # fmt: skip
    code = program.wait()
    assert code in (0, 1), program.text()
    [told] = json.loads(program.out.read_text())
    assert told["exit_code"] == code
    assert told["trajectory_sha256"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_reaches_the_flight_and_nothing_is_left(start, tmp_path, hover, number):
    program = start(
        "gcs_tools", "fly", hover(600.0), "--law", law(tmp_path), "--out", tmp_path / "run",
        "--speed", "1",
    )  # fmt: skip
    copy = until(lambda: _children(program.pid), "a copy")[0]
    until(lambda: len(_children(copy)) >= 2, "a flight")
    flight = _children(copy)
    program.signal(number)
    assert program.wait() == 130
    assert (tmp_path / "run" / "result.json").exists()
    until(lambda: not any(map(alive, (copy, *flight))), "an end of all")


def test_a_guardian_that_is_killed_leaves_nobody(start, tmp_path, hover):
    program = start(
        "gcs_tools", "fly", hover(600.0), "--law", law(tmp_path), "--out", tmp_path / "run",
        "--speed", "1",
    )  # fmt: skip
    copy = until(lambda: _children(program.pid), "a copy")[0]
    until(lambda: len(_children(copy)) >= 2, "a flight")
    flight = _children(copy)
    os.kill(program.pid, signal.SIGKILL)
    until(lambda: not any(map(alive, (copy, *flight))), "an end of all")


def _children(pid: int) -> list[int]:
    try:
        return [*map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())]
    except OSError:
        return []
