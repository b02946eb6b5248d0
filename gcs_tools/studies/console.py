"""A MAVProxy session on a vehicle of ours, as a person types it: `make console` writes it down.

MAVProxy runs on a pseudo-terminal; what it prints is what goes into the file, less its colours.
"""

from __future__ import annotations

import os
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import click

from fcu.interface.ports import ports

PATIENCE_S = 60.0  # wall: until something that must come has come
QUIET_S = 0.7  # wall: nothing printed for so long, the answer to a command is whole
_CODES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\x1b[=>()][A-Z0-9]?|\r|\x07|\x08")

# What is typed, and what must have been printed before the next line is. Modes are set by `long`:
# MAVProxy's own `mode` fails on every vehicle of PX4's kind (it hands on a tuple).
FLIGHT: tuple[tuple[str, str], ...] = (
    ("param show MR_GAMMA", r"MR_GAMMA +[1-9]\d+"),
    ("param show MPC_XY_CRUISE", r"MPC_XY_CRUISE +5"),
    ("param set MPC_XY_CRUISE 4", r"(?s)param set.*> "),
    ("param set MR_GAMMA -1", r"MR_GAMMA -1 refused"),
    ("arm throttle", r"ARMED"),
    ("takeoff 5", r"Takeoff complete"),
    ("guided 47.397830 8.545730 8", r"Flying \d+ m"),
    ("long DO_SET_MODE 1 3", r"Mode POSCTL"),
    ("status LOCAL_POSITION_NED", r"LOCAL_POSITION_NED \{"),
    ("status WIND_COV", r"WIND_COV \{"),
    ("long DO_SET_MODE 1 4 12", r"Mode Figure eight"),
    ("pause", r"Mode Hold"),
    ("disarm", r"Disarming denied"),
    ("long NAV_RETURN_TO_LAUNCH", r"Return complete"),
    ("", r"DISARMED"),
)


class Console:
    """MAVProxy on a pseudo-terminal, and all it has printed."""

    def __init__(self, master: str, folder: Path) -> None:
        """`master`: what it connects to. `folder`: where it leaves its logs."""
        import pty

        self.text = ""
        self._at = 0  # of what has been looked at
        self._fd, child = pty.openpty()
        program = shutil.which("mavproxy.py", path=str(Path(sys.executable).parent))
        if program is None:
            raise FileNotFoundError("mavproxy.py is not installed beside this Python")
        self._process = subprocess.Popen(
            [sys.executable, program, "--master", master],
            cwd=folder, stdin=child, stdout=child, stderr=child, start_new_session=True,
            env={**os.environ, "TERM": "dumb", "HOME": str(folder), "COLUMNS": "100"},
        )  # fmt: skip
        os.close(child)

    def read(self, timeout_s: float) -> bool:
        """Take what has been printed; False if nothing was within the time."""
        if not select.select([self._fd], [], [], timeout_s)[0]:
            return False
        try:
            raw = os.read(self._fd, 65536)
        except OSError:
            raw = b""
        self.text += _CODES.sub("", raw.decode(errors="replace"))
        return bool(raw)

    def expect(self, pattern: str) -> str:
        """Wait until something is printed that was not looked at yet. Raises TimeoutError."""
        until = time.monotonic() + PATIENCE_S
        while (found := re.search(pattern, self.text[self._at :])) is None:
            if time.monotonic() > until:
                raise TimeoutError(f"not printed: {pattern}\n{self.text[self._at :]}")
            self.read(0.1)
        self._at += found.end()
        return found.group(0)

    def type(self, line: str) -> None:
        """A line, and Return."""
        os.write(self._fd, line.encode() + b"\n")

    def settle(self) -> None:
        """Until nothing has been printed for a while."""
        while self.read(QUIET_S):
            pass

    def close(self) -> None:
        """End it for certain: it ignores being asked to."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._fd)


def session(master: str, folder: Path, fly: Callable[[Console], None]) -> str:
    """What MAVProxy printed from its start to the end of `fly`."""
    console = Console(master, folder)
    try:
        fly(console)
        return console.text
    finally:
        console.close()


def whole_flight(console: Console) -> None:
    """Connect, arm, take off, look around, return, land."""
    console.expect(r"Received \d+ parameters")
    console.settle()
    for line, printed in FLIGHT:
        if line:
            console.type(line)
        if printed:
            console.expect(printed)
        console.settle()


@click.command()
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path))
def main(out: Path) -> None:
    """Fly a vehicle by MAVProxy and write the session to OUT."""
    from gcs_tools.flight.processes import claimed

    with claimed(None) as instance:
        pass  # a free one; `gcs up` claims it for itself
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        vehicle = subprocess.Popen(
            [sys.executable, "-m", "gcs_tools", "up", "--instance", str(instance)],
            cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        try:
            assert vehicle.stdout is not None
            vehicle.stdout.readline()  # ready
            text = session(f"udpin:127.0.0.1:{ports(instance).station}", folder, whole_flight)
        finally:
            vehicle.send_signal(signal.SIGINT)
            vehicle.wait()
    out.write_text(text.replace(str(folder), ".") + "\n")
    click.echo(f"{out}: {len(text.splitlines())} lines", err=True)


if __name__ == "__main__":
    main()
