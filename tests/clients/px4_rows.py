"""Table of the answers of a PX4 and of this vehicle: one row a command, a mode or a setpoint.

    python -m tests.clients.px4_rows            # the counts, and every row that differs
    python -m tests.clients.px4_rows --write    # docs/px4-rows.md, the whole table

Each row is sent to a real vehicle (`gcs up`) by pymavlink: disarmed on the ground, and armed in the
air. PX4's side is what its source says at COMMIT for a multicopter in SITL without sticks, mission
or target. A command that Commander leaves to other modules is not compared.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from fcu.interface.ports import ports

COMMIT = "0066393e8614097976facc6be6606417da11598c"
COMMANDER = "src/modules/commander/Commander.cpp"
PAGE = Path(__file__).parents[2] / "docs" / "px4-rows.md"
INSTANCE = 9
ANSWERED_S, STATE_S = 0.6, 60.0  # an answer is there in some ms; a state is reached at speed 5
ACCEPTED, TEMPORARILY, DENIED, UNSUPPORTED, NOTHING = (
    "ACCEPTED", "TEMPORARILY_REJECTED", "DENIED", "UNSUPPORTED", "no answer",
)  # fmt: skip
GROUND, AIR, STICKS = "on the ground, disarmed", "in the air, armed", "in the air, with sticks"
ALIKE, OURS, THEIRS, REFUSED, NEITHER = (
    "as PX4", "only this vehicle takes it", "only PX4 takes it", "both refuse, by another code",
    "one of the two does not answer",
)  # fmt: skip


class Row(NamedTuple):
    """One thing that is sent."""

    state: str
    what: str
    command: int
    params: tuple[float, ...]
    px4: str
    where: str = COMMANDER


class Flown(NamedTuple):
    """A row, and what this vehicle answered."""

    row: Row
    ours: str

    @property
    def kind(self) -> str:
        """How the two compare."""
        if self.row.px4 == self.ours:
            return ALIKE
        if NOTHING in (self.row.px4, self.ours):
            return NEITHER
        takes = self.row.px4 == ACCEPTED, self.ours == ACCEPTED
        return {(True, False): THEIRS, (False, True): OURS}.get(takes, REFUSED)


# --- PX4's side

# Commander's switch, with all parameters 0: disarmed on the ground, armed in the air
HANDLED: dict[int, tuple[str, str]] = {
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: (ACCEPTED, ACCEPTED),
    mavlink.MAV_CMD_NAV_LAND: (ACCEPTED, ACCEPTED),
    mavlink.MAV_CMD_NAV_LAND_LOCAL: (ACCEPTED, ACCEPTED),  # PX4's NAV_PRECLAND
    mavlink.MAV_CMD_NAV_TAKEOFF: (ACCEPTED, ACCEPTED),
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: (ACCEPTED, ACCEPTED),
    mavlink.MAV_CMD_DO_ORBIT: (ACCEPTED, ACCEPTED),
    mavlink.MAV_CMD_DO_SET_MODE: (ACCEPTED, ACCEPTED),  # base mode 0 asks for none
    mavlink.MAV_CMD_DO_SET_HOME: (ACCEPTED, ACCEPTED),
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: (DENIED, DENIED),
    mavlink.MAV_CMD_DO_CHANGE_ALTITUDE: (ACCEPTED, ACCEPTED),
    mavlink.MAV_CMD_DO_REPOSITION: (UNSUPPORTED, UNSUPPORTED),  # without the flag of a mode change
    mavlink.MAV_CMD_PREFLIGHT_CALIBRATION: (ACCEPTED, TEMPORARILY),
    mavlink.MAV_CMD_PREFLIGHT_STORAGE: (ACCEPTED, TEMPORARILY),
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: (ACCEPTED, ACCEPTED),
    mavlink.MAV_CMD_MISSION_START: (DENIED, DENIED),
    mavlink.MAV_CMD_ACTUATOR_TEST: (NOTHING, DENIED),
    mavlink.MAV_CMD_CONTROL_HIGH_LATENCY: (NOTHING, NOTHING),
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: (ACCEPTED, TEMPORARILY),
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: (ACCEPTED, ACCEPTED),
    mavlink.MAV_CMD_FIXED_MAG_CAL_YAW: (ACCEPTED, TEMPORARILY),
}
# What Commander leaves to other modules, and what the receiver of messages answers itself.
ELSEWHERE = frozenset(
    getattr(mavlink, f"MAV_CMD_{name}", -1)
    for name in (
        "START_RX_PAIR", "DO_MOUNT_CONTROL", "DO_MOUNT_CONFIGURE", "DO_MOUNT_CONTROL_QUAT",
        "PREFLIGHT_SET_SENSOR_OFFSETS", "PREFLIGHT_UAVCAN", "PAYLOAD_PREPARE_DEPLOY",
        "PAYLOAD_CONTROL_DEPLOY", "DO_VTOL_TRANSITION", "DO_TRIGGER_CONTROL", "DO_DIGICAM_CONTROL",
        "DO_SET_CAM_TRIGG_DIST", "OBLIQUE_SURVEY", "DO_SET_CAM_TRIGG_INTERVAL", "SET_CAMERA_MODE",
        "SET_CAMERA_ZOOM", "SET_CAMERA_FOCUS", "DO_CHANGE_SPEED", "DO_LAND_START", "DO_GO_AROUND",
        "LOGGING_START", "LOGGING_STOP", "NAV_DELAY", "DO_SET_ROI", "NAV_ROI",
        "DO_SET_ROI_LOCATION", "DO_SET_ROI_WPNEXT_OFFSET", "DO_SET_ROI_NONE", "INJECT_FAILURE",
        "DO_GIMBAL_MANAGER_PITCHYAW", "DO_GIMBAL_MANAGER_CONFIGURE", "CONFIGURE_ACTUATOR",
        "DO_SET_ACTUATOR", "REQUEST_MESSAGE", "DO_WINCH", "DO_GRIPPER", "SET_MESSAGE_INTERVAL",
        "GET_MESSAGE_INTERVAL", "REQUEST_PROTOCOL_VERSION", "REQUEST_AUTOPILOT_CAPABILITIES",
        "GET_HOME_POSITION", "DO_AUTOTUNE_ENABLE", "REQUEST_STORAGE_INFORMATION",
        "REQUEST_FLIGHT_INFORMATION", "REQUEST_CAMERA_INFORMATION", "REQUEST_CAMERA_SETTINGS",
        "REQUEST_CAMERA_CAPTURE_STATUS", "IMAGE_START_CAPTURE", "IMAGE_STOP_CAPTURE",
        "EXTERNAL_POSITION_ESTIMATE", "DO_SET_STANDARD_MODE", "DO_SET_MISSION_CURRENT",
        "CAN_FORWARD", "UAVCAN_GET_NODE_INFO", "STORAGE_FORMAT",
    )
)  # fmt: skip

# DO_SET_MODE with the flag of custom modes: main, sub; disarmed, armed, armed with sticks
_BY_STICKS = (ACCEPTED, TEMPORARILY, ACCEPTED)
_ALWAYS = (ACCEPTED, ACCEPTED, ACCEPTED)
_NEVER = (TEMPORARILY, TEMPORARILY, TEMPORARILY)
_DISARMED = (ACCEPTED, TEMPORARILY, TEMPORARILY)
MODES: dict[tuple[int, int], tuple[str, str, str]] = {
    (1, 0): _BY_STICKS, (2, 0): _BY_STICKS, (3, 0): _BY_STICKS, (5, 0): _BY_STICKS,
    (7, 0): _BY_STICKS, (3, 1): _BY_STICKS, (3, 2): _BY_STICKS, (1, 3): _BY_STICKS,
    (4, 0): _DISARMED, (4, 1): _NEVER, (4, 2): _ALWAYS, (4, 3): _ALWAYS, (4, 4): _DISARMED,
    (4, 5): _ALWAYS, (4, 6): _ALWAYS, (4, 7): _NEVER, (4, 8): _ALWAYS, (4, 9): _ALWAYS,
    (4, 10): _NEVER, **{(4, n): _DISARMED for n in range(11, 19)}, (4, 19): _NEVER,
    (6, 0): _DISARMED, (6, 3): _DISARMED, (0, 0): _ALWAYS, (8, 0): _ALWAYS, (9, 0): _ALWAYS,
    (99, 0): _ALWAYS,
}  # fmt: skip
# without that flag, by the bits of the base mode
BASE_MODES: dict[int, tuple[str, str]] = {
    mavlink.MAV_MODE_FLAG_AUTO_ENABLED: (ACCEPTED, TEMPORARILY),
    mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED: (ACCEPTED, TEMPORARILY),
    mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED: (
        ACCEPTED, TEMPORARILY,
    ),
    mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED: (
        ACCEPTED, TEMPORARILY,
    ),
}  # fmt: skip
NAN = float("nan")
# commands with parameters: what, command, parameters; disarmed, armed
VARIANTS: tuple[tuple[str, int, tuple[float, ...], str, str], ...] = (
    ("arm", 400, (1.0,), ACCEPTED, ACCEPTED),
    ("arm, forced", 400, (1.0, 21196.0), ACCEPTED, ACCEPTED),
    ("disarm", 400, (0.0,), ACCEPTED, TEMPORARILY),
    ("disarm, forced", 400, (0.0, 21196.0), ACCEPTED, ACCEPTED),
    ("arm with 2", 400, (2.0,), NOTHING, NOTHING),
    ("arm with 0.9, which rounds to 1", 400, (0.9,), ACCEPTED, ACCEPTED),
    ("arm with unused parameters", 400, (1.0, 0.0, 3.0, 4.0, 5.0, 6.0, 7.0), ACCEPTED, ACCEPTED),
    ("land with NaN", 21, (NAN,) * 7, ACCEPTED, ACCEPTED),
    ("land with an abort height", 21, (5.0,), ACCEPTED, ACCEPTED),
    ("return with parameters", 20, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0), ACCEPTED, ACCEPTED),
    ("take off with NaN", 22, (NAN,) * 7, ACCEPTED, ACCEPTED),
    ("take off, with pitch and yaw", 22, (15.0, 0.0, 0.0, 1.0, NAN, NAN, NAN), ACCEPTED, ACCEPTED),
    ("home here", 179, (1.0,), ACCEPTED, ACCEPTED),
    ("home here, with a roll", 179, (1.0, 5.0, 6.0), ACCEPTED, ACCEPTED),
    ("home without a place", 179, (0.0, 0.0, 0.0, 0.0, NAN, NAN, NAN), DENIED, DENIED),
    ("reposition to nowhere: hold", 192, (-1.0, 1.0, 0.0, NAN, NAN, NAN, NAN), ACCEPTED, ACCEPTED),
    ("reposition, with an unknown flag", 192, (-1.0, 3.0, 0.0, NAN, NAN, NAN, NAN), UNSUPPORTED, UNSUPPORTED),
    ("change the altitude to 10 m", 186, (10.0, 3.0), ACCEPTED, ACCEPTED),
    ("orbit here", 34, (5.0, 1.0, 0.0, 0.0, NAN, NAN, NAN), ACCEPTED, ACCEPTED),
    ("terminate with 0.5", 185, (0.5,), DENIED, DENIED),
    ("storage: save", 245, (1.0,), ACCEPTED, TEMPORARILY),
    ("storage: 9", 245, (9.0,), NOTHING, TEMPORARILY),
    ("reboot: 3", 246, (3.0,), DENIED, DENIED),
    ("calibrate the gyroscope", 241, (1.0,), ACCEPTED, TEMPORARILY),
    ("calibrate the level", 241, (0.0, 0.0, 0.0, 0.0, 2.0), ACCEPTED, TEMPORARILY),
    ("start a mission that is not there", 300, (0.0, 0.0), DENIED, DENIED),
    ("mode with NaN as sub mode", 176, (1.0, 2.0, NAN), ACCEPTED, TEMPORARILY),
)  # fmt: skip


def rows() -> Iterator[Row]:
    """Every row, state by state."""
    for n, state in enumerate((GROUND, AIR)):
        for command, entry in sorted(mavlink.enums["MAV_CMD"].items()):
            name = entry.name.removeprefix("MAV_CMD_")
            if name == "ENUM_END" or command in ELSEWHERE:
                continue
            px4 = HANDLED.get(command, (UNSUPPORTED, UNSUPPORTED))[n]
            yield Row(state, f"{name}, all 0", command, (), px4)
        for what, command, params, *px4s in VARIANTS:
            yield Row(state, what, command, params, px4s[n])
        for base, px4s in BASE_MODES.items():
            yield Row(state, f"DO_SET_MODE, base mode {base}", 176, (float(base),), px4s[n])
    for n, state in enumerate((GROUND, AIR, STICKS)):
        for (main, sub), px4s in MODES.items():
            params = 1.0, float(main), float(sub)
            yield Row(state, f"DO_SET_MODE {main}, {sub}", 176, params, px4s[n])


# --- ours


class Vehicle:
    """A vehicle that is up, and a ground station."""

    def __init__(self, instance: int) -> None:
        self._at, self._folder = ports(instance), tempfile.TemporaryDirectory()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "gcs_tools", "up", "--instance", str(instance), "--speed", "5"],
            cwd=self._folder.name, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        if not self._process.stdout.readline().startswith("ready"):
            raise SystemExit(f"gcs up of instance {instance} did not get ready")
        self._link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{self._at.script}")
        self._link.wait_heartbeat(timeout=STATE_S)
        self._spoken = 0.0

    def close(self) -> None:
        """End it."""
        self._process.send_signal(signal.SIGTERM)
        self._process.wait()
        self._link.close()
        self._folder.cleanup()

    def answer(self, command: int, params: tuple[float, ...], sticks: bool = False) -> str:
        """The result of a COMMAND_LONG, by name."""
        while self._link.recv_msg() is not None:
            pass
        seven = (*params, *[0.0] * (7 - len(params)))
        self._link.mav.command_long_send(self._at.system_id, 1, command, 0, *seven)
        until = time.monotonic() + ANSWERED_S
        while time.monotonic() < until:
            if sticks:
                self.speak()
            m = self._link.recv_match(type="COMMAND_ACK", blocking=True, timeout=0.05)
            if m is not None and m.command == command:
                name = mavlink.enums["MAV_RESULT"][m.result].name
                return str(name.removeprefix("MAV_RESULT_"))
        return NOTHING

    def speak(self) -> None:
        """Sticks in their middle, as often as a joystick sends them."""
        if time.monotonic() - self._spoken > 0.04:
            self._spoken = time.monotonic()
            self._link.mav.manual_control_send(self._at.system_id, 0, 0, 500, 0, 0)

    def be(self, state: str) -> None:
        """Get it into a state, from whatever a row has made of it."""
        until = time.monotonic() + STATE_S
        while time.monotonic() < until:
            if state == STICKS:
                for _ in range(3):
                    self.speak()
                    # a joystick's rate: sticks count as there while they are heard so often
                    time.sleep(0.05)
            if self._is(state):
                return
        raise SystemExit(f"the vehicle does not get {state}")

    def _is(self, state: str) -> bool:
        beat = self._fresh("HEARTBEAT", 0)
        extended = self._fresh("EXTENDED_SYS_STATE", 245)
        armed = bool(beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        lands = extended.landed_state
        if beat.system_status == mavlink.MAV_STATE_FLIGHT_TERMINATION:
            self.answer(246, (1.0,))
            return False
        if state == GROUND:
            if armed:
                self.answer(400, (0.0, 21196.0))
                return False
            if lands != mavlink.MAV_LANDED_STATE_ON_GROUND:
                self.answer(246, (1.0,))
                return False
            return self._holds(beat)
        if lands == mavlink.MAV_LANDED_STATE_IN_AIR and armed:
            return self._holds(beat)
        if lands == mavlink.MAV_LANDED_STATE_ON_GROUND:
            if not armed:
                self.answer(22, (NAN,) * 7)
                self.answer(400, (1.0,))
            else:
                self.answer(22, (NAN,) * 7)
        elif not armed:
            self.answer(246, (1.0,))
        else:
            self.answer(176, (1.0, 4.0, 3.0))
        return False

    def _holds(self, beat: mavlink.MAVLink_heartbeat_message) -> bool:
        if beat.custom_mode == 4 << 16 | 3 << 24:
            return True
        self.answer(176, (1.0, 4.0, 3.0))
        return False

    def _fresh(self, name: str, number: int) -> mavlink.MAVLink_message:
        until = time.monotonic() + STATE_S
        while time.monotonic() < until:
            self.answer(512, (float(number),))
            m = self._link.recv_match(type=name, blocking=True, timeout=0.2)
            if m is not None:
                return m
            if name in self._link.messages:
                return self._link.messages[name]
        raise SystemExit(f"no {name}")


def flown(instance: int) -> list[Flown]:
    """Every row, sent to a real vehicle."""
    vehicle, found = Vehicle(instance), []
    try:
        for row in rows():
            vehicle.be(row.state)
            ours = vehicle.answer(row.command, row.params, row.state == STICKS)
            found.append(Flown(row, ours))
            print(f"{len(found):4} {row.state}: {row.what}: {ours}", file=sys.stderr)
    finally:
        vehicle.close()
    return found


def page(found: list[Flown]) -> str:
    """docs/px4-rows.md."""
    counts = Counter(each.kind for each in found)
    lines = [
        "# What a PX4 answers, and what this vehicle answers", "",
        "Written by `python -m tests.clients.px4_rows --write`, which sends each row to a real vehicle. PX4's side is its",
        f"source, {COMMANDER} at {COMMIT[:10]}, for a multicopter in SITL without sticks (but where the state says so),",
        "mission or target. Commands that Commander leaves to other modules are not in the table.", "",
        "| rows | |", "|---|---|",
        *(f"| {counts[kind]} | {kind} |" for kind in (ALIKE, OURS, THEIRS, REFUSED, NEITHER)),
        f"| {len(found)} | in all |", "",
    ]  # fmt: skip
    for state in (GROUND, AIR, STICKS):
        lines += [f"## The vehicle {state}", "", "| sent | PX4 | here | |", "|---|---|---|---|"]
        for each in found:
            if each.row.state == state:
                mark = "" if each.kind == ALIKE else each.kind
                lines.append(f"| {each.row.what} | {each.row.px4} | {each.ours} | {mark} |")
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    """Fly the rows and tell the counts, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write docs/px4-rows.md")
    parser.add_argument("--instance", type=int, default=INSTANCE)
    options = parser.parse_args()
    found = flown(options.instance)
    if options.write:
        PAGE.write_text(page(found))
    for kind, count in Counter(each.kind for each in found).most_common():
        print(f"{count:4} {kind}")
    for each in found:
        if each.kind != ALIKE and not options.write:
            print(f"{each.row.state}: {each.row.what}: PX4 {each.row.px4}, here {each.ours}")


if __name__ == "__main__":
    main()
