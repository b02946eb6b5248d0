"""Changes the source in 200 places, one at a time, and looks whether a quick test fails.

python -m tests.mutation               # all: killers.json is written (`make mutate`)
python -m tests.mutation --tenth       # those of killers.json whose turn it is (`make mutate-tenth`)
python -m tests.mutation --room guard  # one room, whose part of killers.json is written

Exit code 1: fewer than 95 % are killed, or a survivor is not in equivalents.toml.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

from tests.mutation import sites, suite
from tests.mutation.sites import Mutant
from tests.mutation.suite import ROOT, Job, Place

HERE = Path(__file__).parent
ROOMS: dict[str, dict[str, Any]] = tomllib.loads((HERE / "rooms.toml").read_text())
EQUIVALENT: dict[str, str] = tomllib.loads((HERE / "equivalents.toml").read_text())
KILLERS = HERE / "killers.json"
KEPT = ROOT / ".mutation"  # of each test file: what it executes
WANTED = 0.95
LONGEST_S = 60.0  # of the tests that one mutant is given


class Seen(NamedTuple):
    """One test file on the unchanged source."""

    file: str
    took: dict[str, float]  # of tests that pass uncompiled, in time
    left_out: dict[str, str]  # test -> failed, skipped, late
    lines: dict[str, dict[str, set[int]]]  # source file -> test, "" for imports -> lines
    arcs: dict[str, set[tuple[int, int]]]


class Verdict(NamedTuple):
    """One mutant, and what noticed it."""

    mutant: Mutant
    killer: str  # a test, "timeout" or a signal; "" of a survivor
    tests: int  # that execute the place
    compiled: bool
    before: str
    after: str


# --- what tests execute


def digest(root: Path, names: list[str]) -> str:
    """A hash of the files that a test file executes, and of all that tests share."""
    shared = [*(root / "tests").glob("*.py"), *(root / "fcu").rglob("*.toml"),
              *(root / "missions").rglob("*.toml")]  # fmt: skip
    whole = hashlib.sha256()
    for path in sorted({*shared, *(root / name for name in names)}):
        whole.update(path.relative_to(root).as_posix().encode())
        whole.update(path.read_bytes() if path.is_file() else b"")
    return whole.hexdigest()


def beside(root: Path, file: str) -> list[str]:
    """The Python files of the folder of a test file."""
    folder = (root / file).parent
    return [file, *(p.relative_to(root).as_posix() for p in folder.glob("*.py")
                    if not p.name.startswith("test_"))]  # fmt: skip


def test_files(root: Path, rooms: dict[str, dict[str, Any]]) -> dict[str, list[str]]:
    """The test files of every room, from the root."""
    found: dict[str, list[str]] = {}
    for room, table in rooms.items():
        paths = [root / "tests" / name for name in table["tests"]]
        files = [f for p in paths for f in (sorted(p.glob("test_*.py")) if p.is_dir() else [p])]
        found[room] = [file.relative_to(root).as_posix() for file in files]
    return found


def seen_by(wanted: list[tuple[str, bool]], at: list[Place]) -> dict[tuple[str, bool], Seen]:
    """Lines and outcomes of each test file, compiled or not: as kept, or run if something has changed."""
    root, found = at[0].compiled.folder, {}
    todo = list(wanted)
    for again in (False, True):  # what has compiled kernels is run again, for its time
        jobs = []
        for file, compiled in todo:
            kept = _kept(file, compiled)
            told = json.loads(kept.read_text()) if kept.exists() else {}
            if (
                told
                and told["digest"] == digest(root, [*beside(root, file), *told["lines"]])
                and not again
            ):
                found[file, compiled] = _seen(file, told)
            else:
                jobs.append(Job(file, compiled, suite.seen_of(file), 600.0))
        todo = []
        for n, (job, run) in enumerate(suite.run_all(jobs, at), 1):
            told = run.result
            if "lines" not in told:
                print(f"{job.name}: left out: {run.ended or told.get('log', '')}", file=sys.stderr)
                continue
            if job.compiled and not again and sum(told["took"].values()) > 15.0:
                todo.append((job.name, True))
            told["digest"] = digest(root, [*beside(root, job.name), *told["lines"]])
            KEPT.mkdir(exist_ok=True)
            _kept(job.name, job.compiled).write_text(json.dumps(told))
            seen = found[job.name, job.compiled] = _seen(job.name, told)
            print(
                f"{n}/{len(jobs)} {job.name}{' compiled' * job.compiled}: {len(seen.took)} tests,"
                f" {len(seen.left_out)} left out, {run.took_s:.0f} s",
                file=sys.stderr,
            )
    return found


def _kept(file: str, compiled: bool) -> Path:
    return KEPT / f"{file.replace('/', '-')}-{'compiled' if compiled else 'plain'}.json"


def _seen(file: str, told: dict[str, Any]) -> Seen:
    passed = {name for name, outcome in told["outcome"].items() if outcome == "passed"}
    return Seen(
        file=file,
        took={name: s for name, s in told["took"].items() if name in passed},
        left_out={name: o for name, o in told["outcome"].items() if o != "passed"},
        lines={
            path: {test: set(lines) for test, lines in by_test.items()}
            for path, by_test in told["lines"].items()
        },
        arcs={path: {(a, b) for a, b in arcs} for path, arcs in told["arcs"].items()},
    )


def modes(mutant: Mutant, root: Path) -> tuple[bool, ...]:
    """Compiled or not, in the order of trying: a change of a kernel would compile for minutes."""
    if ROOMS[mutant.room].get("compiled", False):
        return (True,)
    source = (root / mutant.path).read_bytes()
    return (False,) if suite.is_compiled_code(mutant.path, source) else (False, True)


def tests_of(mutant: Mutant, files: list[Seen]) -> tuple[list[str], float]:
    """Tests that a mutant is given, and how long they take.

    First come those that execute its lines, of quick files first. Then come the others of these files,
    whose fixtures may have executed them.
    """
    span = set(range(mutant.first, mutant.last + 1))
    groups = []
    took_by: dict[str, float] = {}
    for file in files:
        by_test, took = file.lines.get(mutant.path, {}), file.took
        took_by |= took
        touched = {test for test, lines in by_test.items() if lines & span}
        if not touched:
            continue
        near = touched if touched - {""} else set(by_test)
        first = sorted((t for t in took if t in near), key=lambda t: took[t])
        rest = [t for t in took if t not in near]
        groups.append((took[first[0]] if first else 1e3, first, rest))
    chosen, total = [], 0.0
    for _, first, rest in sorted(groups):
        for test in (*first, *rest):
            s = took_by[test]
            if total + s <= LONGEST_S:
                chosen.append(test)
                total += s
    return chosen, total


# --- coverage


def coverage_of(seen: list[Seen], root: Path) -> dict[str, tuple[int, int, int, int]]:
    """Lines and branches by room: executed, all, branches taken, all."""
    from coverage.python import PythonParser

    told = {}
    for room, table in ROOMS.items():
        counts = [0, 0, 0, 0]
        for path in sites.files(root, table["paths"], table.get("without", ())):
            name = path.relative_to(root).as_posix()
            parser = PythonParser(
                text=path.read_text(), filename=str(path), exclude=r"TYPE_CHECKING"
            )
            parser.parse_source()
            lines: set[int] = set()
            arcs: set[tuple[int, int]] = set()
            for each in seen:
                for own in each.lines.get(name, {}).values():
                    lines |= own
                arcs |= each.arcs.get(name, set())
            lines = set(parser.translate_lines(lines))
            arcs = set(parser.translate_arcs(arcs))
            starts = {line for line, n in parser.exit_counts().items() if n > 1}
            possible = {arc for arc in parser.arcs() if arc[0] in starts}
            for n, found in enumerate((
                parser.statements & lines, parser.statements, possible & arcs, possible,
            )):  # fmt: skip
                counts[n] += len(found)
        told[room] = (counts[0], counts[1], counts[2], counts[3])
    return told


# --- mutants


class Given(NamedTuple):
    """A mutant, and the tests that it is given."""

    mutant: Mutant
    compiled: bool
    tests: list[str]
    took_s: float


def mutate(given: list[Given], at: list[Place], progress: bool = True) -> list[Verdict]:
    """Run the tests of every mutant until one fails."""
    root, of_name, jobs, verdicts = at[0].compiled.folder, {}, [], []
    for mutant, compiled, tests, took in given:
        source = (root / mutant.path).read_bytes()
        before, after = mutant.lines(source)
        of_name[mutant.name] = Verdict(mutant, "", len(tests), compiled, before, after)
        if tests:
            jobs.append(Job(
                mutant.name, compiled, suite.first_failure(tests), 2.0 * took + suite.SPARE_S,
                mutant.path, mutant.applied(source), source,
            ))  # fmt: skip
        else:
            verdicts.append(of_name[mutant.name])
    for n, (job, run) in enumerate(suite.run_all(jobs, at), 1):
        killer = run.ended or run.result.get("killer") or ""
        if not killer and run.result.get("code") not in (
            0,
            5,
        ):  # all passed, or none of them is there
            killer = f"exit code {run.result.get('code')}"
        verdicts.append(of_name[job.name]._replace(killer=killer))
        if progress:
            print(f"{n}/{len(jobs)} {told(verdicts[-1])} {run.took_s:.1f} s", file=sys.stderr)
    return verdicts


def told(verdict: Verdict) -> str:
    """One line: killed or not, where, by what."""
    mutant = verdict.mutant
    return (
        f"{'killed' if verdict.killer else 'SURVIVED'} {mutant.path}:{mutant.line} {verdict.killer}"
    )


def unsound(verdicts: list[Verdict], at: list[Place]) -> set[str]:
    """The tests that killed a mutant, and fail on the unchanged source as well."""
    by_file: dict[tuple[str, bool], set[str]] = defaultdict(set)
    for verdict in verdicts:
        if "::" in verdict.killer:
            file = verdict.killer.partition("::")[0]
            by_file[file, verdict.compiled].add(verdict.killer)
    jobs = [
        Job(f, c, suite.first_failure(sorted(t)), 300.0) for (f, c), t in sorted(by_file.items())
    ]
    failed = set()
    for job, run in suite.run_all(jobs, at):
        if run.ended or run.result.get("code") != 0:
            failed.add(run.result.get("killer") or job.name)
    return failed


def drawn(root: Path, rooms: list[str]) -> list[Mutant]:
    """The mutants of rooms."""
    found = []
    for room in rooms:
        table = ROOMS[room]
        files = sites.files(root, table["paths"], table.get("without", ()))
        found += sites.drawn(sites.mutants(root, room, files), table["count"])
    return found


def turn() -> int:
    """Which tenth it is: of the hash of the commit, or of the sources where there is no commit."""
    command = ["git", "-C", str(ROOT), "rev-parse", "HEAD"]
    try:
        head = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        head = hashlib.sha256(KILLERS.read_bytes()).hexdigest()
    return int(head, 16) % 10


def all_of(rooms: list[str], at: list[Place]) -> tuple[list[Verdict], dict[str, Any]]:
    """Draw, see what tests execute, and run: uncompiled first, then the rest compiled where it can be."""
    root, began, mapped = at[0].compiled.folder, time.monotonic(), 0.0
    files = test_files(root, {room: ROOMS[room] for room in rooms})
    seen: dict[tuple[str, bool], Seen] = {}
    done: dict[str, Verdict] = {}
    for compiled in (False, True):
        todo = [
            mutant for mutant in drawn(root, rooms)
            if compiled in modes(mutant, root) and not (mutant.name in done and done[mutant.name].killer)
        ]  # fmt: skip
        start = time.monotonic()
        wanted = sorted({(file, compiled) for mutant in todo for file in files[mutant.room]})
        seen |= seen_by(wanted, at)
        mapped += time.monotonic() - start
        given = []
        for mutant in todo:
            own = [seen[f, compiled] for f in files[mutant.room] if (f, compiled) in seen]
            given.append(Given(mutant, compiled, *tests_of(mutant, own)))
        for verdict in sound(given, at):
            before = done.get(verdict.mutant.name, verdict)
            done[verdict.mutant.name] = verdict._replace(tests=max(verdict.tests, before.tests))
    branches = coverage_of(list(seen.values()), root)
    more = {
        "map_s": round(mapped, 1),
        "mutants_s": round(time.monotonic() - began - mapped, 1),
        "left_out": {
            f"{name}{' compiled' * compiled}": why
            for (_, compiled), each in seen.items() for name, why in each.left_out.items()
        },
        "coverage": {room: branches[room] for room in rooms},
    }  # fmt: skip
    return list(done.values()), more


def sound(given: list[Given], at: list[Place]) -> list[Verdict]:
    """Run the mutants, without the tests that turn out to fail on the unchanged source as well."""
    verdicts = mutate(given, at)
    while failed := unsound(verdicts, at):
        print(f"fail on the unchanged source: {', '.join(sorted(failed))}", file=sys.stderr)
        given = [g._replace(tests=[t for t in g.tests if t not in failed]) for g in given]
        again = {v.mutant.name for v in verdicts if v.killer in failed}
        verdicts = [v for v in verdicts if v.mutant.name not in again]
        verdicts += mutate([g for g in given if g.mutant.name in again], at)
    return verdicts


def tenth_of(n: int, at: list[Place]) -> tuple[list[Verdict], dict[str, Any]]:
    """Run again what killed each mutant whose turn it is, where its place is still there."""
    root, began = at[0].compiled.folder, time.monotonic()
    kept = {
        name: row
        for name, row in json.loads(KILLERS.read_text()).items()
        if int(name, 16) % 10 == n
    }
    there = {}
    for room, table in ROOMS.items():
        files = sites.files(root, table["paths"], table.get("without", ()))
        there |= {m.name: m for m in sites.mutants(root, room, files) if m.name in kept}
    given = []
    for name, row in kept.items():
        if name in there and (root / row["killer"].partition("::")[0]).is_file():
            given.append(Given(there[name], row["compiled"], [row["killer"]], 60.0))
    verdicts = mutate(given, at)
    gone = sorted(kept.keys() - {each.mutant.name for each in given})
    return verdicts, {"gone": gone, "mutants_s": round(time.monotonic() - began, 1)}


def report(verdicts: list[Verdict], more: dict[str, Any]) -> None:
    """A table by room, then the survivors."""
    rows = defaultdict(list)
    for verdict in verdicts:
        rows[verdict.mutant.room].append(verdict)
    branches = more.get("coverage", {})
    print(f"{'room':12} {'killed':>8}" + (f" {'lines':>7} {'branches':>9}" if branches else ""))
    for room in ROOMS:
        if room not in rows:
            continue
        killed = sum(bool(v.killer) for v in rows[room])
        line = f"{room:12} {killed:>4}/{len(rows[room]):<3}"
        if room in branches:
            a, b, c, d = branches[room]
            line += f" {a / b:>7.1%}" + (f" {c / d:>9.1%}" if d else f" {'-':>9}")
        print(line)
    killed = sum(bool(v.killer) for v in verdicts)
    line = f"{'all':12} {killed:>4}/{len(verdicts):<3}"
    if branches:
        a, b, c, d = map(sum, zip(*branches.values(), strict=True))
        line += f" {a / max(b, 1):>7.1%} {c / max(d, 1):>9.1%}"
    print(line)
    timeouts = [v for v in verdicts if v.killer == "timeout"]
    print(f"of these by a timeout: {len(timeouts)}")
    for verdict in sorted(verdicts, key=lambda v: (v.mutant.room, v.mutant.path, v.mutant.line)):
        if not verdict.killer:
            mutant = verdict.mutant
            reason = EQUIVALENT.get(mutant.name)
            print(f"\n{mutant.path}:{mutant.line} {mutant.name} {mutant.operator}:"
                  f" {f'equivalent: {reason}' if reason else 'SURVIVED'}"
                  f" ({verdict.tests} tests)")  # fmt: skip
            print(f"- {verdict.before}\n+ {verdict.after}")


def main() -> int:
    """Run as the command line says."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.mutation", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--tenth", action="store_true", help="those whose turn it is, by the commit"
    )
    parser.add_argument("--turn", type=int, choices=range(10), help="the tenth to run (0 to 9)")
    parser.add_argument("--room", action="append", choices=list(ROOMS), help="this room alone")
    parser.add_argument("--json", action="store_true", help="the report as JSON")
    parser.add_argument("-j", type=int, default=min(2, os.cpu_count() or 1), help="at a time")
    parser.add_argument("--draw", action="store_true", help="show the changes, and run nothing")
    chosen = parser.parse_args()
    chosen.tenth |= chosen.turn is not None
    rooms = chosen.room or list(ROOMS)
    if chosen.draw:
        for mutant in drawn(ROOT, rooms):
            before, after = mutant.lines((ROOT / mutant.path).read_bytes())
            print(
                f"{mutant.path}:{mutant.line} {mutant.name} {mutant.operator}\n- {before}\n+ {after}"
            )
        return 0
    signal.signal(
        signal.SIGTERM, lambda *_: sys.exit(143)
    )  # ends what runs, and removes the copies
    suite.preload()
    with tempfile.TemporaryDirectory(prefix="mutation-") as folder:
        at = suite.places(Path(folder), chosen.j)
        if chosen.tenth:
            n = turn() if chosen.turn is None else chosen.turn
            verdicts, more = tenth_of(n, at)
        else:
            verdicts, more = all_of(rooms, at)
    survivors = [v for v in verdicts if not v.killer]
    listed = [v for v in survivors if v.mutant.name in EQUIVALENT]
    if chosen.json:
        print(json.dumps({
            "killed": len(verdicts) - len(survivors), "all": len(verdicts), **more,
            "mutants": [{**v.mutant._asdict(), "killer": v.killer, "tests": v.tests, "before": v.before,
                         "after": v.after, "equivalent": EQUIVALENT.get(v.mutant.name)} for v in verdicts],
        }, indent=1))  # fmt: skip
    else:
        report(verdicts, more)
    if not chosen.tenth:
        others = json.loads(KILLERS.read_text()) if chosen.room and KILLERS.exists() else {}
        table = {name: row for name, row in others.items() if row["room"] not in rooms}
        table |= {
            v.mutant.name: {"room": v.mutant.room, "path": v.mutant.path, "before": v.before,
                            "after": v.after, "killer": v.killer, "compiled": v.compiled}
            for v in verdicts if v.killer
        }  # fmt: skip
        ordered = dict(sorted(table.items()))
        KILLERS.write_text(json.dumps(ordered, indent=1, ensure_ascii=False) + "\n")
    if 2 * len(more.get("gone", ())) > len(verdicts):
        print(
            "most of killers.json is gone: run `make mutate`, and commit the file", file=sys.stderr
        )
        return 1
    enough = len(verdicts) - len(survivors) >= WANTED * len(verdicts)
    return 0 if enough and len(listed) == len(survivors) else 1


if __name__ == "__main__":
    sys.exit(main())
