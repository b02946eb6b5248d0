"""Messages of std_msgs."""

from message_types import Bool, Empty, Float64, Header, String  # noqa: F401
