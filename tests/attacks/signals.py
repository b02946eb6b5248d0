"""Every process of a flight is killed, stopped, and told to end, in every phase: a table.

    python -m tests.attacks.signals

A row is a program (`gcs fly` or `gcs up`), the process that is sent the signal, and which; a column a phase.
PAUSE is a STOP that is continued after 3 s. The script is a user's: a mission of `gcs fly` names it, and
with `gcs up` it is started beside it. The station is a program that sends heartbeats. A cell has the exit
code and the seconds from the signal to the end.
Findings are told as they come; the exit code is 1 if there is any. `README.md` says what is looked for.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from itertools import product
from pathlib import Path
from typing import NamedTuple

import click

from fcu.interface.ports import ports
from fcu.interface.status_texts import Code, Told, words
from gcs_tools.judging import result
from gcs_tools.recording import reader
from tests.attacks.outcome import TRACES
from tests.patience import until
from tests.process.conftest import Program, alive, claimed_instance

SIGNALS = ("KILL", "STOP", "PAUSE", "TERM", "INT", "HUP")
OURS = ("runner", "fcu", "sitl_plant", "publisher")
PROGRAMS, VICTIMS = ("fly", "up"), (*OURS, "script", "station")
PHASES = ("start-up", "handshake", "armed", "flight", "plan", "landing", "closing")
STARTS = PHASES[:2]
PAUSED_S = 3.0  # wall: shorter than anybody's patience with a process that is silent
SUSPENDED_S = 6.5  # wall: longer than anybody's patience with a process that is silent
WITHIN_S = 30.0  # wall, from the signal to the end
SCRIPT_WITHIN_S = 120.0  # of a script, which flies to its end, or to that of the mission
LANDING = """title = "It flies, and lands on a setpoint below the ground."
[flight]
duration_s = 3000.0
ground_z_m = -0.5
setpoints = [[0.0, 0.0, 0.0, 0.0], [{at_s}, 0.0, 0.0, -0.9]]
"""
PLAN = """title = "It flies a plan, and holds at its end for longer than anybody waits."
[flight]
duration_s = 3000.0
items = [
    { kind = "go_to", position_m = [6.0, 0.0, 1.0] },
    { kind = "hold", for_s = 2900.0 },
]
"""
SCRIPTED = """title = "A script takes off, stays for a while, and lands."
[flight]
duration_s = 60.0
ground_z_m = 0.0
start = {{ on_ground = true }}
script = "{python} {script} {{url}} {how}"
pace = "speed:1"
[expect]
ended = "landed"
"""
HOP = Path(__file__).parents[1] / "scripts" / "hop.py"
HOVERED_S = {"landing": "0", "closing": "0"}  # wall, by the script; long enough for any other phase
ENOUGH_S = "12"
SAID = {"armed": "armed", "flight": "up", "plan": "plan", "landing": "landing", "closing": "landed"}
LANDING_TOLD, ARMED_TOLD = (words(Told(code)) for code in (Code.SETPOINT_INTO_GROUND, Code.ARMED))
ROOT = Path(__file__).parents[2]
HALF_A_MEGABYTE = 1 << 19


class Trial(NamedTuple):
    """One signal to one process in one phase."""

    program: str
    victim: str
    name: str  # of SIGNALS
    phase: str

    def __str__(self) -> str:
        return f"{self.program}, {self.name} to the {self.victim}, {self.phase}"

    @property
    def number(self) -> signal.Signals:
        return signal.Signals[f"SIG{'STOP' if self.name == 'PAUSE' else self.name}"]


class Ended(NamedTuple):
    """What became of it."""

    code: int
    took_s: float  # from the signal to the end
    recording: str  # ticks, "none", or what is wrong
    result: str  # exit code in it, "none", or what is wrong
    findings: list[str]

    def __str__(self) -> str:
        return f"{self.code}, {self.took_s:.1f} s"


def _pids(program: Program) -> dict[str, int]:
    children = program.children()
    found = {name: children[name] for name in ("fcu", "sitl_plant") if name in children}
    if "gcs_tools" in children:
        found["publisher"] = children["gcs_tools"]
    script = _script(program.folder)
    if script is not None:
        found["script"] = script
    return found


def _script(folder: Path) -> int | None:
    """Pid of the script of a flight, which is the Python that runs the copy in the flight's folder."""
    wanted = str(folder / HOP.name).encode()
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if wanted in words[1:2]:
            return int(entry.name)
    return None


def _reach(trial: Trial, program: Program, folder: Path, beside: Program | None) -> None:
    """Wait until the flight is in the phase. Raises AssertionError if it does not get there.

    beside : the script that is started beside `gcs up`.
    """
    names = {"fcu", "sitl_plant", "publisher", "script"} if beside is None else set(OURS[1:])

    def begun() -> bool:
        wanted = {trial.victim} & names or {"fcu"}
        return _pids(program).keys() >= wanted or program.process.poll() is not None

    if trial.phase == "start-up":
        until(begun, "a process")
        return
    if trial.program == "up":
        if trial.phase == "handshake":
            program.started()
            return
        program.says("ready: ")
        if beside is not None and trial.phase != "closing":
            beside.says(SAID[trial.phase])
        return
    log, file = folder / "run" / "fcu.log", folder / "run" / "flight.mcap"
    if trial.victim == "script":
        heard, word = folder / "run" / "script.log", SAID[trial.phase]
        until(lambda: heard.exists() and word in heard.read_text(), f"a script that says {word}")
        return

    def said(what: str) -> bool:
        return log.exists() and what in log.read_text()

    def recorded() -> bool:
        return file.exists() and file.stat().st_size > HALF_A_MEGABYTE

    if trial.phase == "handshake":
        until(lambda: said("waiting for the plant"), "a flight controller that is ready")
    elif trial.phase == "armed":
        until(lambda: said(ARMED_TOLD), "an armed vehicle")
    else:
        until(recorded, "a recording")
        if trial.phase == "landing":
            until(lambda: said(LANDING_TOLD), "a landing")


def attempt(trial: Trial, folder: Path) -> Ended:
    """Fly, send the signal, and see what is left."""
    folder.mkdir(parents=True)
    with claimed_instance() as instance, ExitStack() as stack:
        words = ["--instance", str(instance)]
        if trial.program == "fly":
            words = ["fly", str(_mission(trial, folder)), "--publish", "--out", str(folder / "run"),
                     "--allow-commands", "--figure", "never", *words]  # fmt: skip
        else:
            words = ["up", *words]
        others = {}
        if trial.victim == "station":
            finds = {**os.environ, "PYTHONPATH": str(ROOT)}
            station = Program(folder, "tests.attacks.station", str(instance), env=finds)
            stack.callback(station.kill)
            others["station"] = station.pid
        hovers = {**os.environ, "HOP_S": HOVERED_S.get(trial.phase, ENOUGH_S)}
        program, beside = Program(folder, "gcs_tools", *words, env=hovers), None
        stack.callback(program.kill)
        if _has_script(trial) and trial.program == "up":
            shutil.copy(HOP, folder)
            url = f"udpin:127.0.0.1:{ports(instance).script}"
            beside = Program(folder, HOP.stem, url, _how(trial), env=hovers)
            stack.callback(beside.kill)
            others["script"] = beside.pid
        _reach(trial, program, folder, beside)
        if trial.phase != "start-up":
            ready = {"fcu", "sitl_plant", "publisher"}
            until(
                lambda: _pids(program).keys() >= ready or program.process.poll() is not None,
                "three",
            )
        pids = _pids(program)
        stack.callback(_end, pids)
        if program.process.poll() is not None:
            return Ended(-1, 0.0, "", "", [f"has ended before: {program.text()[-300:]}"])
        return _struck(trial, program, pids, others, folder)


def _mission(trial: Trial, folder: Path) -> Path:
    """The mission of a trial, written to its folder."""
    if trial.victim == "script":
        script = shutil.copy(HOP, folder)
        text = SCRIPTED.format(python=sys.executable, script=script, how=_how(trial))
    elif trial.phase == "plan":
        text = PLAN
    else:
        text = LANDING.format(at_s=5.0 if trial.phase == "landing" else 2000.0)
    mission = folder / "signals.toml"
    mission.write_text(text)
    return mission


def _has_script(trial: Trial) -> bool:
    """Return true for a trial that a script brings to its phase, or is the victim of."""
    by_script = trial.program == "up" and trial.phase not in (*STARTS, "closing")
    return by_script or trial.victim == "script"


def _how(trial: Trial) -> str:
    """Return the behaviour of hop.py."""
    return "plans" if trial.phase == "plan" else "well"


def _end(pids: dict[str, int]) -> None:
    for pid in pids.values():
        if alive(pid):
            os.kill(pid, signal.SIGKILL)


def _struck(
    trial: Trial, program: Program, pids: dict[str, int], others: dict[str, int], folder: Path
) -> Ended:
    victim = {"runner": program.pid, **pids, **others}.get(trial.victim)
    scripted = (
        trial.victim == "script" and trial.program == "fly"
    )  # the flight ends with its script
    if trial.phase == "closing" and not scripted:
        program.signal(signal.SIGINT)
    began, findings = time.monotonic(), []
    try:
        if victim is not None:
            os.kill(victim, trial.number)
        elif trial.phase != "closing":
            findings.append("there was nobody to send the signal to")
    except ProcessLookupError:  # it has closed already
        victim = None
    goes_on = trial.victim in ("publisher", "station", "script") and not scripted
    suspended = {"PAUSE": PAUSED_S, "STOP": SUSPENDED_S if trial.victim == "runner" else 0.0}
    if victim is not None and (for_s := suspended.get(trial.name, 0.0)):
        _wait(program, for_s)
        with suppress(ProcessLookupError):
            os.kill(victim, signal.SIGCONT)
        goes_on = not scripted
    if goes_on and trial.phase != "closing":
        _goes_on(trial, program, folder)
        if program.process.poll() is None:
            program.signal(signal.SIGINT)
            began = time.monotonic()
    code = program.wait()
    took_s = time.monotonic() - began
    pids |= _pids(program)
    if took_s > (SCRIPT_WITHIN_S if scripted else WITHIN_S):
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
        program.says("ready: ") if trial.phase in STARTS else _wait(program, 0.5)
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
    if trial.victim == "script" and trial.program == "fly":
        if trial.name == "PAUSE":
            return {0}  # it lands
        failed = 1 if trial.name == "STOP" else 3  # script_timeout, script_killed
        return {failed, *({0} if trial.phase == "closing" else ())}  # it may have ended before
    if trial.name == "PAUSE" and trial.victim != "runner":
        return {stopped}
    if trial.victim == "runner":
        if trial.name == "KILL":
            return {-signal.SIGKILL}
        if trial.name == "PAUSE" and trial.phase not in STARTS:
            return {stopped}
        if trial.number == signal.SIGSTOP:  # they may take it for dead, and say so
            return {stopped, 3, *({0} if trial.program == "up" else ())}
        # of a start that is over at once it is told after it
        return {stopped, 130} if trial.phase in STARTS else {stopped}
    if trial.phase == "closing":
        return {stopped}
    if trial.victim in ("publisher", "station", "script"):
        return {stopped}
    return {3}


def _kept(trial: Trial, run: Path, code: int) -> tuple[str, str, list[str]]:
    """What is on file: ticks, the exit code in the result, and what is wrong with them."""
    findings = []
    flown = trial.phase in ("flight", "plan", "landing", "closing")
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
    """All of them that there are, in the order of the table."""
    asked = (Trial(*each) for each in product(programs, victims, numbers, phases))
    return [trial for trial in asked if _is_one(trial)]


def _is_one(trial: Trial) -> bool:
    """Return true if there is such a trial: `gcs fly` starts a script after the handshake."""
    return not (trial.program == "fly" and trial.victim == "script" and trial.phase == "handshake")


def _choice(names: Sequence[str], what: str) -> click.Option:
    return click.option(
        f"--{what}", f"{what}s", type=click.Choice(names), multiple=True, default=names,
        help="May be repeated; default: all.",
    )  # fmt: skip


@click.command(help=__doc__)
@_choice(PROGRAMS, "program")
@_choice(VICTIMS, "victim")
@_choice(SIGNALS, "signal")
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
    for program, victim, name in dict.fromkeys((t.program, t.victim, t.name) for t in asked):
        row = (found.get(Trial(program, victim, name, phase)) for phase in phases)
        cells = " | ".join("-" if ended is None else str(ended) for ended in row)
        click.echo(f"| `gcs {program}` | {victim} | {name} | {cells} |")
    sys.exit(any(ended.findings for ended in found.values()))


if __name__ == "__main__":
    main()
