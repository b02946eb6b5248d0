"""A law of a user's own flies, is recorded, drawn and judged, and no line of ours knows it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from fcu.interface.status_texts import Code
from fcu.laws.loader import LawError
from gcs_tools.flight import law_alone
from gcs_tools.flight.scenario import scenario
from gcs_tools.missions.mission import load
from gcs_tools.recording.reader import read
from tests.command_line import gcs
from tests.two_ways import both, run

pytestmark = pytest.mark.slow  # starts processes

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PAGE = ROOT / "docs" / "law-of-your-own.md"


_gcs = partial(run, "gcs_tools")


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """The mission flown over the wire and in process: result.json of each, and the folders."""
    folder = tmp_path_factory.mktemp("flights")
    return folder, both(HERE / "step_in_still_air.toml", folder)


def test_an_own_law_flies_the_same_bits_both_ways(flights):
    _, results = flights
    wire, process = results["wire"], results["process"]
    assert wire["passed"]
    assert wire["trajectory_sha256"] == process["trajectory_sha256"]
    assert wire["values"]["law.k_r"]["value"] == 1.2
    assert wire["values"]["law.k_rate"]["value"] == 20.0
    assert wire["metrics"]["margin_min_n"] is None


def test_state_of_an_own_law_is_recorded_by_its_names(flights):
    folder, results = flights
    wire, process = (read(folder / way / "flight.mcap") for way in ("wire", "process"))
    assert wire.metadata["law"] == "plain_cascade"
    assert len(wire.metadata["law_sha256"]) == 16
    flown = f"plain_cascade {wire.metadata['law_sha256']}"
    assert [results[way]["versions"]["law"] for way in results] == [flown, flown]
    for name in ("state.v_E", "state.v_dot", "internals.tau_c", "outputs.T_c"):
        assert np.array_equal(wire.fcu[name], process.fcu[name])
    assert np.abs(wire.fcu["state.v_dot"]).max() > 0.5
    assert "guard.margin" not in wire.fcu


IN_DOUBT = """
@kernel
def step(state, params, setpoint, measured):
    if measured.r_E.x > 0.3:
        raise ValueError("east of all reason")
"""


def _raising(own_mission):
    """The mission of a law that raises an error under way, and the line at which."""
    law = own_mission.parent / "plain_cascade.py"
    start = "\n@kernel\ndef step(state, params, setpoint, measured):\n"
    text = law.read_text().replace(start, IN_DOUBT)
    law.write_text(text)
    return own_mission, text[: text.index("raise ValueError")].count("\n") + 1


def test_a_law_that_raises_ends_the_flight_and_says_where(own_mission):
    mission, line = _raising(own_mission)
    folder, said, flown, ended = mission.parent, {}, {}, {}
    for way, options in {"wire": (), "process": ("--in-process",)}.items():
        how = ("--out", folder / way, "--figure", "never", *options)
        done = _gcs("fly", mission, *how, folder=folder)
        assert done.returncode == 3, done.stdout
        log = (folder / way / "fcu.log").read_text()
        ended[way] = json.loads((folder / way / "result.json").read_text())["error"]
        said[way] = [text for text in log.splitlines() if " error " in text]
        flown[way] = read(folder / way / "flight.mcap").fcu["measured.r_E"]
        assert flown[way][:, 0].max() <= 0.3
        assert flown[way][-1, 0] > 0.28, "up to the tick before"
    raised = f"the law raised ValueError: east of all reason, plain_cascade.py:{line}"
    assert len(said["wire"]) == 1
    assert said["wire"][0].endswith(raised)
    assert said["wire"] == said["process"]
    assert ended["wire"] == ended["process"]
    assert ended["wire"].startswith(f"the flight controller ended: {raised} (last")
    assert np.array_equal(flown["wire"], flown["process"])


def test_a_law_that_does_not_return_is_not_blamed_on_the_link(own_mission):
    law, folder = own_mission.with_name("plain_cascade.py"), own_mission.parent
    start = "\n@kernel\ndef step(state, params, setpoint, measured):\n"
    loop = "    left = measured.r_E.x\n    while left > 0.3:\n        left = left + 1e-9 * (left - 1.0) ** 2\n"
    law.write_text(law.read_text().replace(start, start + loop))
    done = _gcs("fly", own_mission, "--figure", "never", "--out", folder / "run", folder=folder)
    assert done.returncode == 3, done.stdout
    assert "has been silent for 5 s; it is still computing: the law may not return" in done.stdout


def test_a_law_that_raises_ends_a_study(own_mission):
    mission, line = _raising(own_mission)
    with pytest.raises(LawError, match=f"east of all reason, plain_cascade.py:{line}"):
        law_alone.fly(scenario(load(mission)))


THRUSTS = "    thrusts, gave_up = allocate(params.rotors, T_c, tau_c)\n"
COMMAND = "    u = speed_command(params.rotors, thrusts, measured.Omega)\n"


HIGH = "select(measured.r_E.z > 1.0, nan, 1.0)"
STOPPED, OF_TORQUE = "rotors stopped", "internals.tau_c.x, internals.tau_c.y, internals.tau_c.z"


@pytest.mark.parametrize(
    ("line", "more", "column", "told"),
    [
        (THRUSTS, f"    thrusts = {HIGH} * thrusts\n", "outputs.thrusts", STOPPED),
        (COMMAND, f"    u = {HIGH} * u\n", "command.u", STOPPED),
        (COMMAND, f"    tau_c = {HIGH} * tau_c\n", "internals.tau_c", OF_TORQUE),
    ],
)
def test_a_law_that_is_not_finite_is_told_of_and_does_not_pass(
    own_mission, line, more, column, told
):
    """NaN stops the rotors and ends no flight; the mission expects nothing that would see it."""
    law = own_mission.with_name("plain_cascade.py")
    law.write_text(law.read_text().replace(line, line + more))
    text = own_mission.read_text()
    own_mission.write_text(text[: text.index("[expect]")] + '[expect]\nended = "time"\n')
    folder, said = own_mission.parent, {}
    for way, options in {"wire": (), "process": ("--in-process",)}.items():
        done = _gcs("fly", own_mission, "--out", folder / way, *options, folder=folder)
        assert done.returncode == 1, done.stdout + done.stderr
        assert "nonfinite_samples" in done.stdout
        result = json.loads((folder / way / "result.json").read_text())
        recording = read(folder / way / "flight.mcap")
        fcu = recording.fcu
        bad = np.isnan(fcu[column]).any(axis=1) & (fcu["engaged"] > 0.5)
        assert not result["passed"]
        assert result["metrics"]["nonfinite_samples"] >= bad.sum() > 10
        first = result["not_finite"]
        assert first["time_s"] == pytest.approx(fcu["t"][bad][0])
        assert any(name.startswith(column) for name in first["fields"])
        assert any(first["fields"][0] in cause for cause in result["causes"])
        (event,) = (e for e in recording.events if e.code == Code.LAW_NOT_FINITE.name)
        assert event.level == "error" and event.values[0].startswith(told)
        assert event.t == pytest.approx(fcu["t"][bad][0])
        log = (folder / way / "fcu.log").read_text().splitlines()
        said[way] = [line for line in log if "not finite" in line]
    assert said["wire"] == said["process"]


def test_what_a_mission_expects_of_another_law_is_missed_with_the_reason(own_mission):
    text = (
        own_mission.read_text() + "reference_error_max_m = 0.2\nmargin_min_n = { at_least = 1.0 }\n"
    )
    own_mission.write_text(text)
    folder, run = own_mission.parent, own_mission.parent / "run"
    done = _gcs(
        "fly", own_mission, "--in-process", "--figure", "never", "--out", run, folder=folder
    )
    assert done.returncode == 1, done.stdout + done.stderr
    judged = {e["name"]: e for e in json.loads((run / "result.json").read_text())["expectations"]}
    for name, why in {"reference_error_max_m": "reference model", "margin_min_n": "guard"}.items():
        assert judged[name]["why"] == f"this law has no {why}"
        assert f"{name} has no value: this law has no {why}\n" in done.stdout


def test_a_flight_of_an_own_law_is_drawn(flights):
    folder, _ = flights
    done = _gcs("plot", folder / "wire" / "flight.mcap", folder=folder)
    assert done.returncode == 0, done.stderr
    assert (folder / "wire" / "flight.png").stat().st_size > 0


def test_an_own_law_takes_off_for_a_ground_station_and_is_published(start, instance, tmp_path):
    law = ("--law", HERE / "plain_cascade.py")
    up = start("gcs_tools", "up", "--instance", instance, *law, "--speed", 3)
    up.says("ready")
    record = start("gcs_tools", "record", tmp_path / "r.mcap", "--for", 3, "--instance", instance)
    go = start("gcs_tools", "setpoint", 2, 0, 3, "--instance", instance, "--json")
    assert go.wait() == 0, go.text()
    assert json.loads(go.out.read_text())["error_m"] < 0.3
    assert record.wait() == 0, record.text()
    assert up.interrupted() == 0
    heard = read(tmp_path / "r.mcap")
    assert heard.metadata["law"] == "plain_cascade"
    assert np.isfinite(heard.fcu["internals.tau_c"]).all()
    assert np.isnan(heard.reports["/fcu/wind"]["wind.v_air_E"]).all()


def test_ticks_of_another_law_are_not_published(start, instance):
    fcu = start("fcu", "--instance", instance, "--law", HERE / "plain_cascade.py")
    publisher = start("gcs_tools", "publish", "--instance", instance)
    said = publisher.says("not published")
    assert "plain_cascade" in said
    assert "--law" in said
    assert publisher.interrupted() == 0
    assert fcu.process.poll() is None


def test_no_line_of_ours_knows_it():
    for package in ("fcu", "sitl_plant", "gcs_tools"):
        for path in (ROOT / package).rglob("*.py"):
            assert "plain_cascade" not in path.read_text(), path


@pytest.mark.parametrize("policy", ["govern", "refuse"])
def test_a_policy_of_the_guard_is_rejected_without_one(own_mission, policy, monkeypatch):
    monkeypatch.chdir(own_mission.parent)
    done = gcs("fly", own_mission, "--set", f"law.guard={policy}")
    assert done.exit_code == 2
    assert "no guard" in done.stderr
    assert "law" in done.stderr


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("k_r = 1.2", "k_r = 99.0", ["13", "k_r"]),
        ("k_r = 1.2", "f_m = 1.2", ["13", "f_m"]),
        ("plain_cascade.py", "nowhere.py", ["12", "nowhere.py"]),
    ],
)
def test_keys_of_an_own_law_are_those_of_its_table(own_mission, old, new, said, monkeypatch):
    monkeypatch.chdir(own_mission.parent)
    own_mission.write_text(own_mission.read_text().replace(old, new))
    done = gcs("fly", own_mission)
    assert done.exit_code == 2
    for part in said:
        assert part in done.stderr


def test_a_law_that_does_not_compile_ends_with_2_and_the_line(own_mission, instance):
    law = own_mission.with_name("plain_cascade.py")
    text = law.read_text()
    law.write_text(text.replace("params.J *", "params.JJ *"))
    line = next(n for n, row in enumerate(text.splitlines(), 1) if "params.J *" in row)
    command = [sys.executable, "-m", "fcu", "--law", str(law), "--instance", str(instance)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert f"plain_cascade.py:{line}:" in done.stderr
    assert "JJ" in done.stderr


NO_SUCH_FIELD = ("params.J *", "params.JJ *")
ONE_RESULT_LESS = (", Internals(v_c=v_c, tau_c=tau_c)", "")


@pytest.mark.parametrize(
    ("command", "old", "new", "told"),
    [
        (("fly",), *ONE_RESULT_LESS, "Outputs"),
        *(
            (command, *NO_SUCH_FIELD, "Params")
            for command in (("fly",), ("fly", "--in-process"), ("campaign",), ("up",))
        ),
    ],
)
def test_a_law_that_does_not_compile_is_found_before_anything_else_is_compiled(
    own_mission, tmp_path, monkeypatch, command, old, new, told
):
    law = own_mission.with_name("plain_cascade.py")
    law.write_text(law.read_text().replace(old, new))
    (tmp_path / "campaign.toml").write_text(
        f'title = "Eight."\nmission = "{own_mission.name}"\nflights = 8\n'
        '[draw]\n"wind.azimuth_deg" = { uniform = [0.0, 360.0] }\n'
    )
    given = {"campaign": ("campaign.toml",), "up": ("--law", law.name)}
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    done = _gcs(*command, *given.get(command[0], (own_mission.name,)), folder=tmp_path)
    assert done.returncode == 2, done.stdout + done.stderr
    assert "plain_cascade.py" in done.stderr and told in done.stderr
    assert not (tmp_path / "runs").exists()
    compiled = [path.name for path in (tmp_path / "cache").rglob("*.*")]
    assert compiled, "the kernels that the law calls"
    others = ("advance", "observe", "decide", "together", "closed", "ahead")
    assert not [name for name in compiled if name.startswith(others)]


def test_the_page_shows_the_whole_file_and_its_mission():
    page = PAGE.read_text().partition("## Fly it on any vehicle")[0]
    shown = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    text = (HERE / "plain_cascade.py").read_text()
    left = [row for row in text.splitlines() if row]
    assert left == [row for block in shown for row in block.splitlines() if row]
    assert len(text.splitlines()) <= 80
    (toml,) = re.findall(r"^```toml\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    assert toml in (HERE / "step_in_still_air.toml").read_text()


def test_with_the_rules_of_the_page_it_flies_a_vehicle_of_another_mass(own_mission):
    """The quadrotor has a fifth of the mass in its table; as it is, the law flies away with it."""
    law = own_mission.with_name("plain_cascade.py")
    flown = partial(_error_on_the_quad, own_mission)
    assert flown() > 10.0
    page = PAGE.read_text().partition("## Fly it on any vehicle")[2]
    (ruled,) = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    was = re.search(r"^PARAMETERS = \(\n.*\n.*\n", law.read_text(), re.MULTILINE)
    assert was is not None
    law.write_text(law.read_text().replace(was.group(), ruled))
    assert flown() < 0.2


def _error_on_the_quad(mission: Path) -> float:
    options = ("--airframe", "quad", "--in-process", "--figure", "never", "--json")
    done = _gcs("fly", mission, *options, folder=mission.parent)
    return float(json.loads(done.stdout)[0]["metrics"]["setpoint_error_final_m"])
