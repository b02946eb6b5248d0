"""A flight controller process whose plant is the test: every state is answered, or the test fails."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import time

import numpy as np
import pymavlink.dialects.v20.common as mavlink

from fcu.interface.airframe import believed
from fcu.interface.messages import VehicleState
from fcu.interface.ports import ports
from fcu.interface.status_texts import Code, Told, brief
from fcu.kernel.algebra import Rotors, Vec3
from fcu.kernel.buffers import to_buffer
from fcu.kernel.rotations import from_euler
from fcu.mavlink.plant_link import PlantCodec
from tests.patience import PATIENCE_S

NAN = math.nan
STILL = Vec3(0.0, 0.0, 0.0)
HOVER = math.sqrt(9.81 / 8.2e-5)  # rad/s, near enough
MASK_POSITION = 0xDF8
HOLD, OFFBOARD, POSITION = 4 << 16 | 3 << 24, 6 << 16, 3 << 16


class Flight:
    """A flight controller process, the plant it believes in (it hovers), and a ground script."""

    def __init__(self, start, instance, *options, streams=None, airframe=None):
        self.at = ports(instance)
        self.program = start(
            "fcu", "--instance", instance, "--link-clock", "sim", *options, **(streams or {})
        )
        self.program.says('"ready"')
        self.plant = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.plant.bind(("127.0.0.1", self.at.plant))
        self.plant.connect(("127.0.0.1", self.at.fcu_plant))
        self.plant.settimeout(PATIENCE_S)
        rotors = airframe or believed()[0]
        self.codec = PlantCodec(self.at.system_id, rotors.spin)
        self.script = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.script.bind(("127.0.0.1", self.at.script))
        self.script.settimeout(PATIENCE_S)
        self.mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        q = from_euler(0.0, 0.0, 0.0)
        self.state = to_buffer(
            VehicleState(
                Vec3(0.0, 0.0, 20.0),
                STILL,
                q,
                STILL,
                Rotors(*[HOVER * abs(s) for s in rotors.spin]),
            )
        )
        self.inbox = []
        self.command = np.zeros(8)
        self.ticks = self.pings = self.stays = 0
        self.ticked = time.monotonic()
        self.tick()

    def tick(self, n=1):
        """n states, each answered before the next: time goes on, and none is lost."""
        for _ in range(n):
            time_us = self.ticks * 2000
            self.plant.send(self.codec.pack_state(time_us, self.state))
            answered, armed, _ = self.codec.parse_controls(self.plant.recv(2048), self.command)
            assert answered == time_us
            self.armed = armed
            self.ticks += 1
        self.ticked = time.monotonic()

    def stay(self):
        """The last state once more: no time goes on, and the plant is not taken for silent."""
        if time.monotonic() - self.ticked > 0.5:  # half of what is taken for silence
            self.plant.send(self.codec.pack_state((self.ticks - 1) * 2000, self.state))
            self.plant.recv(2048)
            self.stays += 1
            self.ticked = time.monotonic()

    def send(self, message, source=(245, 190)):
        self.mav.srcSystem, self.mav.srcComponent = source
        self.raw(message.pack(self.mav))

    def raw(self, datagram, port="fcu_script"):
        self.script.sendto(datagram, ("127.0.0.1", self.at._asdict()[port]))

    def heard(self, kind, condition=lambda m: True, within_s=PATIENCE_S):
        """The first message of a kind that the script was sent and has not been asked for yet."""
        until = time.monotonic() + within_s
        while time.monotonic() < until:
            for message in self.inbox:
                if message.get_type() == kind and condition(message):
                    self.inbox.remove(message)
                    return message
            self.stay()
            if select.select([self.script], [], [], min(within_s, 0.5))[0]:
                self.inbox += self.parser.parse_buffer(self.script.recv(65535)) or []
        raise AssertionError(f"no {kind}; heard {[m.get_type() for m in self.inbox]}")

    def ask(self, command, *params, **options):
        """The result of a COMMAND_LONG, sent again where no answer comes, as clients do."""
        asked = self.long(command, *params, **options)
        return self.insist(asked, "COMMAND_ACK", lambda m: m.command == command, every_s=5.0).result

    def long(self, command, *params, confirmation=0, target=None):
        seven = [*params, *[0.0] * (7 - len(params))]
        system = self.at.system_id if target is None else target
        return mavlink.MAVLink_command_long_message(system, 1, command, confirmation, *seven)

    def setpoint(self, mask=MASK_POSITION, frame=1, r=(0.0, 0.0, -20.0), v=(0, 0, 0), yaw=0.0):
        return mavlink.MAVLink_set_position_target_local_ned_message(
            0, self.at.system_id, 1, frame, mask, *r, *v, 0, 0, 0, yaw, 0
        )

    def stream(self, n=2):
        for _ in range(n):
            self.send(self.setpoint())
            self.sync()

    def drain(self):
        """Forget what has been sent so far."""
        self.script.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                self.script.recv(65535)
        self.script.settimeout(PATIENCE_S)
        self.inbox.clear()

    def asked(self, message_id, kind):
        """A message as it is now."""
        self.sync()
        self.drain()
        self.send(self.long(512, message_id))
        return self.heard(kind)

    def sync(self):
        """All that was sent before has been read, and answered: a ping comes back.

        One that met a full queue, after a flood on a busy machine, is sent again.
        """
        self.pings += 1
        ping = mavlink.MAVLink_ping_message(7, self.pings, 0, 0)
        self.insist(ping, "PING", lambda m: m.seq == self.pings, every_s=5.0)

    def insist(self, message, kind, condition=lambda m: True, every_s=0.05, **options):
        """Send again and again until it is answered: who sends too fast is not heard."""
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            self.send(message, **options)
            with contextlib.suppress(AssertionError):
                return self.heard(kind, condition, within_s=every_s)
        raise AssertionError(f"no {kind}")

    def says(self, what):
        """A text for people that is this Told, or holds this text; chunks are put together."""
        text = brief(what) if isinstance(what, Told) else what
        whole, last = "", None
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            chunk = self.heard("STATUSTEXT")
            whole = whole + chunk.text if chunk.chunk_seq and chunk.id == last else chunk.text
            last = chunk.id
            if text in whole:
                return whole
        raise AssertionError(f"not said: {text}")

    def refuses(self, setpoint, why, **options):
        """A setpoint is not flown, and why is told."""
        self.complains(setpoint, Told(Code.SETPOINT_REFUSED, (why,)), **options)

    def complains(self, setpoint, what, **options):
        """A setpoint has something wrong with it; the same is told at most once a second.

        what : a Told, or a part of its text.
        """
        text = brief(what) if isinstance(what, Told) else what
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            self.send(setpoint, **options)
            self.sync()
            said = "".join(m.text for m in self.inbox if m.get_type() == "STATUSTEXT")
            if text in said:
                return
            select.select([self.script], [], [], 0.05)
        raise AssertionError(f"not told {text!r}: {said}")

    def mode(self):
        """As the heartbeat that is asked for now has it; older ones may be on the way."""
        self.send(self.long(512, 0))
        self.sync()
        beats = [m for m in self.inbox if m.get_type() == "HEARTBEAT"]
        return beats[-1].custom_mode

    @property
    def lives(self):
        """Whether there is no danger of its plant having been silent for too long."""
        return time.monotonic() - self.ticked < 2.0

    def close(self):
        self.plant.close()
        self.script.close()
