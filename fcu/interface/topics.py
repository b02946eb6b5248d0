"""Where diagnostics are on Zenoh: every key and every TCP port, from run and vehicle.

    m_mrac/<run>/<vehicle>/<topic>            what is published, e.g. m_mrac/20261121-1700-up/1/fcu/law
    m_mrac/<run>/<vehicle>/alive/<process>    a liveliness token for each process that is there
    m_mrac/<run>/<vehicle>/about              answers a query with what runs, as JSON
    m_mrac/<run>/<vehicle>/schemas            answers one with what its messages are, as JSON
    m_mrac/<run>/<vehicle>/ended              put last: the number of the last tick of each topic

A publisher's session has the namespace `m_mrac/<run>` and cannot write outside it. Which topics
there are, and their messages, is derived from what a tick is, and told by `schemas`: whoever
listens needs nothing else. See `gcs topics`, docs/schemas.
"""

from __future__ import annotations

import re
from typing import NamedTuple

PREFIX = "m_mrac"
ABOUT, ALIVE, ENDED, EVENTS, SCHEMAS = "about", "alive", "ended", "events", "schemas"
PUBLISHER = "publisher"
PROCESSES = ("fcu", "plant", PUBLISHER)

_PORT, _STEP = 7447, 10  # Zenoh's own number; ten apart, as publishers of a campaign need none


class Key(NamedTuple):
    """A key taken apart."""

    run: str
    vehicle: str
    topic: str  # or alive/<process>, about, ended


def port(instance: int) -> int:
    """The TCP port on which the publisher of an instance listens."""
    return _PORT + _STEP * instance


def namespace(run: str) -> str:
    """What all keys of a run begin with."""
    return f"{PREFIX}/{run}"


def run_name(text: str) -> str:
    """`text` as one part of a key: what Zenoh keeps for itself becomes a dash."""
    return re.sub(r"[^\w.-]+", "-", text).strip("-") or "run"


def is_topic(text: str) -> bool:
    """Whether `text` can be a topic: names of letters, digits, `_`, `.` and `-` with / between."""
    return re.fullmatch(r"/?[\w.-]+(/[\w.-]+)*", text) is not None


def relative(vehicle: str, topic: str) -> str:
    """The key of a topic inside the namespace of its run."""
    return f"{vehicle}/{topic.strip('/')}"


def take_apart(key: str) -> Key | None:
    """The parts of a whole key; None for one that is not ours."""
    parts = key.split("/", 3)
    if len(parts) != 4 or parts[0] != PREFIX:
        return None
    return Key(*parts[1:])
