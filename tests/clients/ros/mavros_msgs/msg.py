"""Messages of mavros_msgs."""

from message_types import (  # noqa: F401
    Altitude,
    AttitudeTarget,
    ExtendedState,
    GlobalPositionTarget,
    HomePosition,
    ManualControl,
    OverrideRCIn,
    ParamValue,
    PositionTarget,
    State,
    StatusText,
    Thrust,
    Waypoint,
    WaypointList,
    WaypointReached,
)
