"""Many flights on the simulator in C, from inside what `fcu` believes: python -m tests.foreign_plant.campaign

Each policy flies the same draws (`flights.py`), and what was flown is kept in a file (`flights_file.py`).

*Saturated*: from 3 s after take-over until it lands, the thrust or the tilt is at its limit by the truth, or a
rotor is, its share of yaw's torque left out (`told`: the vehicle says so, of yaw too). *Lost*: the simulator says it. *Not
arrived*: at the end of the mode the vehicle is more than 0.5 m from the place that it was sent to, or still
moves in modes that have none, or stays armed after the landing. *Late*: of a step from rest whose arrival is
announced (`gcs envelope`), the vehicle is not within 0.3 m 1.1 times as long after it, or leaves again.
*In landing*: the same limits from the moment at which it is told to land. *Landing*: rotors that still turn 3 s
after the contact, or that were cut above 0.05 m once it was told to land (of a return: below 3 m at home), or a vehicle that tips over. The ground rises or falls by up to
8 degrees in half of the flights, from 3 m about the start on. Under `warn` nobody holds the
vehicle: what part of these flights saturates says how hard the draws are.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from gcs_tools.campaigns.statistics import interval
from tests.foreign_plant.computed_winds import WindsError, read
from tests.foreign_plant.flights import AIRFRAMES, MODES, POLICIES, Found, believed, drawn, fly
from tests.foreign_plant.flights_file import CampaignError, counted, fingerprint, opened
from tests.foreign_plant.fly import compile_plant

LATE_S = 3.0  # from the contact to rotors that are stopped
CUT_M = 0.05  # above the ground with rotors cut
WRONG_USE, DIED = 2, 3  # exit codes
COMPUTED, ANSWERS = WINDS = ("computed winds", "winds that answer")

COUNTED: dict[str, Callable[[Found], bool]] = {
    "saturated": lambda each: bool(each["saturated"]),
    "in landing": lambda each: bool(each["saturated_landing"]),
    "lost": lambda each: bool(each["lost"]),
    "not arrived": lambda each: not each["arrived"],
    "late": lambda each: bool(each["late"]),
    "landing": lambda each: bool(landing_faults(each)),
}


def landing_faults(found: Found) -> list[str]:
    """Return what was wrong with the landing: not disarmed in time, rotors cut in the air, tipped over."""
    took, faults = found.get("disarmed_s"), []
    if took is None or took > LATE_S:
        faults.append("late to disarm")
    if (found.get("cut_m") or 0.0) > CUT_M:
        faults.append("cut in the air")
    if found.get("lost") in ("tipped", "impact"):
        faults.append(found["lost"])
    return faults


def kept(found: Found) -> bool:
    """Return whether a flight is as promised."""
    return not any(counts(found) for counts in COUNTED.values())


def shares(found: list[Found]) -> str:
    """Return the counts of flights, each with the interval that holds 95 %, in percent."""
    cells = []
    for what, counts in COUNTED.items():
        of = [each for each in found if each.get("announced_s")] if what == "late" else found
        many = sum(map(counts, of))
        low, high = interval(many, len(of)) if of else (0.0, 1.0)
        cells.append(f"{many} of {len(of)} ({100.0 * low:.2f} to {100.0 * high:.2f})")
    return " | ".join(cells)


def table(found: list[Found]) -> str:
    """Return the counts of each policy, airframe, mode and kind of wind."""
    lines = [f"| | {' | '.join(COUNTED)} |", f"|---|{'--:|' * len(COUNTED)}"]
    for policy in sorted({each["policy"] for each in found}):
        flown = [each for each in found if each["policy"] == policy]
        lines.append(f"| **{policy}** | {shares(flown)} |")
        for key, kinds in (("airframe", AIRFRAMES), ("mode", tuple(MODES)), ("wind", WINDS)):
            for kind in kinds:
                if some := [each for each in flown if (each["wind"] == "series" if kind == COMPUTED else
                                                       each["wind"] != "series" if kind == ANSWERS else each[key] == kind)]:  # fmt: skip
                    lines.append(f"| {kind} | {shares(some)} |")
    return "\n".join(lines)


def fly_all(asked: Sequence[tuple[str, Found]], program: Path, jobs: int) -> Iterator[Found]:
    """Fly each by its policy, `jobs` at a time, in processes that have loaded `fcu`."""
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"))
    try:
        yield from pool.map(_fly, [(program, policy, made) for policy, made in asked])
    finally:
        pool.shutdown(cancel_futures=True)


def _fly(one: tuple[Path, str, Found]) -> Found:
    """Fly one, in a process of the pool."""
    return fly(*one)


def _number(least: int) -> Callable[[str], int]:
    """Return what reads a whole number of an option, of `least` or more."""

    def whole(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least:
            raise argparse.ArgumentTypeError(
                f"expected a whole number of {least} or more, got {text}"
            )
        return value

    return whole


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly what is asked and not yet flown, and print the table. Exit codes: 1 not as promised, 2 wrong use, 3 a process died."""
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--flights", type=_number(1), default=100, help="of each policy")
    words.add_argument("--policy", choices=POLICIES, action="append", help="default: all of them")
    words.add_argument("--first-seed", type=_number(0), default=1, help="of these flights, in a row")  # fmt: skip
    words.add_argument("--computed", type=Path, help="of `computed_winds`: half fly in these winds")
    words.add_argument("--out", type=Path, default=Path("foreign.jsonl"), help="added to; what it has is not flown again")  # fmt: skip
    words.add_argument("-j", "--jobs", type=_number(1), default=1)
    given = words.parse_args(arguments)
    try:
        return _flown(given)
    except (CampaignError, WindsError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return WRONG_USE
    except OSError as error:
        print(f"Error: {error.filename or given.out}: {error.strerror or error}", file=sys.stderr)
        return WRONG_USE
    except BrokenProcessPool:
        print("Error: a process that flew has died: start again, what it flew is flown anew", file=sys.stderr)  # fmt: skip
        return DIED


def _flown(given: argparse.Namespace) -> int:
    """Fly what is asked and not yet flown. Raises CampaignError, WindsError, OSError, BrokenProcessPool."""
    computed = read(given.computed) if given.computed else []
    made_of = fingerprint(given.computed)
    policies = [each for each in POLICIES if each in (given.policy or POLICIES)]
    seeds = range(given.first_seed, given.first_seed + given.flights)
    asked = [(policy, seed) for seed in seeds for policy in policies]
    with opened(given.out, made_of) as (found, out), tempfile.TemporaryDirectory() as name:
        has = {(each["policy"], each["seed"]) for each in found}
        if rest := [key for key in asked if key not in has]:
            beliefs = {airframe: believed(airframe) for airframe in AIRFRAMES}
            made = [(policy, drawn(seed, beliefs, computed)) for policy, seed in rest]
            for each in fly_all(made, compile_plant(Path(name)), given.jobs):
                found.append(each | {"fingerprint": made_of})
                out.write(f"{json.dumps(found[-1])}\n")
    flown = counted(found, asked)
    print(table(flown))
    return any(not kept(each) for each in flown if each["policy"] != "warn")


if __name__ == "__main__":
    sys.exit(main())
