"""Messages of sensor_msgs."""

from message_types import BatteryState, Imu, NavSatFix, NavSatStatus  # noqa: F401
