"""The collector of cycles does not run in flight: what is asked for must leave none."""

from __future__ import annotations

import gc
import random
from contextlib import ExitStack

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.ports import ports
from fcu.mavlink.definitions import CommandId
from gcs_tools.flight.memory_flight import INSTANCE, MemoryFlight
from gcs_tools.flight.run import prepared
from tests.attacks import generators

TIMES = 30  # each: one cycle an answer would be more than all that is allowed
ALLOWED = 25  # objects: what Python itself does once
ROUNDS = 3  # a cycle an answer is in each; what is done once, or by another thread, is not


@pytest.fixture
def asked():
    """`asked(datagrams)`: the fewest objects that the collector finds after a vehicle has answered them."""
    _, scene = prepared("gust_step")
    with ExitStack() as stack:
        flight = MemoryFlight(scene, None, (lambda rows: None, lambda rows: None))
        flight.begin(stack)
        link = flight._network.link(9, ports(INSTANCE).fcu_script, "another script")

        def serve(datagrams):
            for datagram in datagrams:
                link.send(datagram)
                flight._serve()
                while link.receive() is not None:
                    pass

        def collected(datagrams):
            gc.collect()
            gc.disable()
            try:
                serve(datagrams)
                return gc.collect()
            finally:
                gc.enable()

        yield lambda datagrams: min(collected(datagrams) for _ in range(ROUNDS))


def packed(messages):
    mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    return [message.pack(mav) for message in messages]


@pytest.mark.parametrize("number", [0, 1, 30, 32, 74, 148, 242, 244, 245, 300, 435])
@pytest.mark.computes
def test_a_message_that_is_asked_for_leaves_no_cycle(asked, number):
    ask = mavlink.MAVLink_command_long_message(1, 1, 512, 0, number, 0, 0, 0, 0, 0, 0)
    assert asked(packed([ask] * TIMES)) <= ALLOWED


def test_no_message_of_the_dialect_leaves_a_cycle(asked):
    rng = random.Random(1)
    commands = [int(each) for each in CommandId]
    kinds = [kind for _, kind in sorted(mavlink.mavlink_map.items())]
    made = [generators.message(rng, kind, 1, [b"MR_GAMMA"], commands) for kind in kinds * 3]
    assert asked(packed(made)) <= ALLOWED
