"""Nine actions with plans by client, each judged by what the vehicle did: the table of docs/plans.md.

    python -m tests.clients.plan_table --out FOLDER --table docs/plans.md
    python -m tests.clients.plan_table --out FOLDER --only Rust --built tests/clients/plan_rust/target/debug

A client uploads a plan, a fence and a rally point, downloads the plan, flies it, pauses, resumes, sets another item as
the next and clears the plan. Each flies with a vehicle and a network of its own. The recording says what came of it, but
for the download, which the client compares with what it sent. Clients that `make clients` does not install are named by
--python and --built, as for public_scripts. A client that is not there is left out. Needs Linux with `unshare`.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.event_log import Event
from fcu.interface.ports import ports
from gcs_tools.recording.plans import PlanHistory
from gcs_tools.recording.reader import read
from tests.clients.plan_places import write
from tests.clients.public_scripts import Runner, Script
from tests.clients.typed import END

HERE = Path(__file__).parent
ACTIONS = ("upload", "fly", "pause", "resume", "jump", "download", "clear", "fence", "rally")
MARKS = "<!-- clients: begin -->", "<!-- clients: end -->"
PACE = "speed:3"
UP_M = 4.0
NEAR_M = 1.5  # of a rally point, where the vehicle lands
STATION = "udpout:127.0.0.1:{fcu_station}"


@dataclass(frozen=True)
class Client:
    """One row of the table."""

    name: str
    program: str  # {python}: its Python, {here}: this folder, {places}: a folder with the plan's files, and ports
    python: str = ""  # name of --python. Empty: this one
    typed: tuple[tuple[str, str], ...] = ()
    pythonpath: tuple[str, ...] = ()
    environment: str = ""  # words of `env`
    built: str = ""  # a program of --built
    lacks: dict[str, str] = field(default_factory=dict)  # actions that the client has not, and why


# what is written, as a regular expression, and the line that is typed then
MAVPROXY = (
    (r"Received \d+ parameters", "wp load {places}/plan.waypoints"),
    (r"Loaded 5 waypoints in", "wp list"),
    (r"(?s)Requesting 5 waypoints.*\n20 ", "fence load {places}/fence.waypoints"),
    (r"Loaded 4 fence items in", "rally load {places}/rally.waypoints"),
    (r"Loaded 1 rally items in", "long DO_SET_MODE 1 4 4"),
    (r"Mode MISSION", "arm throttle"),
    (r"ARMED", ""),
    (r"waypoint 1", "long DO_SET_MODE 1 4 3"),
    (r"Mode LOITER", "long DO_SET_MODE 1 4 4"),
    (r"Mode MISSION", "wp set 3"),
    (r"DISARMED", "wp clear"),
    (r"Mission cleared", "wp list"),
    (r"Requesting 0 waypoints", END),
)
CLIENTS = (
    Client("MAVSDK 4 (package mavsdk)", "{python} {here}/plan_mavsdk.py {script}"),
    Client("MAVSDK 4 (package mavsdk-grpc)", "{python} {here}/plan_mavsdk_grpc.py udpin://127.0.0.1:{script} mavsdk_grpc"),
    Client("MAVSDK 3", "{python} {here}/plan_mavsdk_grpc.py udpin://127.0.0.1:{script} mavsdk", python="mavsdk3"),
    Client(
        "MAVProxy, typed in", "{python} {bin}/mavproxy.py --master=" + STATION + " --state-basedir=.", typed=MAVPROXY,
    ),
    Client(
        "DroneKit", "{python} {here}/plan_dronekit.py " + STATION, python="dronekit",
        lacks={"fence": "by its message factory", "rally": "by its message factory"},
    ),
    Client("pymavlink's mavwp, MAVLink 2", "{python} {here}/plan_mavwp.py " + STATION + " kinds"),
    Client(
        "pymavlink's mavwp, MAVLink 1", "{python} {here}/plan_mavwp.py " + STATION, environment="-u MAVLINK20",
        lacks={"fence": "MAVLink 1 has none", "rally": "MAVLink 1 has none"},
    ),
    Client("MAVROS, its plugins' messages", "{python} {here}/plan_mavros.py", pythonpath=("ros",)),
    Client("Rust, crate mavlink", "127.0.0.1:{fcu_station}", built="plan_rust"),
)  # fmt: skip


def modes(events: list[Event], since: float) -> str:
    """The modes of a flight from a time on, in turn."""
    found = (event for event in events if event.code == "MODE" and event.t >= since)
    return " ".join(str(event.values[0]) for event in found)


def done(run: Path) -> Iterator[str]:
    """The actions that the recording of a run shows, and the download if the client has written of it."""
    recording, told = read(run / "flight.mcap"), json.loads((run / "result.json").read_text())
    history = PlanHistory(recording.events)
    last = float(recording.events[-1].t) if recording.events else 0.0
    times = sorted({event.t for event in recording.events} | {last})
    ever = [history.at(t) for t in times]
    plans = [plan for plan in ever if plan.mission]
    if plans:
        yield "upload"
    said = (run / "script.log").read_text(errors="replace")
    steps = [step for step in history.steps() if step[1] > 0]
    r_E = np.asarray(recording.plant["state.r_E"])
    is_up = r_E[:, 2] > UP_M
    if is_up.any() and any(reached >= 0 for _, _, reached in steps):
        yield "fly"
    since = float(recording.plant["t"][int(is_up.argmax())]) if is_up.any() else math.inf
    in_turn = modes(recording.events, since)
    if "Hold" in in_turn:
        yield "pause"
    if re.search(r"Hold.* Mission", in_turn):
        yield "resume"
    if any(current > reached + 1 for _, current, reached in steps):
        yield "jump"
    if re.search(r"^(download|given back)|Requesting 5 waypoints", said, re.MULTILINE):
        yield "download"
    if plans and not history.at(last).mission and told["script"]["exit_code"] == 0:
        yield "clear"
    if any(plan.fence for plan in ever):
        yield "fence"
    rests = recording.plant["on_ground"][-1] > 0.5
    if rests and any(
        math.dist(r_E[-1][:2], (p.x, p.y)) < NEAR_M for plan in ever for p in plan.rally
    ):
        yield "rally"


class PlanRunner:
    """Flies clients: each in a folder of its own below `out`."""

    def __init__(
        self, out: Path, pythons: dict[str, str], built: Path, instance: int = 0, **runner: Any
    ) -> None:
        """`runner`: of the Runner of public_scripts."""
        self._places, self._pythons, self._built = out / "places", pythons, built
        self._places.mkdir(parents=True, exist_ok=True)
        write(self._places)
        self._runner = Runner(HERE, out, pythons, pace=PACE, instance=instance, **runner)
        self._ports = ports(instance)._asdict()

    def is_there(self, client: Client) -> bool:
        """Tell whether the client is installed or built."""
        if client.built:
            return (self._built / client.built).is_file()
        return not client.python or client.python in self._pythons

    def fly(self, client: Client) -> tuple[set[str], str]:
        """Fly the client. Returns the actions that it did, and the end of its output."""
        program = self._words(client, client.program)
        if client.built:
            program = f"{(self._built / client.built).absolute()} {program}"
        # a command that does not name the instance is taken for one of instance 0
        program = f"env {client.environment} INSTANCE={{instance}} {program}"
        script = Script(
            repository="", commit="", client=client.name, path=client.name, does="", program=program,
            typed=tuple((after, self._words(client, line)) for after, line in client.typed),
            pythonpath=client.pythonpath, for_s=600.0, lands=True,
        )  # fmt: skip
        run = self._runner.run(script)
        log = run / "script.log"
        if not (run / "flight.mcap").is_file():
            return set(), (run.parent / "gcs.log").read_text()[-2000:]
        return set(done(run)), log.read_text(errors="replace")[-2000:]

    def _words(self, client: Client, line: str) -> str:
        python = self._pythons.get(client.python, sys.executable)
        return line.format(python=python, here=HERE, places=self._places.absolute(), bin=Path(python).parent, **self._ports)  # fmt: skip


def table(results: dict[str, list[str]]) -> str:
    """The table of all clients that have flown, as Markdown."""
    lines = [f"| | {' | '.join(ACTIONS)} |", "|---" * (len(ACTIONS) + 1) + "|"]
    for client in CLIENTS:
        if client.name in results:
            did = results[client.name]
            cells = []
            for action in ACTIONS:
                why = client.lacks.get(action, "")
                cells.append(f"yes, {why}" if why and action in did else why or ("yes" if action in did else "no"))  # fmt: skip
            lines.append(f"| {client.name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> int:
    """Fly the clients that are there. Exit code 1: one did not do an action that it has."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs and results.json")  # fmt: skip
    parser.add_argument("--only", default="", help="regular expression: clients by name")
    parser.add_argument("--python", action="append", default=[], metavar="NAME=PROGRAM", help="the Python with a client")  # fmt: skip
    parser.add_argument("--built", type=Path, default=Path(), help="folder of the programs that are compiled")  # fmt: skip
    parser.add_argument("--table", type=Path, help="page whose table is written anew")
    given = parser.parse_args()
    runner = PlanRunner(given.out.absolute(), dict(each.split("=", 1) for each in given.python), given.built)  # fmt: skip
    kept = given.out / "results.json"
    results = json.loads(kept.read_text()) if kept.exists() else {}
    missed = 0
    for client in CLIENTS:
        if not re.search(given.only, client.name) or not runner.is_there(client):
            continue
        did, said = runner.fly(client)
        lacks = [each for each in ACTIONS if each not in did and each not in client.lacks]
        missed += bool(lacks)
        print(f"{client.name}: {', '.join(lacks) or 'all'}" + (f" missed, after\n{said}" if lacks else ""), flush=True)  # fmt: skip
        results[client.name] = sorted(did)
        kept.write_text(json.dumps(results, indent=1))
    if given.table:
        page = given.table.read_text()
        before, rest = page.split(MARKS[0])
        given.table.write_text(f"{before}{MARKS[0]}\n{table(results)}\n{MARKS[1]}{rest.split(MARKS[1])[1]}")  # fmt: skip
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
