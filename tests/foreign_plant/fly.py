"""A ground script that flies `fcu` on the simulator in C, in lockstep: python fly.py --help."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

HERE = Path(__file__).parent
Setpoint = Callable[[float], tuple[int, float, float, float]]
POSITION, VELOCITY = 0xDF8, 0xDC7
MODES = {
    "hold": (4, 3), "takeoff": (4, 2), "offboard": (6, 0), "land": (4, 6), "return": (4, 5),
    "follow": (4, 8),
}  # fmt: skip
ORIGIN = 47.397742, 8.545594, 489.4  # of `fcu`, as shipped: deg, deg, m
EARTH_M = 6_371_000.0
WALL_S = 240.0  # the first start of `fcu` compiles
AGAIN_S = 2.0  # wall: what has no answer is asked again


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


def anew(words: list[str], log: IO[str]) -> Any:
    """Start `fcu` with these options as a process of its own."""
    program = Path(sys.executable).with_name("fcu")
    return subprocess.Popen([str(program), *words], stdout=log, stderr=log)


def on_earth(north: float, east: float) -> tuple[float, float]:
    """Return latitude and longitude of a place near the origin, deg."""
    lat = ORIGIN[0] + math.degrees(north / EARTH_M)
    return lat, ORIGIN[1] + math.degrees(east / EARTH_M / math.cos(math.radians(ORIGIN[0])))


class Flight:
    """Run `fcu` and the simulator, and talk to both while simulation time stands."""

    def __init__(
        self,
        program: Path,
        airframe: str,
        vehicle: str,
        folder: Path,
        instance: int,
        options: dict[str, Any] | None = None,
        start: Callable[[list[str], IO[str]], Any] = anew,
    ) -> None:
        """`start`: begins `fcu` with its options and its log, and returns something like a Popen."""
        self.texts: list[str] = []
        self.values: dict[str, list[float]] = {}
        self.echoes = 0
        self.echo: tuple[int, tuple[float, ...]] = (
            0,
            (),
        )  # mask and numbers of the setpoint in force
        self.t = 0.0
        self.truth: dict[str, Any] = {}
        self.armed, self.mode, self.status = False, 0, 0
        self._acks: dict[int, int] = {}
        self._system = instance + 1
        self._answered = self._asked = 0
        self._verdict: dict[str, Any] | None = None
        self._log = (folder / "fcu.log").open("w")
        (folder / "vehicle.txt").write_text(vehicle)
        words = [word for key, value in (options or {}).items() for word in (f"--{key}", value)]
        vehicle_file = folder / "vehicle.txt"
        plant = [program, "--instance", instance, "--vehicle", vehicle_file, *words]
        fcu = ["--instance", str(instance), "--airframe", airframe, "--link-clock", "sim"]
        self._fcu = start(fcu, self._log)
        self._plant = subprocess.Popen(
            [*map(str, plant)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{14540 + instance}")
        try:
            self.wait(lambda: self.link.target_system == self._system)
            self.barrier()
        except BaseException:
            self.close()
            raise

    def close(self) -> dict[str, Any]:
        """End both processes and return the simulator's verdict."""
        if self._verdict is not None:
            return self._verdict
        self._verdict = {}
        assert self._plant.stdin and self._plant.stdout
        if self._plant.poll() is None:
            self.line("end")
            self._verdict = json.loads(self._plant.stdout.readline() or "{}")
        self._plant.wait(10.0)
        self._plant.stdout.close()
        with contextlib.suppress(BrokenPipeError):  # a line to a simulator that has ended
            self._plant.stdin.close()
        self._fcu.send_signal(signal.SIGTERM)
        self._fcu.wait(30.0)
        self.link.close()
        self._log.close()
        codes = {"fcu_exit": self._fcu.returncode, "plant_exit": self._plant.returncode}
        self._verdict |= codes
        return self._verdict

    def wait(self, met: Callable[[], bool]) -> None:
        """Read what the vehicle sends until a condition is met, while time stands."""
        end = time.monotonic() + WALL_S
        while not met():
            if self._fcu.poll() is not None:
                raise RuntimeError(f"fcu ended with {self._fcu.returncode}: {self._log.name}")
            if time.monotonic() > end:
                raise TimeoutError(f"not met for {WALL_S} s at {self.t} s; {self.texts[-3:]}")
            self._hear()

    def _hear(self) -> None:
        message = self.link.recv_match(blocking=True, timeout=0.05)
        if message is None:
            return
        kind = message.get_type()
        if kind == "STATUSTEXT":
            self.texts.append(f"{self.t:.2f} {message.severity} {message.text}")
        elif kind == "COMMAND_ACK":
            self._acks[message.command] = message.result
        elif kind == "NAMED_VALUE_FLOAT":
            self.values.setdefault(message.name, []).append(message.value)
        elif kind == "HEARTBEAT":
            self.armed = bool(message.base_mode & 128)
            self.mode, self.status = message.custom_mode, message.system_status
        elif kind == "POSITION_TARGET_LOCAL_NED":
            self.echoes += 1
            moves = message.type_mask & 0x38 == 0x38  # no velocity: it is a position
            told = ("x", "y", "z") if moves else ("vx", "vy", "vz")
            self.echo = message.type_mask, tuple(getattr(message, name) for name in told)
        elif kind == "TIMESYNC" and message.tc1:
            self._answered = message.ts1

    def barrier(self) -> None:
        """Wait until the vehicle has read whatever was sent to it before.

        A datagram may be lost among much telemetry: then it is asked again.
        """
        self._asked += 1
        asked_s = -math.inf

        def answered() -> bool:
            nonlocal asked_s
            if self._answered != self._asked and time.monotonic() > asked_s + AGAIN_S:
                asked_s = time.monotonic()
                self.link.mav.timesync_send(0, self._asked)
            return self._answered == self._asked

        self.wait(answered)

    def line(self, text: str) -> None:
        assert self._plant.stdin
        self._plant.stdin.write(text + "\n")
        self._plant.stdin.flush()

    def go(self, seconds: float) -> dict[str, Any]:
        """Let simulation time run, and read what the vehicle says each second: no socket holds more."""
        end = round(self.t + seconds, 6)
        while self.t < end:
            self._go_to(min(end, round(self.t + 1.0, 6)))
        return self.truth

    def _go_to(self, t: float) -> None:
        assert self._plant.stdout
        if self._plant.poll() is not None:
            raise RuntimeError(f"the simulator ended with {self._plant.returncode}")
        self.t = t
        self.line(f"until {self.t}")
        answer = self._plant.stdout.readline()
        if not answer:
            raise RuntimeError(f"the simulator ended with {self._plant.wait(10.0)}")
        self.truth = json.loads(answer)
        self.barrier()

    def go_until(self, met: Callable[[], bool], most_s: float) -> None:
        """Let simulation time run, a second at a time, until a condition is met."""
        end = self.t + most_s
        while not met():
            if self.t >= end or self.truth.get("lost"):
                raise AssertionError(f"not met at {self.t} s: {self.truth}; {self.texts[-5:]}")
            self.go(1.0)

    def reset(self, force: bool = False) -> None:
        """Put vehicle and simulator back to the start."""
        said = len(self.texts)
        assert self.command(246, 1, 0, 0, 0, 0, 20190226 if force else 0) == 0
        self.wait(lambda: any("Reset:" in text for text in self.texts[said:]))
        self.t = 0.0

    def command(self, number: int, *values: float) -> int:
        """Send a command and return the result of its acknowledgement."""
        self._acks.pop(number, None)
        padded = [*values, *[0.0] * (7 - len(values))]
        self.link.mav.command_long_send(self._system, 1, number, 0, *padded)
        self.wait(lambda: number in self._acks)
        return self._acks[number]

    def command_mode(self, name: str) -> int:
        if name == "land":
            self.line("landing")
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *MODES[name])

    def set(self, name: str, value: float) -> None:
        real = mavlink.MAV_PARAM_TYPE_REAL32
        self.link.mav.param_set_send(self._system, 1, name.encode(), value, real)
        self.barrier()

    def yaw_steps(self, yaw: float) -> dict[str, float]:
        """Turn there and back twice, 2 s each, and return how long rotors were at a limit."""
        before, longest = self.truth["at_limit"][0], 0.0
        north, east, down = self.truth["at"]
        for n in range(40):
            angle = 0.0 if n // 10 % 2 else yaw
            place = (north, east, down, *[0.0] * 6, angle, 0.0)
            ms = round(self.t * 1000)
            self.link.mav.set_position_target_local_ned_send(ms, self._system, 1, 1, 0x9F8, *place)
            self.barrier()
            if n == 1:
                assert self.command_mode("offboard") == 0
            longest = max(longest, self.go(0.2)["longest_s"])
        return {"ticks": self.truth["at_limit"][0] - before, "longest_s": longest}

    def setpoint(self, mask: int, north: float, east: float, down: float) -> None:
        """Send a position or a velocity, and wait until it was read."""
        three, none = (north, east, down), (0.0, 0.0, 0.0)
        moves = (*three, *none) if mask == POSITION else (*none, *three)
        ms = round(self.t * 1000)
        self.link.mav.set_position_target_local_ned_send(
            ms, self._system, 1, 1, mask, *moves, *[0.0] * 5
        )
        self.barrier()

    def takes(self, mask: int, north: float, east: float, down: float) -> bool:
        """Send one, and return whether the vehicle flies it: what the guard refuses has no echo."""
        self.setpoint(mask, north, east, down)
        moves, told = self.echo
        return moves == mask and math.dist(told, (north, east, down)) < 1e-3 if told else False

    def reposition(self, north: float, east: float, down: float) -> int:
        """Send DO_REPOSITION as COMMAND_INT, and return its result."""
        lat, lon = on_earth(north, east)
        number = mavlink.MAV_CMD_DO_REPOSITION
        self._acks.pop(number, None)
        self.link.mav.command_int_send(
            self._system, 1, 0, number, 0, 0, -1, 1, 0, float("nan"),
            round(lat * 1e7), round(lon * 1e7), ORIGIN[2] - down,
        )  # fmt: skip
        self.wait(lambda: number in self._acks)
        return self._acks[number]

    def target(self, north: float, east: float, speed: tuple[float, float]) -> None:
        """Tell where a target is that is to be followed, and its velocity, m/s north and east."""
        lat, lon = on_earth(north, east)
        none = [0.0] * 3
        self.link.mav.follow_target_send(
            round(self.t * 1000), 3, round(lat * 1e7), round(lon * 1e7), ORIGIN[2],
            [*speed, 0.0], none, [1.0, 0.0, 0.0, 0.0], none, none, 0,
        )  # fmt: skip
        self.barrier()

    def take_off(self, height_m: float, seconds: float = 8.0) -> bool:
        """Climb, and return whether the vehicle is there by the truth."""
        nan = float("nan")
        self.set("MIS_TAKEOFF_ALT", height_m)
        if self.command(400, 1) != 0:  # COMPONENT_ARM_DISARM
            return False
        self.command(22, 0, 0, 0, nan, nan, nan, nan)  # NAV_TAKEOFF
        before = self.truth["at"][2]
        return abs(self.go(seconds)["at"][2] - before + height_m) < 0.5

    def offboard(self, setpoint: Setpoint) -> int:
        """Begin a stream, and return the result of the change of mode."""
        self.setpoint(*setpoint(self.t))
        self.go(0.1)
        self.setpoint(*setpoint(self.t))
        return self.command_mode("offboard")

    def stream(self, seconds: float, setpoint: Setpoint, every: float = 0.2) -> None:
        """Stream what `setpoint(t)` returns: a mask and three numbers."""
        for _ in range(round(seconds / every)):
            if self.truth.get("lost"):
                return
            self.setpoint(*setpoint(self.t))
            self.go(every)


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--airframe", type=Path, default=HERE / "quad.toml")
    words.add_argument("--instance", type=int, default=0)
    words.add_argument("--seed", type=int, default=0)
    words.add_argument("--wind", default="gust")
    words.add_argument("--wind-max", type=float, default=5.0, help="m/s")
    words.add_argument("--end", choices=["land", "return"], default="return")
    words.add_argument("--rotor-inertia", type=float, help="kg m^2, in place of the airframe's")
    words.add_argument(
        "--spin-up", type=int, default=1, choices=[0, 1], help="rotors that speed up"
    )
    words.add_argument("--yaw-steps", action="store_true", help="by 2.5 rad and back, then stop")
    given = words.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        options = {"wind": given.wind, "wind-max": given.wind_max, "seed": given.seed}
        vehicle = vehicle_lines(given.airframe) + f"spin_up {given.spin_up}\n"
        if given.rotor_inertia is not None:
            vehicle += f"rotor_inertia {given.rotor_inertia}\n"
        program = compile_plant(folder)
        flight = Flight(program, str(given.airframe), vehicle, folder, given.instance, options)
        try:
            flight.go(0.5)
            there = flight.take_off(5.0)
            if given.yaw_steps:
                print(json.dumps(flight.yaw_steps(2.5)))
                return 0
            flight.line("goal 8 -6 -7 0.3")
            flight.offboard(lambda _: (POSITION, 8.0, -6.0, -7.0))
            flight.stream(12.0, lambda _: (POSITION, 8.0, -6.0, -7.0))
            arrived = flight.truth["arrived_s"]
            flight.line("no goal")
            flight.command_mode("hold")
            flight.go(2.0)
            flight.command_mode(given.end)
            flight.go_until(lambda: not flight.armed, 90.0)
        finally:
            verdict = flight.close()
        report = {"took_off": there, "arrived_s": arrived, **verdict, "texts": flight.texts}
        print(json.dumps(report, indent=1))
        return 0 if there and arrived is not None and not verdict["lost"] else 1


if __name__ == "__main__":
    sys.exit(main())
