"""Files, command lines and messages that are nearly right, by the thousand.

    python -m tests.attacks.mutations --seed 1

Each is run as a user would (`outcome.py`); a message is sent to a flight controller in flight, whose
states must all be answered. Findings are told as they come, with the seed and number that lead to
them again; the exit code is 1 if there is any. `README.md` says what is looked for.
"""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import click
import pymavlink.dialects.v20.common as mavlink

from gcs_tools.cli.program import main as gcs
from tests.attacks import generators
from tests.attacks.outcome import Outcome, Tally, run

ROOT = Path(__file__).parents[2]
SHORT = ("--set", "flight.duration_s=0.4", "--figure", "never", "--out", "out")
HOVER = """title = "A hover."
[flight]
duration_s = 0.4
setpoints = [[0.0, 0.0, 0.0, 0.0]]
"""
FLOWN, READ = {0, 1, 2}, {0, 2}  # exit codes: as the help of each command names them
CODES = {
    "fly": {0, 1, 2, 3}, "up": {0, 2, 3}, "setpoint": {2, 3}, "envelope": FLOWN, "plot": READ,
    "compare": READ, "view": {0, 2, 3}, "recover": READ, "replay": {0, 2, 3},
    "monitor": {0, 2, 3}, "record": {0, 2, 3}, "topics": {0, 2, 3}, "publish": {0, 2, 3},
}  # fmt: skip
EACH_ANEW = 20  # of so many command lines one is a Python of its own
SERVES_S = 4.0  # wall: after so long a program that waits for somebody is interrupted
HEADER = "| what | number | exit codes | most memory, MB | most processor time, s | findings | took, s |"  # fmt: skip


def originals(folder: Path) -> list[bytes]:
    """Recordings to begin with: full, light, of a flight that ended early, and truncated."""
    hover = folder / "hover.toml"
    hover.write_text(HOVER)
    found = []
    for n, more in enumerate(((), ("--record", "light"), ("--set", "plant.mass_scale=9.0"))):
        out = folder / f"original-{n}"
        words = ["gcs", "fly", str(hover), "--in-process", "--figure", "never", "--out", str(out)]
        done = run([*words, *more], folder, 600.0, 600.0)  # the first compiles
        if not (out / "flight.mcap").exists():
            continue
        found.append((out / "flight.mcap").read_bytes())
        if not n:
            shutil.copytree(out, folder / "run")
            assert done.code in FLOWN, done.said
    return [*found, found[0][: 2 * len(found[0]) // 3]]


def load() -> None:
    """Import what copies need: each would do it for itself otherwise."""
    import gcs_tools.flight.run
    import gcs_tools.judging.comparison
    import gcs_tools.pictures.plot.overview
    import gcs_tools.recording.repair  # noqa: F401

    for name in gcs.list_commands(click.Context(gcs)):
        gcs.get_command(click.Context(gcs), name)


@contextlib.contextmanager
def place(base: Path, number: int) -> Iterator[Path]:
    """A folder of one run's own."""
    folder = base / "runs-of-it" / str(number) / "here"
    folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder.parent, ignore_errors=True)


Attempt = Callable[[int], Sequence[tuple[Outcome, set[int]]]]


def attempts(what: str, seed: int, numbers: Sequence[int], attempt: Attempt, tally: Tally) -> None:
    """Make them, as many at a time as there are cores. `attempt`: number -> outcomes, codes."""
    here = get_context("fork")  # an attempt is a closure; and no process that forks has threads
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), here, _hold, (attempt,)) as pool:
        for number, outcomes in zip(numbers, pool.map(_held, numbers), strict=True):
            for outcome, codes in outcomes:
                tally.add(outcome, codes, f"{what} --seed {seed} --only {number}")


_attempt: list[Attempt] = []  # of a process of the pool


def _hold(attempt: Attempt) -> None:
    _attempt[:] = [attempt]


def _held(number: int) -> Sequence[tuple[Outcome, set[int]]]:
    return _attempt[0](number)


def missions(base: Path, seed: int) -> Attempt:
    """Mutated missions: flown in process if they are accepted, and asked about by `envelope`."""
    texts = [path.read_text() for path in sorted((ROOT / "missions").glob("*.toml"))]

    def attempt(number: int) -> list[tuple[Outcome, set[int]]]:
        rng = random.Random(f"mission {seed} {number}")
        with place(base, number) as here:
            (here / "m.toml").write_bytes(generators.mission(rng, texts))
            flown = run(["gcs", "fly", "m.toml", "--in-process", *SHORT], here, 60.0)
            asked: list[tuple[Outcome, set[int]]] = []
            if flown.code != 2 and number % 4 == 2:  # of its own duration, which may be any
                long = run(
                    ["gcs", "fly", "m.toml", "--in-process", *SHORT[2:-1], "long"], here, 5.0
                )
                asked = [(long, {0, 1, 2} | ({130} if long.interrupted else set()))]
            if flown.code != 2 and number % 4 == 0:
                asked = [(run(["gcs", "envelope", "m.toml"], here, 60.0), FLOWN)]
            return [(flown, {0, 1, 2}), *asked]

    return attempt


def recordings(base: Path, begin_with: Sequence[bytes], seed: int) -> Attempt:
    """Mutated recordings and results: compared, repaired, and each tenth drawn or replayed."""
    text = (base / "run" / "result.json").read_text()

    def attempt(number: int) -> list[tuple[Outcome, set[int]]]:
        rng = random.Random(f"recording {seed} {number}")
        with place(base, number) as here:
            as_json = ["--json"] if rng.random() < 0.5 else []
            if rng.random() < 0.1:
                shutil.copytree(base / "run", here / "run")
                (here / "run" / "result.json").write_bytes(generators.result(rng, text))
                return [(run(["gcs", "compare", "run", str(base / "run"), *as_json], here), READ)]
            (here / "x.mcap").write_bytes(generators.recording(rng, begin_with))
            lines: list[tuple[list[str], set[int]]] = [
                (["compare", "x.mcap", str(base / "run"), *as_json], READ),
                (["recover", "x.mcap", "--out", "new.mcap"], READ),
            ]
            if number % 10 == 0:
                lines.append((["plot", "x.mcap", "--what", "overview", "--out", "."], READ))
            if number % 10 == 5:
                lines.append((["replay", "x.mcap", "--speed", "max"], {0, 2, 3}))
            if number % 50 == 7:
                lines.append((["view", "x.mcap", "--no-open"], {0, 2, 3}))
            outcomes = []
            for words, codes in lines:
                serves = words[0] in ("view", "replay")
                done = run(["gcs", *words], here, SERVES_S if serves else 60.0)
                outcomes.append((done, codes | ({130} if done.interrupted else set())))
            return outcomes

    return attempt


def command_lines(base: Path, begin_with: Sequence[bytes], seed: int, instance: int) -> Attempt:
    """Random command lines, where missions, recordings and a law are at hand."""

    def attempt(number: int) -> list[tuple[Outcome, set[int]]]:
        rng = random.Random(f"command line {seed} {number}")
        with place(base, number) as here:
            shutil.copytree(base / "run", here / "run")
            (here / "hover.toml").write_text(HOVER)
            (here / "bad.toml").write_text("title = \n")
            (here / "law.py").write_text("x = 1\n")
            (here / "bad.mcap").write_bytes(b"x" * 100)
            (here / "cut.mcap").write_bytes(begin_with[-1])
            (here / "out").mkdir()
            words = ["gcs", *generators.command_line(rng, gcs, instance)]
            if rng.random() < 0.1:
                program = rng.choice(("fcu", "sitl-plant"))
                words = [program, *rng.choices(generators.WORDS, k=rng.randrange(4))]
            anew = number % EACH_ANEW == 0
            done = run(words, here, 2 * SERVES_S if anew else SERVES_S, anew=anew)
            codes = CODES.get(words[1] if len(words) > 1 else "", {0, 2})
            if words[0] != "gcs":
                codes = {0, 2, 3} | ({-signal.SIGINT} if done.interrupted else set())
            return [(done, codes | ({130} if done.interrupted else set()))]

    return attempt


class Started:
    """What `Flight` asks of a test: programs that are gone at the end."""

    def __init__(self, base: Path) -> None:
        self._base = base
        self.programs: list[Any] = []

    def __call__(self, module: str, *arguments: Any, **options: Any) -> Any:
        from tests.process.conftest import Program

        folder = self._base / f"{len(self.programs)}-{module}"
        folder.mkdir(parents=True)
        self.programs.append(Program(folder, module, *arguments, **options))
        return self.programs[-1]

    def close(self) -> None:
        for each in self.programs:
            each.kill()


def messages(base: Path, seed: int, each: int, tally: Tally, instance: int) -> int:
    """Every message of the dialect, `each` times with random fields, to a vehicle in flight.

    Every state that is sent meanwhile must be answered. Returns the number of messages.
    """
    from fcu.laws.mmrac.parameters import PARAMETERS
    from fcu.parameters import VEHICLE
    from tests.bad_input.hovering import Flight

    rng = random.Random(f"message {seed}")
    kinds = [kind for _, kind in sorted(mavlink.mavlink_map.items())]
    names = [each.name.encode() for each in (*PARAMETERS, *VEHICLE)]
    commands = sorted({*_commands(), *(rng.randrange(65536) for _ in range(20))})
    started = Started(base)
    sent = 0
    stack = contextlib.ExitStack()
    try:
        flight = stack.enter_context(contextlib.closing(Flight(started, instance)))
        flight.stream()
        flight.ask(176, 1, 6)
        flight.ask(400, 1)
        order = kinds * each
        rng.shuffle(order)
        for kind in order:
            made = generators.message(rng, kind, flight.at.system_id, names, commands)
            flight.mav.srcSystem, flight.mav.srcComponent = rng.choice(
                ((245, 190), (1, 1), (255, 0))
            )
            flight.raw(made.pack(flight.mav), rng.choice(("fcu_script", "fcu_station")))
            sent += 1
            if sent % 50 == 0:
                flight.tick(5)
                _met(flight, sent)
        _met(flight, sent)
        memory = _most(flight.program.pid)
        code = flight.program.interrupted()
    except (AssertionError, OSError) as error:
        tally.find(f"messages --seed {seed}, after {sent}: {type(error).__name__} {error}\n"
                   f"{started.programs[-1].text()[-2000:]}")  # fmt: skip
        return sent
    finally:
        stack.close()
        started.close()
    said = flight.program.text()
    tally.add(Outcome(("fcu",), code, said, memory, 0.0, True), {0}, f"messages --seed {seed}")
    return sent


def _commands() -> list[int]:
    from fcu.mavlink.definitions import CommandId

    return [int(each) for each in CommandId]


def _met(flight: Any, number: int) -> None:
    """All that was sent is read: a ping is answered. Also one that is sent too fast is asked again."""
    ping = mavlink.MAVLink_ping_message(7, number, 0, 0)
    flight.insist(ping, "PING")
    flight.drain()


def _most(pid: int) -> int:
    """Bytes of memory, the most since it was started."""
    status = Path(f"/proc/{pid}/status").read_text()
    return 1024 * int(status.split("VmHWM:")[1].split()[0])


@click.command(help=__doc__)
@click.option("--seed", default=1, show_default=True)
@click.option("--missions", "n_missions", default=2000, show_default=True)
@click.option("--recordings", "n_recordings", default=2000, show_default=True)
@click.option("--command-lines", "n_lines", default=1000, show_default=True)
@click.option("--messages", "n_messages", default=50, show_default=True, help="Of each kind.")
@click.option("--only", type=int, help="The one of this number, and not those before it.")
def main(
    seed: int, n_missions: int, n_recordings: int, n_lines: int, n_messages: int, only: int | None
) -> None:
    from tests.process.conftest import claimed_instance

    load()
    findings = 0
    with tempfile.TemporaryDirectory(prefix="attacks-") as name, claimed_instance() as instance:
        base = Path(name)
        begin_with = originals(base)
        groups: list[tuple[str, int, Callable[[], Attempt]]] = [
            ("missions", n_missions, lambda: missions(base, seed)),
            ("recordings", n_recordings, lambda: recordings(base, begin_with, seed)),
            ("command lines", n_lines, lambda: command_lines(base, begin_with, seed, instance)),
        ]
        lines = []
        for what, count, make in groups:
            if count:
                tally = Tally(click.echo)
                numbers = [only] if only is not None else range(count)
                attempts(what, seed, numbers, make(), tally)
                lines.append(f"| {what} {tally.line()}")
                click.echo(lines[-1], err=True)
                findings += len(tally.findings)
        if n_messages:
            tally = Tally(click.echo)
            sent = messages(base / "messages", seed, n_messages, tally, instance)
            lines.append(f"| {sent} messages to a vehicle {tally.line()}")
            findings += len(tally.findings)
    click.echo("\n".join((HEADER, "|---" * 7 + "|", *lines)))
    sys.exit(1 if findings else 0)


if __name__ == "__main__":
    main()
