"""A machine that has other things to do: loops that want all processors all the time."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator

LOOPS = 3


@contextlib.contextmanager
def busy_loops(count: int = LOOPS) -> Iterator[None]:
    """Have so many loops run beside what is measured."""
    # Each ends with the pipe, whatever ends this process.
    loop = "import os, sys; os.set_blocking(0, False)\nwhile sys.stdin.buffer.read(1) is None: pass"
    loops = [
        subprocess.Popen([sys.executable, "-c", loop], stdin=subprocess.PIPE)  # noqa: S603 - ours
        for _ in range(count)
    ]
    try:
        yield
    finally:
        for each in loops:
            each.kill()
            each.wait()
