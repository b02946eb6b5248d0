"""The rows of what is taken from the ground and from the simulator, against what reads, hands over and sends."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest

from fcu import services
from fcu.mavlink import plan_messages, plant_link, replies
from fcu.mavlink.definitions import Definition, definition
from fcu.mavlink.framing import Source
from fcu.mavlink.ground_link import READERS
from fcu.services.exchange import OF_PLANT, REPLIES, SERVICE_OF, TAKEN, Service
from fcu.services.messages import ANSWERS, STREAMS

TOLD = {row.name for row in (*STREAMS.values(), *ANSWERS.values())}


@pytest.mark.parametrize("row", TAKEN, ids=lambda row: row.name)
def test_a_message_that_is_taken_is_read_as_its_row_says(row):
    found = definition(row.name)
    assert isinstance(
        READERS[row.name](found.unpack(bytes(found.size)), Source(245, 190)), row.kind
    )
    assert SERVICE_OF[row.kind] is row.service


def test_a_message_that_is_read_is_taken_or_is_of_the_vehicle_itself():
    taken = {row.name for row in TAKEN}
    assert len(taken) == len(TAKEN)
    assert READERS.keys() - taken <= TOLD | {row.name for row in REPLIES}
    assert set(SERVICE_OF.values()) == set(Service)


def built(module):
    """The names of messages that services build by a module's functions."""
    text = "".join(p.read_text() for p in Path(services.__path__[0]).glob("*.py"))
    called = set(re.findall(rf"\b{module.__name__.rpartition('.')[2]}\.([a-z_]+)\(", text))
    sources = (inspect.getsource(getattr(module, name)) for name in called)
    return {name for text in sources for name in re.findall(r'"([A-Z][A-Z_]{3,})"', text)}


def test_the_answers_are_what_services_build():
    sent = built(replies) | built(plan_messages)
    assert sent - TOLD == {row.name for row in REPLIES}
    assert {answer for row in TAKEN for answer in row.answers} <= {r.name for r in REPLIES} | TOLD


def test_the_messages_of_the_simulator_are_those_of_the_plant_link():
    known = {each.name for each in vars(plant_link).values() if isinstance(each, Definition)}
    assert {row.name for row in OF_PLANT} == known
