"""Ctrl-C before a command has begun, and after it has ended: one line instead of a traceback.

Python imports modules for some seconds on a slow computer. Nothing is open meanwhile that would
have to be closed, so an interrupt ends the process at once. While a command runs, an interrupt is
a KeyboardInterrupt, or what the command makes of it.
"""

import os
import signal
from types import FrameType

INTERRUPTED = 130
"""The exit code of a program that was interrupted, as shells have it."""


def leave_when_interrupted() -> None:
    """An interrupt ends the process with one line from now on, unless it is ignored."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def raise_when_interrupted() -> None:
    """An interrupt is a KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(_number: int, _frame: FrameType | None) -> None:
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)
