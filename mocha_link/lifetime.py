"""Things that are started, and given up by `close`, also at the end of a ``with``; signals.

Python 3.8 reads this file too: see `mocha_link.service.service_client`.
"""

from __future__ import annotations

import contextlib
import os
import signal
from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import FrameType, TracebackType
from typing import TypeVar

_Closeable = TypeVar("_Closeable", bound="Closeable")  # Python 3.8 has no Self
_Startable = TypeVar("_Startable", bound="Startable")


class Closeable(ABC):
    """Use it as a context manager, or call `close`."""

    @abstractmethod
    def close(self) -> None:
        """Give up everything; may be called twice."""

    def __enter__(self: _Closeable) -> _Closeable:  # noqa: PYI019
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class Startable(Closeable):
    """Use it as a context manager, or call `start` and `close`."""

    @abstractmethod
    def start(self) -> None:
        """Begin."""

    def __enter__(self: _Startable) -> _Startable:  # noqa: PYI019
        try:
            self.start()
        except BaseException:  # what `__exit__` would have closed, e.g. a file
            self.close()
            raise
        return self


class _Terminated(BaseException):
    """Raised by SIGTERM in the block of `until_terminated`, which it ends."""


@contextlib.contextmanager
def until_terminated() -> Iterator[None]:
    """SIGTERM ends the body of the ``with`` without an error. For the main thread."""

    def terminate(_number: int, _frame: FrameType | None) -> None:
        raise _Terminated

    before = signal.signal(signal.SIGTERM, terminate)
    try:
        with contextlib.suppress(_Terminated):
            yield
    finally:
        signal.signal(signal.SIGTERM, before)


INTERRUPTED = 130
"""The exit code of a program that was interrupted, as shells have it."""


def leave_when_interrupted() -> None:
    """Ctrl-C ends the process with one line from now on, not a traceback, unless it is ignored.

    For the seconds in which a slow computer imports modules, and after a command has ended: nothing
    is open that would have to be closed.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def raise_when_interrupted() -> None:
    """An interrupt is a KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(_number: int, _frame: FrameType | None) -> None:
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)
