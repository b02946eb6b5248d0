"""The stand-in for ROS' roslib."""


def load_manifest(_name):
    """ROS' old way to find packages: nothing to do."""
