"""Every port and MAVLink identity, from the instance number: one table.

Instances run side by side on one machine without meeting. The numbers of the script and
ground station links are PX4's, so tools find an instance where they look for one.
"""

from __future__ import annotations

from typing import NamedTuple

from fcu.interface import topics
from fcu.interface.link import PortBusy, bound_ports, exclusive_socket, listening_socket

INSTANCES = 10


class Ports(NamedTuple):
    """The ports of one instance, each named for the side that binds it, and its identity."""

    plant: int
    fcu_plant: int
    fcu_script: int
    script: int
    fcu_station: int
    station: int
    system_id: int  # MAVLink; the component is 1
    fcu_tcp: int = 0  # of TCP; 0: none


ANY_PORTS = Ports(*(0,) * 6, system_id=1)  # whichever are free: of what nobody is to meet


class _Row(NamedTuple):
    first: int  # for instance 0
    step: int  # from one instance to the next
    owner: str  # who binds it, on which link


_TABLE = {
    "plant": _Row(4560, 1, "plant, plant link"),
    "fcu_plant": _Row(4660, 1, "flight controller, plant link"),
    "fcu_script": _Row(14580, 1, "flight controller, script link"),
    "script": _Row(14540, 1, "ground script, script link"),
    "fcu_station": _Row(18570, 1, "flight controller, ground station link"),
    "station": _Row(14550, 0, "ground station, shared by all instances"),
}
_BY_TCP = {"fcu_tcp": _Row(5760, 10, "flight controller, scripts by TCP")}
_ROWS = {**_TABLE, **_BY_TCP}
_BOUND = ("plant", "fcu_plant", "fcu_script", "fcu_station", "fcu_tcp")  # by its two processes


class NoFreeInstance(OSError):
    """Every instance has a port that another process holds."""


def ports(instance: int) -> Ports:
    """The ports and system id of an instance. Raises ValueError unless it is 0 to 9."""
    if not 0 <= instance < INSTANCES:
        raise ValueError(f"instance {instance}: expected 0 to {INSTANCES - 1}")
    numbers = {name: row.first + instance * row.step for name, row in _ROWS.items()}
    return Ports(**numbers, system_id=instance + 1)


def owner(port: str) -> str:
    """Who binds the port of this name in Ports, and on which link: for error messages."""
    return _ROWS[port].owner


def table() -> str:
    """The table as text, a line a port, for `--help`."""
    rows = [f"{row.first}{'+N' if row.step else '':4}{row.owner}" for row in _TABLE.values()]
    heading = f"UDP ports on loopback, instance N (0 to {INSTANCES - 1}), MAVLink system N+1:"
    by_tcp = [
        *_BY_TCP.values(),
        _Row(topics.port(0), topics.port(1) - topics.port(0), "publisher, Zenoh"),
    ]
    tcp = [f"  {row.first}+{row.step}N  {row.owner}" for row in by_tcp]
    return "\n".join([heading, *(f"  {row}" for row in rows), "TCP ports:", *tcp])


def first_free_instance(*names: str) -> int:
    """The lowest instance whose ports can all be bound now; raises NoFreeInstance.

    `names`: which of its ports, by their names in Ports; none: all that its two processes bind.
    """
    for instance in range(INSTANCES):
        if not busy(instance, *names):
            return instance
    raise NoFreeInstance(f"instances 0 to {INSTANCES - 1} all have a port in use")


def running_instances() -> list[int]:
    """The instances that have a flight controller, the lowest first.

    Where the kernel tells which ports are bound none is touched: who starts meanwhile gets them all.
    """
    bound = bound_ports()
    if bound is None:
        return [n for n in range(INSTANCES) if busy(n, "fcu_script")]
    return [n for n in range(INSTANCES) if ports(n).fcu_script in bound]


def busy(instance: int, *names: str) -> list[PortBusy]:
    """Which of an instance's ports (all that its two processes bind, by default) are taken."""
    numbers = ports(instance)._asdict()
    taken = []
    for name in names or _BOUND:
        try:
            bind = listening_socket if name in _BY_TCP else exclusive_socket
            bind(numbers[name], owner(name)).close()
        except PortBusy as error:
            taken.append(error)
    return taken
