"""The stand-in for ROS: a package of messages."""
