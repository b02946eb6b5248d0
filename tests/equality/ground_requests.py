"""Requests of scripts and ground stations to a vehicle in flight, drawn by a seed, in raw pymavlink."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

SCRIPT, STATION, LATE = "script", "station", "late"  # a second station, that comes under way
NAN = math.nan
OFFBOARD, POSITION, AUTO = 6, 3, 4
LOITER, RETURN, LAND, TAKE_OFF = 3, 5, 6, 2
FORCE_DISARM, FORCE_REBOOT = 21196.0, 20190226.0
PARAMETERS = (
    ("MPC_XY_CRUISE", 3.0), ("MPC_XY_CRUISE", -3.0), ("MPC_TKO_SPEED", 1.0), ("MIS_TAKEOFF_ALT", 4.0),
    ("COM_OF_LOSS_T", 0.6), ("COM_OBL_RC_ACT", 4.0), ("MR_F_M", 1.5), ("MR_F_M", 50.0), ("MR_GUARD", 1.0),
    ("RTL_RETURN_ALT", 5.0), ("BAT_LOW_THR", 0.3), ("BAT1_CAPACITY", 9000.0), ("MAV_TYPE", 2.0),
    ("COM_DISARM_LAND", 1.0), ("SYS_NOTHING", 1.0), ("MPC_LAND_SPEED", NAN), ("MR_GAMMA", 1500.0),
)  # fmt: skip


class Sent(NamedTuple):
    """A datagram and when it is sent, simulation time, s."""

    at_s: float
    by: str
    datagram: bytes


class Client:
    """Packs what one client sends, with its sequence numbers."""

    def __init__(self, by: str, system: int, component: int) -> None:
        self.by = by
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)

    def send(self, at_s: float, name: str, *fields: Any) -> Sent:
        """A message by its name in small letters and its fields, as pymavlink's encoders take them."""
        packed = getattr(self._mav, f"{name}_encode")(*fields).pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return Sent(at_s, self.by, packed)

    def command(
        self, at_s: float, command: int, *params: float, to: int = 1, again: int = 0
    ) -> Sent:
        """COMMAND_LONG. Parameters not given are 0."""
        seven = (*params, *[0.0] * (7 - len(params)))
        return self.send(at_s, "command_long", to, 1, command, again, *seven)

    def heartbeat(self, at_s: float) -> Sent:
        """HEARTBEAT of a ground station."""
        return self.send(at_s, "heartbeat", 6, 8, 0, 0, 4)


def requests(seed: int, until_s: float) -> list[Sent]:
    """Draw all datagrams of a flight: the commands and setpoints that fly it, and questions between."""
    draw = random.Random(seed)
    script, station, late = (
        Client(SCRIPT, 245, 190),
        Client(STATION, 255, 190),
        Client(LATE, 250, 191),
    )
    sent = [*_course(draw, script, station), *_questions(draw, (script, station), until_s)]
    sent += [one.heartbeat(0.1 + t) for one in (script, station) for t in range(int(until_s))]
    sent += [late.heartbeat(t) for t in (12.0, 13.0, 14.0)]
    return sorted((each for each in sent if each.at_s < until_s), key=lambda each: each.at_s)


def _course(draw: random.Random, script: Client, station: Client) -> Iterator[Sent]:
    """Arm, take off, fly setpoints of every kind, lose the stream, hold, go on, return, land."""
    yield station.send(0.2, "param_request_list", 1, 1)
    yield script.command(0.4, 400, 0.0)
    yield script.command(0.5, 176, 1.0, OFFBOARD)  # without a setpoint
    yield script.command(0.8, 401)
    yield script.command(1.0, 400, 1.0)
    yield script.command(1.2, 22, NAN, NAN, NAN, NAN, NAN, NAN, 3.0)
    legs = [(5.0 + 1.5 * n, kind) for n, kind in enumerate(draw.sample(range(8), 8))]
    for began, kind in legs:
        point = [draw.uniform(-4.0, 4.0), draw.uniform(-4.0, 4.0), -draw.uniform(2.0, 6.0)]
        for n in range(15):
            yield _setpoint(script, began + 0.1 * n, kind, point)
    yield script.command(5.3, 176, 1.0, OFFBOARD)
    yield script.command(14.6, 176, 1.0, AUTO, LOITER)
    yield script.command(15.0, 176, 1.0, OFFBOARD)  # then nothing is sent from 17 s on
    place = 47.3977 + draw.uniform(-1e-5, 1e-5), 8.5456 + draw.uniform(-1e-5, 1e-5)
    yield station.send(20.0, "command_int", 1, 1, 6, 192, 0, 0, -1.0, 1.0, 0.0, NAN, int(place[0] * 1e7), int(place[1] * 1e7), 6.0)  # fmt: skip
    yield station.command(21.0, 178, 1.0, 2.0, -1.0)
    for n in range(10):
        stick = [draw.randint(-1000, 1000) for _ in range(4)]
        yield station.send(22.0 + 0.1 * n, "manual_control", 1, stick[0], stick[1], abs(stick[2]), stick[3], 0)  # fmt: skip
    yield station.command(21.8, 176, 1.0, POSITION)
    yield station.command(23.5, 20)
    yield station.command(27.0, 176, 1.0, AUTO, LAND)


def _setpoint(script: Client, at_s: float, kind: int, p: list[float]) -> Sent:
    """A setpoint of one of eight kinds, one of which makes no sense."""
    ms = int(at_s * 1000)
    v = [0.2 * each for each in p]
    if kind in (0, 1, 2, 3, 4):
        mask = (0xDF8, 0x9F8, 0xDC7, 0xC38, 0xFFF)[kind]  # place; and yaw; velocity; all; nothing
        return script.send(at_s, "set_position_target_local_ned", ms, 1, 1, 1, mask, *p, *v, 0, 0, 0, 0.5, 0.1)  # fmt: skip
    if kind == 5:
        place = int(47.3977419e7 + 30 * p[0]), int(8.5455938e7 + 30 * p[1])
        return script.send(at_s, "set_position_target_global_int", ms, 1, 1, 6, 0xDF8, *place, 4.0, 0, 0, 0, 0, 0, 0, 0, 0)  # fmt: skip
    if kind == 6:
        half = 0.02 * p[0]
        return script.send(at_s, "set_attitude_target", ms, 1, 1, 7, [math.cos(half), math.sin(half), 0.0, 0.0], 0.0, 0.0, 0.0, 0.45)  # fmt: skip
    return script.send(
        at_s, "set_position_target_local_ned", ms, 1, 1, 8, 0xDF8, NAN, 0, 0, *[0] * 8
    )


def _questions(draw: random.Random, clients: tuple[Client, ...], until_s: float) -> Iterator[Sent]:
    """Something of somebody's, every tenth of a second or so: much of it is refused."""
    at_s = 0.3
    while (at_s := at_s + draw.choice((0.05, 0.1, 0.2, 0.3))) < until_s:
        one = draw.choice(clients)
        yield draw.choice(QUESTIONS)(draw, one, round(at_s, 2))


def _set_parameter(draw: random.Random, one: Client, at_s: float) -> Sent:
    name, value = draw.choice(PARAMETERS)
    return one.send(at_s, "param_set", 1, 1, name.encode(), value, draw.choice((9, 9, 9, 6, 2)))


def _read_parameter(draw: random.Random, one: Client, at_s: float) -> Sent:
    by_name = draw.random() < 0.7
    index = -1 if by_name else draw.choice((0, 3, 20, 3000))
    return one.send(at_s, "param_request_read", 1, 1, draw.choice(PARAMETERS)[0].encode(), index)


def _set_interval(draw: random.Random, one: Client, at_s: float) -> Sent:
    number = draw.choice((30, 32, 33, 74, 83, 105, 147, 350, 0))
    return one.command(at_s, 511, number, draw.choice((0.0, -1.0, 50_000.0, 500_000.0, -7.0)))


def _request_message(draw: random.Random, one: Client, at_s: float) -> Sent:
    number = draw.choice((0, 1, 24, 32, 147, 148, 242, 244, 245, 300, 331, 350, 435, 436, 9, 76))
    return one.command(at_s, 512, number, draw.choice((0.0, 0.0, 1.0, 30.0)))


def _mode(draw: random.Random, one: Client, at_s: float) -> Sent:
    main, sub = draw.choice(((1, 0), (7, 0), (AUTO, 4), (AUTO, 99), (99, 0), (5, 0)))
    if draw.random() < 0.3:
        return one.send(at_s, "set_mode", 1, 1, main << 16 | sub << 24)
    return one.command(at_s, 176, draw.choice((1.0, 0.0)), main, sub)


COMMANDS = (
    (16,), (115, 90.0, 10.0), (21, 0, 0, 0, 0, 40.0, 8.0), (22, 0, 0, 0, 0, 10.0, 8.0, 3.0), (22, 5.0),
    (178, 0.0, 3.0), (178, 1.0, -5.0), (178, 1.0, 400.0), (179, 0.0), (179, 1.0), (185, 0.0), (192, -1.0),
    (193, 1.0), (193, 7.0), (241, 1.0), (245, 0.0), (245, 1.0), (245, 2.0),
    (246, 3.0), (262, 3.0), (262, 77.0), (300, 1.0, 1.0), (400, 7.0), (400, 0.0), (400, NAN), (400, 1.0),
    (410,), (510, 30.0), (510, 9.0), (519, 1.0), (520, 1.0), (521, 1.0), (2000,), (31010,), (176, math.inf),
)  # fmt: skip


def _command(draw: random.Random, one: Client, at_s: float) -> Sent:
    command, *params = draw.choice(COMMANDS)
    to = draw.choice((1, 1, 1, 1, 0, 9))
    return one.command(at_s, int(command), *params, to=to, again=draw.choice((0, 0, 1)))


def _command_int(draw: random.Random, one: Client, at_s: float) -> Sent:
    command, frame = draw.choice((179, 192, 400, 22, 999)), draw.choice((0, 6, 11, 8))
    place = draw.choice(((473977419, 85455938), (2**31 - 1, 2**31 - 1), (0, 0)))
    return one.send(at_s, "command_int", 1, 1, frame, command, 0, 0, 0.0, 0.0, 0.0, NAN, *place, draw.choice((5.0, 490.0, NAN)))  # fmt: skip


def _other(draw: random.Random, one: Client, at_s: float) -> Sent:
    name, *fields = draw.choice(OTHERS)
    return one.send(at_s, name, *fields)


OTHERS = (
    ("timesync", 0, 123456789), ("timesync", 5, 6), ("ping", 17, 3, 0, 0), ("ping", 17, 3, 1, 1),
    ("request_data_stream", 1, 1, 6, 10, 1), ("request_data_stream", 1, 1, 10, 5, 0),
    ("mission_request_list", 1, 1), ("mission_count", 1, 1, 0), ("mission_count", 1, 1, 3),
    ("mission_clear_all", 1, 1), ("mission_request_int", 1, 1, 0), ("mission_set_current", 1, 1, 2),
    ("log_request_list", 1, 1, 0, 0xFFFF), ("log_request_data", 1, 1, 0, 0, 90),
    ("file_transfer_protocol", 0, 1, 1, [1, 0, 0, 3] + [0] * 247),
    ("serial_control", 10, 2, 0, 0, 4, [104, 101, 108, 112] + [0] * 66),
    ("param_ext_request_list", 1, 1), ("param_ext_request_read", 1, 1, b"X", -1),
    ("param_request_list", 1, 1), ("rc_channels_override", 1, 1, *[1500] * 8),
    ("set_gps_global_origin", 1, 473977419, 85455938, 488000),
    ("set_actuator_control_target", 0, 0, 1, 1, [0.0] * 8), ("manual_control", 1, 10, 20, 500, 0, 0),
    ("statustext", 6, b"hello"), ("attitude", 0, 0, 0, 0, 0, 0, 0),
)  # fmt: skip


def _broken(draw: random.Random, one: Client, at_s: float) -> Sent:
    """A datagram that is no message: torn, of a wrong checksum, signed, or noise."""
    good = one.send(at_s, "param_request_list", 1, 1).datagram
    torn = good[:-4], good[:-1] + bytes([good[-1] ^ 1]), bytes([good[0], good[1], 1]) + good[3:], good + good  # fmt: skip
    noise = draw.randbytes(draw.randint(1, 300))
    return Sent(at_s, one.by, draw.choice((*torn, noise, b"")))


QUESTIONS = (
    _set_parameter, _read_parameter, _set_interval, _request_message, _mode, _command, _command,
    _command, _command_int, _other, _other, _broken,
)  # fmt: skip
