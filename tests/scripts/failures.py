"""`python -m tests.scripts.failures`: makes every failure of a script happen, and prints a table of them.

A row says what the script did, what the result calls it, how the flight ended, the exit code of `gcs fly`, and the
wall time. Other programs that use the vehicle's ports may make it wait.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
SPOILS = {  # what a script does with the folder of its run
    "removes": "rm -r {out}",
    "replaces": "mv {out} {out}.old; mkdir {out}",
    "links": "mv {out} {out}.old; ln -s $PWD/elsewhere {out}",
    "removes the recording": "rm {out}/flight.mcap",
    "replaces the recording": "echo > {out}/new; mv {out}/new {out}/flight.mcap",
    "empties the recording": "truncate -s 0 {out}/flight.mcap",
    "stretches the recording": "truncate -s 100G {out}/flight.mcap",
    "flips a byte of the recording": "printf x | dd of={out}/flight.mcap bs=1 seek=700 conv=notrunc",
    "removes a log": "rm {out}/fcu.log",
    "links the result": "ln -s $PWD/elsewhere/result.json {out}/result.json",
    "puts a FIFO for the result": "mkfifo {out}/result.json",
    "tells its own result": "touch {out}/result.json; rm {out}/fcu.log",
    "moves the folder with its own result": "touch {out}/result.json; mv {out} {out}.old",
    "tells a result in another folder": "mv {out} {out}.old; mkdir {out}; touch {out}/result.json",
    "puts a FIFO for the figure": "mkfifo {out}/flight.png",
    "puts a file of its own for the figure": "ln $PWD/kept {out}/flight.png",
    "puts a FIFO for events": "rm {out}/fcu.jsonl; mkfifo {out}/fcu.jsonl",
}


ALLOWED = ("--allow-commands",)


@dataclass(frozen=True)
class Case:
    """A script, and how it is flown."""

    what: str
    script: str
    settings: tuple[str, ...] = ()
    options: tuple[str, ...] = ALLOWED


def hop(what: str, how: str, *settings: str, options: tuple[str, ...] = ALLOWED) -> Case:
    """A flight by hop.py with one of its misbehaviours."""
    return Case(what, f"python hop.py {{url}} {how}", settings, options)


CASES = (
    hop("does all well", "well"),
    hop("ends with exit code 1", "fails"),
    hop("is ended by SIGSEGV", "crashes"),
    hop("hangs, duration_s = 15", "hangs", "flight.duration_s=15"),
    hop("ends, and never sent a message", "mute"),
    hop("hangs, and never sent a message, duration_s = 15", "deaf", "flight.duration_s=15"),
    hop("leaves a process behind", "leaves"),
    hop("stops the rotors in the air", "stops", "flight.after_script_s=3"),
    hop("never takes off", "sits", "flight.after_script_s=3"),
    Case("writes without end", "yes {url}"),
    Case("names an interpreter that is not there", "./broken {url}"),
    Case("is not there", "./nothing {url}"),
    hop("is not allowed to run", "well", options=()),
    *(
        Case(f"{how} (in its folder)", f"sh -c '{sys.executable} hop.py {{url}} sits; {does}'")
        for how, does in SPOILS.items()
    ),
)  # fmt: skip


def flown(case: Case, folder: Path) -> tuple[dict[str, object], int, float]:
    """The result of a case, flown in this folder, with exit code and wall time. Empty without a result."""
    for name in ("hop.py", "hop.toml"):
        (folder / name).write_bytes((HERE / name).read_bytes())
    (folder / "elsewhere").mkdir()
    (folder / "kept").touch()
    (folder / "broken").write_text("#!/no/such/interpreter\n")
    (folder / "broken").chmod(0o755)
    settings = [f'flight.script="{case.script}"', *case.settings]
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "gcs_tools", "fly", "hop.toml", "--out", "run", "--json", *case.options,
         *(word for each in settings for word in ("--set", each))],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    took_s = time.monotonic() - began
    results = json.loads(done.stdout) if done.stdout.startswith("[") else []
    return (results[0] if results else {}), done.returncode, took_s


def main() -> None:
    """Fly all cases, and print a line for each."""
    print("| the script | `failure` | `ended` | exit code | wall time |\n|---|---|---|---|---|")
    for case in CASES:
        with tempfile.TemporaryDirectory() as name:
            result, code, took_s = flown(case, Path(name))
        script = result.get("script") or {}
        named = script.get("failure") if isinstance(script, dict) else ""
        print(
            f"| {case.what} | {named or '-'} | {result.get('ended', '-')} | {code} | {took_s:.1f} s |",
            flush=True,
        )


if __name__ == "__main__":
    main()
