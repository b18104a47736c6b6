"""Signals end a process of the simulated world, whenever they come."""

import signal

import pytest

from sitl.process.end_with_parent import stop_signal


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_noted_and_the_handlers_of_before_come_back(number):
    before = signal.getsignal(number)
    with stop_signal() as stopped:
        assert not stopped()
        signal.raise_signal(number)
        signal.raise_signal(number)  # a parent that is killed sends one for each of its threads
        assert stopped()
    assert signal.getsignal(number) is before
