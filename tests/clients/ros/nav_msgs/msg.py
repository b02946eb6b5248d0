"""Messages of nav_msgs."""

from message_types import Odometry  # noqa: F401
