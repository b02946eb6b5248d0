"""MAVROS' package for Python nodes: its namespace."""

_namespace = "mavros"


def set_namespace(ns="mavros"):
    """The namespace of MAVROS' topics."""
    globals()["_namespace"] = ns


def get_namespace():
    """The namespace that was set."""
    return _namespace


def get_topic(*names):
    """The name of a topic of MAVROS."""
    return "/".join([_namespace, *names])
