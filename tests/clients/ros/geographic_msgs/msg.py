"""Messages of geographic_msgs."""

from message_types import GeoPoint, GeoPose, GeoPoseStamped  # noqa: F401
