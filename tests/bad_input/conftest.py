"""The vehicle that bad input is sent to."""

from __future__ import annotations

import pymavlink.dialects.v20.common as mavlink
import pytest

from tests.bad_input.hovering import Flight
from tests.process.conftest import Program, claimed_instance, instance, start

__all__ = ["instance", "start"]


@pytest.fixture
def hover(start, instance):
    """`hover("--params", FILE)`: a flight controller with these options, in flight."""
    flights = []

    def begin(*options, **streams):
        flights.append(Flight(start, instance, *options, streams=streams))
        return flights[-1]

    yield begin
    for flight in flights:
        flight.close()


@pytest.fixture
def flight(hover):
    return hover()


@pytest.fixture(scope="module")
def enduring(tmp_path_factory):
    """One flight controller for all tests that leave it as it was: it has to stand them all.

    A new one only if tests that need one of their own have kept it waiting.
    """
    programs, flights = [], []

    def start(module, *arguments, **options):
        programs.append(Program(tmp_path_factory.mktemp(module), module, *arguments, **options))
        return programs[-1]

    with claimed_instance() as number:

        def one():
            if not flights or not flights[-1].lives:
                for program in programs:
                    program.kill()
                for flight in flights:
                    flight.close()
                flights.append(Flight(start, number))
            return flights[-1]

        yield one
        for flight in flights:
            flight.close()
    for program in programs:
        program.kill()


@pytest.fixture
def flying(enduring):
    """Armed, in offboard mode, on a stream."""
    flight = enduring()
    flight.drain()
    flight.tick(500)  # whatever a test before has asked for is over
    flight.stream()
    assert flight.ask(176, 1, 6) == mavlink.MAV_RESULT_ACCEPTED
    assert flight.ask(400, 1) == mavlink.MAV_RESULT_ACCEPTED
    flight.stream()
    flight.tick(3)
    assert flight.armed
    flight.sync()
    return flight
