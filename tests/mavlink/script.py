"""A script and the flight controller that it talks to, pymavlink on one side or the other."""

from __future__ import annotations

import pymavlink.dialects.v20.common as mavlink

from fcu.mavlink.framing import Source
from fcu.mavlink.ground_link import GroundCodec

FCU = Source(3, 1)
SCRIPT = Source(245, 190)


def read(datagram):
    """The messages of a datagram, by pymavlink."""
    return mavlink.MAVLink(None).parse_buffer(bytearray(datagram))


def sent(message, source=SCRIPT):
    """A pymavlink message as the bytes of a sender."""
    return message.pack(mavlink.MAVLink(None, source.system, source.component))


def heard(message):
    """What the flight controller reads of a pymavlink message, or of our own."""
    own = isinstance(message, tuple)
    (read_,) = GroundCodec(*FCU).parse(
        GroundCodec(*SCRIPT).framed(message) if own else sent(message)
    )
    return read_
