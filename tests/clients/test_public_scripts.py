"""Scripts flown as public ones are: from a repository, unmodified, and judged by where the vehicle was."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace

import pytest

from tests.clients.public_scripts import FLIES, NOT, WORKS, Runner, Script, listed, table
from tests.process.conftest import claimed_instance

HOP = """
import sys

from pymavlink import mavutil

link = mavutil.mavlink_connection(sys.argv[1])
link.wait_heartbeat()
link.mav.command_long_send(link.target_system, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
link.mav.command_long_send(link.target_system, 1, 22, 0, 0, 0, 0, float("nan"), float("nan"), float("nan"), 3)
while link.recv_match(type="LOCAL_POSITION_NED", blocking=True).z > -2.5:
    pass
link.mav.command_long_send(link.target_system, 1, 21, 0, 0, 0, 0, 0, 0, 0, 0)
link.motors_disarmed_wait()
"""
# a node in the frames of ROS: east, north, up
NODE = """
import rospy
from geometry_msgs.msg import PoseStamped
from mavros_msgs.msg import State
from mavros_msgs.srv import CommandBool, SetMode

state = State()
place = PoseStamped()


def state_cb(said):
    global state
    state = said


def pose_cb(said):
    global place
    place = said


rospy.init_node("there")
rospy.Subscriber("mavros/state", State, state_cb)
rospy.Subscriber("mavros/local_position/pose", PoseStamped, pose_cb)
setpoint = rospy.Publisher("mavros/setpoint_position/local", PoseStamped, queue_size=1)
mode = rospy.ServiceProxy("mavros/set_mode", SetMode)
arm = rospy.ServiceProxy("mavros/cmd/arming", CommandBool)
there = PoseStamped()
there.pose.position.x, there.pose.position.y, there.pose.position.z = 3.0, -2.0, 4.0
there.pose.orientation.w = 1.0
rate = rospy.Rate(20)
asked = rospy.Time.now()
while abs(place.pose.position.z - 4.0) > 0.2 or abs(place.pose.position.x - 3.0) > 0.2:
    setpoint.publish(there)
    if state.connected and rospy.Time.now() - asked > rospy.Duration(1.0):
        asked = rospy.Time.now()
        if state.mode != "OFFBOARD":
            mode(custom_mode="OFFBOARD")
        elif not state.armed:
            arm(True)
    rate.sleep()
heading = place.pose.orientation
print(f"x {place.pose.position.x:.1f} y {place.pose.position.y:.1f} turned {abs(heading.z):.1f}")
mode(custom_mode="AUTO.LAND")
while state.armed:
    rate.sleep()
"""
LISTENS = """
import sys

from pymavlink import mavutil

link = mavutil.mavlink_connection(sys.argv[1])
while True:
    print(link.recv_match(type="HEARTBEAT", blocking=True).custom_mode, flush=True)
"""


@pytest.fixture
def clones(tmp_path):
    """A folder of git repositories: one, with three scripts."""
    place = tmp_path / "clones" / "somebody" / "flights"
    place.mkdir(parents=True)
    for name, text in {"hop.py": HOP, "node.py": NODE, "listens.py": LISTENS}.items():
        (place / name).write_text(text)
    git = [
        "git",
        "-C",
        str(place),
        "-c",
        "user.name=somebody",
        "-c",
        "user.email=somebody@example.org",
    ]
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "Add flights"]):
        subprocess.run([*git, *words], check=True)
    (place / "hop.py").write_text("raise SystemExit(3)")  # not committed: the commit is flown
    return tmp_path / "clones"


@pytest.fixture
def flown(clones, tmp_path):
    """`flown(path, **fields)`: what comes of a script of that repository."""
    with claimed_instance() as instance:
        runner = Runner(
            clones, tmp_path / "out", {}, instance, network=False, pace="speed:4",
            built=tmp_path / "built",
        )  # fmt: skip

        def fly(path, **fields):
            script = Script("somebody/flights", "HEAD", "pymavlink", path, "flies", **fields)
            return runner.fly(script)

        fly.runner = runner
        yield fly


def test_a_script_that_flies(flown):
    got = flown("hop.py", arguments="{url}", up_m=2.0, lands=True)
    assert (got.verdict, got.why) == (FLIES, "")
    assert 2.4 < float(re.match(r"([\d.]+) m up", got.did)[1]) < 3.5


def test_a_script_that_flies_but_not_as_far_as_it_should(flown):
    got = flown("hop.py", arguments="{url}", up_m=2.0, away_m=8.0)
    assert got.verdict == NOT
    assert "away, not 8" in got.why


def test_a_node_flies_by_the_stand_in_for_ros(flown, tmp_path):
    got = flown(
        "node.py",
        arguments="{instance}",
        pythonpath=("ros",),
        up_m=3.7,
        away_m=5.0,
        lands=True,
        for_s=400.0,
    )
    assert (got.verdict, got.why) == (FLIES, "")
    (said,) = (tmp_path / "out").rglob("script.log")
    x, y, turned = re.search(r"x (\S+) y (\S+) turned (\S+)", said.read_text()).groups()
    assert abs(float(x) - 3.0) < 0.3
    assert abs(float(y) + 2.0) < 0.3
    assert float(turned) == 0.0  # yaw from east


def test_a_script_without_end_works_without_flying(flown):
    got = flown("listens.py", arguments="{url}", endless=True, for_s=8.0, says=r"^\d+$|\n\d+\n")
    assert (got.verdict, got.did) == (WORKS, "stays on the ground")


def test_a_script_without_end_that_should_end(flown):
    got = flown("listens.py", arguments="{url}", for_s=8.0)
    assert got.verdict == NOT
    assert "did not end" in got.why


def test_a_script_that_does_not_say_what_it_should(flown):
    got = flown("listens.py", arguments="{url}", endless=True, for_s=8.0, says="landed at home")
    assert got.verdict == NOT


def test_a_program_that_was_built_flies_with_another_beside_it(flown, tmp_path):
    """It begins once the other is ready, and is judged again without a flight."""
    place = tmp_path / "built" / "somebody" / "flights"
    place.mkdir(parents=True)
    programs = {
        "hop": f"test -e made && exec {sys.executable} hop.py $1",
        "makes": "touch $1/made && echo it is made && exec sleep 1000",
    }
    for name, line in programs.items():
        (place / name).write_text(f"#!/bin/sh\n{line}\n")
        (place / name).chmod(0o755)
    folder = tmp_path / "out" / "somebody-flights-hop-py" / "copy"
    fields = {
        "built": "hop", "arguments": "{url}", "beside": f"somebody/flights/makes {folder}",
        "ready": "is made", "up_m": 2.0, "lands": True, "logged": r"Armed[\s\S]*Disarmed",
    }  # fmt: skip
    assert flown("hop.py", **fields).verdict == FLIES
    script = Script("somebody/flights", "HEAD", "pymavlink", "hop.py", "flies", **fields)
    assert flown.runner.judged(script).verdict == FLIES
    judged = flown.runner.judged(replace(script, logged="Mode Orbit"))
    assert (judged.verdict, "did not log" in judged.why) == (NOT, True)
    assert flown.runner.judged(replace(script, up_m=9.0)).verdict == NOT


def test_the_list_names_each_script_once_and_what_it_is_judged_by():
    scripts = listed()
    assert len({script.name for script in scripts}) == len(scripts) > 100
    for script in scripts:
        assert script.program or re.fullmatch("[0-9a-f]{7,40}", script.commit), script.name
        assert not script.lands or script.up_m or script.away_m, script.name
        assert script.does, script.name
        # nothing else tells a script that works from one that waits for ever
        evidence = script.up_m or script.away_m or script.says or script.logged or script.wants
        assert evidence or not script.endless, script.name


def test_the_table_counts():
    scripts = listed()[:3]
    told = zip(scripts, (FLIES, WORKS, NOT), strict=True)
    results = {
        script.name: {"verdict": verdict, "did": "", "why": "a|b", "at": "0123456"}
        for script, verdict in told
    }
    page = table(listed(), results)
    assert page.splitlines()[0].startswith(
        "3 scripts of 1 repositories: 1 fly, 1 do without flying"
    )
    assert "a/b" in page


@pytest.mark.parametrize(("lines", "code"), [(["ready", "4"], 0), (["ready", "x"], 1)])
def test_typed_lines_reach_the_program(lines, code):
    program = "print('ready'); print(int(input()) * 2)"
    typed = [
        sys.executable,
        "-m",
        "tests.clients.typed",
        "2",
        *lines,
        sys.executable,
        "-c",
        program,
    ]
    done = subprocess.run(typed, capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert ("8" in done.stdout.split()) == (code == 0)
