"""ROS messages and services, as far as nodes and MAVROS use them: plain values with ROS' names and defaults."""

from __future__ import annotations

from typing import Any, ClassVar


class Message:
    """A ROS message: its fields in order, given by position or by name, else their defaults."""

    FIELDS: ClassVar[dict[str, Any]] = {}  # name: default, or the class of a message

    def __init__(self, *values: Any, **named: Any) -> None:
        if len(values) > len(self.FIELDS):
            raise TypeError(f"{type(self).__name__} has {len(self.FIELDS)} fields")
        given = dict(zip(self.FIELDS, values)) | named  # noqa: B905
        for name, default in self.FIELDS.items():
            fresh = default() if isinstance(default, type) else default
            setattr(self, name, given.pop(name, fresh))
        if given:
            raise AttributeError(f"{type(self).__name__} has no field {', '.join(given)}")

    def __repr__(self) -> str:
        return "\n".join(f"{name}: {getattr(self, name)}" for name in self.FIELDS)


def message(name: str, constants: dict[str, int] | None = None, **fields: Any) -> Any:
    """The class of a message."""
    return type(name, (Message,), {"FIELDS": fields, **(constants or {})})


def service(name: str, request: dict[str, Any], response: dict[str, Any]) -> Any:
    """The class of a service, which has those of its request and response."""
    asked, told = message(f"{name}Request", **request), message(f"{name}Response", **response)
    return type(name, (), {"Request": asked, "Response": told})


class Time(Message):
    """A time in seconds, as rospy has it."""

    FIELDS: ClassVar[dict[str, Any]] = {"secs": 0, "nsecs": 0}

    def to_sec(self) -> float:
        """In seconds."""
        return self.secs + self.nsecs * 1e-9

    def to_nsec(self) -> int:
        """In nanoseconds."""
        return int(self.secs * 1_000_000_000 + self.nsecs)

    def is_zero(self) -> bool:
        """True for no time."""
        return self.to_nsec() == 0

    @classmethod
    def from_sec(cls, seconds: float) -> Any:
        """A time of so many seconds."""
        return cls(*divmod(round(seconds * 1e9), 1_000_000_000))


Header = message("Header", seq=0, stamp=Time, frame_id="")

Point = message("Point", x=0.0, y=0.0, z=0.0)
Vector3 = message("Vector3", x=0.0, y=0.0, z=0.0)
Quaternion = message("Quaternion", x=0.0, y=0.0, z=0.0, w=0.0)
Pose = message("Pose", position=Point, orientation=Quaternion)
Twist = message("Twist", linear=Vector3, angular=Vector3)
PoseStamped = message("PoseStamped", header=Header, pose=Pose)
TwistStamped = message("TwistStamped", header=Header, twist=Twist)
Vector3Stamped = message("Vector3Stamped", header=Header, vector=Vector3)
PointStamped = message("PointStamped", header=Header, point=Point)
PoseWithCovariance = message("PoseWithCovariance", pose=Pose, covariance=list)
TwistWithCovariance = message("TwistWithCovariance", twist=Twist, covariance=list)
Odometry = message(
    "Odometry", header=Header, child_frame_id="", pose=PoseWithCovariance, twist=TwistWithCovariance
)
GeoPoint = message("GeoPoint", latitude=0.0, longitude=0.0, altitude=0.0)
GeoPose = message("GeoPose", position=GeoPoint, orientation=Quaternion)
GeoPoseStamped = message("GeoPoseStamped", header=Header, pose=GeoPose)

String = message("String", data="")
Float64 = message("Float64", data=0.0)
Bool = message("Bool", data=False)
Empty = message("Empty")

NavSatStatus = message("NavSatStatus", {"STATUS_NO_FIX": -1, "STATUS_FIX": 0}, status=0, service=1)
# fmt: off
NavSatFix = message("NavSatFix", header=Header, status=NavSatStatus, latitude=0.0, longitude=0.0, altitude=0.0,
                    position_covariance=list, position_covariance_type=0)
Imu = message("Imu", header=Header, orientation=Quaternion, orientation_covariance=list,
              angular_velocity=Vector3, angular_velocity_covariance=list,
              linear_acceleration=Vector3, linear_acceleration_covariance=list)
BatteryState = message("BatteryState", header=Header, voltage=0.0, current=0.0, percentage=0.0)

State = message("State", header=Header, connected=False, armed=False, guided=False, manual_input=False, mode="",
                system_status=0)
ExtendedState = message(
    "ExtendedState",
    {"VTOL_STATE_UNDEFINED": 0, "LANDED_STATE_UNDEFINED": 0, "LANDED_STATE_ON_GROUND": 1, "LANDED_STATE_IN_AIR": 2,
     "LANDED_STATE_TAKEOFF": 3, "LANDED_STATE_LANDING": 4},
    header=Header, vtol_state=0, landed_state=0)
Altitude = message("Altitude", header=Header, monotonic=0.0, amsl=0.0, local=0.0, relative=0.0, terrain=0.0,
                   bottom_clearance=0.0)
HomePosition = message("HomePosition", header=Header, geo=GeoPoint, position=Point, orientation=Quaternion,
                       approach=Vector3)
Waypoint = message(
    "Waypoint",
    {"FRAME_GLOBAL": 0, "FRAME_MISSION": 2, "FRAME_GLOBAL_REL_ALT": 3},
    frame=0, command=0, is_current=False, autocontinue=False, param1=0.0, param2=0.0, param3=0.0, param4=0.0,
    x_lat=0.0, y_long=0.0, z_alt=0.0)
WaypointList = message("WaypointList", current_seq=0, waypoints=list)
WaypointReached = message("WaypointReached", header=Header, wp_seq=0)
ParamValue = message("ParamValue", integer=0, real=0.0)
Thrust = message("Thrust", header=Header, thrust=0.0)
StatusText = message("StatusText", header=Header, severity=0, text="")
OverrideRCIn = message("OverrideRCIn", {"CHAN_RELEASE": 0, "CHAN_NOCHANGE": 65535}, channels=list)
ManualControl = message("ManualControl", header=Header, x=0.0, y=0.0, z=0.0, r=0.0, buttons=0)
_MASK = {f"IGNORE_{name}": 1 << bit for bit, name in enumerate(
    ["PX", "PY", "PZ", "VX", "VY", "VZ", "AFX", "AFY", "AFZ"])} | {
    "FORCE": 512, "IGNORE_YAW": 1024, "IGNORE_YAW_RATE": 2048}
PositionTarget = message(
    "PositionTarget",
    {"FRAME_LOCAL_NED": 1, "FRAME_LOCAL_OFFSET_NED": 7, "FRAME_BODY_NED": 8, "FRAME_BODY_OFFSET_NED": 9, **_MASK},
    header=Header, coordinate_frame=0, type_mask=0, position=Point, velocity=Vector3, acceleration_or_force=Vector3,
    yaw=0.0, yaw_rate=0.0)
GlobalPositionTarget = message(
    "GlobalPositionTarget",
    {"FRAME_GLOBAL_INT": 5, "FRAME_GLOBAL_REL_ALT": 6, "FRAME_GLOBAL_TERRAIN_ALT": 11,
     **{f"IGNORE_{new}": 1 << bit for bit, new in enumerate(["LATITUDE", "LONGITUDE", "ALTITUDE"])}, **_MASK},
    header=Header, coordinate_frame=0, type_mask=0, latitude=0.0, longitude=0.0, altitude=0.0, velocity=Vector3,
    acceleration_or_force=Vector3, yaw=0.0, yaw_rate=0.0)
AttitudeTarget = message(
    "AttitudeTarget",
    {"IGNORE_ROLL_RATE": 1, "IGNORE_PITCH_RATE": 2, "IGNORE_YAW_RATE": 4, "IGNORE_THRUST": 64, "IGNORE_ATTITUDE": 128},
    header=Header, type_mask=0, orientation=Quaternion, body_rate=Vector3, thrust=0.0)

_TOL = {"min_pitch": 0.0, "yaw": 0.0, "latitude": 0.0, "longitude": 0.0, "altitude": 0.0}
_DONE = {"success": False, "result": 0}
CommandBool = service("CommandBool", {"value": False}, _DONE)
CommandTOL = service("CommandTOL", _TOL, _DONE)
CommandHome = service(
    "CommandHome",
    {"current_gps": False, "yaw": 0.0, "latitude": 0.0, "longitude": 0.0, "altitude": 0.0}, _DONE)
CommandLong = service(
    "CommandLong",
    {"broadcast": False, "command": 0, "confirmation": 0, **{f"param{i}": 0.0 for i in range(1, 8)}}, _DONE)
CommandInt = service(
    "CommandInt",
    {"broadcast": False, "frame": 0, "command": 0, "current": 0, "autocontinue": 0,
     **{f"param{i}": 0.0 for i in range(1, 5)}, "x": 0, "y": 0, "z": 0.0}, {"success": False})
SetMode = service("SetMode", {"base_mode": 0, "custom_mode": ""}, {"mode_sent": False})
ParamGet = service("ParamGet", {"param_id": ""}, {"success": False, "value": ParamValue})
ParamSet = service("ParamSet", {"param_id": "", "value": ParamValue}, {"success": False, "value": ParamValue})
StreamRate = service("StreamRate", {"stream_id": 0, "message_rate": 0, "on_off": False}, {})
WaypointPush = service("WaypointPush", {"start_index": 0, "waypoints": list}, {"success": False, "wp_transfered": 0})
WaypointClear = service("WaypointClear", {}, {"success": False})
WaypointPull = service("WaypointPull", {}, {"success": False, "wp_received": 0})
WaypointSetCurrent = service("WaypointSetCurrent", {"wp_seq": 0}, {"success": False})
# fmt: on
