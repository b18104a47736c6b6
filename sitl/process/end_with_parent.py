"""Runs a program that ends when its parent ends, also if that was killed.

    python -m sitl.process.end_with_parent PARENT_PID PROGRAM [ARGUMENT ...]

Linux only; elsewhere the program is run as it is.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from typing import Final

_SET_PARENT_DEATH_SIGNAL: Final = 1  # prctl(2)


def main(arguments: list[str]) -> None:
    """Become the program; returns only if the parent is gone already."""
    parent_id, program = int(arguments[0]), arguments[1:]
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGTERM)
        if os.getppid() != parent_id:
            return
    os.execvp(program[0], program)  # noqa: S606 - the caller's own program and arguments


if __name__ == "__main__":
    main(sys.argv[1:])
