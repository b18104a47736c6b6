"""Ending a process of the simulated world: SIGINT and SIGTERM."""

from __future__ import annotations

import contextlib
import logging
import signal
import threading
from collections.abc import Iterator
from types import FrameType

_log = logging.getLogger(__name__)


@contextlib.contextmanager
def stop_signal() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set while this lasts; look at it, do not wait for it.

    Who holds its lock when a signal comes would wait for ever: the first one sets it, once.
    """
    stop = threading.Event()
    noted = False

    def note(number: int, _frame: FrameType | None) -> None:
        nonlocal noted
        if noted:  # a parent that is killed sends one for each of its threads
            return
        noted = True
        _log.info("%s: stopping", signal.Signals(number).name)
        stop.set()

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
