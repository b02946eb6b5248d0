"""Signals are heard where a flight can be left, and nowhere else."""

import signal
from contextlib import suppress

import pytest

from fcu.kernel import cache
from gcs_tools.cli.plot import plot
from gcs_tools.cli.program import main
from gcs_tools.flight import interrupts as hearing
from gcs_tools.flight.interrupts import interrupts_wait


@pytest.fixture(autouse=True)
def as_in_a_program():
    before = [
        (number, signal.signal(number, signal.default_int_handler)) for number in hearing.SIGNALS
    ]
    yield
    for number, handler in before:
        signal.signal(number, handler)


@pytest.mark.parametrize("number", hearing.SIGNALS)
def test_a_signal_waits_for_a_look_and_is_raised_once(number):
    with interrupts_wait() as interrupts:
        interrupts.look()
        signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            interrupts.look()
        signal.raise_signal(number)  # a second one, while what the first has begun goes on
        interrupts.look()


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


def test_a_block_within_another_takes_the_interruption_for_both():
    def flight():
        with interrupts_wait() as inner:
            signal.raise_signal(signal.SIGINT)
            inner.look()

    with interrupts_wait() as outer:
        with pytest.raises(KeyboardInterrupt):
            flight()
        outer.look()


def test_what_takes_long_is_interrupted_at_once_and_what_follows_is_not():
    reached = []

    def compiled():
        with interrupts_wait() as interrupts:
            try:
                with interrupts.at_once():
                    signal.raise_signal(signal.SIGINT)
                    reached.append("the end of it")
            finally:
                signal.raise_signal(signal.SIGINT)
                reached.append("its clean-up")

    with pytest.raises(KeyboardInterrupt):
        compiled()
    assert reached == ["its clean-up"]


def test_an_interruption_that_code_has_swallowed_is_raised_when_it_is_done():
    def compiled():
        with interrupts_wait() as interrupts, interrupts.at_once():
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                pass

    with pytest.raises(KeyboardInterrupt):
        compiled()


def test_a_program_cleans_up_undisturbed_and_then_hears_again():
    hearing.install()
    cleaned = []

    def interrupted():
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            signal.raise_signal(signal.SIGTERM)
            cleaned.append("up")

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert cleaned == ["up"]
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)


def test_a_signal_that_a_program_was_started_to_ignore_stays_ignored():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # nohup
    hearing.install()
    signal.raise_signal(signal.SIGHUP)
    assert not hearing.is_heard()


def test_whose_exit_code_is_known_hears_nothing_more():
    hearing.install()
    hearing.ignore()
    for number in hearing.SIGNALS:
        signal.raise_signal(number)


@pytest.mark.parametrize("comes", [True, False])
def test_an_interruption_of_which_other_code_made_an_error_is_one(monkeypatch, comes):
    """As matplotlib's C++ does: it says "Invalid bounding box"."""

    def draws(**_options):
        try:
            if comes:
                signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            pass
        raise ValueError("Invalid bounding box")

    hearing.install()
    monkeypatch.setattr(plot, "callback", draws)
    if comes:
        assert main._code(args=["plot", "x.mcap"]) == 130
    else:
        with pytest.raises(ValueError, match="bounding box"):
            main._code(args=["plot", "x.mcap"])


def test_an_interrupt_lost_in_the_compiler_is_raised_at_the_next_kernel():
    def compiling():
        with interrupts_wait() as interrupts, interrupts.at_once():
            with suppress(KeyboardInterrupt):  # as in a callback of the compiler
                signal.raise_signal(signal.SIGTERM)
            for watcher in cache.watchers:
                watcher()
            pytest.fail("the next kernel was compiled")

    before = list(cache.watchers)
    with pytest.raises(KeyboardInterrupt):
        compiling()
    assert cache.watchers == before
