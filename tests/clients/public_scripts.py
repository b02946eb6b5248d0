"""Public scripts, unmodified, against the vehicle, each flown and judged by where the vehicle truly was.

    python -m tests.clients.public_scripts CLONES --out FOLDER
    python -m tests.clients.public_scripts CLONES --out FOLDER --only goto --table docs/clients.md

CLONES holds git repositories as OWNER/NAME. public_scripts.toml lists the scripts. Each is run in a clean copy of
its commit, with a vehicle and a network of its own, so the ports that scripts have written into them do not
collide, and several fly at once. What came of each is in FOLDER/results.json, which a later call adds to. The table
is written between two marks of the page. An example that is compiled is a program that you have built as its
repository says, in --built FOLDER/OWNER/NAME. Needs Linux with `unshare`, and git.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fcu.interface.ports import ports
from gcs_tools.recording.reader import read

ROOT = Path(__file__).resolve().parents[2]
LIST = Path(__file__).with_name("public_scripts.toml")
TYPED = Path(__file__).with_name("typed.py")
ROS = Path(__file__).with_name("ros")
FLIES, WORKS, NOT = "flies", "works without flying", "does not"
MARKS = "<!-- flown: begin -->", "<!-- flown: end -->"
ALONE = [
    "unshare",
    "--user",
    "--map-root-user",
    "--net",
    "--pid",
    "--fork",
    "--kill-child",
    "--mount-proc",
]
ERROR = re.compile(
    r"^(?!.*(CancelledError|TimeoutError: *$))[\w.]*(Error|Exception)\b|never retrieved",
    re.MULTILINE,
)


@dataclass(frozen=True)
class Script:
    """One entry of the list."""

    repository: str
    commit: str
    client: str
    path: str
    does: str  # what it is for
    under: str = "."  # the folder of the repository that is copied
    python: str = (
        ""  # name of the Python that has its client: --python NAME=PROGRAM. Empty: this one
    )
    pythonpath: tuple[str, ...] = ()  # folders of its repository; "ros": the stand-in for ROS
    arguments: str = ""
    parameters: dict[str, Any] = field(default_factory=dict)  # of ROS
    program: str = ""  # in place of Python and the file: for what is typed into a program
    built: str = ""  # the program that its repository builds of it, in --built FOLDER/OWNER/NAME
    beside: str = ""  # a program of --built that runs beside it, and its arguments
    ready: str = ""  # what the program beside writes before the script begins
    addresses: tuple[str, ...] = ()  # more addresses of this machine, in the script's network
    typed: tuple[
        tuple[str, str], ...
    ] = ()  # a text that it writes, and the line that is then typed
    router: str = ""  # MAVProxy passes the station's link on to this address
    air: bool = False  # the vehicle begins in the air
    up_m: float = 0.0  # it flies if the vehicle was so high above the ground,
    away_m: float = 0.0  # or, from the air, so far from where it began,
    lands: bool = False  # and then lands and disarms
    for_s: float = 120.0  # simulated seconds that it has
    endless: bool = False  # it ends when it is ended
    code: int = 0  # the exit code of its own that means success
    says: str = ""  # regular expression: what it writes when it has done what it is for
    logged: str = ""  # regular expression: what the autopilot's log then has
    wants: str = ""  # what it wants that the vehicle has not

    @property
    def name(self) -> str:
        """Repository and path."""
        return f"{self.repository}: {self.path}"


@dataclass(frozen=True)
class Flown:
    """Verdict on one script, and how it came."""

    verdict: str
    did: str
    why: str
    at: str  # commit of this project


def listed() -> list[Script]:
    """Every script of the list."""
    tables = tomllib.loads(LIST.read_text())
    scripts = []
    for repository, table in tables.items():
        shared = {key: value for key, value in table.items() if key != "scripts"}
        for path, own in table["scripts"].items():
            fields = {"path": path, **shared, **own}
            for several in ("pythonpath", "addresses"):
                fields[several] = tuple(fields.get(several, ()))
            fields["typed"] = tuple((after, line) for after, line in fields.get("typed", ()))
            scripts.append(Script(repository=repository, **fields))
    return scripts


class Runner:
    """Flies scripts: each in a folder of its own below `out`."""

    def __init__(
        self, clones: Path, out: Path, pythons: dict[str, str], instance: int = 0,
        network: bool = True, pace: str = "real", built: Path = Path(),
    ) -> None:  # fmt: skip
        """`pythons`: a client's Python by its name. `network`: each script has a network of its own.

        `built`: folder of the programs that compiled examples became, OWNER/NAME.
        """
        self._clones, self._out, self._pythons, self._built = clones, out, pythons, built
        self._instance, self._network, self._pace = instance, network, pace
        self._at = _told(["git", "-C", str(ROOT), "rev-parse", "--short=7", "HEAD"]).strip()

    def fly(self, script: Script) -> Flown:
        """The script, flown and judged."""
        self.run(script)
        return self.judged(script)

    def run(self, script: Script) -> Path:
        """Fly the script. Returns the folder of its run."""
        folder = self._folder(script)
        subprocess.run(["rm", "-rf", str(folder)], check=True)
        copy, run = folder / "copy", folder / "run"
        copy.mkdir(parents=True)
        self._copied(script, copy)
        place = (copy / script.path).parent if not script.program else copy
        place.mkdir(parents=True, exist_ok=True)
        mission = place / "public_script.toml"
        mission.write_text(self._mission(script, copy))
        fly = [sys.executable, "-m", "gcs_tools", "fly", str(mission), "--allow-commands"]
        fly += ["--instance", str(self._instance), "--record", "light", "--figure", "never"]
        fly += ["--out", str(run)]
        begun = ["ip link set lo up"] if self._network else []
        begun += [f"ip addr add {each} dev lo" for each in script.addresses]
        if script.router:
            router = Path(sys.executable).with_name("mavproxy.py")
            begun.append(
                f"({sys.executable} {router} --master=udpin:127.0.0.1:14550 --out={script.router}"
                f" --daemon --non-interactive --state-basedir={folder}) >{folder}/router.log 2>&1 &"
            )
        begun.append(f"exec {shlex.join(fly)}")
        at = ports(self._instance)
        places = [str(ROS) if each == "ros" else str(copy / each) for each in script.pythonpath]
        environment = {
            **os.environ, "PYTHONPATH": ":".join([*places, str(ROOT)]), "PYTHONUNBUFFERED": "1",
            "MAVLINK20": "1", "ROS_PARAMETERS": json.dumps(script.parameters),
            "MAVROS_URL": f"{at.script}:{at.fcu_script}:{at.system_id}",
        }  # fmt: skip
        words = [*(ALONE if self._network else []), "sh", "-c", "\n".join(begun)]
        with (folder / "gcs.log").open("w") as log:
            subprocess.run(
                words, cwd=folder, env=environment, check=False, stdin=subprocess.DEVNULL,
                stdout=log, stderr=subprocess.STDOUT,
            )  # fmt: skip
        return run

    def flown(self, script: Script) -> bool:
        """Return true if a run of the script is kept."""
        return (self._folder(script) / "run" / "result.json").is_file()

    def _folder(self, script: Script) -> Path:
        return self._out / re.sub(r"\W+", "-", script.name)

    def _copied(self, script: Script, copy: Path) -> None:
        """A clean copy of the repository, as it is at the script's commit."""
        if script.program and not script.commit:
            return
        git = [
            "git",
            "-C",
            str(self._clones / script.repository),
            "archive",
            script.commit,
            script.under,
        ]
        with subprocess.Popen(git, stdout=subprocess.PIPE) as archive:
            subprocess.run(["tar", "-x", "-C", str(copy)], stdin=archive.stdout, check=True)
        assert archive.returncode == 0, f"{script.repository} has no commit {script.commit}"

    def _mission(self, script: Script, copy: Path) -> str:
        """The mission whose flight is the script."""
        python = self._pythons.get(script.python, sys.executable)
        beside = Path(sys.executable).parent
        words = script.program.split() or [python, Path(script.path).name]
        if words[0].endswith(".py") and not (copy / words[0]).is_file():
            words = [sys.executable, str(beside / words[0]), *words[1:]]
        if script.built:
            words = [str(self._built / script.repository / script.built)]
        words += shlex.split(script.arguments)
        if script.beside:  # begun with the script, since a vehicle begins with its ports free
            log = shlex.quote(str(self._folder(script) / "beside.log"))
            lines = [
                f"{self._built}/{script.beside} >{log} 2>&1 & beside=$!",
                f"until grep -q {shlex.quote(script.ready)} {log}; do sleep 0.1; done",
                f"{shlex.join(words)}; code=$?",
                "kill $beside; wait $beside; exit $code",
            ]
            words = ["sh", "-c", "\n".join(lines)]
        if script.typed:
            lines = [word for pair in script.typed for word in pair]
            words = [sys.executable, str(TYPED), str(len(lines)), *lines, *words]
        start = "" if script.air else "start = { on_ground = true }"
        command = json.dumps(shlex.join(words))
        return f"""title = "A public script flies."

[flight]
duration_s = {script.for_s}
ground_z_m = {-10.0 if script.air else 0.0}
{start}
script = {command}
pace = "{self._pace}"
after_script_s = {150.0 if script.lands else 8.0}
"""

    def judged(self, script: Script) -> Flown:
        """The verdict of a script that has flown, from its run that is kept."""
        run, station = self._folder(script) / "run", self._folder(script) / "gcs.log"
        try:
            told = json.loads((run / "result.json").read_text())
            recording = read(run / "flight.mcap")
        except (OSError, ValueError) as error:
            return Flown(NOT, "", f"no result: {error}: {station.read_text()[-300:]}", self._at)
        r_E = np.asarray(recording.plant["state.r_E"])
        up_m = float(r_E[:, 2].max() + (10.0 if script.air else 0.0))
        away_m = float(np.linalg.norm(r_E - r_E[0], axis=1).max())
        level_m = float(np.linalg.norm((r_E - r_E[0])[:, :2], axis=1).max())
        said = (run / "script.log").read_text(errors="replace")
        ended, code = told["ended"], (told["script"] or {}).get("exit_code")
        if not len(recording.plant) or not len(recording.fcu):
            return Flown(NOT, "", script.wants or "it ended before the first tick", self._at)
        rests = recording.plant["on_ground"][-1] > 0.5 and not recording.fcu["engaged"][-1] > 0.0
        landed = bool(rests and away_m > 0.3)
        did = []
        if away_m > 0.3:
            did.append(f"{up_m:.1f} m up" + (f", {level_m:.1f} m away" if level_m > 0.5 else ""))
        elif script.air:
            did.append("holds its place")
        else:
            did.append("stays on the ground")
        if ended in ("crashed", "diverged"):
            did.append(ended)
        elif landed:
            did.append("landed")
        ends = code == script.code or (script.endless and code is None)
        faults = []
        if ended in ("crashed", "diverged"):
            faults.append(ended)
        if not ends:
            faults.append(f"ended with {code}" if code is not None else "did not end")
        if ends and ERROR.search(said):
            faults.append("an exception")
        if ends and script.says and not re.search(script.says, said):
            faults.append(f"did not write {script.says!r}")
        wants_m = max(script.up_m, script.away_m)
        log = (run / "fcu.log").read_text(errors="replace")
        if ends and script.logged and not re.search(script.logged, log):
            faults.append(f"the autopilot did not log {script.logged!r}")
        if script.wants and not wants_m and not script.says:
            faults.append("nothing tells that it has it")
        if not faults and wants_m:
            if up_m < script.up_m:
                faults.append(f"was {up_m:.1f} m up, not {script.up_m:g}")
            if away_m < script.away_m:
                faults.append(f"was {away_m:.1f} m away, not {script.away_m:g}")
            if script.lands and not landed:
                faults.append("did not land")
        if not faults:
            return Flown(FLIES if wants_m else WORKS, "; ".join(did), "", self._at)
        pace = told["real_time_factor"]
        if self._pace == "real" and pace < 0.95:  # its own waits were too short for the vehicle
            faults.append(f"at {pace:.2f} times real time")
        last = [line.strip() for line in said.splitlines() if line.strip()][-1:] or ["nothing"]
        why = script.wants or f"{', '.join(faults)}; last line: {last[0][:160]}"
        return Flown(NOT, "; ".join(did), why, self._at)


def _kept(file: Path) -> dict[str, dict[str, str]]:
    """The results of earlier calls."""
    return dict(json.loads(file.read_text())) if file.exists() else {}


def _told(words: list[str]) -> str:
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout


def table(scripts: list[Script], results: dict[str, dict[str, str]]) -> str:
    """The counts and the table of all scripts that have been flown, as Markdown."""
    flown = [
        (script, Flown(**results[script.name])) for script in scripts if script.name in results
    ]
    counts = {each: sum(got.verdict == each for _, got in flown) for each in (FLIES, WORKS, NOT)}
    repositories = {script.repository for script, _ in flown}
    lines = [
        f"{len(flown)} scripts of {len(repositories)} repositories: {counts[FLIES]} fly,"
        f" {counts[WORKS]} do without flying what they are for, {counts[NOT]} do not.",
    ]
    before = ""
    for script, got in flown:
        if script.repository != before:
            before = script.repository
            commit = f" at {script.commit[:7]}" if script.commit else ""
            lines += ["", f"**{script.repository}**{commit}, {script.client}:", ""]
            lines += ["| script | what it is for | verdict | the vehicle | why not | flown at |"]
            lines += ["|---|---|---|---|---|---|"]
        why = got.why.replace("|", "/").replace("<", "&lt;")
        lines.append(
            f"| {script.path} | {script.does} | {got.verdict} | {got.did} | {why} | {got.at} |"
        )
    return "\n".join(lines)


def main() -> int:
    """Fly the scripts that the command line names. Exit code 1: one did not do what it is for, unless it is known."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clones", type=Path, help="folder of git repositories, OWNER/NAME")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of the runs and results.json"
    )
    parser.add_argument(
        "--only", default="", help="regular expression: scripts by repository and path"
    )
    parser.add_argument("--not-flown", action="store_true", help="leave out what results.json has")
    parser.add_argument(
        "--failed", action="store_true", help="only those that did not, unless it is known why"
    )
    parser.add_argument(
        "--python",
        action="append",
        default=[],
        metavar="NAME=PROGRAM",
        help="the Python with a client",
    )
    parser.add_argument(
        "--built",
        type=Path,
        default=Path(),
        help="folder of the programs built of examples, OWNER/NAME",
    )
    parser.add_argument(
        "--judge", action="store_true", help="fly nothing, judge the kept runs anew"
    )
    parser.add_argument("-j", "--jobs", type=int, default=2, help="flights at once")
    parser.add_argument("--table", type=Path, help="page whose table is written anew")
    given = parser.parse_args()
    pythons = dict(each.split("=", 1) for each in given.python)
    given.out.mkdir(parents=True, exist_ok=True)
    kept = given.out / "results.json"
    results = _kept(kept)
    scripts = listed()
    chosen = [script for script in scripts if re.search(given.only, script.name)]
    if given.not_flown:
        chosen = [script for script in chosen if script.name not in results]
    if given.failed:
        chosen = [
            script for script in chosen
            if results.get(script.name, {}).get("verdict") == NOT and not script.wants
        ]  # fmt: skip
    runner = Runner(
        given.clones.absolute(), given.out.absolute(), pythons, built=given.built.absolute()
    )
    if given.judge:
        for script in filter(runner.flown, chosen):
            at = results[script.name]["at"]
            results[script.name] = asdict(replace(runner.judged(script), at=at))
        kept.write_text(json.dumps(results, indent=1))
        chosen = []
    unknown = 0
    with ThreadPoolExecutor(given.jobs) as pool:
        flights = {pool.submit(runner.fly, script): script for script in chosen}
        for flight in as_completed(flights):
            script, got = flights[flight], flight.result()
            unknown += got.verdict == NOT and not script.wants
            print(f"{got.verdict:22}{script.name}: {got.did}. {got.why}", flush=True)
            results = _kept(kept) | {script.name: asdict(got)}  # another call may have added to it
            kept.write_text(json.dumps(results, indent=1))
    if given.table:
        page = given.table.read_text()
        before, rest = page.split(MARKS[0])
        given.table.write_text(
            f"{before}{MARKS[0]}\n{table(scripts, results)}\n{MARKS[1]}{rest.split(MARKS[1])[1]}"
        )
    return 1 if unknown else 0


if __name__ == "__main__":
    sys.exit(main())
