"""A mission's script flies the vehicle, and whatever it does wrong is a failure with a name."""

from __future__ import annotations

import os
import shutil
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from gcs_tools.cli.terminal import Terminal
from gcs_tools.flight.run import UsageError, prepared
from gcs_tools.flight.run_folder import Kept, left_by_script
from gcs_tools.flight.script_flight import only_first, values
from gcs_tools.flight.user_command import SCRIPT_WORDS, CommandError, command_words
from gcs_tools.judging import result
from gcs_tools.judging.script_check import ScriptFlown
from gcs_tools.missions.mission import MissionError, load
from tests.patience import until, with_room
from tests.process.conftest import alive
from tests.scripts.failures import SPOILS

HERE = Path(__file__).parent
FAILURES = {  # how it misbehaves -> exit code, name of the failure, exit code of the script, ended
    "fails": (1, "script_exit", 1, "script"),
    "crashes": (3, "script_killed", -11, "aborted"),
    "hangs": (1, "script_timeout", None, "time"),
    "mute": (1, "script_silent", 0, "script"),
    "deaf": (1, "script_silent", None, "time"),
    "leaves": (1, "script_left_processes", 0, "landed"),
}


def test_a_script_flies_and_its_output_is_kept(fly):
    code, found = fly()
    assert (code, found.ended, found.error) == (0, "landed", None)
    assert found.script is not None
    assert (found.script.exit_code, found.script.failure, found.script.left) == (0, "", [])
    assert found.script.messages >= 4  # a heartbeat, arming, take-off, landing
    assert found.values["flight.pace"].value == "speed:8"
    log = Path(found.folder) / "script.log"
    assert log.read_text().split() == ["armed", "up", "landing", "landed"]
    assert [each.name for each in found.expectations][:1] == ["ended"]
    assert {each.name: each.passed for each in found.expectations}["script"] is True


def test_a_vehicle_that_never_left_the_ground_has_not_landed(fly):
    code, found = fly('flight.script="python hop.py {url} sits"', "flight.after_script_s=2")
    assert (code, found.ended, found.passed) == (1, "script", False)
    assert found.script is not None and found.script.failure == ""
    assert found.causes == ["The vehicle never left the ground."]


def test_a_vehicle_that_a_script_leaves_in_the_air_is_told_of(fly):
    code, found = fly('flight.script="python hop.py {url} floats"', "flight.after_script_s=1")
    assert (code, found.ended) == (1, "script")
    assert ["height" in each for each in found.causes[:1]] == [True]


@pytest.mark.parametrize("pace", ["speed:8", "held"])
def test_rotors_that_are_stopped_in_the_air_are_a_fall(fly, pace):
    """It lies on the ground disarmed, as after a landing."""
    code, found = fly(
        f'flight.pace="{pace}"',
        'flight.script="python hop.py {url} stops"',
        "flight.after_script_s=3",
    )
    assert (code, found.ended, found.passed) == (1, "fell", False)
    assert found.script is not None and found.script.failure == ""
    assert found.causes[0].startswith("The rotors were stopped in flight, at ")


@pytest.mark.alone  # what a ground station is sent comes by the wall's clock
def test_a_script_by_the_port_of_ground_stations_is_not_silent(fly):
    code, found = fly('flight.script="python hop.py udpin:127.0.0.1:1455{instance}"')
    assert (code, found.ended) == (0, "landed")
    assert found.script is not None
    assert (found.script.failure, found.script.messages) == ("", 0)


def test_a_name_that_is_no_text_is_listed_all_the_same(tmp_path):
    (tmp_path / os.fsdecode(b"bad\xff")).touch()
    assert left_by_script(tmp_path) == ["bad\\xff"]


def test_what_a_script_sets_of_the_guard_is_listed(fly):
    code, found = fly('flight.script="python hop.py {url} unguarded"')
    assert (code, found.ended) == (0, "landed")
    assert found.script is not None
    assert found.script.parameters == {"MR_GUARD": 0.0}
    assert any("MR_GUARD 0" in text for text in found.script.told())


def test_the_pace_is_told_and_whether_it_was_kept(fly):
    _, found = fly()
    assert found.script is not None and found.script.pace == 8.0
    assert found.script.pace_kept is not None and 0.0 < found.script.pace_kept < 8.8
    for kept, is_slow in ((7.0, True), (7.3, False)):
        flown = ScriptFlown("hop", wall_time_s=2.0, pace=8.0, pace_kept=kept)
        assert (flown.is_slow, len(flown.told())) == (is_slow, is_slow)
    short = ScriptFlown("hop", wall_time_s=0.6, pace=8.0, pace_kept=7.0)
    assert not short.is_slow  # which says nothing of the machine
    assert ScriptFlown("hop").told() == []  # its time was held
    assert ScriptFlown("hop", by_wall=True).told() != []  # but not that of its threads


def test_what_changes_the_meaning_of_a_verdict_stands_below_it(capsys):
    found = replace(
        result.rejected("hop", "No reason.", {}),
        script=ScriptFlown("hop", wall_time_s=2.0, pace=8.0, pace_kept=1.0),
    )
    Terminal().verdict(found, "run")
    told = capsys.readouterr()
    assert told.err == ""
    assert told.out.index("No reason.") < told.out.index("simulated seconds per second")


@pytest.mark.parametrize(
    ("does", "options"),
    [(does, ()) for does in SPOILS.values()]
    + [("echo > {out}/flight.mcap", ("--record", "none")),
       ("echo > {out}/flight.png", ("--figure", "never"))],
    ids=[*SPOILS, "a recording of its own", "a figure of its own"],
)  # fmt: skip
def test_a_script_that_spoils_the_folder_of_its_run_fails(start, tmp_path, does, options):
    """JUnit says so, and nothing is written elsewhere."""
    for name in ("hop.py", "hop.toml"):
        shutil.copy(HERE / name, tmp_path)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "kept").touch()
    script = f"sh -c '{sys.executable} hop.py {{url}} sits; {does}'"
    out, report = tmp_path / "run", tmp_path / "report.xml"

    def flown() -> tuple[int, str]:
        shutil.rmtree(out, ignore_errors=True)
        program = start(
            "gcs_tools", "fly", tmp_path / "hop.toml", "--allow-commands", "--set", f'flight.script="{script}"',
            "--out", out, "--junit", report, "--json", *options,
        )  # fmt: skip
        return program.wait(), program.text()

    code, text = with_room(flown)
    assert code == 3, text
    assert list((tmp_path / "elsewhere").iterdir()) == []
    assert (tmp_path / "kept").stat().st_size == 0
    for folder in (out, tmp_path / "run.old"):
        assert not os.path.lexists(folder / "result.json")
    assert '<error message="the script' in report.read_text()


@pytest.mark.parametrize("put", [Path.rename, lambda users, run: run.symlink_to(users)])
def test_a_result_of_the_users_is_not_removed(tmp_path, put):
    """It was there before, in a folder that the script puts in the place of the run's."""
    run, users = tmp_path / "run", tmp_path / "users"
    for folder in (run, users):
        folder.mkdir()
    (users / "result.json").touch()
    before, later = (users / "result.json").stat().st_ctime_ns, tmp_path / "later"
    # a file's time is that of the system's last tick: the run begins at a later one
    until(lambda: later.touch() or later.stat().st_ctime_ns > before, "a tick of the system")
    with Kept(run) as kept:
        run.rename(tmp_path / "moved")
        put(users, run)
        kept.remove("result.json")
    assert (run / "result.json").is_file()


def test_a_program_beside_its_mission_is_found_from_any_folder(tmp_path, monkeypatch):
    program = tmp_path / "fly.sh"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    assert command_words("./fly.sh {url}", SCRIPT_WORDS)[0] == "./fly.sh"
    monkeypatch.chdir("/")
    assert command_words("./fly.sh", SCRIPT_WORDS, tmp_path) == ("./fly.sh",)
    with pytest.raises(CommandError):
        command_words("./fly.sh", SCRIPT_WORDS)
    for bad in ("true x\0y", "true \udcff"):
        with pytest.raises(CommandError):
            command_words(bad, SCRIPT_WORDS, tmp_path)


@pytest.mark.parametrize(
    "command",
    [
        "true {url} && true",
        "true; exit 7",
        "true {url} > out.txt",
        "true | tee out",
        "true &",
        "true {url",
    ],
)
def test_signs_of_a_shell_and_open_braces_are_refused(command, tmp_path):
    """A check behind && was given to the script as its arguments, and never ran."""
    with pytest.raises(CommandError):
        command_words(command, SCRIPT_WORDS, tmp_path)


def test_signs_of_a_shell_are_allowed_within_quotes(tmp_path):
    assert (
        command_words("sh -c 'true && true; exit 7'", SCRIPT_WORDS, tmp_path)[2]
        == "true && true; exit 7"
    )
    assert command_words("true 'a;b' \"c & d\" it\\'s", SCRIPT_WORDS, tmp_path)[1:] == (
        "a;b",
        "c & d",
        "it's",
    )


@pytest.mark.parametrize("how", FAILURES)
def test_a_failure_is_named_and_leaves_nobody(fly, how):
    late = how in ("hangs", "deaf")
    code, found = fly(
        f'flight.script="python hop.py {{url}} {how}"', *(["flight.duration_s=15"] if late else [])
    )
    wanted, failure, exit_code, ended = FAILURES[how]
    assert (code, found.exit_code, found.passed, found.ended) == (wanted, wanted, False, ended)
    assert found.script is not None
    assert (found.script.failure, found.script.exit_code) == (failure, exit_code)
    assert found.script.text.endswith((".", ")"))
    assert (found.script.messages == 0) == (failure == "script_silent")
    if wanted == 3:
        assert found.error is not None
    else:
        missed = {each.name: each.value for each in found.expectations if each.is_missed}
        assert missed["script"] == failure
    if how == "leaves":
        assert found.script.left == ["sleep"]
        words = (Path(found.folder) / "script.log").read_text().split()
        assert not alive(int(words[words.index("child") + 1]))


def test_a_flight_from_the_air_holds_until_the_script_speaks(fly):
    code, found = fly(
        "flight.start={ position_m = [0.0, 0.0, 5.0] }",
        f'flight.script="python {HERE / "listens.py"} {{url}}"',
        "expect={ reached = 0.2 }", "flight.after_script_s=6",
    )  # fmt: skip
    assert (code, found.ended) == (0, "script")
    stood = {each.name: each.value for each in found.expectations}["reached"]
    assert isinstance(stood, float) and stood < 0.2
    at_s = found.script.ended_at_s
    assert at_s is not None and at_s + 5.9 < found.sim_time_s < at_s + 8.0


def test_a_command_runs_only_where_it_is_allowed(start, tmp_path):
    program = start("gcs_tools", "fly", HERE / "hop.toml", "--out", tmp_path / "run")
    assert program.wait() == 2
    assert "--allow-commands" in program.text()
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(("how", "wanted"), [("well", 0), ("fails", 1)])
def test_a_script_is_tested_without_a_mission(start, tmp_path, how, wanted):
    report = tmp_path / "report.xml"

    def flown() -> tuple[int, str]:
        program = start(
            "gcs_tools", "test", "--speed", "8", "--out", tmp_path / "run", "--overwrite",
            "--junit", report, HERE / "hop.py", "{url}", how,
        )  # fmt: skip
        return program.wait(), program.text()

    code, _ = with_room(flown)
    found = result.read(tmp_path / "run" / "result.json")
    assert (code, found.passed, found.mission) == (wanted, wanted == 0, "hop")
    assert found.ended == ("script" if wanted else "landed")
    limits = [f"{what}_saturated_fraction" for what in ("thrust", "tilt", "torque")]
    assert [each.name for each in found.expectations] == ["ended", *limits, "script"]
    text = report.read_text()
    assert f'failures="{wanted}"' in text and 'classname="scripts"' in text


@pytest.mark.parametrize(
    "arguments",
    [
        ("nothing.py",), ("./nothing", "{url}"), ("--speed", "max", HERE / "hop.py"), ("hop.toml",),
        (HERE / "hop.py", "{url}", "--speed", "8"), (HERE / "hop.py", "--out=here"),
        ("--instance", "3", HERE / "hop.py"),
    ],
)  # fmt: skip
def test_what_cannot_be_tested_is_refused(start, tmp_path, arguments):
    told = start("gcs_tools", "test", *arguments)
    assert told.wait() == 2


def test_a_report_is_written_of_what_cannot_be_tested(start, tmp_path):
    report = tmp_path / "report.xml"
    assert start("gcs_tools", "test", "--junit", report, "nothing.py").wait() == 2
    text = report.read_text()
    assert 'classname="scripts" name="nothing"' in text and "nothing.py: no such file" in text


def test_missions_that_are_refused_have_a_reason_each(start, tmp_path):
    for name, height in (("one", "3"), ("other", "4")):
        (tmp_path / f"{name}.toml").write_text(f"title = {height}\n")
    report = tmp_path / "report.xml"
    names = tmp_path / "one.toml", tmp_path / "other.toml"
    assert start("gcs_tools", "fly", *names, "--junit", report).wait() == 2
    cases = {each.get("name"): each.find("error") for each in ET.parse(report).iter("testcase")}
    assert set(cases) == {"one", "other"}
    for name, other in (("one", "other"), ("other", "one")):
        error = cases[name]
        assert error is not None
        assert f"{name}.toml" in error.get("message", "")
        assert f"{other}.toml" not in error.get("message", "")


MANY = """title = "A script hops in winds that are not known."
mission = "hop.toml"
flights = 3
[draw]
"wind.steady_m_s[0]" = { uniform = [-3.0, 3.0] }
"""


def test_a_campaign_flies_a_script_with_what_it_draws(start, tmp_path):
    """One flight is flown again, too. Of a script that fails each flight has the name of the failure."""
    for name in ("hop.py", "hop.toml"):
        shutil.copy(HERE / name, tmp_path)
    (tmp_path / "many.toml").write_text(MANY)
    (tmp_path / "fails.toml").write_text(
        f"{MANY.replace('flights = 3', 'flights = 1')}[set]\n"
        '"flight.script" = "python hop.py {url} fails"\n'
    )
    shares = {}
    for name in ("many", "fails"):
        out = tmp_path / name
        told = start(
            "gcs_tools", "campaign", tmp_path / f"{name}.toml", "--allow-commands", "--out", out,
            "--no-report", "-j", "2",
        )  # fmt: skip
        assert told.wait() == 0, told.text()
        shares[name] = pq.read_table(out / "flights.parquet").to_pylist()
    assert [each["success"] for each in shares["many"]] == [True] * 3
    assert [each["ended"] for each in shares["many"]] == ["landed"] * 3
    assert len({each["draw.wind.steady_m_s[0]"] for each in shares["many"]}) == 3
    ((failed,),) = [shares["fails"]]
    assert not failed["success"] and failed["exit_code"] == 0
    assert failed["missed"].split(", ")[0] == "script_exit"
    again = start(
        "gcs_tools", "fly", f"{tmp_path / 'many'}#1", "--allow-commands", "--record", "none"
    )
    assert again.wait() == 0, again.text()


@pytest.mark.parametrize("program", ["campaign", "envelope"])
def test_what_does_not_run_scripts_refuses_them(start, tmp_path, program):
    given = HERE / "hop.toml"
    if program == "campaign":
        given = tmp_path / "many.toml"
        given.write_text(f'title = "Many."\nmission = "{HERE / "hop.toml"}"\nflights = 1\n')
    told = start("gcs_tools", program, given)
    assert told.wait() == 2
    assert "--allow-commands" in told.text()


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('pace = "speed:8"', 'pace = "speed:0"', "pace"),
        ('pace = "speed:8"', 'pace = "fast"', "pace"),
        ('pace = "speed:8"', "setpoints = [[0.0, 0.0, 0.0, 3.0]]", "[flight]"),
        ('pace = "speed:8"', "arrive = { within_m = 1.0, for_s = 1.0 }", "arrive"),
        ('pace = "speed:8"', "yaw_deg = 3.0", "yaw_deg"),
        ('script = "python hop.py {url}"', "setpoints = [[0.0, 0.0, 0.0, 3.0]]", "pace"),
        ('ended = "landed"', 'ended = "time"', "ended"),
        ('ended = "landed"', "limited = false", "limited"),
    ],
)
def test_keys_that_do_not_go_together_are_refused(tmp_path, old, new, key):
    text = (HERE / "hop.toml").read_text()
    assert old in text
    (tmp_path / "one.toml").write_text(text.replace(old, new))
    with pytest.raises(MissionError, match=key.replace("[", r"\[")):
        load(tmp_path / "one.toml")


def test_a_program_that_is_not_there_is_named(tmp_path):
    shutil.copy(HERE / "hop.toml", tmp_path)
    path = tmp_path / "hop.toml"  # without the script
    for command, said in (
        ("./nothing.py {url}", r"nothing\.py: no such program"),
        ("python nothing.py", r"nothing\.py: no such file in "),
        ("./plain.sh", r"chmod \+x \./plain\.sh"),
        ("fly.sh", r"\./fly\.sh"),
    ):
        for name, mode in (("plain.sh", 0o644), ("fly.sh", 0o755)):
            (tmp_path / name).write_text("#!/bin/sh\n")
            (tmp_path / name).chmod(mode)
        with pytest.raises(UsageError, match=said):
            prepared(str(path), [f'flight.script="{command}"'])
    line = 1 + path.read_text().splitlines().index('script = "python hop.py {url}"')
    with pytest.raises(UsageError, match=rf"hop\.toml:{line}: \[flight\] script: hop\.py"):
        prepared(str(path))


def test_scripts_that_can_only_fly_the_first_instance_fly_one_after_the_other(start, tmp_path):
    """Each binds instance 0's port by itself, and so both cannot fly at once."""
    text = (HERE / "hop.toml").read_text()
    own = f"python {HERE / 'hop.py'} udpin:127.0.0.1:14540"
    for name in ("a", "b"):
        (tmp_path / f"{name}.toml").write_text(text.replace("python hop.py {url}", own))

    def flown() -> tuple[int, str]:
        program = start(
            "gcs_tools", "fly", tmp_path / "a.toml", tmp_path / "b.toml", "--allow-commands", "--jobs", "2",
            "--out", tmp_path / "out", "--overwrite", "--figure", "never", "--record", "none", "--json",
        )  # fmt: skip
        return program.wait(), program.text()

    code, told = with_room(flown)
    assert code == 0, told
    found = [result.read(tmp_path / "out" / name / "result.json") for name in ("a", "b")]
    assert [each.ended for each in found] == ["landed", "landed"]


def test_what_a_script_leaves_in_its_folder_is_listed(fly):
    _, found = fly("flight.script=\"sh -c 'touch {out}/mine.csv; exec python hop.py {url}'\"")
    assert found.script is not None and found.script.files == ["mine.csv"]


def test_values_take_the_place_of_words_in_braces(tmp_path):
    told = values(3, tmp_path, 4.0)
    assert tuple(told) == SCRIPT_WORDS
    assert told["url"] == "udpin:127.0.0.1:14543"
    assert told["mavsdk_url"] == "udpin://127.0.0.1:14543"
    assert told["tcp_url"] == "tcp:127.0.0.1:5790"
    assert (told["system_id"], told["speed"], told["out"]) == ("4", "4", str(tmp_path))
    assert only_first(("sh", "{out}")) and not only_first(("sh", "--to={port}"))
    with pytest.raises(CommandError, match=r"\{url\}"):
        command_words("sh {urls}", SCRIPT_WORDS)
