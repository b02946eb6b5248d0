"""Flights whose every datagram to ground stations and scripts is recorded, in lockstep.

Both processes are the product's own, on real sockets. The simulator's time is granted as `gcs fly` grants
it (`--control-fd`), a twentieth of a second at a time. Then the controller's wall clock (`clock.py`) is set
on as far, and what is due is sent. Pings from a port of their own tell when everything before was served.

    python -m tests.equality.ground_traffic NAME PYTHON CHECKOUT   in a network of its own (`alone.py`)
"""

from __future__ import annotations

import json
import mmap
import os
import select
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from tests.equality.ground_requests import (
    AUTO,
    FORCE_REBOOT,
    LATE,
    NAN,
    SCRIPT,
    STATION,
    Client,
    requests,
)

STEP_S, STEP_NS = 0.05, 50_000_000
TICKS = 25  # of a step, at 500 Hz
FLIGHTS = 1 << 40  # grants of the next flight, after a reset, begin there
PATIENCE_S = 300.0  # wall, on a machine that is busy
HOST = "127.0.0.1"
REBOOT, ACCEPTED, IN_PROGRESS = 246, 0, 5  # a command, and results of COMMAND_ACK
SOCKETS = {SCRIPT: 14540, STATION: 14550, LATE: 14999, "barrier": 14998}
VEHICLE = {SCRIPT: 14580, STATION: 18570, LATE: 18570}
UNTIL_S, AFTER_S = 33.0, 9.0  # the flight up to its reset, and a short one after it


class Flown(NamedTuple):
    """A vehicle, its law and how it is set."""

    airframe: str
    law: str
    seed: int
    settings: tuple[str, ...] = ()
    link_clock: str = "sim"


GUARD = {each: (f'law.guard="{each}"',) for each in ("govern", "refuse", "warn")}
GROUND_FLIGHTS = {
    "s1000-govern": Flown("s1000", "mmrac", 1, GUARD["govern"]),
    "s1000-refuse": Flown("s1000", "mmrac", 2, GUARD["refuse"], "both"),
    "s1000-warn": Flown("s1000", "mmrac", 3, GUARD["warn"]),
    "quad-govern": Flown("quad", "mmrac", 4, GUARD["govern"], "both"),
    "hexa-refuse": Flown("hexa", "mmrac", 5, GUARD["refuse"]),
    "x8-px4": Flown("x8", "px4", 6),
    "quad-se3": Flown("quad", "se3", 7),
    "s1000-indi": Flown("s1000", "indi", 8, (), "both"),
    "racer-l1": Flown("racer", "l1", 9),
    "s1000-plain_cascade": Flown("s1000", "{checkout}/tests/own_law/plain_cascade.py", 10),
}
MISSION = """title = "On the ground, in wind, with noise."
[flight]
duration_s = 0.1
ground_z_m = 0.0
start = { on_ground = true }
setpoints = [{ at_s = 0.0, position_m = [0.0, 0.0, 0.5] }]
[wind]
steady_m_s = [2.0, 1.0, 0.0]
amplitude_m_s = [1.0, 1.0, 0.5]
frequency_rad_s = [0.7, 0.9, 1.1]
[plant]
noise = { position_m = 0.005, velocity_m_s = 0.01, attitude_deg = 0.1, rate_rad_s = 0.005 }
"""


def prepared(flown: Flown, python: str, checkout: Path, folder: Path) -> list[str]:
    """Have `gcs fly` write settings and world of this vehicle to `folder`. The law and airframe as options."""
    (folder / "ground.toml").write_text(MISSION)
    law = flown.law.format(checkout=checkout)
    options = ["--law", law, "--airframe", flown.airframe]
    sets = [word for each in flown.settings for word in ("--set", each)]
    how = ["--out", "made", "--record", "none", "--figure", "never", "--seed", str(flown.seed)]
    done = subprocess.run(
        [python, "-m", "gcs_tools", "fly", "ground.toml", *options, *sets, *how], cwd=folder,
        stdin=subprocess.DEVNULL, capture_output=True, text=True,
    )  # fmt: skip
    if not (folder / "made/world.json").exists():
        raise RuntimeError(f"not prepared: {done.stdout}{done.stderr}")
    return options


class Process:
    """A process that announces itself as JSON, a line at a time, on standard output."""

    def __init__(self, words: list[str], log: Path, fds: tuple[int, ...] = ()) -> None:
        self.process = subprocess.Popen(
            words, cwd=log.parent, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=log.open("wb"), pass_fds=fds,
        )  # fmt: skip
        assert self.process.stdout is not None
        self.out = self.process.stdout
        os.set_blocking(self.out.fileno(), False)
        self._left = b""

    def said(self) -> list[dict[str, Any]]:
        """Return the announcements since the last call."""
        self._left += self.out.read() or b""
        *lines, self._left = self._left.split(b"\n")
        return [json.loads(line) for line in lines if line.startswith(b"{")]

    def stop(self) -> int:
        """End it. Its exit code."""
        if self.process.poll() is None:
            self.process.terminate()
        code = self.process.wait(PATIENCE_S)
        self.out.close()
        return code


class GroundFlight:
    """One vehicle, its clock, and what its ground ports have sent."""

    def __init__(
        self, stack: ExitStack, flown: Flown, python: str, checkout: Path, folder: Path
    ) -> None:
        options = prepared(flown, python, checkout, folder)  # before anybody listens
        self.lines: list[str] = []  # time, port, datagram as hex; > what was sent
        self._now_ns = 1_000_000_000
        self._flight, self._granted, self.has_ended = 0, 0, False
        self._sockets = {name: _bound(stack, port) for name, port in SOCKETS.items()}
        self._barrier = mavlink.MAVLink(None, srcSystem=77, srcComponent=1)
        clock = folder / "clock"
        clock.write_bytes(struct.pack("<q", self._now_ns))
        with clock.open("r+b") as file:
            self._clock = mmap.mmap(file.fileno(), 8)
        launcher = str(Path(__file__).with_name("clock.py"))
        life, self._life = os.pipe()  # the controller ends with this process
        self.fcu = Process(
            [python, launcher, str(clock), "fcu", "--instance", "0", *options, "--handover",
             "made/settings.json", "--link-clock", flown.link_clock, "--params", "saved.params",
             "--lifeline-fd", str(life)],
            folder / "fcu.log", (life,),
        )  # fmt: skip
        os.close(life)
        self._wait(lambda: self._has_come(SCRIPT), "the first heartbeat")
        self._rows, rows = os.pipe()
        grants, self._grants = os.pipe()
        self.plant = Process(
            [python, "-m", "sitl_plant", "--instance", "0", "--world", "made/world.json", "--speed", "max",
             "--stay", "--record-fd", str(rows), "--control-fd", str(grants)],
            folder / "plant.log", (rows, grants),
        )  # fmt: skip
        os.close(rows)
        os.close(grants)
        os.set_blocking(self._rows, False)
        self._row_bytes = self._bytes = 0
        stack.callback(self._end)
        first = len(self.lines)
        self._wait(
            lambda: self._has_come(SCRIPT, first) and self._has_come(STATION, first), "telemetry"
        )
        self._serve()
        self._grant(1)

    def _end(self) -> None:
        codes = self.fcu.stop(), self.plant.stop()
        self.lines.append(f"{self.elapsed_s:.2f} > exit codes of fcu and sitl_plant: {codes}")
        for fd in (self._grants, self._rows, self._life):
            os.close(fd)

    # --- time

    def step(self, datagrams: list[tuple[str, bytes]]) -> None:
        """Fly a twentieth of a second, hear what is due, and send these."""
        if not self.has_ended:
            self._grant(self._granted + TICKS)
        self._now_ns += STEP_NS
        self._clock[:] = struct.pack("<q", self._now_ns)
        self._serve()
        before = len(self.lines)
        for by, datagram in datagrams:
            self._sockets[by].sendto(datagram, (HOST, VEHICLE[by]))
            self._note(f"> {by}", datagram)
            self._pass()  # before the next one, whichever port that is for
        if datagrams:
            self._serve()
            self._wait(lambda: not self._is_in_progress(before), "the end of a command")
            self._serve()
            if (REBOOT, ACCEPTED) in _answers(self.lines[before:]):
                self._wait(self._is_reset, "a reset")
                self._serve()
                self._grant(1)

    @property
    def elapsed_s(self) -> float:
        """Since the first tick, s."""
        return round(1e-9 * self._now_ns - 1.0, 6)

    def _grant(self, ticks: int) -> None:
        """Let time run to this tick, and wait until it is flown, or the flight has ended."""
        before, more = self._bytes, ticks - self._granted
        os.write(self._grants, struct.pack("<q", self._flight * FLIGHTS + ticks))
        self._granted = ticks
        if not self._row_bytes:
            self._wait(lambda: self._read() > before, "the first row")
            self._row_bytes = self._bytes
        whole = before + more * self._row_bytes
        self._wait(lambda: self._read() >= whole or self._is_over(), "a row")
        if self._is_over():  # announced before the last rows
            seen = len(self.lines)
            self._wait(lambda: self._has_come(SCRIPT, seen), "how the flight has ended")
        self._pass()

    def _read(self) -> int:
        try:
            self._bytes += len(os.read(self._rows, 1 << 20))
        except BlockingIOError:
            pass
        return self._bytes

    def _is_over(self) -> bool:
        self.has_ended |= any("flight_ended" in said for said in self.plant.said())
        return self.has_ended

    def _is_in_progress(self, since: int) -> bool:
        """True while a command that takes its time, such as saving, is not done."""
        for name in (SCRIPT, STATION):
            self._has_come(name)
        results = dict(_answers(self.lines[since:]))  # the last of each
        return IN_PROGRESS in results.values()

    def _is_reset(self) -> bool:
        for said in self.plant.said():
            if "reset" in said:
                self._flight, self._granted, self.has_ended = said["reset"], 0, False
                return True
        return False

    # --- the ground

    def _serve(self) -> None:
        """Wait until the vehicle has served what was sent, and has sent what is due. Hear it.

        A ping is answered before what is due is sent, and the next one after it.
        """
        self._pass()
        self._pass()
        for name in (SCRIPT, STATION, LATE):
            self._has_come(name)

    def _pass(self) -> None:
        """Wait until the controller has come by: a ping is answered."""
        ping = mavlink.MAVLink_ping_message(0, self._barrier.seq, 0, 0).pack(self._barrier)
        self._barrier.seq = (self._barrier.seq + 1) % 256
        self._sockets["barrier"].sendto(ping, (HOST, VEHICLE[SCRIPT]))
        self._wait(self._is_answered, "the answer to a ping")

    def _is_answered(self) -> bool:
        try:
            self._sockets["barrier"].recv(4096)
        except BlockingIOError:
            return False
        return True

    def _has_come(self, name: str, since: int = 0) -> bool:
        """Take the datagrams of a port. True if there was any, now or since a line."""
        while True:
            try:
                datagram = self._sockets[name].recv(4096)
            except BlockingIOError:
                return any(f" {name} " in line for line in self.lines[since:])
            self._note(name, datagram)

    def _note(self, name: str, datagram: bytes) -> None:
        self.lines.append(f"{self.elapsed_s:.2f} {name} {datagram.hex()}")

    def _wait(self, done: Callable[[], Any], what: str) -> None:
        """Until something is so. Raises TimeoutError, and ChildProcessError if a process has ended."""
        until = time.monotonic() + PATIENCE_S
        while not done():
            if time.monotonic() > until:
                raise TimeoutError(f"waited {PATIENCE_S:.0f} s for {what}")
            for process in (self.fcu, getattr(self, "plant", None)):
                if process is not None and process.process.poll() is not None:
                    raise ChildProcessError(f"a process has ended, waiting for {what}")
            heard = [self._sockets["barrier"], self._sockets[SCRIPT], self.fcu.out]
            if hasattr(self, "plant"):
                heard += [self._rows, self.plant.out]
            select.select([each for each in heard if each is not self.fcu.out], [], [], 0.02)


def _bound(stack: ExitStack, port: int) -> socket.socket:
    bound = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
    bound.bind((HOST, port))
    bound.setblocking(False)
    return bound


def _answers(lines: list[str]) -> list[tuple[int, int]]:
    """Of each COMMAND_ACK in recorded lines: the command and its result."""
    found = []
    for _, name, told in (line.split(" ", 2) for line in lines):
        frame = bytes.fromhex(told) if name != ">" else b""
        if int.from_bytes(frame[7:10], "little") == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
            payload = frame[10 : 10 + frame[1]].ljust(3, b"\0")
            found.append((int.from_bytes(payload[:2], "little"), payload[2]))
    return found


def fly(name: str, python: str, checkout: Path, folder: Path) -> list[str]:
    """Fly one of GROUND_FLIGHTS in `folder`. What was sent and what came, a line each."""
    flown = GROUND_FLIGHTS[name]
    with ExitStack() as stack:
        flight = GroundFlight(stack, flown, python, checkout, folder)
        try:
            _script(flight, flown)
        except ChildProcessError as error:
            flight.lines.append(f"{flight.elapsed_s:.2f} > {error}")
    return flight.lines


def _script(flight: GroundFlight, flown: Flown) -> None:
    resets = flown.link_clock == "both"  # by simulation time alone a reset would run the clock back
    again = Client(STATION, 255, 189)
    force = 246, 1.0, 0, 0, 0, 0, FORCE_REBOOT
    to_come = requests(flown.seed, UNTIL_S)
    if resets:
        to_come.append(again.command(UNTIL_S + 0.1, 246, 1.0))  # refused in the air
        to_come.append(again.command(UNTIL_S + 0.2, *force))
    to_come += [
        again.command(UNTIL_S + 1.0, 400, 1.0),
        again.command(UNTIL_S + 1.2, 22, NAN, NAN, NAN, NAN, NAN, NAN, 2.0),
        again.command(UNTIL_S + 5.0, 176, 1.0, AUTO, 3),
        again.command(UNTIL_S + 6.0, 185, 1.0),  # it falls
    ]
    while flight.elapsed_s < UNTIL_S + AFTER_S and not flight.has_ended:
        due = [each for each in to_come if each.at_s < flight.elapsed_s + 0.5 * STEP_S]
        to_come = to_come[len(due) :]
        flight.step([(each.by, each.datagram) for each in due])
    # lying there, time stands: a controller counts that as silence, so not for long
    last = [again.command(0.0, 400, 1.0), *([again.command(0.0, *force)] if resets else [])]
    for each in last:
        flight.step([])
        flight.step([(each.by, each.datagram)])
    for _ in range(5):
        flight.step([])


if __name__ == "__main__":
    name, python, checkout = sys.argv[1:]
    flown_lines = fly(name, python, Path(checkout), Path.cwd())
    for port in (SCRIPT, STATION, LATE, ">"):  # the order between ports is chance
        of_port = [
            line.replace(f" {port}", "", 1) for line in flown_lines if line.split()[1] == port
        ]
        Path(f"{port.replace('>', 'sent')}.traffic").write_text(
            "".join(f"{line}\n" for line in of_port)
        )
