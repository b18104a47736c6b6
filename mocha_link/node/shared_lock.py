"""A lock for a busy thread that shares it with others."""

from __future__ import annotations

import threading
import time
from types import TracebackType

# A waiting thread does not get the lock from a thread that takes it again at once. Yielding costs
# a turn of the scheduler, which takes milliseconds on a busy machine.
YIELD_EVERY_S = 0.005


class SharedLock:
    """Wraps a lock for a busy thread, which yields to the others at intervals."""

    def __init__(self, lock: threading.Lock) -> None:
        self._lock = lock
        self._yielded_s = 0.0  # when another thread could last take it, steady seconds

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
        """Note that this thread has waited for something else, so that others had the lock."""
        self._yielded_s = time.monotonic()

    def give_way(self) -> None:
        """Let another thread take the lock, if none could for a while."""
        if time.monotonic() - self._yielded_s > YIELD_EVERY_S:
            time.sleep(0.0)
            self.yielded()
