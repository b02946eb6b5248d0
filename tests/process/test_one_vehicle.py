"""One vehicle, whatever carries it: over the wire, in real time, and in memory.

A script is a list: at which tick, from whom, what is asked. Time stands while it is asked. Each is
flown in all ways; every row, every line of log and every answer must be the same.
"""

from __future__ import annotations

import math
import os
import signal
from collections import deque
from contextlib import ExitStack
from enum import IntEnum

import pytest

from fcu.interface.link import UdpLink
from fcu.interface.messages import Setpoint
from fcu.interface.ports import ports
from fcu.kernel.algebra import Vec3
from fcu.mavlink import replies, setpoints
from fcu.mavlink.definitions import IGNORE_POSITION, CommandId, Result
from fcu.mavlink.framing import Source
from fcu.mavlink.ground_link import GroundCodec
from fcu.mavlink.px4_modes import AutoMode, MainMode
from gcs_tools.flight import ground_script
from gcs_tools.flight.ground_script import ME, Vehicle, VehicleError
from gcs_tools.flight.memory_flight import MemoryFlight
from gcs_tools.flight.run import UsageError, fly
from gcs_tools.flight.scenario import scenario
from gcs_tools.flight.wire_flight import WireFlight
from gcs_tools.missions.mission import from_tables

RATE_HZ = 250
ANOTHER = Source(254, 190)
ITS_PORT = 14999  # in memory: any that is free
STILL = Vec3(0.0, 0.0, 0.0)
FORCED = 21196.0  # ARM_DISARM's second parameter, for disarming in the air


def fly_to(x, y, z, psi=0.0):
    return lambda v: v.set_setpoint(Setpoint(Vec3(x, y, z), STILL, STILL, psi, 0.0))


def fly_at(v_x, v_y, v_z):
    wanted = Setpoint(STILL, Vec3(v_x, v_y, v_z), STILL, 0.0, 0.0)
    return lambda v: v.set_setpoint(wanted, 0.0, IGNORE_POSITION)


class Command(IntEnum):
    UNKNOWN = 31000


def offer(x, y, z):
    """A setpoint that is not expected to be flown: nobody waits for its echo, but for its turn."""
    asked = Setpoint(Vec3(x, y, z), STILL, STILL, 0.0, 0.0)

    def send(v):
        v._link.send(v._codec.framed(setpoints.setpoint(v._target, 0.0, asked)))
        v.command(CommandId.REQUEST_CAPABILITIES)  # is answered after it

    return send


def beat(v):
    """A ground station's heartbeat, and a question that is answered after it."""
    v.greet()
    v.command(CommandId.REQUEST_CAPABILITIES)


def do(command, *params):
    return lambda v: v.command(command, *params, tries=2)


def mode(main, sub=AutoMode.NONE):
    return do(CommandId.SET_MODE, 1.0, main, sub)


def parameter(name, value):
    return lambda v: v.set_parameter(name, value, tries=1)


def streamed(first, last, *asked, every=100, who="script"):
    """The same again and again, as a script sends it that does not want to be taken for lost."""
    return [(k, who, what) for k in range(first, last, every) for what in asked]


LAND, DISARM, TAKEOFF = CommandId.LAND, CommandId.ARM_DISARM, CommandId.TAKEOFF
FAIL = CommandId.INJECT_FAILURE
OFFBOARD, LOITER = mode(MainMode.OFFBOARD), mode(MainMode.AUTO, AutoMode.LOITER)
NAN = math.nan
DEEP = (40, "script", parameter("MR_SP_BELOW", 100.0))
HIGH = streamed(50, 1000, fly_to(0.0, 0.0, 3.0))

# name: (the tick at which it ends, [(tick, who, what)])
SCRIPTS = {
    "lands": (2500, [(200, "script", fly_to(1.0, 0.0, 3.0)), (403, "script", do(LAND))]),
    "loses its stream": (1500, [(7, "script", fly_to(2.0, 1.0, 4.0))]),
    "lands by itself, its stream lost": (
        4000, [(3, "script", parameter("COM_OBL_RC_ACT", 4.0)), (11, "script", fly_to(1.0, 1.0, 3.0))],
    ),
    "is refused": (
        700,
        [
            (10, "script", do(CommandId.CHANGE_SPEED, 1.0, 1e6)),
            (90, "script", fly_to(500.0, 0.0, 4.0)),
            (91, "script", offer(math.inf, 0.0, 4.0)),
            (180, "script", do(Command.UNKNOWN)),
            (181, "script", do(TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, 5.0)),
            *streamed(200, 700, fly_to(0.0, 0.0, 3.0)),
        ],
    ),
    "is disarmed in the air": (
        1000, [(100, "script", do(DISARM, 0.0)), (203, "script", do(DISARM, 0.0, FORCED))],
    ),
    "is terminated": (1000, [(150, "script", do(CommandId.FLIGHT_TERMINATION, 1.0))]),
    "is led into the ground": (
        4000, [DEEP, *HIGH, *streamed(1000, 4000, fly_to(0.5, 0.0, -2.0))]
    ),
    "is raised again before it lands": (
        3000,
        [
            DEEP, *HIGH, *streamed(1000, 1850, fly_to(0.5, 0.0, -9.0)),
            *streamed(1850, 3000, fly_to(0.0, 0.0, 3.0)),
        ],
    ),
    "changes mode": (
        1600,
        [
            (100, "script", LOITER), (333, "script", fly_to(1.0, 1.0, 4.0)),
            (334, "script", fly_to(1.0, 1.0, 4.0)), (335, "script", OFFBOARD),
            *streamed(400, 800, fly_to(1.0, 1.0, 4.0)),
            (801, "script", mode(MainMode.POSITION)), (1000, "script", mode(MainMode.ACRO)),
            (1100, "script", do(CommandId.RETURN)),
        ],
    ),
    "changes parameters": (
        900,
        [
            (60, "script", fly_to(3.0, 0.0, 5.0)), (61, "script", parameter("MPC_XY_VEL_MAX", 2.0)),
            (140, "script", parameter("MR_GAMMA", 400.0)), (141, "script", parameter("NO_SUCH", 1.0)),
            *streamed(200, 900, fly_to(-3.0, 0.0, 4.0)),
        ],
    ),
    "has failures injected": (
        1500,
        [
            (40, "script", do(FAIL, 101.0, 1.0, 2.0)), (41, "script", parameter("SYS_FAILURE_EN", 1.0)),
            *streamed(50, 1500, fly_to(1.0, 0.0, 4.0)),
            (301, "script", do(FAIL, 101.0, 4.0, 2.0, 0.7)), (302, "script", do(FAIL, 101.0, 1.0, 9.0)),
            (303, "script", do(FAIL, 4.0, 1.0, 0.0)), (501, "script", do(FAIL, 101.0, 0.0, 2.0)),
            (601, "script", do(FAIL, 6.0, 3.0, 0.0, 0.05, 0.4)),
            (801, "script", do(FAIL, 6.0, 6.0, 0.0, 0.02, 0.4)),
            (901, "script", do(FAIL, 100.0, 1.0, 0.0)), (1401, "script", do(FAIL, 100.0, 0.0, 0.0)),
        ],
    ),
    "loses its state, and is terminated": (
        1000,
        [
            (40, "script", parameter("SYS_FAILURE_EN", 1.0)),
            (41, "script", parameter("CBRK_FLIGHTTERM", 0.0)),
            (101, "script", do(FAIL, 6.0, 1.0, 0.0, 0.0, 0.3)), (403, "script", do(FAIL, 6.0, 1.0, 0.0)),
        ],
    ),
    "hears nobody for a while": (
        1200,
        [
            (40, "script", parameter("SYS_FAILURE_EN", 1.0)), (41, "script", do(FAIL, 105.0, 1.0)),
            *streamed(50, 350, fly_to(1.0, 0.0, 4.0)), (350, "script", do(FAIL, 105.0, 1.0, 0.0, 0.0, 2.0)),
            (600, "station", do(CommandId.RETURN)), (860, "script", LOITER),
        ],
    ),
    "loses its station": (
        2500,
        [
            (2, "station", beat), (3, "station", parameter("NAV_DLL_ACT", 1.0)),
            (4, "station", parameter("COM_DL_LOSS_T", 5.0)),
            *streamed(10, 2500, fly_to(1.0, 0.0, 4.0)), (2001, "station", beat),
        ],
    ),
    "has two who command": (
        1200,
        [
            *streamed(10, 500, fly_to(1.0, 0.0, 3.0)),
            *streamed(60, 460, offer(-1.0, 0.0, 3.0), who="station"),
            (600, "station", LOITER),
            *streamed(640, 1200, fly_to(-2.0, 0.0, 4.0), every=50, who="station"),
            (700, "station", OFFBOARD),
        ],
    ),
    "flies by velocity": (
        4000,
        [
            DEEP, *HIGH, *streamed(1000, 1600, fly_at(1.0, 0.5, 0.2), every=50),
            *streamed(1600, 3800, fly_at(0.0, 0.0, -3.0)),
        ],
    ),
    "lands, and takes off again": (
        5200,
        [
            (20, "script", do(LAND)), (2600, "script", do(DISARM, 1.0)),
            (2650, "script", do(TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, 2.0)),
            (2651, "script", fly_to(0.0, 0.0, 9.0)), (4200, "script", do(LAND)),
            (4300, "station", do(LAND)), (4301, "script", LOITER),
        ],
    ),
}  # fmt: skip

# of which not all are flown in real time
PACED = ("is refused", "has two who command", "is disarmed in the air")


def scene(name):
    """A hover in wind and noise, as long as a script; who goes HIGH knows the ground by standing on it."""
    last, script = SCRIPTS[name]
    air = {"position_m": [0.0, 0.0, 3.0]}
    return scenario(
        from_tables(
            "hover",
            {
                "title": "A hover.",
                "flight": {
                    "duration_s": last / RATE_HZ, "rate_hz": RATE_HZ, "ground_z_m": 0.0, "seed": 3,
                    "start": {"on_ground": True} if HIGH[0] in script else air,
                    "setpoints": [{"at_s": 0.0, "position_m": [0.0, 0.0, 3.0]}],
                },
                "plant": {"noise": {"position_m": 0.002, "rate_rad_s": 0.01}, "delay_s": 0.008},
                "wind": {"steady_m_s": [2.0, 1.0, 0.0]},
                "expect": {"reference_error_max_m": 1e9},
            }
        )
    )  # fmt: skip


def in_turn(script):
    """A script in the order of time; at one tick, in its own."""
    return sorted(script, key=lambda each: each[0])


class Scripted:
    """A flight that is asked what is in a script, in place of a mission's setpoints."""

    script = ()

    def _send_setpoints(self, vehicle):
        self.answers = []
        with ExitStack() as stack:
            ask = {"script": vehicle, "station": self.another()}
            stack.callback(ask["station"].close)
            for tick, who, what in in_turn(self.script):
                if not self._fly_to(tick):
                    break
                self.answers.append((tick, answer(what, ask[who])))
            self._fly_to(self._scene.ticks)
        return False


def answer(what, vehicle):
    try:
        what(vehicle)
    except VehicleError as error:
        return str(error)
    return "done"


class OverTheWire(Scripted, WireFlight):
    def another(self):
        made = Vehicle(self._instance, UdpLink(0, ports(self._instance).fcu_station), ANOTHER)
        made.on_wait = self._pair.check
        return made


class InMemory(Scripted, MemoryFlight):
    def another(self):
        return self.meet(ITS_PORT, ANOTHER)


def said(folder):
    """Every line of both logs, but for those that tell of ports."""
    return [
        line for name in ("fcu", "plant") for line in (folder / f"{name}.log").read_text().splitlines()
        if " instance " not in line and "compiling" not in line
    ]  # fmt: skip


@pytest.fixture
def flown(tmp_path, instance):
    """`flown("lands", speed)`: rows, lines and answers; in memory without a speed."""

    def fly(name, *speed):
        folder = tmp_path / f"{name} {speed}"
        folder.mkdir()
        ignored = (lambda rows: None,) * 2
        if speed:
            flight = OverTheWire(scene(name), folder, instance, *speed, ignored, lambda t: None)
        else:
            flight = InMemory(scene(name), folder, ignored)
        flight.script = SCRIPTS[name][1]
        found = flight.fly()
        return found.plant.tobytes(), found.fcu.tobytes(), said(folder), flight.answers

    return fly


def test_scripts_are_a_dozen_and_none_asks_after_its_end():
    assert len(SCRIPTS) >= 12
    for name, (last, script) in SCRIPTS.items():
        assert max(tick for tick, *_ in script) < last, name


EXPECTED = {  # words of its log: that it has done what it is there for
    "lands": ("Land", "Disarmed"),
    "loses its stream": ("lost",),
    "lands by itself, its stream lost": ("lost", "Disarmed"),
    "is refused": ("Setpoint rejected", "limited"),
    "is disarmed in the air": ("Disarmed", "hit the ground"),
    "is terminated": ("erminat",),
    "is led into the ground": ("ground", "Disarmed"),
    "is raised again before it lands": ("ground",),
    "changes mode": ("Hold", "Offboard", "Position", "Return"),
    "changes parameters": (),
    "has failures injected": (
        "SYS_FAILURE_EN is 0",
        "Injected: motor 2 wrong",
        "rotor, size or time",
        "no such unit or type",
        "Cleared: motor 2",
        "Injected: vio garbage",
        "Battery emergency: 0 %",
        "Cleared: battery",
    ),
    "loses its state, and is terminated": (
        "State failed",
        "State valid again",
        "State lost",
        "rotors stopped",
    ),
    "hears nobody for a while": (
        "needs seconds",
        "Injected: mavlink_signal off",
        "Offboard lost",
        "RETURN",
        "Mode Hold",
    ),
    "loses its station": ("Ground station lost", "Failsafe: mode Hold", "heard again"),
    "has two who command": ("255/190 is sending", "Hold", "Offboard"),
    "flies by velocity": ("ground",),
    "lands, and takes off again": ("Disarmed", "Takeoff"),
}


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_has_one_flight_and_one_log(flown, name):
    in_memory = flown(name)
    lines, answers = in_memory[2:]
    text = "\n".join([*lines, *(each for _, each in answers)])
    for word in EXPECTED[name]:
        assert word.lower() in text.lower(), text
    over_the_wire = flown(name, None)
    assert over_the_wire[3] == answers
    assert over_the_wire[2] == lines
    assert over_the_wire[:2] == in_memory[:2]


@pytest.mark.parametrize("name", PACED)
def test_a_script_has_the_same_flight_in_real_time(flown, name):
    assert flown(name, 1.0) == flown(name)


def test_a_script_has_the_same_flight_on_a_busy_machine(flown, busy_neighbours):
    name = "has two who command"
    assert flown(name, None) == flown(name)


class SlowLink:
    """A vehicle that acknowledges nothing before it was asked twice, and then both."""

    def __init__(self):
        self.codec, self.asked, self.inbox = GroundCodec(1, 1), 0, deque()

    def send(self, datagram):
        self.asked += 1
        ack = replies.command_ack(CommandId.LAND, Result.ACCEPTED, ME)
        self.inbox.append(self.codec.framed(ack))

    def wait(self, timeout_s):
        return self.asked > 1

    def receive(self):
        return self.inbox.popleft() if self.asked > 1 and self.inbox else None


def test_a_client_that_asks_twice_awaits_both_answers(monkeypatch):
    """Or the second would take effect when time has gone on."""
    monkeypatch.setattr(ground_script, "ANSWER_S", 0.01)
    link = SlowLink()
    Vehicle(0, link).command(CommandId.LAND)
    assert link.asked == 2
    assert not link.inbox


@pytest.mark.parametrize("option", [{"speed": 1.0}, {"instance": 3}], ids=str)
def test_a_flight_in_memory_has_neither_speed_nor_instance(tmp_path, option):
    with pytest.raises(UsageError, match="in process"):
        fly("gust_step", in_process=True, out=tmp_path / "run", **option)
    assert not (tmp_path / "run").exists()


def test_an_interrupt_waits_for_the_end_of_a_burst(tmp_path):
    """What was flown by then is recorded and judged: nothing of it is lost or torn."""
    kept = [], []

    def interrupt(rows):
        kept[0].append(rows)
        if len(kept[0]) == 3:
            os.kill(os.getpid(), signal.SIGINT)

    flight = MemoryFlight(scene("changes mode"), tmp_path, (interrupt, kept[1].append))
    with pytest.raises(KeyboardInterrupt):
        flight.fly()
    flown = flight.flown()
    assert len(flown.plant) == len(flown.fcu) == sum(map(len, kept[0])) > 0
    assert sum(map(len, kept[0])) == sum(map(len, kept[1]))
