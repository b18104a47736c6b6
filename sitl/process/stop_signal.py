"""Ending a process of the simulated world: SIGINT and SIGTERM."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType


@contextlib.contextmanager
def stop_signal() -> Iterator[Callable[[], bool]]:
    """While this lasts, whether SIGINT or SIGTERM has come.

    Signals come in the middle of anything, also of each other: nothing here takes a lock.
    """
    stopped = False

    def note(_number: int, _frame: FrameType | None) -> None:
        nonlocal stopped
        stopped = True

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
