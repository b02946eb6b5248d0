"""A ground script that flies `fcu` on the simulator in C, in lockstep: python fly.py --help."""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

HERE = Path(__file__).parent
POSITION, VELOCITY = 0xDF8, 0xDC7
MODES = {"hold": (4, 3), "takeoff": (4, 2), "offboard": (6, 0), "land": (4, 6), "return": (4, 5)}
WALL_S = 240.0  # the first start of `fcu` compiles


def compile_plant(folder: Path) -> Path:
    """Return the program, compiled."""
    compiler = os.environ.get("CC", "cc")
    if shutil.which(compiler) is None:
        raise SystemExit(
            f"no C compiler '{compiler}': the simulator in C needs one (apt install gcc libc6-dev)"
        )
    program = folder / "plant"
    flags = ["-std=c11", "-O2", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *flags, "-o", program, HERE / "plant.c", "-lm"], check=True)
    return program


def vehicle_lines(airframe: Path, mass_kg: float | None = None, drag: float | None = None) -> str:
    """Return the simulator's vehicle, from what an airframe file believes."""
    tables = tomllib.loads(airframe.read_text())
    rotors, body, limits = tables["rotors"], tables["vehicle"], tables["limits"]
    angles, arm = rotors.get("angle_deg", []), rotors.get("radius_m", 0.0)
    turned = [[arm * f(math.radians(a)) for f in (math.cos, math.sin)] for a in angles]
    places = rotors.get("position_m") or turned
    count = len(places)

    def each(key: str) -> list[float]:
        value = rotors[key]
        return value if isinstance(value, list) else [value] * count

    middle = [sum(pair) / 2 for pair in body["inertia_kg_m2"]]
    drags = [drag] * 3 if drag is not None else tables["air"]["drag"]
    lines = [
        f"mass {sum(body['mass_kg']) / 2 if mass_kg is None else mass_kg}",
        "inertia " + " ".join(map(str, middle)),
        "drag " + " ".join(map(str, drags)),
        f"lag {rotors['lag_s']}",
        f"torque_to_thrust {rotors['torque_to_thrust_m']}",
        f"rotor_inertia {rotors['inertia_kg_m2']}",
        f"thrust_min {limits['thrust_min_n']}",
        f"thrust_max {limits['thrust_max_n']}",
        f"tilt_max {limits['tilt_max_deg']}",
    ]
    for place, spin, k, full in zip(
        places, rotors["spin"], each("thrust_coefficient"), each("full_speed_rad_s"), strict=True
    ):
        lines.append(f"rotor {place[0]} {place[1]} {spin} {k} {full}")
    return "\n".join(lines) + "\n"


class Flight:
    """Run `fcu` and the simulator, and talk to both while simulation time stands."""

    def __init__(
        self,
        program: Path,
        airframe: str,
        vehicle: str,
        folder: Path,
        instance: int,
        options: dict[str, object] | None = None,
    ) -> None:
        self.texts: list[str] = []
        self.acks: list[tuple[int, int]] = []
        self.values: dict[str, list[float]] = {}
        self.echoes = 0
        self.t = 0.0
        self.truth: dict[str, object] = {}
        self.armed = False
        self._system = instance + 1
        self._nonce = 0
        self._sent = 0
        self._log = (folder / "fcu.log").open("w")
        (folder / "vehicle.txt").write_text(vehicle)
        words = [[f"--{key}", str(value)] for key, value in (options or {}).items()]
        command = [program, "--instance", str(instance), "--vehicle", folder / "vehicle.txt"]
        fcu = [Path(sys.executable).with_name("fcu"), "--instance", str(instance)]
        fcu += ["--airframe", airframe, "--link-clock", "sim"]
        self._fcu = subprocess.Popen(fcu, stdout=self._log, stderr=self._log)
        self._plant = subprocess.Popen(
            [*command, *sum(words, [])], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{14540 + instance}")
        self._until(lambda: self.link.target_system == self._system)
        self.barrier()

    def close(self) -> dict[str, object]:
        """End both processes and return the simulator's verdict."""
        verdict: dict[str, object] = {}
        if self._plant.poll() is None:
            assert self._plant.stdin and self._plant.stdout
            try:
                self._plant.stdin.write("end\n")
                self._plant.stdin.close()
                verdict = json.loads(self._plant.stdout.readline() or "{}")
            finally:
                self._plant.wait(10.0)
        self._fcu.terminate()
        self._fcu.wait(30.0)
        self.link.close()
        self._log.close()
        verdict["fcu_exit"], verdict["plant_exit"] = self._fcu.returncode, self._plant.returncode
        return verdict

    def _until(self, met) -> None:
        end = time.monotonic() + WALL_S
        while not met():
            if self._fcu.poll() is not None:
                raise RuntimeError(f"fcu ended with {self._fcu.returncode}: {self._log.name}")
            if time.monotonic() > end:
                raise TimeoutError(f"nothing came for {WALL_S} s at {self.t} s; {self.texts[-3:]}")
            self._hear(0.05)

    def _hear(self, patience: float) -> None:
        message = self.link.recv_match(blocking=True, timeout=patience)
        if message is None:
            return
        kind = message.get_type()
        if kind == "STATUSTEXT":
            self.texts.append(f"{self.t:.2f} {message.severity} {message.text}")
        elif kind == "COMMAND_ACK":
            self.acks.append((message.command, message.result))
        elif kind == "NAMED_VALUE_FLOAT":
            self.values.setdefault(message.name, []).append(message.value)
        elif kind == "HEARTBEAT":
            self.armed = bool(message.base_mode & 128)
            self.mode = message.custom_mode
        elif kind == "POSITION_TARGET_LOCAL_NED":
            self.echoes += 1
        elif kind == "TIMESYNC" and message.tc1:
            self._nonce = message.ts1

    def barrier(self) -> None:
        """Wait until the vehicle has read whatever was sent to it before."""
        self._sent += 1
        self.link.mav.timesync_send(0, self._sent)
        self._until(lambda: self._nonce == self._sent)

    def line(self, text: str) -> None:
        assert self._plant.stdin
        self._plant.stdin.write(text + "\n")
        self._plant.stdin.flush()

    def go(self, seconds: float) -> dict[str, object]:
        """Let simulation time run, then read what the vehicle said."""
        assert self._plant.stdout
        self.t = round(self.t + seconds, 6)
        self.line(f"until {self.t}")
        answer = self._plant.stdout.readline()
        if not answer:
            raise RuntimeError(f"the simulator ended with {self._plant.wait(10.0)}")
        self.truth = json.loads(answer)
        self.barrier()
        return self.truth

    def command(self, number: int, *values: float) -> int:
        """Send a command and return the result of its acknowledgement."""
        self.acks.clear()
        padded = [*values, *[0.0] * (7 - len(values))]
        self.link.mav.command_long_send(self._system, 1, number, 0, *padded)
        self._until(lambda: any(ack[0] == number for ack in self.acks))
        return next(ack[1] for ack in self.acks if ack[0] == number)

    def mode_set(self, name: str) -> int:
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *MODES[name])

    def set(self, name: str, value: float, kind: int = mavlink.MAV_PARAM_TYPE_REAL32) -> None:
        self.link.mav.param_set_send(self._system, 1, name.encode(), value, kind)
        self.barrier()

    def setpoint(self, mask: int, n: float, e: float, d: float) -> None:
        p, v = ((n, e, d), (0.0,) * 3) if mask == POSITION else ((0.0,) * 3, (n, e, d))
        ms = round(self.t * 1000)
        self.link.mav.set_position_target_local_ned_send(
            ms, self._system, 1, 1, mask, *p, *v, *[0.0] * 5
        )
        self.barrier()

    def take_off(self, height_m: float, seconds: float = 8.0) -> bool:
        """Climb, and return whether the vehicle is there by the truth."""
        nan = float("nan")
        self.set("MIS_TAKEOFF_ALT", height_m)
        if self.command(400, 1) != 0:
            return False
        self.command(22, 0, 0, 0, nan, nan, nan, nan)
        here = self.truth["at"][2] if self.truth else 0.0
        self.go(seconds)
        return abs(self.truth["at"][2] - here + height_m) < 0.5

    def stream(self, seconds: float, setpoint, every: float = 0.2) -> None:
        """Stream what `setpoint(t)` returns: a mask and three numbers."""
        for _ in range(round(seconds / every)):
            if self.truth.get("lost"):
                return
            self.setpoint(*setpoint(self.t))
            self.go(every)

    def offboard(self, setpoint) -> int:
        """Begin a stream, and return the result of the change of mode."""
        self.setpoint(*setpoint(self.t))
        self.go(0.1)
        self.setpoint(*setpoint(self.t))
        return self.mode_set("offboard")
