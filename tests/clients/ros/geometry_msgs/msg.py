"""Messages of geometry_msgs."""

from message_types import (  # noqa: F401
    Point,
    PointStamped,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    Quaternion,
    Twist,
    TwistStamped,
    Vector3,
    Vector3Stamped,
)
