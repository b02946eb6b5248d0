"""Which instance a runner flies: claimed before its processes have bound their ports.

A process takes a second to start. Two runners that look for a free instance in that second
must not find the same one, so each holds a claim while its own processes run.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

from fcu.interface.link import HOST, PortBusy
from fcu.interface.ports import INSTANCES, NoFreeInstance, busy, ports


@contextmanager
def claimed(instance: int | None, *names: str) -> Iterator[int]:
    """Hold an instance whose ports are free, the first there is or the one asked for.

    `names`: which of its ports must be free, as for `busy`. Raises PortBusy for the one asked
    for, NoFreeInstance if there is none.
    """
    for number in range(INSTANCES) if instance is None else (instance,):
        try:
            claim = _claim(number)
        except PortBusy:
            if instance is not None:
                raise
            continue
        with claim:
            taken = busy(number, *names)
            if not taken:
                yield number
                return
            if instance is not None:
                raise taken[0]
    raise NoFreeInstance(f"instances 0 to {INSTANCES - 1} all have a port in use")


def _claim(number: int) -> socket.socket:
    """A TCP socket bound to the plant link's number: nobody uses it, and it dies with us."""
    port = ports(number).fcu_plant
    claim = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        claim.bind((HOST, port))
    except OSError as error:
        claim.close()
        raise PortBusy(port, f"instance {number}, claimed by another runner") from error
    return claim
