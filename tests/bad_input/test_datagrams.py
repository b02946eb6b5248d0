"""Datagrams that are no messages, and too many of them.

`tests/bad_input/README.md` says which line of the bad-input catalogue is where.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import socket
from pathlib import Path

import numpy as np
import pymavlink.dialects.v20.common as mavlink

from tests.bad_input.hovering import NAN, OFFBOARD
from tests.patience import PATIENCE_S


def noise(n, size):
    random = np.random.default_rng(7)
    return [random.bytes(size) for _ in range(n)]


def test_garbage_costs_nothing_and_the_next_good_frame_is_read(flying):
    """P1, P2, P3, P4, P7, P9."""
    good = flying.setpoint().pack(flying.mav)
    bad_crc = good[:-1] + bytes([good[-1] ^ 1])
    odd_flags = good[:2] + b"\x82" + good[3:]
    from_nobody = good[:5] + b"\0" + good[6:]
    unknown = good[:7] + b"\xff\xff\x7f" + good[10:]
    for datagram in (
        b"", b"\0", *noise(50, 1), *noise(50, 300), *noise(2, 60000), *[b"\xfd\xff\x00"] * 20,
        bad_crc, odd_flags, from_nobody, unknown, good[: len(good) // 2],
    ):  # fmt: skip
        flying.raw(datagram)
    flying.tick(5)
    flying.sync()
    flying.tick(5)
    assert flying.mode() == OFFBOARD


def test_garbage_of_one_client_costs_another_nothing(flying):
    """P2: a parser's state is nobody else's."""
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for k in range(20):
        stranger.sendto(b"\xfd\xff\x00", ("127.0.0.1", flying.at.fcu_script))
        flying.send(mavlink.MAVLink_ping_message(7, k, 0, 0))
        assert flying.heard("PING").seq == k
    stranger.close()


def test_a_flood_does_not_lose_a_tick(flying):
    """P12, R6: ten thousand datagrams between twenty ticks."""
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(flying.mav)
    listing = mavlink.MAVLink_param_request_list_message(flying.at.system_id, 1).pack(flying.mav)
    gamma = mavlink.MAVLink_param_set_message(flying.at.system_id, 1, b"MR_GAMMA", NAN, 9)
    flood = [beat, listing, gamma.pack(flying.mav), *noise(3, 1000)]
    for k in range(20):
        for datagram in flood * 80:
            flying.raw(datagram, "fcu_script" if k % 2 else "fcu_station")
        flying.tick()
    flying.tick(20)
    assert flying.armed


def test_three_hundred_strangers_are_not_sent_telemetry(flying):
    """P13: nor do they push out who has proved to be there."""
    proven = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    proven.settimeout(PATIENCE_S)
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(flying.mav)
    proven.sendto(beat, ("127.0.0.1", flying.at.fcu_script))
    assert proven.recv(65535)
    ping = mavlink.MAVLink_ping_message(7, 7, 0, 0).pack(flying.mav)
    strangers = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(300)]
    for stranger in strangers:
        stranger.sendto(ping, ("127.0.0.1", flying.at.fcu_script))
    flying.tick(50)
    flying.sync()
    proven.recv(65535)
    for stranger in strangers:
        stranger.setblocking(False)
        heard = b""
        try:
            while True:
                heard += stranger.recv(65535)
        except BlockingIOError:
            pass
        assert len(heard) < 200  # its answer, and no stream
        stranger.close()
    proven.close()


def test_nine_newcomers_push_out_no_client_that_beats(flight):
    """P13: heartbeats from nine more ports than there are places."""
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(flight.mav)
    to = ("127.0.0.1", flight.at.fcu_script)
    there = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    there.settimeout(PATIENCE_S)
    there.sendto(beat, to)
    assert there.recv(65535)
    crowd = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(17)]
    for each in crowd:
        each.sendto(beat, to)
    flight.sync()
    there.setblocking(False)
    with contextlib.suppress(BlockingIOError):
        while True:
            there.recv(65535)
    there.settimeout(PATIENCE_S)
    assert there.recv(65535)  # and goes on
    for each in (there, *crowd):
        each.close()


def test_requests_leave_no_memory_behind(flight):
    """Thousands of ticks, messages and answers: the process does not grow."""

    def churn(n):
        for k in range(n):
            flight.send(flight.setpoint())
            flight.tick()
            flight.insist(flight.long(512, 30 + k % 4), "COMMAND_ACK")
            flight.inbox.clear()

    churn(3000)
    before = resident(flight.program.pid)
    churn(6000)
    assert resident(flight.program.pid) - before < 1_000_000


def resident(pid):
    """Bytes of memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def test_what_is_dropped_is_counted_by_its_reason_and_told(flight):
    """P1 to P9, C1, S1: in SYS_STATUS, and when the flight controller ends."""
    good = flight.setpoint().pack(flight.mav)
    to_another = flight.long(400, 1, target=77).pack(flight.mav)
    before = flight.asked(1, "SYS_STATUS").errors_comm
    for datagram, times in (
        (b"garbage", 2), (good[: len(good) // 2], 3), (good[:2] + b"\x82" + good[3:], 4),
        (good[:7] + b"\xff\xff\x7f" + good[10:], 5), (good[:5] + b"\0" + good[6:], 6),
        (good[:-1] + bytes([good[-1] ^ 1]), 7), (to_another, 8),
    ):  # fmt: skip
        for _ in range(times):
            flight.raw(datagram)
    for _ in range(9):
        flight.send(flight.setpoint(r=(math.inf, 0.0, 0.0)))
    flight.sync()
    assert flight.asked(1, "SYS_STATUS").errors_comm - before == sum(range(2, 9))
    assert flight.program.interrupted() == 0
    said = json.loads(flight.program.out.read_text().splitlines()[-1])
    assert said["ground_dropped"] == {
        "not MAVLink": 2, "truncated": 3, "unknown flags": 4, "unknown message": 5, "source 0": 6,
        "wrong checksum": 7, "for another": 8, "setpoints refused": 9,
    }  # fmt: skip
    assert said["ticks"] == flight.ticks
    assert (said["refused"], said["resent"]) == (0, flight.stays)
