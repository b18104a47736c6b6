"""How a process of the simulated world ends: with its parent, and on SIGINT or SIGTERM.

    python -m sitl.process.end_with_parent PARENT_PID PROGRAM [ARGUMENT ...]

runs a program that ends when its parent ends, also if that was killed. Linux only; elsewhere the
program is run directly.
"""

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Final

_SET_PARENT_DEATH_SIGNAL: Final = 1  # prctl(2)


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


def ending_with_us(*program: str) -> list[str]:
    """The command line by which a program is started that ends when this process does."""
    return [sys.executable, "-m", __name__, str(os.getpid()), *program]


def main(arguments: list[str]) -> None:
    """Become the program; returns only if the parent has ended already."""
    parent_id, program = int(arguments[0]), arguments[1:]
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGTERM)
        if os.getppid() != parent_id:
            return
    os.execvp(program[0], program)  # noqa: S606 - the caller's own program and arguments


if __name__ == "__main__":
    main(sys.argv[1:])
