"""Signals are heard where a flight can be left, and nowhere else."""

import signal

import pytest

from gcs_tools.flight.interrupts import interrupts_wait


@pytest.fixture(autouse=True)
def as_in_a_program():
    before = [
        (number, signal.signal(number, signal.default_int_handler))
        for number in (signal.SIGINT, signal.SIGTERM)
    ]
    yield
    for number, handler in before:
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_for_a_look_and_is_raised_once(number):
    with interrupts_wait() as look:
        look()
        signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            look()
        look()
        signal.raise_signal(number)  # a second one, on the way out
        with pytest.raises(KeyboardInterrupt):
            look()


def test_what_nobody_looked_at_is_raised_at_the_end():
    reached = []

    def flight():
        with interrupts_wait():
            signal.raise_signal(signal.SIGINT)
            reached.append("the end")

    with pytest.raises(KeyboardInterrupt):
        flight()
    assert reached == ["the end"]


def test_afterwards_signals_are_heard_as_before():
    with interrupts_wait():
        pass
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
