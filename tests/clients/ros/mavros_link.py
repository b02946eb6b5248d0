"""Messages that MAVROS 2.14 sends to a PX4, and topics that it tells its nodes, over one MAVLink connection.

MAVROS is system 1, component 191, as its launch files have it. The source of each thing is its plugin in
mavlink/mavros at f8f462dd (mavros/src/plugins): sys_status, command, param, setpoint_*, local_position ...
"""

from __future__ import annotations

import math
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import message_types as ros
from mavros_missions import GEOFENCE, RALLYPOINTS, WAYPOINTS, MissionPlugin
from pymavlink import mavutil

MAIN = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
}
AUTO = {1: "READY", 2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND", 7: "RTGS", 8: "FOLLOW_TARGET",
        9: "PRECLAND"}  # fmt: skip
MODES = {main << 16: name for main, name in MAIN.items()} | {
    (4 << 16) | (sub << 24): f"AUTO.{name}" for sub, name in AUTO.items()
}
NUMBERS = {name: number for number, name in MODES.items()}
ACK_S = 5.0  # how long a service waits for the vehicle's answer
BODY_FRAMES = (8, 9)
EARTH = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)  # from ENU to NED, and back
BODY = (0.0, 1.0, 0.0, 0.0)  # from forward-left-up to forward-right-down, and back
SERVICES = [
    "set_mode",
    "cmd/arming",
    "cmd/takeoff",
    "cmd/land",
    "cmd/set_home",
    "cmd/command",
    "cmd/command_int",
    "param/get",
    "param/set",
    "mission/push",
    "mission/clear",
    "mission/pull",
    "mission/set_current",
    "geofence/push",
    "geofence/clear",
    "geofence/pull",
    "rallypoint/push",
    "rallypoint/clear",
    "rallypoint/pull",
    "set_stream_rate",
]


def product(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    """The product of two quaternions, scalar first."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def turned(q: tuple[float, ...]) -> tuple[float, ...]:
    """An attitude between (ENU, forward-left-up) and (NED, forward-right-down), either way."""
    return product(product(EARTH, q), BODY)


def other_earth(v: Any) -> tuple[float, float, float]:
    """A vector between ENU and NED, either way."""
    return v[1], v[0], -v[2]


def other_body(v: Any) -> tuple[float, float, float]:
    """A vector between forward-left-up and forward-right-down, either way."""
    return v[0], -v[1], -v[2]


def of(v: Any) -> tuple[float, float, float]:
    """The numbers of a ROS vector."""
    return float(v.x), float(v.y), float(v.z)


def quaternion(told: Any) -> tuple[float, ...]:
    """The numbers of a ROS quaternion, scalar first. As in Eigen all zeros turn nothing."""
    q = (float(told.w), float(told.x), float(told.y), float(told.z))
    length = math.sqrt(sum(each * each for each in q))
    return tuple(each / length for each in q) if length else (1.0, 0.0, 0.0, 0.0)


def yaw_of(q: tuple[float, ...]) -> float:
    """The yaw of an attitude."""
    w, x, y, z = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


class MavrosLink:
    """MAVROS: it hears the vehicle in a thread, and sends what nodes publish and call."""

    def __init__(self, own_port: int, vehicle_port: int, system: int = 1) -> None:
        """`system`: the vehicle's. MAVROS' own is 1 all the same."""
        self._to = (system, 1)
        self._link = mavutil.mavlink_connection(
            f"udpin:127.0.0.1:{own_port}", source_system=1, source_component=191
        )
        self._link.clients.add(("127.0.0.1", vehicle_port))
        self._link.clients_last_alive[("127.0.0.1", vehicle_port)] = 1e12
        self._send = threading.Lock()
        self._called = threading.Lock()
        self._calls: dict[str, list[Callable[[Any], None]]] = defaultdict(list)
        self._last: dict[str, Any] = {}  # topics that are latched
        self._acks: dict[int, Any] = {}
        self._parameters: dict[str, Any] = {}
        self._came = threading.Condition()
        self._base_mode = 0
        self._connected = False
        self._attitude = (1.0, 0.0, 0.0, 0.0)
        self._rates = (0.0, 0.0, 0.0)
        self._thrust: Any = None
        self._begun = time.monotonic()
        kinds = {"mission": WAYPOINTS, "geofence": GEOFENCE, "rallypoint": RALLYPOINTS}
        self._missions = {name: self._plugin(name, kind) for name, kind in kinds.items()}
        threading.Thread(target=self._beat, daemon=True).start()
        threading.Thread(target=self._hear, daemon=True).start()

    def _plugin(self, name: str, kind: int) -> MissionPlugin:
        def send(message: str, fields: tuple[Any, ...]) -> None:
            with self._send:
                getattr(self._link.mav, f"{message}_send")(*self._to, *fields)

        return MissionPlugin(send, kind, lambda said: self._tell(f"{name}/waypoints", said, latched=True))  # fmt: skip

    # ---- what nodes ask for

    def subscribe(self, topic: str, call: Callable[[Any], None]) -> None:
        """Call with each message of a topic."""
        self._calls[topic].append(call)
        if topic in self._last:
            call(self._last[topic])

    def unsubscribe(self, topic: str, call: Callable[[Any], None]) -> None:
        """Call no more."""
        self._calls[topic].remove(call)

    def has(self, service: str) -> bool:
        """True if MAVROS has such a service."""
        return service in SERVICES

    def published(self, topic: str, said: Any) -> None:
        """Send what a node publishes."""
        name = "_" + topic.replace("/", "_")
        if hasattr(self, name):
            getattr(self, name)(said)

    def call(self, service: str, asked: Any) -> dict[str, Any]:
        """The fields of a service's response. Raises LookupError."""
        if service not in SERVICES:
            raise LookupError(service)
        plugin, _, name = service.partition("/")
        if plugin in self._missions:
            words = {"push": (asked,), "set_current": (getattr(asked, "wp_seq", 0),)}.get(name, ())
            return dict(getattr(self._missions[plugin], name)(*words))
        with self._called:
            return dict(getattr(self, "_service_" + service.replace("/", "_"))(asked))

    # ---- setpoints

    def _now_ms(self) -> int:
        return int((time.monotonic() - self._begun) * 1e3)

    def _local(
        self, frame: int, mask: int, p: Any = (0.0,) * 3, v: Any = (0.0,) * 3, a: Any = (0.0,) * 3,
        yaw: float = 0.0, yaw_rate: float = 0.0,
    ) -> None:  # fmt: skip
        with self._send:
            self._link.mav.set_position_target_local_ned_send(
                self._now_ms(), *self._to, frame, mask, *p, *v, *a, yaw, yaw_rate
            )

    def _setpoint_position_local(self, said: Any) -> None:
        q = turned(quaternion(said.pose.orientation))
        self._local(1, 0x9F8, other_earth(of(said.pose.position)), yaw=yaw_of(q))

    def _setpoint_velocity_cmd_vel(self, said: Any) -> None:
        self._setpoint_velocity_cmd_vel_unstamped(said.twist)

    def _setpoint_velocity_cmd_vel_unstamped(self, said: Any) -> None:
        self._local(
            1,
            (1 << 10) | (7 << 6) | 7,
            v=other_earth(of(said.linear)),
            yaw_rate=-float(said.angular.z),
        )

    def _setpoint_accel_accel(self, said: Any) -> None:
        self._local(1, (3 << 10) | (7 << 3) | 7, a=other_earth(of(said.vector)))

    def _setpoint_raw_local(self, said: Any) -> None:
        body = said.coordinate_frame in BODY_FRAMES
        other = other_body if body else other_earth
        p, v, a = (
            other(of(each)) for each in (said.position, said.velocity, said.acceleration_or_force)
        )
        yaw = -said.yaw if body else _wrapped(math.pi / 2.0 - said.yaw)
        self._local(said.coordinate_frame, said.type_mask, p, v, a, yaw, -said.yaw_rate)

    def _setpoint_raw_global(self, said: Any) -> None:
        v, a = (other_earth(of(each)) for each in (said.velocity, said.acceleration_or_force))
        place = (int(said.latitude * 1e7), int(said.longitude * 1e7), float(said.altitude))
        with self._send:
            self._link.mav.set_position_target_global_int_send(
                self._now_ms(), *self._to, said.coordinate_frame, said.type_mask, *place, *v, *a,
                _wrapped(math.pi / 2.0 - said.yaw), -said.yaw_rate,
            )  # fmt: skip

    def _setpoint_position_global(self, said: Any) -> None:
        place = said.pose.position
        q = turned(quaternion(said.pose.orientation))
        with self._send:
            self._link.mav.set_position_target_global_int_send(
                self._now_ms(), *self._to, 5, 0x1F8, int(place.latitude * 1e7), int(place.longitude * 1e7),
                float(place.altitude), *(0.0,) * 6, yaw_of(q), 0.0,
            )  # fmt: skip

    def _attitude_target(self, mask: int, q: Any, rates: Any, thrust: float) -> None:
        with self._send:
            self._link.mav.set_attitude_target_send(
                self._now_ms(), *self._to, mask, list(q), *rates, thrust
            )

    def _setpoint_raw_attitude(self, said: Any) -> None:
        q = turned(quaternion(said.orientation))
        self._attitude_target(said.type_mask, q, other_body(of(said.body_rate)), float(said.thrust))

    def _setpoint_attitude_thrust(self, said: Any) -> None:
        self._thrust = float(said.thrust)

    def _setpoint_attitude_attitude(self, said: Any) -> None:
        if self._thrust is not None:
            self._attitude_target(
                7, turned(quaternion(said.pose.orientation)), (0.0,) * 3, self._thrust
            )

    def _setpoint_attitude_cmd_vel(self, said: Any) -> None:
        if self._thrust is not None:
            rates = other_earth(of(said.twist.angular))
            self._attitude_target(128, (1.0, 0.0, 0.0, 0.0), rates, self._thrust)

    def _manual_control_send(self, said: Any) -> None:
        with self._send:
            self._link.mav.manual_control_send(
                self._to[0], int(said.x), int(said.y), int(said.z), int(said.r), int(said.buttons)
            )

    def _rc_override(self, said: Any) -> None:
        with self._send:
            self._link.mav.rc_channels_override_send(
                *self._to, *(list(said.channels) + [0] * 18)[:18]
            )

    # ---- services

    def _service_set_mode(self, asked: Any) -> dict[str, Any]:
        mode = asked.base_mode or 0
        number = 0
        if asked.custom_mode:
            number = NUMBERS.get(asked.custom_mode, -1)
            if number < 0 and asked.custom_mode.isdigit():
                number = int(asked.custom_mode)
            if number < 0:
                return {"mode_sent": False}
            mode |= (self._base_mode & 128) | 1
        with self._send:
            self._link.mav.set_mode_send(self._to[0], mode, number)
        return {"mode_sent": True}

    def _command(self, command: int, confirmation: int, *values: float) -> dict[str, Any]:
        with self._came:
            self._acks.pop(command, None)
        with self._send:
            self._link.mav.command_long_send(*self._to, command, confirmation, *values)
        with self._came:
            self._came.wait_for(lambda: command in self._acks, ACK_S)
            result = self._acks.get(command)
        return {"success": result == 0, "result": 4 if result is None else result}

    def _service_cmd_arming(self, asked: Any) -> dict[str, Any]:
        return self._command(400, 1, 1.0 if asked.value else 0.0, *(0.0,) * 6)

    def _service_cmd_takeoff(self, asked: Any) -> dict[str, Any]:
        place = asked.latitude, asked.longitude, asked.altitude
        return self._command(22, 1, asked.min_pitch, 0.0, 0.0, asked.yaw, *place)

    def _service_cmd_land(self, asked: Any) -> dict[str, Any]:
        return self._command(
            21, 1, 0.0, 0.0, 0.0, asked.yaw, asked.latitude, asked.longitude, asked.altitude
        )

    def _service_cmd_set_home(self, asked: Any) -> dict[str, Any]:
        place = asked.latitude, asked.longitude, asked.altitude
        return self._command(179, 1, 1.0 if asked.current_gps else 0.0, 0.0, 0.0, asked.yaw, *place)

    def _service_cmd_command(self, asked: Any) -> dict[str, Any]:
        values = (float(getattr(asked, f"param{i}")) for i in range(1, 8))
        return self._command(int(asked.command), int(asked.confirmation), *values)

    def _service_cmd_command_int(self, asked: Any) -> dict[str, Any]:
        values = (float(getattr(asked, f"param{i}")) for i in range(1, 5))
        with self._send:
            self._link.mav.command_int_send(
                *self._to, asked.frame, asked.command, asked.current, asked.autocontinue, *values,
                int(asked.x), int(asked.y), float(asked.z),
            )  # fmt: skip
        return {"success": True}

    def _known(self, name: str) -> Any:
        with self._came:
            self._came.wait_for(lambda: name in self._parameters, ACK_S)
            return self._parameters.get(name)

    def _service_param_get(self, asked: Any) -> dict[str, Any]:
        value = self._known(asked.param_id)
        return {"success": value is not None, "value": _parameter(value)}

    def _service_param_set(self, asked: Any) -> dict[str, Any]:
        name, kind = asked.param_id, type(self._known(asked.param_id))
        given = asked.value.integer if asked.value.integer != 0 else asked.value.real
        value = int(given) if kind is int else float(given)
        with self._came:
            self._parameters.pop(name, None)
        with self._send:
            self._link.mav.param_set_send(*self._to, name.encode(), *_encoded(value))
        now = self._known(name)
        near = now is not None and abs(now - value) <= 1e-6 * max(1.0, abs(value))
        return {"success": near, "value": _parameter(now)}

    def _service_set_stream_rate(self, _asked: Any) -> dict[str, Any]:
        return {}

    # ---- what the vehicle says

    def _tell(self, topic: str, said: Any, latched: bool = False) -> None:
        if latched:
            self._last[topic] = said
        for call in list(self._calls[topic]):
            call(said)

    def _beat(self) -> None:
        asked = False
        second = 0
        while True:
            with self._send:
                self._link.mav.heartbeat_send(18, 8, 192, 0, 4)
                self._link.mav.system_time_send(time.time_ns() // 1000, self._now_ms())
            if self._connected and not asked:
                asked = True
                with self._send:  # as its plugins do once they are connected
                    self._link.mav.command_long_send(*self._to, 520, 0, 1.0, *(0.0,) * 6)
                    self._link.mav.param_request_list_send(*self._to)
                threading.Thread(target=self._missions["mission"].pull, daemon=True).start()
            if self._connected and second % 10 == 0:
                with self._send:
                    self._link.mav.command_long_send(*self._to, 410, 0, *(0.0,) * 7)
            second += 1
            for _ in range(10):
                with self._send:
                    self._link.mav.timesync_send(0, time.time_ns())
                # it sends at a rate by the wall, as MAVROS does: there is nothing to wait for
                time.sleep(0.1)

    def _hear(self) -> None:
        while True:
            said = self._link.recv_match(blocking=True, timeout=1.0)
            if said is None or (said.get_srcSystem(), said.get_srcComponent()) != self._to:
                continue
            if said.get_type().startswith("MISSION_"):
                for plugin in self._missions.values():
                    plugin.hears(said)
            hears = getattr(self, "_hears_" + said.get_type().lower(), None)
            if hears is not None:
                hears(said)

    def _header(self) -> Any:
        return ros.Header(stamp=ros.Time.from_sec(time.time()), frame_id="map")

    def _hears_heartbeat(self, m: Any) -> None:
        self._base_mode, self._connected = m.base_mode, True
        state = ros.State(
            header=self._header(), connected=True, armed=bool(m.base_mode & 128), guided=bool(m.base_mode & 8),
            manual_input=bool(m.base_mode & 64), mode=MODES.get(m.custom_mode, f"CMODE({m.custom_mode})"),
            system_status=m.system_status,
        )  # fmt: skip
        self._tell("state", state, latched=True)

    def _hears_extended_sys_state(self, m: Any) -> None:
        said = ros.ExtendedState(self._header(), m.vtol_state, m.landed_state)
        self._tell("extended_state", said)

    def _hears_attitude_quaternion(self, m: Any) -> None:
        self._attitude = turned((m.q1, m.q2, m.q3, m.q4))
        self._rates = other_body((m.rollspeed, m.pitchspeed, m.yawspeed))
        imu = ros.Imu(
            header=self._header(),
            orientation=self._ros_attitude(),
            angular_velocity=ros.Vector3(*self._rates),
        )
        self._tell("imu/data", imu)

    def _hears_attitude(self, m: Any) -> None:
        half = (m.roll / 2, m.pitch / 2, m.yaw / 2)
        (cr, cp, cy), (sr, sp, sy) = map(math.cos, half), map(math.sin, half)
        q = (cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
             cr * cp * sy - sr * sp * cy)  # fmt: skip
        self._attitude = turned(q)
        self._rates = other_body((m.rollspeed, m.pitchspeed, m.yawspeed))

    def _ros_attitude(self) -> Any:
        w, x, y, z = self._attitude
        return ros.Quaternion(x, y, z, w)

    def _hears_local_position_ned(self, m: Any) -> None:
        p, v = other_earth((m.x, m.y, m.z)), other_earth((m.vx, m.vy, m.vz))
        pose = ros.Pose(ros.Point(*p), self._ros_attitude())
        w, x, y, z = self._attitude
        _, *v_body = product(product((w, -x, -y, -z), (0.0, *v)), self._attitude)
        self._tell("local_position/pose", ros.PoseStamped(self._header(), pose))
        angular = ros.Vector3(*self._rates)
        local = ros.TwistStamped(self._header(), ros.Twist(ros.Vector3(*v), angular))
        body = ros.TwistStamped(self._header(), ros.Twist(ros.Vector3(*v_body), angular))
        for topic in ("local_position/velocity", "local_position/velocity_local"):
            self._tell(topic, local)
        self._tell("local_position/velocity_body", body)
        odometry = ros.Odometry(
            self._header(),
            "base_link",
            ros.PoseWithCovariance(pose),
            ros.TwistWithCovariance(body.twist),
        )
        for topic in ("local_position/odom", "global_position/local"):
            self._tell(topic, odometry)

    def _hears_global_position_int(self, m: Any) -> None:
        fix = ros.NavSatFix(
            header=self._header(),
            latitude=m.lat * 1e-7,
            longitude=m.lon * 1e-7,
            altitude=m.alt * 1e-3,
        )
        for topic in ("global_position/global", "global_position/raw/fix"):
            self._tell(topic, fix)
        self._tell("global_position/rel_alt", ros.Float64(m.relative_alt * 1e-3))
        if m.hdg != 65535:
            self._tell("global_position/compass_hdg", ros.Float64(m.hdg * 1e-2))

    def _hears_altitude(self, m: Any) -> None:
        said = ros.Altitude(
            self._header(), m.altitude_monotonic, m.altitude_amsl, m.altitude_local, m.altitude_relative,
            m.altitude_terrain, m.bottom_clearance,
        )  # fmt: skip
        self._tell("altitude", said)

    def _hears_home_position(self, m: Any) -> None:
        said = ros.HomePosition(
            self._header(), ros.GeoPoint(m.latitude * 1e-7, m.longitude * 1e-7, m.altitude * 1e-3),
            ros.Point(*other_earth((m.x, m.y, m.z))),
        )  # fmt: skip
        self._tell("home_position/home", said, latched=True)

    def _hears_sys_status(self, m: Any) -> None:
        said = ros.BatteryState(
            self._header(),
            m.voltage_battery * 1e-3,
            -m.current_battery * 1e-2,
            m.battery_remaining * 1e-2,
        )
        self._tell("battery", said)

    def _hears_statustext(self, m: Any) -> None:
        self._tell("statustext/recv", ros.StatusText(self._header(), m.severity, m.text))

    def _hears_command_ack(self, m: Any) -> None:
        if m.result != 5:  # in progress
            self._answer(m.command, m.result)

    def _answer(self, key: Any, value: Any) -> None:
        with self._came:
            self._acks[key] = value
            self._came.notify_all()

    def _hears_mission_item_reached(self, m: Any) -> None:
        self._tell("mission/reached", ros.WaypointReached(self._header(), m.seq))

    def _hears_param_value(self, m: Any) -> None:
        import struct

        value: Any = m.param_value
        if m.param_type == 6:  # by its bytes, as PX4 sends it
            value = struct.unpack("<i", struct.pack("<f", value))[0]
        with self._came:
            self._parameters[m.param_id] = value
            self._came.notify_all()


def _encoded(value: Any) -> tuple[float, int]:
    """A parameter's value on the wire and its type, as PX4 has them."""
    import struct

    if isinstance(value, int):
        return struct.unpack("<f", struct.pack("<i", value))[0], 6
    return value, 9


def _parameter(value: Any) -> Any:
    """A parameter as MAVROS tells it."""
    if isinstance(value, int):
        return ros.ParamValue(value, 0.0)
    return ros.ParamValue(0, 0.0 if value is None else value)


def _wrapped(angle: float) -> float:
    return math.atan2(math.sin(angle), math.cos(angle))
