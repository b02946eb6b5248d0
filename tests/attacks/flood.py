"""A vehicle in real time under a flood of datagrams: what a true client notices of it.

    python -m tests.attacks.flood --seconds 60

The flood comes from 300 ports to both ground ports: of strangers (pings, commands to another system,
garbage), and with authority (heartbeats, then commands that the vehicle takes), with 1 and with 16
messages in a datagram. A true client on the script link asks for a message 20 times a second and
counts what it hears. A flight in lockstep under the same flood must be the flight without it. The
exit code is 1 if there is a finding. `README.md` says what is looked for, and what was found.

The sender takes a part of a core itself: on two cores it competes with the vehicle.
"""

from __future__ import annotations

import json
import os
import random
import select
import signal
import socket
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
import pymavlink.dialects.v20.common as mavlink

from fcu.interface.ports import Ports, ports
from gcs_tools.flight.forking import fork
from tests.attacks.outcome import TRACES
from tests.patience import PATIENCE_S, until
from tests.process.conftest import Program, alive, claimed_instance
from tests.process.script import Script

PORTS, RATE = 300, 20_000
ASKS_PER_S = 20.0
BASELINE_S, SETTLED_S = 5.0, 3.0
COUNTED_HZ = 4.0  # of what is slower, one more or less in the baseline would be a finding
LEAST_FACTOR, MOST_ACK_S, LEAST_TELEMETRY = 0.98, 0.050, 0.95
MOST_GROWTH = 5_000_000  # bytes of memory of the flight controller
HEADER = "| flood | datagrams/s sent | sender's core | real-time factor before, under it | ACK median, ms | ACK p99, ms | worst telemetry | memory, MB | descriptors | not read |"  # fmt: skip


class Flood(NamedTuple):
    """What is sent."""

    authority: bool
    messages: int  # in a datagram
    steers: bool = True  # whether it may change the flight: not in lockstep

    def __str__(self) -> str:
        who = "with authority" if self.authority else "strangers"
        return f"{who}, {self.messages} message{'s' if self.messages > 1 else ''}"

    def datagrams(self, system: int, seed: int) -> list[bytes]:
        """Some hundred, to be sent in turns."""
        rng = random.Random(f"flood {seed}")
        codec = mavlink.MAVLink(None, srcSystem=201, srcComponent=190)

        def long(number: int, *params: float, to: int = system) -> mavlink.MAVLink_message:
            seven = [*params, *[0.0] * (7 - len(params))]
            return mavlink.MAVLink_command_long_message(to, 1, number, 0, *seven)

        made: list[mavlink.MAVLink_message | bytes]
        if self.authority:
            made = [
                mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
                long(512, rng.choice((30, 32, 148, 242))),
                long(511, 30, 100_000.0),
                mavlink.MAVLink_param_request_read_message(system, 1, b"MR_GAMMA", -1),
                mavlink.MAVLink_param_request_list_message(system, 1),
                mavlink.MAVLink_ping_message(1, 1, 0, 0),
            ]
            if self.steers:
                made += [long(176, 1, 4, 3), long(178, 1, 4.0, -1)]
        else:
            made = [
                mavlink.MAVLink_ping_message(1, 1, 0, 0), long(400, 1, to=77), long(512, 30, to=77),
                rng.randbytes(40), mavlink.MAVLink_statustext_message(6, b"x"),
            ]  # fmt: skip
        packed = [each if isinstance(each, bytes) else each.pack(codec) for each in made]
        return [b"".join(rng.choice(packed) for _ in range(self.messages)) for _ in range(200)]


class Sender:
    """A process that sends the flood; `stop` gives datagrams a second, and its part of a core."""

    def __init__(self, flood: Flood, at: Ports, rate: float, seed: int, n_ports: int) -> None:
        self._out, said = os.pipe()
        datagrams = flood.datagrams(at.system_id, seed)
        self._pid = fork(lambda: _send(said, datagrams, at, rate, n_ports), "flood", (said,)).pid
        os.close(said)

    def stop(self) -> tuple[float, float]:
        os.kill(self._pid, signal.SIGTERM)
        with os.fdopen(self._out) as out:
            told = json.loads(out.read())
        os.waitpid(self._pid, 0)
        return told["per_s"], told["core"]


def _send(said: int, datagrams: Sequence[bytes], at: Ports, rate: float, n_ports: int) -> None:
    told: list[int] = []
    signal.signal(signal.SIGTERM, lambda *_: told.append(1))
    sockets = []
    for n in range(n_ports):
        each = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        each.bind(("127.0.0.1", 0))
        each.connect(("127.0.0.1", (at.fcu_script, at.fcu_station)[n % 2]))
        each.setblocking(False)
        sockets.append(each)
    began, sent = time.monotonic(), 0
    while not told:
        due = int((time.monotonic() - began) * rate)
        while sent < due and not told:
            try:
                sockets[sent % n_ports].send(datagrams[sent % len(datagrams)])
            except OSError:  # refused: nobody is there yet, or any more
                pass
            sent += 1
        select.select([], [], [], 0.001)
    took = time.monotonic() - began
    os.write(said, json.dumps({"per_s": sent / took, "core": time.process_time() / took}).encode())


class Heard(NamedTuple):
    """What a true client heard in a while."""

    factor: float  # simulated seconds a second
    acks_s: list[float]  # from each question to its answer; infinite: none
    rates: dict[str, float]  # messages a second, by name


class Client(Script):
    """A script that knows its vehicle."""

    def __init__(self, instance: int) -> None:
        super().__init__(instance)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)

    def _ask(self, command: int, *params: float) -> None:
        self.command_to(self.target[0], command, *params)

    def _heard(self, within_s: float) -> list[mavlink.MAVLink_message]:
        if not select.select([self._socket], [], [], max(within_s, 0.0))[0]:
            return []
        return self._codec.parse_buffer(self._socket.recv(4096)) or []

    def take_off(self) -> None:
        """Armed and 2 m above the ground."""
        end, asked, top = time.monotonic() + PATIENCE_S, 0.0, None
        while time.monotonic() < end:
            if time.monotonic() - asked > 1.0:
                asked = time.monotonic()
                self._ask(400, 1)
                self._ask(22, 0, 0, 0, *[float("nan")] * 3, 3.0)
            for each in self._heard(0.5):
                if each.get_type() == "LOCAL_POSITION_NED":
                    top = each.z if top is None else top
                    if each.z < top - 2.0:
                        return
        raise AssertionError("the vehicle does not take off")

    def measure(self, seconds: float) -> Heard:
        """Ask, listen and count for so long (wall)."""
        count: Counter[str] = Counter()
        acks, open_since = [], 0.0
        times: list[tuple[float, float]] = []  # wall, simulation time
        began = time.monotonic()
        due = began
        while (now := time.monotonic()) < began + seconds:
            if now >= due and (not open_since or now - open_since > 1.0):
                if open_since:
                    acks.append(float("inf"))
                self._ask(512, 148)
                open_since, due = time.monotonic(), max(due + 1.0 / ASKS_PER_S, now)
            for each in self._heard(min(due - now, 0.05) if not open_since else 0.05):
                kind = each.get_type()
                count[kind] += 1
                if kind == "COMMAND_ACK" and each.command == 512 and open_since:
                    acks.append(time.monotonic() - open_since)
                    open_since = 0.0
                elif kind == "LOCAL_POSITION_NED":
                    times.append((time.monotonic(), each.time_boot_ms * 1e-3))
        (first, t_first), (last, t_last) = times[0], times[-1]
        took = time.monotonic() - began
        rates = {kind: n / took for kind, n in count.items()}
        return Heard((t_last - t_first) / (last - first), acks, rates)


def _part(values: Sequence[float], part: float) -> float:
    """Not above this is such a part of them; infinite if there are none."""
    return sorted(values)[int(np.ceil(part * len(values))) - 1] if values else float("inf")


def _memory(pid: int) -> int:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _descriptors(pid: int) -> int:
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def _lost(number: int) -> int:
    """Datagrams that had no room at a port, of the system's table."""
    for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
        words = line.split()
        if int(words[1].partition(":")[2], 16) == number:
            return int(words[-1])
    return 0


def in_real_time(
    flood: Flood, seconds: float, rate: float, seed: int, n_ports: int, folder: Path
) -> tuple[str, list[str]]:
    """A row of the table, and the findings."""
    folder.mkdir(parents=True)
    with claimed_instance() as instance, ExitStack() as stack:
        at = ports(instance)
        program = Program(folder, "gcs_tools", "up", "--instance", str(instance), "--no-publish")
        stack.callback(program.kill)
        program.says("ready: ")
        pids = program.started()
        client = Client(instance)
        stack.callback(client.close)
        client.take_off()
        quiet = client.measure(BASELINE_S)
        descriptors = _descriptors(pids["fcu"])
        sender = Sender(flood, at, rate, seed, n_ports)
        try:
            client.measure(min(SETTLED_S, seconds))  # queues fill, links are made: once
            before = _memory(pids["fcu"]), descriptors
            heard = client.measure(seconds)
        finally:
            per_s, core = sender.stop()
        lost = sum(_lost(number) for number in (at.fcu_script, at.fcu_station))
        after = _memory(pids["fcu"]), _descriptors(pids["fcu"])
        code = program.interrupted()
        until(lambda: not any(map(alive, pids.values())), "no orphan")
        logs = [path.read_text() for path in folder.rglob("*.log")]
    asked = {
        kind: r for kind, r in quiet.rates.items() if r >= COUNTED_HZ and kind != "COMMAND_ACK"
    }
    parts = {kind: heard.rates.get(kind, 0.0) / r for kind, r in asked.items()}
    # what answers its questions is asked for at the same rate, if they are answered as soon
    parts.pop("AUTOPILOT_VERSION", None)
    worst = min(parts, key=lambda kind: parts[kind])
    median, p99 = (_part(heard.acks_s, part) for part in (0.5, 0.99))
    findings = [word for word in TRACES if any(word in text for text in (program.text(), *logs))]
    for wrong, what in (
        (code != 0, f"exit code {code}"),
        (heard.factor < LEAST_FACTOR, f"real-time factor {heard.factor:.3f}"),
        (p99 > MOST_ACK_S, f"ACK p99 {1e3 * p99:.0f} ms"),
        (parts[worst] < LEAST_TELEMETRY, f"{worst}: {parts[worst]:.2f} of its rate"),
        (after[0] - before[0] > MOST_GROWTH, f"memory grows by {(after[0] - before[0]) / 1e6:.1f} MB"),
        (after[1] != before[1], f"descriptors: {before[1]} before, {after[1]} after"),
    ):  # fmt: skip
        if wrong:
            findings.append(what)
    row = (
        f"| {flood} | {per_s:.0f} | {core:.2f} | {quiet.factor:.3f}, {heard.factor:.3f} | {1e3 * median:.1f} "
        f"| {1e3 * p99:.1f} | {parts[worst]:.2f} ({worst}) "
        f"| {before[0] / 1e6:.1f} to {after[0] / 1e6:.1f} | {before[1]}, {after[1]} "
        f"| {lost / max(per_s * (seconds + SETTLED_S), 1.0):.0%} |"
    )
    return row, findings


def in_lockstep(
    flood: Flood, duration_s: float, rate: float, seed: int, n_ports: int, folder: Path
) -> tuple[str, list[str]]:
    """The hash of a flight under the flood, and that of the same one without."""
    folder.mkdir(parents=True)
    words = ["fly", "paper_nominal", "--set", f"flight.duration_s={duration_s:g}", "--json",
             "--figure", "never", "--record", "none"]  # fmt: skip
    hashes = []
    with claimed_instance() as instance:
        for name in ("quiet", "flooded"):
            options = ["--instance", str(instance), "--out", str(folder / name)]
            (folder / f"{name}-said").mkdir()
            sender = (
                Sender(flood, ports(instance), rate, seed, n_ports) if name == "flooded" else None
            )
            try:
                program = Program(folder / f"{name}-said", "gcs_tools", *words, *options)
                code = program.wait()
            finally:
                per_s = sender.stop()[0] if sender else 0.0
            told = json.loads(program.out.read_text() or "[{}]")[0]
            hashes.append((told.get("trajectory_sha256"), told.get("error"), code))
    findings = [] if hashes[0] == hashes[1] and hashes[0][0] else [f"lockstep: {hashes}"]
    same = "the same" if not findings else "another"
    return (
        f"lockstep, {flood}, {per_s:.0f} datagrams/s: {same} trajectory, {hashes[0][0]}",
        findings,
    )


@click.command(help=__doc__)
@click.option("--seconds", default=60.0, show_default=True, help="Of each flood, wall.")
@click.option("--rate", default=float(RATE), show_default=True, help="Datagrams a second.")
@click.option("--ports", "n_ports", default=PORTS, show_default=True, help="That send them.")
@click.option("--seed", default=1, show_default=True)
@click.option(
    "--lockstep-s", default=60.0, show_default=True, help="Simulated time of the flights."
)
def main(seconds: float, rate: float, n_ports: int, seed: int, lockstep_s: float) -> None:
    rows, findings = [], []
    with tempfile.TemporaryDirectory(prefix="attacks-") as name:
        base = Path(name)
        for authority in (False, True):
            for messages in (1, 16):
                flood = Flood(authority, messages)
                row, found = in_real_time(flood, seconds, rate, seed, n_ports, base / str(flood))
                rows.append(row)
                click.echo(row, err=True)
                findings += [f"{flood}: {each}" for each in found]
        lines = []
        for authority in (False, True):
            flood = Flood(authority, 16, steers=False)
            line, found = in_lockstep(
                flood, lockstep_s, rate, seed, n_ports, base / f"lockstep {flood}"
            )
            lines.append(line)
            findings += [f"{flood}: {each}" for each in found]
    click.echo("\n".join((HEADER, "|---" * 10 + "|", *rows, "", *lines, *findings)))
    sys.exit(1 if findings else 0)


if __name__ == "__main__":
    main()
