"""A lock as the thread that takes it most often uses it."""

from __future__ import annotations

import threading
import time
from types import TracebackType

# A thread that waits for the lock would not get it from one that takes it again at once. To yield
# costs a turn of the scheduler, which takes milliseconds on a busy machine.
YIELD_EVERY_S = 0.005


class SharedLock:
    """Wraps a lock for a busy thread, which gives way to the others now and then."""

    def __init__(self, lock: threading.Lock) -> None:
        self._lock = lock
        self._yielded_s = 0.0  # when another thread could last take it, steady clock

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._lock.release()

    def yielded(self) -> None:
        """This thread has waited for something else, so the others had the lock."""
        self._yielded_s = time.monotonic()

    def give_way(self) -> None:
        """Let another thread take it, if none could for long."""
        if time.monotonic() - self._yielded_s > YIELD_EVERY_S:
            time.sleep(0.0)
            self.yielded()
