"""A controller that commands a constant thrust, and misbehaves: INSTANCE HOW PIDS [TICK].

PIDS: a file to which it writes the pids of its processes. From TICK on it does what HOW says.
"""

import math
import os
import signal
import socket
import struct
import subprocess
import sys

from pymavlink.dialects.v20 import common as mavlink

instance, how, pids = int(sys.argv[1]), sys.argv[2], sys.argv[3]
since = int(sys.argv[4]) if len(sys.argv) > 4 else 100
with open(pids, "a") as file:
    print(os.getpid(), file=file, flush=True)
FOREVER = [sys.executable, "-c", "import signal; signal.pause()"]
if how == "leaves":  # one in its session, one in a session of its own
    for new in (False, True):
        child = subprocess.Popen(FOREVER, start_new_session=new)
        with open(pids, "a") as file:
            print(child.pid, file=file, flush=True)
if how in ("leaves", "stubborn"):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
if how == "refuses":
    sys.exit("nothing to fly today")
if how == "absent":
    signal.pause()


def udp(port):
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", port))
    return link


plant, beside = udp(4660 + instance), udp(0)
mav = mavlink.MAVLink(None, instance + 1, 1)
elsewhere = mavlink.MAVLink(None, instance + 2, 1)
tick = 0


def controls(time_us, u, by=mav):
    return mavlink.MAVLink_hil_actuator_controls_message(time_us, [u] * 8 + [0.0] * 8, 129, 1).pack(
        by
    )


while True:
    datagram, simulator = plant.recvfrom(4096)
    state = mav.parse_buffer(datagram)[0]
    if state.get_type() == "HEARTBEAT":
        if how == "answers_holds":
            (time_us,) = struct.unpack_from(
                "<Q", datagram, 21 + 10
            )  # of ODOMETRY, behind HEARTBEAT
            plant.sendto(controls(time_us, 0.6266), simulator)
        continue
    now = state.time_usec
    answer = controls(now, 0.6266)
    tick += 1
    if how == "twice":
        plant.sendto(answer, simulator)
    if tick < since:
        plant.sendto(answer, simulator)
        continue
    if how == "dies":
        print("the last word", flush=True)
        sys.exit(7)
    elif how == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    elif how == "talks":
        while True:
            print("and another thing" * 1000)
    elif how == "hangs":
        signal.pause()
    elif how == "suspended":
        os.kill(os.getpid(), signal.SIGSTOP)
    elif how == "wrong_id":
        answer = controls(now, 0.6266, elsewhere)
    elif how == "nan":
        answer = controls(now, math.nan)
    elif how == "out_of_range":
        answer = controls(now, 1.5)
    elif how == "checksum":
        answer = answer[:-1] + bytes([answer[-1] ^ 1])
    elif how == "other_state":
        answer = controls(now + 1, 0.6266)
    elif how == "flood":
        while True:
            for wrong in (b"\xfd garbage", controls(now + 2000, 0.6266), controls(now, math.nan)):
                plant.sendto(wrong, simulator)
    elif how == "chatter":  # the right answer among a hundred others
        for _ in range(100):
            plant.sendto(controls(0, 0.6266), simulator)
    elif how == "other_port":
        beside.sendto(answer, simulator)
        continue
    plant.sendto(answer, simulator)
