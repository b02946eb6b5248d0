"""`python -m tests.equality record OUT` and `compare A B`: README.md tells what for."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import click

from tests.equality.cases import Case, cases
from tests.equality.comparison import compared, is_meant
from tests.equality.recording import NotRecorded, checkout_of, clear, record_case


@click.group()
def main() -> None:
    """Record what a checkout flies, says and writes, and compare two recordings."""


@main.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--python", type=click.Path(path_type=Path, exists=True), default=Path(sys.executable), help="Interpreter of the checkout to record; default: this one.")  # fmt: skip
@click.option("--only", multiple=True, metavar="PATTERN", help="Cases to record, for example 'missions/*'; may be repeated.")  # fmt: skip
@click.option("-j", "--jobs", type=click.IntRange(1), default=2, show_default=True, help="Cases at a time.")  # fmt: skip
@click.option("--list", "lists", is_flag=True, help="Print the names of the cases, and end.")
def record(out: Path, python: Path, only: tuple[str, ...], jobs: int, lists: bool) -> None:
    """Record everything to OUT, a folder: a folder for each case, a text file for each output."""
    python = python.absolute()
    checkout = checkout_of(python)
    chosen = [case for case in cases(checkout) if is_meant(case.name, only)]
    if lists:
        print(*(case.name for case in chosen), sep="\n")
        return
    if not chosen:
        raise click.UsageError(f"no case is named like {' or '.join(only)}")
    began = time.monotonic()
    failed: list[str] = []

    def run(case: Case) -> str:
        clear(out / case.name)
        try:
            record_case(case, python, checkout, out / case.name)
        except NotRecorded as error:
            failed.append(str(error))
            return f"NOT RECORDED {error}"
        return case.name

    with ThreadPoolExecutor(jobs) as pool:
        for number, name in enumerate(_done(pool, run, chosen), 1):
            print(f"{number:4d} of {len(chosen)}  {name}", flush=True)
    print(f"{len(chosen)} cases of {checkout} in {time.monotonic() - began:.0f} s")
    if failed:
        print(*failed, sep="\n")
        sys.exit(1)


def _done(pool: ThreadPoolExecutor, run, chosen: list[Case]) -> Iterator[str]:
    """Run the first alone, since it compiles, then the others at the same time."""
    yield run(chosen[0])
    yield from pool.map(run, chosen[1:])


@main.command()
@click.argument("a", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("b", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--all", "every", is_flag=True, help="Print each difference of each case.")
@click.option("--only", multiple=True, metavar="PATTERN", help="Cases to compare; may be repeated.")
def compare(a: Path, b: Path, every: bool, only: tuple[str, ...]) -> None:
    """Print what differs between two recordings. Exit with 1 if anything does."""
    sys.exit(0 if compared(a, b, every, only) else 1)


if __name__ == "__main__":
    main()
