"""Every process of a flight is killed, stopped, and told to end, in every phase: a table.

    python -m tests.attacks.signals

A row is a program (`gcs fly` or `gcs up`), who is sent the signal, and which; a column a phase. A
cell has the exit code and the seconds from the signal to the end. Findings are told as they come; the
exit code is 1 if there is any. `README.md` says what is looked for.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import product
from pathlib import Path
from typing import NamedTuple

import click
import pymavlink.dialects.v20.common as mavlink

from fcu.interface.status_texts import Code, Told, words
from gcs_tools.judging import result
from gcs_tools.recording import reader
from tests.attacks.outcome import TRACES
from tests.patience import until
from tests.process.conftest import Program, alive, claimed_instance
from tests.process.script import Script

NUMBERS = (signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
PROGRAMS, VICTIMS = ("fly", "up"), ("runner", "fcu", "sitl_plant", "publisher")
PHASES = ("start-up", "arming", "flight", "landing", "closing")
SUSPENDED_S = 6.5  # wall: longer than anybody's patience with a process that is silent
WITHIN_S = 30.0  # wall, from the signal to the end
LANDING = """title = "It flies, and lands on a setpoint below the ground."
[flight]
duration_s = 3000.0
ground_z_m = -0.5
setpoints = [[0.0, 0.0, 0.0, 0.0], [{at_s}, 0.0, 0.0, -0.9]]
"""
LANDING_TOLD = words(Told(Code.SETPOINT_INTO_GROUND))
HALF_A_MEGABYTE = 1 << 19


class Trial(NamedTuple):
    """One signal to one process in one phase."""

    program: str
    victim: str
    number: signal.Signals
    phase: str

    def __str__(self) -> str:
        return f"{self.program}, {self.number.name} to the {self.victim}, {self.phase}"


class Ended(NamedTuple):
    """What became of it."""

    code: int
    took_s: float  # from the signal to the end
    recording: str  # ticks, "none", or what is wrong
    result: str  # exit code in it, "none", or what is wrong
    findings: list[str]

    def __str__(self) -> str:
        return f"{self.code}, {self.took_s:.1f} s"


class GroundScript(Script):
    """Arms, takes off and lands."""

    def reach(self, phase: str) -> None:
        """Bring a vehicle that is up to a phase, from the ground."""
        if phase in ("start-up", "closing"):
            return
        standby = mavlink.MAV_STATE_STANDBY
        self.first("HEARTBEAT", lambda m: m.system_status == standby)
        self._ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        if phase == "arming":
            return
        start = self.first("LOCAL_POSITION_NED").z
        self._ask(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, *[float("nan")] * 3, 2.0)
        self.first("LOCAL_POSITION_NED", lambda m: m.z < start - 1.0)
        if phase == "landing":
            self._ask(mavlink.MAV_CMD_NAV_LAND)
            landing = mavlink.MAV_LANDED_STATE_LANDING
            self.first("EXTENDED_SYS_STATE", lambda m: m.landed_state == landing)

    def _ask(self, command: int, *params: float) -> None:
        """A command whose answer nobody waits for: what follows shows that it was taken."""
        self.command_to(self.target[0], command, *params)


def _pids(program: Program) -> dict[str, int]:
    children = program.children()
    found = {name: children[name] for name in ("fcu", "sitl_plant") if name in children}
    if "gcs_tools" in children:
        found["publisher"] = children["gcs_tools"]
    return found


def _reach(trial: Trial, program: Program, folder: Path, instance: int) -> None:
    """Wait until the flight is in the phase; Raises AssertionError if it does not get there."""
    names = {"fcu", "sitl_plant", "publisher"}

    def begun() -> bool:
        wanted = {trial.victim} & names or {"fcu"}
        return _pids(program).keys() >= wanted or program.process.poll() is not None

    if trial.phase == "start-up":
        until(begun, "a process")
        return
    if trial.program == "up":
        program.says("ready: ")
        script = GroundScript(instance)
        try:
            script.reach(trial.phase)
        finally:
            script.close()
        return
    log, file = folder / "run" / "fcu.log", folder / "run" / "flight.mcap"

    def said(what: str) -> bool:
        return log.exists() and what in log.read_text()

    def recorded() -> bool:
        return file.exists() and file.stat().st_size > HALF_A_MEGABYTE

    if trial.phase == "arming":
        until(lambda: said("waiting for the plant"), "a flight controller that is ready")
    else:
        until(recorded, "a recording")
        if trial.phase == "landing":
            until(lambda: said(LANDING_TOLD), "a landing")


def attempt(trial: Trial, folder: Path) -> Ended:
    """Fly, send the signal, and see what is left."""
    folder.mkdir(parents=True)
    mission = folder / "landing.toml"
    mission.write_text(LANDING.format(at_s=5.0 if trial.phase == "landing" else 2000.0))
    with claimed_instance() as instance, ExitStack() as stack:
        words = ["--instance", str(instance)]
        if trial.program == "fly":
            words = ["fly", str(mission), "--publish", "--out", str(folder / "run"),
                     "--figure", "never", *words]  # fmt: skip
        else:
            words = ["up", *words]
        program = Program(folder, "gcs_tools", *words)
        stack.callback(program.kill)
        _reach(trial, program, folder, instance)
        if trial.phase != "start-up":
            until(lambda: len(_pids(program)) == 3 or program.process.poll() is not None, "three")
        pids = _pids(program)
        stack.callback(_end, pids)
        if program.process.poll() is not None:
            return Ended(-1, 0.0, "", "", [f"has ended before: {program.text()[-300:]}"])
        return _struck(trial, program, pids, folder)


def _end(pids: dict[str, int]) -> None:
    for pid in pids.values():
        if alive(pid):
            os.kill(pid, signal.SIGKILL)


def _struck(trial: Trial, program: Program, pids: dict[str, int], folder: Path) -> Ended:
    victim = program.pid if trial.victim == "runner" else pids[trial.victim]
    if trial.phase == "closing":
        program.signal(signal.SIGINT)
    began = time.monotonic()
    try:
        os.kill(victim, trial.number)
    except ProcessLookupError:  # it has closed already
        pass
    goes_on = trial.victim == "publisher" and trial.phase != "closing"
    if trial.victim == "runner" and trial.number == signal.SIGSTOP:
        _wait(program, SUSPENDED_S)
        program.signal(signal.SIGCONT)
        goes_on = trial.phase != "closing"
    if goes_on:
        _goes_on(trial, program, folder)
        if program.process.poll() is None:
            program.signal(signal.SIGINT)
            began = time.monotonic()
    code = program.wait()
    took_s = time.monotonic() - began
    pids |= _pids(program)
    findings = []
    if took_s > WITHIN_S:
        findings.append(f"took {took_s:.0f} s")
    try:
        until(lambda: not any(map(alive, pids.values())), "no orphan")
    except AssertionError:
        findings.append(f"orphans: {[name for name, pid in pids.items() if alive(pid)]}")
    if code not in expected(trial):
        findings.append(f"exit code {code}, expected {sorted(expected(trial))}")
    logs = [path.read_text(errors="replace") for path in folder.rglob("*.log")]
    findings += [word for word in TRACES if any(word in text for text in (program.text(), *logs))]
    recording, kept = "none", "none"
    if trial.program == "fly":
        recording, kept, more = _kept(trial, folder / "run", code)
        findings += more
    if findings:
        findings.append(program.text()[-1500:])
    return Ended(code, took_s, recording, kept, findings)


def _goes_on(trial: Trial, program: Program, folder: Path) -> None:
    """See that the flight does: it is longer than it was, or still being started, or has ended."""
    file = folder / "run" / "flight.mcap"
    if trial.program == "up":
        program.says("ready: ") if trial.phase == "start-up" else _wait(program, 0.5)
        return
    size = file.stat().st_size if file.exists() else 0
    grown = size + HALF_A_MEGABYTE
    until(
        lambda: program.process.poll() is not None or (file.exists() and file.stat().st_size > grown),
        "a flight that goes on",
    )  # fmt: skip


def _wait(program: Program, seconds: float) -> None:
    """So long, or until it has ended."""
    fd = os.pidfd_open(program.pid)
    try:
        select.select([fd], [], [], seconds)
    finally:
        os.close(fd)


def expected(trial: Trial) -> set[int]:
    """The exit codes that README.md and the help of each command promise."""
    stopped = 130 if trial.program == "fly" else 0
    if trial.victim == "runner":
        if trial.number == signal.SIGKILL:
            return {-signal.SIGKILL}
        if trial.number == signal.SIGSTOP:  # they may take it for dead, and say so
            return {stopped, 3, *({0} if trial.program == "up" else ())}
        # of a start that is over at once it is told after it
        return {stopped, 130} if trial.phase == "start-up" else {stopped}
    if trial.phase == "closing":
        return {stopped}
    if trial.victim == "publisher":
        return {130} if trial.program == "fly" else {0}
    return {3}


def _kept(trial: Trial, run: Path, code: int) -> tuple[str, str, list[str]]:
    """What is on file: ticks, the exit code in the result, and what is wrong with them."""
    findings = []
    flown = trial.phase in ("flight", "landing", "closing")
    file, told = run / "flight.mcap", run / "result.json"
    recording = "none"
    if file.exists():
        try:
            found = reader.read(file)
            recording = f"{len(found.fcu)} ticks" + ("" if found.complete else ", truncated")
            if not found.complete and code != -signal.SIGKILL:
                findings.append("the recording is truncated")
            if flown and len(found.fcu) < 100:
                findings.append(f"recording: {recording}")
        except reader.RecordingError as error:
            recording = "empty"
            if flown or code != -signal.SIGKILL:
                findings.append(f"recording: {error}")
    elif flown:
        findings.append("no recording")
    kept = "none"
    if told.exists():
        try:
            kept = str(result.read(told).exit_code)
        except result.ResultError as error:
            kept = "bad"
            findings.append(str(error))
    if code != -signal.SIGKILL and kept != str(code) and run.exists():
        findings.append(f"result.json: {kept}, exit code {code}")
    return recording, kept, findings


def trials(
    programs: Sequence[str], victims: Sequence[str], numbers: Sequence[str], phases: Sequence[str]
) -> list[Trial]:
    """All of them, in the order of the table."""
    asked = product(programs, victims, numbers, phases)
    return [Trial(p, v, signal.Signals[f"SIG{n}"], phase) for p, v, n, phase in asked]


def _choice(names: Sequence[str], what: str) -> click.Option:
    return click.option(
        f"--{what}", f"{what}s", type=click.Choice(names), multiple=True, default=names,
        help="May be repeated; default: all.",
    )  # fmt: skip


@click.command(help=__doc__)
@_choice(PROGRAMS, "program")
@_choice(VICTIMS, "victim")
@_choice([number.name.removeprefix("SIG") for number in NUMBERS], "signal")
@_choice(PHASES, "phase")
@click.option("-j", "jobs", default=1, show_default=True, help="Flights at a time.")
def main(
    programs: tuple[str, ...], victims: tuple[str, ...], signals: tuple[str, ...],
    phases: tuple[str, ...], jobs: int,
) -> None:  # fmt: skip
    asked = trials(programs, victims, signals, phases)
    found: dict[Trial, Ended] = {}
    with tempfile.TemporaryDirectory(prefix="attacks-") as name, ThreadPoolExecutor(jobs) as pool:

        def one(job: tuple[int, Trial]) -> Ended:
            number, trial = job
            try:
                return attempt(trial, Path(name) / str(number))
            except (AssertionError, OSError) as error:
                return Ended(-1, 0.0, "", "", [f"{type(error).__name__}: {error}"])

        for trial, ended in zip(asked, pool.map(one, enumerate(asked)), strict=True):
            found[trial] = ended
            line = f"{trial}: {ended}; recording {ended.recording}, result.json {ended.result}"
            click.echo(line, err=True)
            for each in ended.findings:
                click.echo(f"{trial}: {each}")
    click.echo(f"| program | signal to | signal | {' | '.join(phases)} |")
    click.echo("|---" * (3 + len(phases)) + "|")
    for program, victim, number in dict.fromkeys((t.program, t.victim, t.number) for t in asked):
        cells = [str(found[Trial(program, victim, number, phase)]) for phase in phases]
        name = number.name.removeprefix("SIG")
        click.echo(f"| `gcs {program}` | {victim} | {name} | {' | '.join(cells)} |")
    sys.exit(any(ended.findings for ended in found.values()))


if __name__ == "__main__":
    main()
