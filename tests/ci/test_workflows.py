"""The files of docs/ci as they stand: every `run:` and `script:` line, in bash, in a clean folder and home.

What a service does itself is stood for by file operations, named in `Job`: checkout copies files, setup-python
gives the environment, cache links the folder of compiled code, upload-artifact copies the folder.
"""

from __future__ import annotations

import glob
import json
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.patience import PATIENCE_S
from tests.wheel.conftest import ROOT, Bare, compiled, environment, wheel

__all__ = ["wheel"]

FILES = ROOT / "docs" / "ci"
GITHUB_BASH = ["bash", "--noprofile", "--norc", "-eo", "pipefail"]


@dataclass
class Job:
    """A job of GitHub's or GitLab's: a working folder, a home folder, an environment and artifacts."""

    folder: Path
    wheel: Path
    variables: dict[str, str]
    artifacts: dict[str, Path] = field(default_factory=dict)
    outputs: dict[str, dict[str, str]] = field(default_factory=dict)
    code: int = 0

    @property
    def work(self) -> Path:
        return self.folder / "work"

    def bash(self, text: str, extra: dict[str, str], shell: list[str]) -> int:
        script = self.folder / "step.sh"
        script.write_text(text)
        done = subprocess.run(
            [*shell, str(script)], cwd=self.work, env=self.variables | extra, capture_output=True,
            text=True, timeout=PATIENCE_S, check=False,
        )  # fmt: skip
        print(text, done.stdout, done.stderr, sep="\n")
        return done.returncode

    def filled(self, text: str, inputs: dict[str, str]) -> str:
        """Fill in what GitHub does. An expression that is not known here is a KeyError."""
        known = {f"inputs.{name}": value for name, value in inputs.items()}
        known |= {
            "github.action_path": str(self.work / "m-mrac/docs/ci"),
            "vars.M_MRAC": "OWNER/NAME",
        }
        known |= {
            f"steps.{step}.outputs.{name}": value
            for step, values in self.outputs.items()
            for name, value in values.items()
        }
        return re.sub(r"\$\{\{ (.*?) \}\}", lambda found: known[found[1]], text)

    def steps(self, steps: list[dict[str, Any]], inputs: dict[str, str]) -> None:
        for number, step in enumerate(steps):
            if self.code and step.get("if") != "always()":
                continue
            given = {k: self.filled(str(v), inputs) for k, v in step.get("with", {}).items()}
            if "run" in step:
                written = self.folder / f"output-{number}"
                written.touch()
                extra = {k: self.filled(v, inputs) for k, v in step.get("env", {}).items()}
                extra["GITHUB_OUTPUT"] = str(written)
                self.code = self.bash(self.filled(step["run"], inputs), extra, GITHUB_BASH)
                lines = (line.partition("=") for line in written.read_text().splitlines())
                self.outputs[step.get("id", "")] = {name: value for name, _, value in lines}
            else:
                self.use(step["uses"], given)

    def use(self, name: str, given: dict[str, str]) -> None:
        action = name.partition("@")[0]
        if (
            action == "actions/checkout" and given
        ):  # this project: its action, and a wheel of its sources
            shutil.copytree(FILES, self.work / given["path"] / "docs/ci")
        elif action == "actions/checkout":  # the user's repository: there already
            assert (self.work / "flights").is_dir()
        elif action == "actions/setup-python":
            assert given["python-version"] in ("3.11", "3.12", "3.13")
        elif action == "actions/cache":
            assert re.fullmatch(r"m-mrac-[0-9a-f]{16}", given["key"])
            restored = Path(given["path"].replace("~", self.variables["HOME"], 1))
            assert not restored.exists()
            restored.parent.mkdir(parents=True, exist_ok=True)
            restored.symlink_to(compiled())
        elif action == "actions/upload-artifact":
            self.artifacts[given["name"]] = self.work / given["path"]
        elif action == "./m-mrac/docs/ci":
            document = yaml.safe_load((self.work / action / "action.yml").read_text())
            assert set(given) <= set(document["inputs"])
            inputs = {k: v["default"] for k, v in document["inputs"].items()} | given
            # the checkout of the project is stood for by its wheel
            self.steps(document["runs"]["steps"], inputs | {"package": str(self.wheel)})
        else:
            raise AssertionError(f"{name}: this test does not know what to do in its place")


@pytest.fixture
def job(tmp_path: Path, wheel: Path) -> Job:
    """A job in a user's repository: a mission that is met, a script that flies, an environment without us."""
    made = Bare(environment(tmp_path / "environment"), tmp_path / "home", wheel)
    (tmp_path / "home").mkdir()
    for name in ("flights", "scripts"):
        (tmp_path / "work" / name).mkdir(parents=True)
    shutil.copy(ROOT / "missions" / "airframe_step.toml", tmp_path / "work/flights/step.toml")
    shutil.copy(ROOT / "tests/scripts/hop.py", tmp_path / "work/scripts/hop.py")
    return Job(tmp_path, wheel, made.variables())


def cases(folder: Path) -> dict[str, list[str]]:
    """Test cases of all reports in a folder, each with what it holds: nothing if it passed.

    What a report tells besides depends on the machine: a pace that was not kept.
    """
    found = [case for path in folder.glob("*.xml") for case in ET.parse(path).iter("testcase")]
    return {
        case.get("name", ""): [each.tag for each in case if each.tag != "system-out"]
        for case in found
    }


def on_github(job: Job, **inputs: str) -> Path:
    (flown,) = yaml.safe_load((FILES / "github.yml").read_text())["jobs"].values()
    for step in flown["steps"]:
        if step.get("uses") == "./m-mrac/docs/ci":
            step["with"] |= inputs
    job.steps(flown["steps"], {})
    return job.artifacts["m-mrac-runs"]


def on_gitlab(job: Job) -> Path:
    (flown,) = yaml.safe_load((FILES / "gitlab-ci.yml").read_text()).values()
    project = {"CI_PROJECT_DIR": str(job.work), "M_MRAC": str(job.wheel)}
    for name, value in flown["variables"].items():
        project[name] = value.replace("$CI_PROJECT_DIR", str(job.work))
    (cached,) = flown["cache"]["paths"]
    (job.work / cached).parent.mkdir()
    (job.work / cached).symlink_to(compiled())
    job.code = job.bash("\n".join(flown["script"]), project, ["bash", "-eo", "pipefail"])
    assert glob.glob(flown["artifacts"]["reports"]["junit"], root_dir=job.work)
    return job.work / flown["artifacts"]["paths"][0]


@pytest.mark.parametrize("service", [on_github, on_gitlab])
def test_a_mission_and_a_script_pass(job: Job, service: Any) -> None:
    kept = service(job)
    assert job.code == 0
    assert cases(kept) == {"step": [], "hop": []}
    for name in ("flight.mcap", "flight.png", "result.json"):
        assert len(list(kept.rglob(name))) == 2, name


def test_time_is_held_for_a_script_on_request(job: Job) -> None:
    kept = on_github(job, held="true", missions="")
    assert job.code == 0
    assert cases(kept) == {"hop": []}
    (told,) = (json.loads(path.read_text()) for path in kept.rglob("result.json"))
    assert told["values"]["flight.pace"]["value"] == "held"


def test_a_mission_that_is_missed_fails_the_job_and_is_kept(job: Job) -> None:
    mission = job.work / "flights" / "step.toml"
    mission.write_text(mission.read_text().replace("[expect]", "[expect]\nenergy_j = 1.0", 1))
    kept = on_github(job)
    assert job.code == 1
    assert cases(kept) == {"step": ["failure"], "hop": []}
    assert len(list(kept.rglob("flight.mcap"))) == 2


def test_a_script_that_fails_fails_the_job(job: Job) -> None:
    (job.work / "scripts" / "hop.py").write_text("raise SystemExit(7)\n")
    kept = on_gitlab(job)
    assert job.code == 1
    assert cases(kept) == {"step": [], "hop": ["failure"]}
