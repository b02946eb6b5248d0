"""The stand-in for ROS' tf: its rotations."""

from . import transformations  # noqa: F401
