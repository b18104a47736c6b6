"""How busy this machine was with everything, ours and others'; and loops that keep it busy."""

import contextlib
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

LOOPS = 3
_PRESSURE = Path("/proc/pressure/cpu")


class Load:
    """Since it was made: the share of the time in which some program waited for a core."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()
        self._began_us = _waited_us()

    @property
    def lasted_s(self) -> float:
        return time.monotonic() - self._began_s

    @property
    def waiting(self) -> float | None:
        """None if this kernel does not count it."""
        now_us = _waited_us()
        if now_us is None or self._began_us is None:
            return None
        return (now_us - self._began_us) / 1e6 / self.lasted_s


def _waited_us() -> int | None:
    try:
        some = _PRESSURE.read_text(encoding="ascii").splitlines()[0]
        return int(some.rpartition("=")[2])
    except (OSError, IndexError, ValueError):
        return None


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
