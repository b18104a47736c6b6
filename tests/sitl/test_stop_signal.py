"""Signals that come while another is being noted."""

import signal

from sitl.stop_signal import stop_signal


def test_a_second_signal_while_the_first_is_noted():
    with stop_signal() as stop:
        notify = stop._cond.notify_all

        def again():
            signal.raise_signal(signal.SIGTERM)
            notify()

        stop._cond.notify_all = again
        signal.raise_signal(signal.SIGTERM)
        assert stop.is_set()
